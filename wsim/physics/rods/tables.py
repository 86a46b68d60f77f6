"""Strands of a scene on a device: constant tables, the start, and what pins hold (kernels/rods/tables.py)."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.rods import tables
from wsim.kernels.rods.seam import GHOST
from wsim.model.structs import fill_struct
from wsim.physics.rods import shape
from wsim.physics.rods.objects import Rods
from wsim.scene.attachments import Pin
from wsim.scene.curve import Motion


def rod_material_columns(rods: Rods) -> dict[str, np.ndarray]:
    """Columns of each point: radius r [m], E A [N], E I, G J [N m^2], mass per length [kg/m], polar
    moment times density [kg m]."""
    d = np.broadcast_to(np.asarray(rods.diameters, np.float64), len(rods.points))
    area, second = np.pi * d**2 / 4.0, np.pi * d**4 / 64.0
    shear = rods.young / (2.0 * (1.0 + rods.poisson))
    say = {"A": (rods.stretch, rods.young * area), "B": (rods.bend, rods.young * second),
           "C": (rods.twist, 2.0 * shear * second)}
    found = {name: np.full(len(d), own) if own is not None else derived for name, (own, derived) in say.items()}
    return found | {"radius": 0.5 * d, "line": rods.density * area, "polar": 2.0 * rods.density * second}


@dataclass(frozen=True)
class SkinFrame:
    """Frame of the triangle of skin that a strand grows from: the motion of one strand of a pin with `follows`.

    roots    `Follow` of the first held point of each strand of the pin        row      of this strand
    """

    roots: Any
    row: int

    @property
    def moves(self) -> bool:
        return self.roots.moves

    def at(self, time: float) -> np.ndarray:
        return self.roots.frames(np.array([time]))[0, self.row]


COPIES = 2        # of the first points of a closed strand, behind its last one (kernels/rods/seam.py)


class StrandTable:
    """Strands of all rods and worlds, side by side: arrays (points of the longest, strands).

    rods    the `Rods` and the world of each group of strands      own     its strands, a slice each
    place   of each group: row of every point in the author's order, in the flat arrays
    counts  points of each strand, copies of closed ones with them; own_counts: without
    """

    def __init__(self, pairs: list[tuple[Rods, int]]):
        self.pairs = pairs
        self.own_counts = np.concatenate([rods.counts for rods, _ in pairs])
        self.copies = np.concatenate([np.full(len(rods.counts), COPIES * rods.closed) for rods, _ in pairs])
        self.counts = self.own_counts + self.copies
        self.closed = bool(self.copies.any())
        self.longest, self.strands = int(self.counts.max()), len(self.counts)
        ends = np.cumsum([len(rods.counts) for rods, _ in pairs])
        self.own = [slice(end - len(rods.counts), end) for end, (rods, _) in zip(ends.tolist(), pairs, strict=True)]
        self.place = [self._place(own) for own in self.own]
        shape2 = (self.longest, self.strands)
        self.values = {name: np.zeros(shape2) for name in ("length", "A", "B", "C", "m", "J", "radius")}
        self.rest, self.x, self.v, self.d = (np.zeros((*shape2, 3)) for _ in range(4))
        self.phi = np.zeros(shape2)
        self.origin = np.zeros((self.strands, 3))
        self.hold, self.clamped = np.full(shape2, -1, np.int32), np.zeros(shape2, np.int32)
        self.pins: list = []
        self.motions: list[Motion | SkinFrame] = []                            # of those now, which may be set
        self.start: list[np.ndarray] = []                                      # and their frames at the start
        self.pin_worlds: list[int] = []
        self.held: list[tuple[int, np.ndarray, np.ndarray]] = []       # (pin, place, director) a row
        for own, (rods, world) in zip(self.own, pairs, strict=True):
            self._hold_pinned_rows(rods, own, world)
            self._fill_strand_columns(rods, own)
        self._clamp_edge_directors()

    def _place(self, own: slice) -> np.ndarray:
        """Flat row, point number * strands + strand, of each point."""
        counts = self.own_counts[own]
        strand = np.repeat(np.arange(own.start, own.stop), counts)
        number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        return number * self.strands + strand

    def _hold_pinned_rows(self, rods: Rods, own: slice, number: int) -> None:
        """Rows of held points in a world of that number, and which edges one pin clamps."""
        where, pin_of = self._place(own), np.full(self.hold.size, -1)
        world = rods.motion.points(rods.points, 0.0)
        for pin in rods.pins:
            frame_of, places = self._add_pin_frames(pin, where[pin.points] % self.strands, world[pin.points])
            self.pin_worlds += [number] * (len(self.pins) - len(self.pin_worlds))
            for point, k, place in zip(pin.points.tolist(), frame_of, places, strict=True):
                row = int(where[point])
                if self.hold.flat[row] < 0:
                    self.hold.flat[row], pin_of[row] = len(self.held), k
                    self.held.append((k, place, np.zeros(3)))
        pin_of = pin_of.reshape(self.hold.shape)
        for k in np.flatnonzero(self.copies[own]) + own.start:
            n = self.own_counts[k]
            for rows in (self.hold, pin_of):
                rows[n:n + COPIES, k] = rows[:COPIES, k]
        both = (pin_of[:-1] >= 0) & (pin_of[:-1] == pin_of[1:])
        self.clamped[:-1] |= both.astype(np.int32)

    def _add_pin_frames(self, pin: Pin, strand: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Adds the frames of a pin: one, or, of one that follows skin, one for each strand. Returns the frame of each held
        point, and its place there [m]. strand, x: strand and world place [m] of each."""
        first = len(self.pins)
        added: list[Motion | SkinFrame]
        if pin.follows is None:
            added, of, start = [pin.motion], np.zeros(len(strand), int), pin.motion.at(0.0)[None]
        else:
            _, root, of = np.unique(strand, return_index=True, return_inverse=True)
            roots = replace(pin.follows, corners=pin.follows.corners[root], places=pin.follows.places[root], faces=None)
            added = [SkinFrame(roots, k) for k in range(len(root))]
            start, x = roots.frames(np.zeros(1))[0], pin.follows.over(np.zeros(1))[0]
        self.pins += [pin] * len(added)
        self.motions += added
        self.start += list(start)
        local = np.einsum("kij,kj->ki", np.linalg.inv(start[:, :3, :3])[of], x - start[of, :3, 3])
        return first + of, local if pin.places is None else np.asarray(pin.places, np.float64)

    def _fill_strand_columns(self, rods: Rods, own: slice) -> None:
        """Strands of one count at a time: lengths, stiffnesses, masses, rest strains, start."""
        of = rod_material_columns(rods)
        x = rods.motion.points(rods.points, 0.0)
        rest = x if rods.rest_points is None else rods.motion.points(rods.rest_points, 0.0)
        R = rods.motion.at(0.0)[:3, :3]
        v = np.zeros_like(x) if rods.velocities is None else np.asarray(rods.velocities, np.float64) @ R.T
        first = np.cumsum(rods.counts) - rods.counts
        for n in np.unique(rods.counts).tolist():
            which = np.flatnonzero(rods.counts == n)
            rows, at = first[which][:, None] + np.arange(n + COPIES * rods.closed) % n, own.start + which
            X, X0 = x[rows], rest[rows]
            def rotate_directors(given, rows=rows):
                return None if given is None else np.asarray(given, np.float64)[rows][:, :-1] @ R.T
            m0 = shape.director_frames(X0, rotate_directors(rods.rest_directors if rods.rest_directors is not None else
                                                            rods.directors if rods.rest_points is None else None), rods.closed)
            m = (shape.director_frames(X, rotate_directors(rods.directors)) if rods.directors is not None
                 else shape.transported_directors(X0, m0, X))
            self._fill_equal_strands(at, rows.shape[1], X, X0, m0, m, {name: value[rows] for name, value in of.items()},
                                     None if rods.masses is None else np.asarray(rods.masses, np.float64)[rows])
            self.v[:rows.shape[1], at] = np.swapaxes(v[rows], 0, 1)
            if rods.closed:
                self._share_ring_masses(n, at)

    def _fill_equal_strands(self, at, n, X, X0, m0, m, of, masses) -> None:
        length = np.linalg.norm(np.diff(X0, axis=1), axis=2)
        edge = {name: 0.5 * (value[:, :-1] + value[:, 1:]) for name, value in of.items()}
        free = length * (1 - self.clamped[:n - 1, at].T)                        # the length that bends
        along = np.zeros((len(at), n))
        along[:, 1:-1] = 0.5 * (free[:, :-1] + free[:, 1:])
        inverse = np.divide(1.0, along, out=np.zeros_like(along), where=along > 0.0)
        mass = edge["line"] * length
        V = self.values
        V["length"][:n - 1, at], V["A"][:n - 1, at] = length.T, (edge["A"] / length).T
        V["B"][:n, at], V["C"][:n, at] = (of["B"] * inverse).T, (of["C"] * inverse).T
        V["J"][:n - 1, at], V["radius"][:n, at] = (edge["polar"] * length).T, of["radius"].T
        V["m"][:n, at] = masses.T if masses is not None else (
            0.5 * (np.pad(mass, ((0, 0), (0, 1))) + np.pad(mass, ((0, 0), (1, 0))))).T
        self.rest[:n, at] = np.swapaxes(shape.bending_twist_strains(X0, m0), 0, 1)
        self.origin[at] = X[:, 0]
        self.x[:n, at] = np.swapaxes(X - X[:, :1], 0, 1)
        self.d[:n - 1, at] = np.swapaxes(m, 0, 1)
        self.phi[:n, at] = shape.bending_twist_strains(X, m)[:, :, 2].T

    def _share_ring_masses(self, n: int, at: np.ndarray) -> None:
        """Masses of closed strands of n points: copies have a part of their own, and no tension between them."""
        m, J, A = (self.values[name] for name in "mJA")
        for whole, own, copy in ((m[n, at], m[0], m[n]), (m[1, at], m[1], m[n + 1]), (J[0, at], J[0], J[n])):
            own[at], copy[at] = (1.0 - GHOST) * whole, GHOST * whole
        A[n, at] = 0.0

    @property
    def masses(self) -> np.ndarray:
        """Masses of points [kg], in the flat arrays; those of copies count for the points that they are copies of."""
        m = self.values["m"].copy()
        for k in np.flatnonzero(self.copies):
            m[:COPIES, k] += m[self.own_counts[k]:self.counts[k], k]
        return m.ravel()

    def copy_rings(self, arrays: dict[str, Any]) -> None:
        """Rows of copies in arrays of the flat tables, as those that they are copies of."""
        k = np.repeat(np.flatnonzero(self.copies), COPIES)
        at = np.tile(np.arange(COPIES), len(k) // COPIES)
        for array in arrays.values() if self.closed else ():
            values = array.numpy()
            values[(self.own_counts[k] + at) * self.strands + k] = values[at * self.strands + k]
            array.assign(values)

    def _clamp_edge_directors(self) -> None:
        """Directors of clamped edges in their pins' frames."""
        for i, k in np.argwhere(self.clamped):
            row = self.hold[i, k]
            pin, place, _ = self.held[row]
            self.held[row] = pin, place, np.linalg.inv(self.start[pin][:3, :3]) @ self.d[i, k]

    def air(self, density: float) -> tuple[np.ndarray, np.ndarray]:
        """Drag of edges over the speed squared, across and along [kg/m]; density: of the air [kg/m^3] (kernels/rods/air.py)."""
        size = self.values["length"].copy()
        size[:-1] *= self.values["radius"][:-1] + self.values["radius"][1:]
        size[np.arange(self.longest)[:, None] >= self.own_counts] = 0.0
        c = np.zeros((2, self.strands))
        for own, (rods, _) in zip(self.own, self.pairs, strict=True):
            c[:, own] = np.array([rods.drag, np.pi * rods.skin_drag])[:, None]
        return 0.5 * density * c[0] * size, 0.5 * density * c[1] * size

    # on the device

    def strands_on(self, device) -> tables.RodTable:
        """The constant tables."""
        def upload_strand_column(values, dtype=wp.float64):
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)
        each = [own.stop - own.start for own in self.own]
        tau = np.repeat([rods.damping for rods, _ in self.pairs], each)
        friction = np.repeat([(rods.static_friction, rods.dynamic_friction) for rods, _ in self.pairs], each, axis=0)
        damped = {"tau": upload_strand_column(tau.astype(np.float64))} if tau.any() else {}
        if self.closed:
            damped["own"] = upload_strand_column(self.own_counts.astype(np.int32), int)
        return fill_struct(tables.RodTable, **damped, points=upload_strand_column(self.counts.astype(np.int32), int),
                           rest=upload_strand_column(self.rest, wp.vec3d),
                           hold=upload_strand_column(self.hold, int), clamped=upload_strand_column(self.clamped, int),
                           origin=upload_strand_column(self.origin, wp.vec3d),
                           friction=upload_strand_column(friction, wp.vec2d),
                           **{name: upload_strand_column(value) for name, value in self.values.items()})

    def holds_on(self, device, substeps: int) -> tables.RodPins:
        """Rows of held points; frames of pins, a row a substep, are zero yet."""
        pin, place, director = zip(*self.held, strict=True) if self.held else ((0,), (np.zeros(3),), (np.zeros(3),))
        return fill_struct(tables.RodPins, pin=wp.array(np.array(pin, np.int32), dtype=int, device=device),
                           place=wp.array(np.array(place), dtype=wp.vec3d, device=device),
                           director=wp.array(np.array(director), dtype=wp.vec3d, device=device),
                           frame=wp.zeros((substeps, max(1, len(self.pins))), dtype=wp.mat44d, device=device))

    def frames(self, times: np.ndarray) -> np.ndarray:
        """Frames of pins at some times [s], (times, pins, 4, 4). A motion that worlds share is evaluated once."""
        found = np.tile(np.eye(4), (len(times), max(1, len(self.pins)), 1, 1))
        each: dict[int, list[int]] = {}
        for k, motion in enumerate(self.motions):
            each.setdefault(id(motion.roots if isinstance(motion, SkinFrame) else motion), []).append(k)
        for pins in each.values():
            motion = self.motions[pins[0]]
            if isinstance(motion, SkinFrame):
                rows = [self.motions[k].row for k in pins]  # type: ignore[union-attr]
                found[:, pins] = motion.roots.frames(times if motion.moves else times[:1])[:, rows]
            else:
                found[:, pins] = (motion.sampled(times) if motion.moves else motion.at(0.0)[None])[:, None]
        return found

    @property
    def moving_pins(self) -> list[str]:
        """Paths of pins that move, in whichever world."""
        return list(dict.fromkeys(pin.path for pin, motion in zip(self.pins, self.motions, strict=True) if motion.moves))

    def move_pin(self, path: str, motion: Motion, world: int | None) -> bool:
        """Gives a pin another motion in one world or in all; False where there is no such pin."""
        hit = [k for k, pin in enumerate(self.pins) if pin.path == path and pin.follows is None and
               world in (None, self.pin_worlds[k])]
        for k in hit:
            self.motions[k] = motion
        return bool(hit)
