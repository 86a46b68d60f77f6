"""Mesh colliders and boxes as surfaces of inverse mass 0 that go on their own path: their corners and edges meet ours.

Their points stand behind all points of the state (`ContactSurfaces.total` of them, a copy a world), in arrays of our own; what
self-contact reads of the state is copied there. Equations: kernels/contact/selfcontact/obstacles.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.geometry import primitives
from wsim.kernels.contact.selfcontact import obstacles as kernels
from wsim.model.structs import fill_struct
from wsim.scene import Box, Surface

if TYPE_CHECKING:
    from wsim.model.model import Model, PointBody
    from wsim.model.stage import Clock
    from wsim.physics.contact.contacts import ColliderContacts

STEPS = 3.0            # of rounding: of where a point stands before a substep and behind it, and of the way between


@dataclass
class SurfaceObstacle:
    """One collider."""

    number: int                          # of `ColliderContacts.rows.colliders`
    mesh: Any                            # `wsim.physics.contact.collider.mesh.ColliderMesh`; None: a box
    points: np.ndarray                   # in its own frame where it begins [m], (n, 3) float32
    own: np.ndarray                      # those that triangles name, (m,)
    triangles: np.ndarray                # (t, 3), of `own`
    motion: Any = None                   # as placed last

    @staticmethod
    def of(number: int, shape, mesh) -> SurfaceObstacle:
        if mesh is None:
            points, triangles = primitives.box_outline(shape.half)
        else:
            poses, triangles = shape.poses, mesh.triangles
            points = shape.points if poses is None else poses.at(0.0)
        own, places = np.unique(triangles, return_inverse=True)
        return SurfaceObstacle(number, mesh, np.asarray(points, np.float32), own.astype(np.int32),
                               places.reshape(-1, 3).astype(int))

    @property
    def forms(self) -> bool:
        """True if its mesh deforms."""
        return self.mesh is not None and self.mesh.moves


def colliders_with_edges(model: Model, contacts: ColliderContacts | None) -> list[SurfaceObstacle]:
    """Colliders of the scene with corners and edges, which do not give way."""
    paths = {c.path for c in model.scene.colliders}
    rows = contacts.rows if contacts else None
    return [SurfaceObstacle.of(k, c.shape, rows.meshes[k]) for k, c in enumerate(rows.colliders)
            if c.path in paths and isinstance(c.shape, Surface | Box)] if rows else []


class SurfaceObstacles:
    """each: the colliders; first: place of the first of their points; body, world, reach, friction, triangles: columns of what
    stands behind that of the state."""

    def __init__(self, model: Model, contacts: ColliderContacts, each: list[SurfaceObstacle], bodies: list[PointBody],
                 first: int):
        """bodies: surfaces, whose first origin is that of all. `state` is given by `ContactSurfaces`."""
        self.model, self.contacts, self.each, self.base = model, contacts, each, bodies[0].origin
        self.first, self.state = first, None               # type: int, Any
        rows, of = contacts.rows, {b.world: b.number for b in reversed(bodies)}
        start, blocks = self.first, []
        for o in each:
            c, m = rows.colliders[o.number], len(o.own)
            row = {w: next(r for r in range(rows.first[b], rows.first[b + 1]) if rows.collider[r] == o.number)
                   for w, b in of.items()}
            reach = max(c.thickness or 0.0, o.mesh.least_gap if o.mesh else 0.0)
            for w in range(model.worlds):
                blocks.append((o, w, start, contacts.friction[row[w]], reach))
                start += m
        self.total = start
        each_of = [len(o.own) for o, *_ in blocks]
        self.body = np.repeat([-1 - o.number for o, *_ in blocks], each_of).astype(np.int32)
        self.world = np.repeat([w for _, w, *_ in blocks], each_of).astype(np.int32)
        self.friction = np.repeat([f for *_, f, _ in blocks], each_of, axis=0)
        self.reach = np.repeat([r for *_, r in blocks], each_of)
        self.triangles = np.concatenate([o.triangles + s for o, _, s, *_ in blocks]).astype(np.int32)
        self.places = {id(o): [s for p, _, s, *_ in blocks if p is o] for o in each}
        self._allocate()

    def _allocate(self) -> None:
        real, device = self.model.real, self.model.device
        self.place = kernels.obstacle_place_kernel(real, self.model.module)
        self.own = [wp.array(np.tile(o.own, self.model.worlds), dtype=int, device=device) for o in self.each]
        self.track = [None if o.forms else wp.array(o.points[None], dtype=wp.vec3f, device=device) for o in self.each]
        self.M = wp.zeros((len(self.each), 2), dtype=wp.mat44d, device=device)

    @property
    def points(self) -> np.ndarray:
        """Places of their points."""
        return np.arange(self.first, self.total, dtype=np.int32)

    @property
    def moves(self) -> bool:
        """True if one of them goes somewhere or deforms."""
        return any(o.forms or self.contacts.rows.colliders[o.number].motion.moves for o in self.each)

    def start(self) -> np.ndarray:
        """Where their points begin, from the origin that surfaces share [m], (total - first, 3)."""
        found = []
        for o in self.each:
            M = self.contacts.rows.colliders[o.number].motion.at(0.0)
            p = o.points[o.own].astype(np.float64) @ M[:3, :3].T + (M[:3, 3] - self.base)
            found += [p] * self.model.worlds
        return np.concatenate(found)

    def before_frame(self, time: float, clock: Clock) -> None:
        """Places what stands still, and uploads paths of what does not; not captured."""
        n, motions = clock.substeps + 1, [self.contacts.rows.colliders[o.number].motion for o in self.each]
        changed = self.M.shape[1] != n or any(m is not o.motion for m, o in zip(motions, self.each, strict=True))
        if not changed and not any(m.moves for m in motions):
            return
        times = time + clock.dt * np.arange(n) / clock.substeps
        M = np.stack([m.sampled(times) if m.moves else np.broadcast_to(m.at(0.0), (n, 4, 4)) for m in motions])
        M[:, :, :3, 3] -= self.base
        if self.M.shape[1] != n:
            self.M = wp.zeros(M.shape[:2], dtype=wp.mat44d, device=self.model.device)
        self.M.assign(M)
        for o, motion in zip(self.each, motions, strict=True):
            o.motion = motion
        for k in range(len(self.each)) if changed else ():
            if not self._obstacle_moves(k):
                self._place(k, 0, 0.0)

    def _obstacle_moves(self, k: int) -> bool:
        return self.each[k].forms or bool(self.contacts.rows.colliders[self.each[k].number].motion.moves)

    def _place(self, k: int, substep: int, part: float, clock: Clock | None = None) -> None:
        o = self.each[k]
        track = o.mesh.device["track"] if o.forms else self.track[k]
        substep, now = (0, clock.loop.number) if clock and clock.loop else (substep, None)
        begin = self.places[id(o)][0]
        to = fill_struct(type(self.state),
                         **{name: getattr(self.state, name)[begin:begin + len(self.own[k])] for name in "xda"})
        self.model.launch(self.place, len(self.own[k]), [self.own[k], self.M[k], track, substep, now, part], [to])

    def move(self, clock: Clock) -> None:
        """Launches the ways of what moves in a substep; surfaces meet it where the substep ends."""
        part = 0.0 if clock.integrator.beyond else 1.0 - clock.effective_step / clock.h
        for k in range(len(self.each)):
            if self._obstacle_moves(k):
                self._place(k, clock.k, part, clock)
