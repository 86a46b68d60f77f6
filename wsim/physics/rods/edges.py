"""Edges of strands that touch each other, as tables of the search and the proof of surfaces
(kernels/contact/selfcontact/pairs.py), of edges alone. A strand's rest shape is the line of its own length: what keeps
neighbours apart is the length between them. That of a closed one is a polygon in a circle, as long as it: alike wherever its
first point is. Its last edge leads back to that point itself, and not to the copy of it (kernels/rods/seam.py)."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.contact.selfcontact import pairs
from wsim.kernels.contact.selfcontact.motion_bounds import LONG
from wsim.model.structs import fill_struct
from wsim.physics.contact.selfcontact.start import StartingStrands, refuse_crowded_points, report_touching_strands
from wsim.physics.contact.selfcontact.surfaces import TUBE, TUBE_EDGE, ULP, WRITTEN
from wsim.scene import Problem

if TYPE_CHECKING:
    from wsim.physics.rods.coupled_newton import CoupledGround
    from wsim.physics.rods.tables import StrandTable


class StrandEdges:
    """Rods that say so touch themselves and each other, as `ContactSurfaces` do. rows: of `points`, and of the copies that
    second points of last edges of closed strands have (kernels/rods/edges/touch.py)."""

    def __init__(self, table: StrandTable, ground: CoupledGround):
        self.table, self.ground, m = table, ground, table.strands
        on = np.zeros(m, bool)
        for own, (rods, _) in zip(table.own, table.pairs, strict=True):
            on[own] = rods.self_collision
        number, count, closed = np.arange(table.longest)[:, None], table.own_counts, table.copies > 0
        points = ((number < count) & on).ravel()
        behind = ((number + 1 < count + closed) & on).ravel()
        self.points = np.flatnonzero(points).astype(np.int32)
        self.rows = np.flatnonzero((number < count + closed) & on).astype(np.int32)
        first = np.flatnonzero(behind)
        second = np.where(first // m + 1 < count[first % m], first + m, first % m)
        self.edges = np.stack([first, second], axis=1).astype(np.int32)
        self.triangles = np.zeros((0, 3), np.int32)
        self.own = self.free = {"points": len(self.points), "edges": len(self.edges), "triangles": 0}
        self.obstacles, self.total = None, ground.points
        self.balls, self.ball_margin, self.ball_edges = np.zeros(0, np.int32), 0.0, slice(len(self.edges), None)
        self.looking = len(self.points)
        self.strand = np.tile(np.arange(m), table.longest).astype(np.int32)
        self.worlds_of = np.repeat([world for _, world in table.pairs], [own.stop - own.start for own in table.own])
        self.world = self.worlds_of[self.strand].astype(np.int32)
        self.paths = np.repeat([rods.path for rods, _ in table.pairs], [own.stop - own.start for own in table.own])
        reach = table.values["radius"].ravel()
        self.thickness = 2.0 * float(reach[self.points].max(initial=0.0))
        length = table.values["length"].ravel()[first]
        self.edge = float(length.mean())
        self.rest = _rest_shapes(table).reshape(-1, 3)
        self.beta = max(TUBE * self.thickness, TUBE_EDGE * self.edge)
        self.data = self._upload(ground, reach)

    def _upload(self, ground: CoupledGround, reach: np.ndarray) -> Any:
        t, m = self.table, self.table.strands
        far, unit, friction = np.zeros((m, 3)), np.zeros(m), np.zeros((m, 2))
        for own, (rods, _) in zip(t.own, t.pairs, strict=True):
            M = rods.motion.at(0.0)
            far[own] = t.origin[own] - M[:3, 3]
            unit[own] = WRITTEN * np.linalg.cond(M[:3, :3])
            friction[own] = rods.static_friction, rods.dynamic_friction
        free, mass = (t.hold < 0) & (t.values["m"] > 0.0), t.masses.reshape(t.hold.shape)
        w = np.where(free, 1.0 / np.where(free, mass, 1.0), 0.0).ravel()
        up, k = ground.upload, self.strand
        self.base = t.origin[0]
        return fill_struct(
            pairs.surface_type(wp.float64), w=up(w, wp.float64), point=up(self.points, int), edge=up(self.edges, wp.vec2i),
            triangle=up(self.triangles, wp.vec3i), unit=up(unit[k], wp.float64), reach=up(reach, wp.float64),
            friction=up(friction[k], wp.vec2d), rest=up(self.rest, wp.vec3d), body=up(k, int),
            world=up(self.world, int), role=up(np.zeros_like(self.world), int),
            shift=up((t.origin - self.base)[k], wp.vec3d), far=up(far[k], wp.vec3d), beta=self.beta,
            longest=LONG * self.edge, tied=0, ulp=ULP[np.float64])

    def start(self, model: CoupledGround) -> np.ndarray:
        """Where all points begin, from the origin of the first strand [m], (points, 3)."""
        return self.table.x.reshape(-1, 3) + (self.table.origin - self.base)[self.strand]

    def told(self) -> list[Problem]:
        """Warnings about how strands start in the first world. Raises SceneError where too many are in one place."""
        x, first, reach = self.start(self.ground) + self.base, self.world == 0, self.table.values["radius"].ravel()
        own, edges, paths = self.points[first[self.points]], self.edges[first[self.edges[:, 0]]], self.paths[self.strand]
        refuse_crowded_points(x[own], paths[own], "strands", self)
        return report_touching_strands(StartingStrands(x, self.rest, reach, edges, self.strand[edges[:, 0]],
                                                       paths[edges[:, 0]]))

    def sides(self) -> SimpleNamespace:
        """Mass [kg] and E A / d [N/m] of every point, and its strand."""
        V = self.table.values
        A, d = V["A"] * V["length"], 2.0 * V["radius"]
        A[-1] = A[-2]
        last = np.arange(self.table.strands)
        A[self.table.counts - 1, last] = A[np.maximum(self.table.counts - 2, 0), last]
        return SimpleNamespace(m=self.table.masses, strand=self.strand,
                               hard=(A / np.where(d > 0.0, d, 1.0)).ravel())


def _rest_shapes(table: StrandTable) -> np.ndarray:
    """Places of points in the rest shapes of their strands [m], (longest, strands, 3)."""
    length, m = table.values["length"], table.strands
    found = np.zeros((table.longest, m, 3))
    found[1:, :, 0] = np.cumsum(length[:-1], axis=0)
    for k in np.flatnonzero(table.copies):
        n = table.own_counts[k]
        turn = 2.0 * np.pi * found[:n, k, 0] / length[:n, k].sum()
        circle = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
        around = np.linalg.norm(circle - np.roll(circle, 1, axis=0), axis=1).sum()
        found[:n, k] = circle * (length[:n, k].sum() / around)
    return found
