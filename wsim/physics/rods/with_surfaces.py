"""Strands that meet surfaces: where rods and cloth or soft bodies say that they collide, points and edges of strands stand
among those of self-contact (wsim/physics/contact/selfcontact/surfaces.py), in its substeps, its contact rows and its proof.
Equations: kernels/rods/with_surfaces.py.

Rods press each other by their own law (touch.py), with their own proof, before surfaces have their say; self-contact proves
their pairs once more, with what surfaces have moved them by, and does not push them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rods.with_surfaces import strand_velocity_kernels, surface_exchange_kernels, surface_strand_struct
from wsim.model.stage import Clock, Stage
from wsim.model.state import StateField
from wsim.model.structs import fill_struct
from wsim.physics.contact.selfcontact.surfaces import WRITTEN
from wsim.scene import Scene
from wsim.scene.methods import has_self_collision

if TYPE_CHECKING:
    from wsim.physics.contact.selfcontact.surfaces import ContactSurfaces
    from wsim.physics.rods.method import RodMethod
    from wsim.physics.rods.touch import StrandSelfContact

PUSH = (StateField("push", "N", True, "force of surfaces on a point that lasts", "vec3d"),
        StateField("pushed", "N", True, "force of surfaces on it in the substep before", "vec3d"))
STEPS = 4.0            # of rounding: what a file rounds, where a point stands before a substep and behind it, the way between


def rods_meet_surfaces(scene: Scene) -> bool:
    """True if rods and surfaces say that they collide."""
    return has_self_collision(scene) and any(rods.self_collision for rods in scene.things("Rods"))


class StrandSurfaceContacts:
    """Points and edges of strands as surfaces have them. points: their number; w, reach, world, friction, unit, body: columns
    of these; edges: by number of theirs."""

    def __init__(self, strands: RodMethod, module: str):
        self.strands, self.touching = strands, cast("StrandSelfContact", strands.touching)
        t, edges = strands.table, self.touching.edges
        own, self.model = edges.points, strands.model
        self.points = len(own)
        number = np.full(edges.total, -1, np.int32)
        number[own] = np.arange(len(own))
        self.edges = number[edges.edges]
        strand = edges.strand[own]
        mass = t.masses[own]
        free = (t.hold.ravel()[own] < 0) & (mass > 0.0)
        self.w = np.where(free, 1.0 / np.where(free, mass, 1.0), 0.0)
        self.reach, self.world, self.strand = t.values["radius"].ravel()[own], edges.world[own], strand
        self.friction, self.unit = np.zeros((t.strands, 2)), np.zeros(t.strands)
        self.prim = np.zeros((t.strands, 3))
        for each, (rods, _) in zip(t.own, t.pairs, strict=True):
            M = rods.motion.at(0.0)
            self.friction[each] = rods.static_friction, rods.dynamic_friction
            self.unit[each], self.prim[each] = STEPS * WRITTEN * np.linalg.cond(M[:3, :3]), M[:3, 3]
        self.friction, self.unit = self.friction[strand], self.unit[strand]
        self.rest = edges.rest[own]
        self._allocate(module)
        n = strands.substeps
        what = (f"{t.strands} strands of {len(own)} points, {n} substeps of BDF2, or backward Euler where they touch, float64; "
                "contact of edges, and a proof; among surfaces")
        self.stages = [Stage("rods", "predict", self.solve, 30, strands.part.bytes, what=what),
                       Stage("rods' ends", "finish", self.end, 8, strands.part.bytes)]

    def _allocate(self, module: str) -> None:
        strands, real, device, ground = self.strands, self.model.real, self.model.device, self.touching.ground
        self.lend_points, self.give_points, self.slow, self.read_points = surface_exchange_kernels(real, module)
        two, vec3 = (strands.table.longest, strands.table.strands), types(real).vec3
        lent, pushed = (wp.zeros(self.points, dtype=vec3, device=device) for _ in range(2))
        strands.trial.given = force = strands.part.arrays["push"].reshape(two)
        more = {}
        if strands.clock.integrator.memory > 0.0:
            self.before, self.change = strand_velocity_kernels(real, module)
            more = {name: wp.zeros(self.points, dtype=vec3, device=device) for name in ("settled", "past")}
        own = ground.upload(self.touching.edges.points, int)
        self.company = fill_struct(surface_strand_struct(real), **more, own=own, lent=lent, pushed=pushed,
                                   force=force, before=strands.part.arrays["pushed"].reshape(two),
                                   over=wp.zeros(two, dtype=wp.vec3d, device=device))
        self.kick = wp.zeros(ground.points, dtype=wp.vec3d, device=device)
        self.d = self.touching.d.reshape(two)

    def join(self, surfaces: ContactSurfaces, first: int) -> None:
        """Takes the place of the first of their points, and the origin that surfaces share."""
        self.first, self.surfaces, t = first, surfaces, self.strands.table
        self.company.first = first
        self.company.frame = wp.array(np.stack([t.origin - surfaces.base, t.origin - self.prim], axis=1), dtype=wp.vec3d,
                                      device=self.model.device)

    def start(self) -> np.ndarray:
        """Places where their points begin, from the origin that surfaces share [m], (points, 3)."""
        t = self.strands.table
        return t.x.reshape(-1, 3)[self.touching.edges.points] + (t.origin - self.surfaces.base)[self.strand]

    def path(self, place: int) -> str:
        """Path of the rods that a point among surfaces is of."""
        strand, t = self.strand[place - self.first], self.strands.table
        return next(rods.path for own, (rods, _) in zip(t.own, t.pairs, strict=True) if strand < own.stop)

    # substeps

    def solve(self, clock: Clock) -> None:
        """A substep of the strands by themselves."""
        if clock.k == 0:
            self.touching.begin_frame(clock)
        A = self.company
        A.g, self.touching.carries = clock.effective_step, clock.integrator.memory > 0.0      # BDF2 may give way
        if A.settled:
            A.settled.zero_()
            A.past.zero_()
            if not clock.carries_history:                # surfaces forget what contacts have changed: so do strands
                self.touching.motion.begun.zero_()
        self.touching.solve(clock.k)

    def lend(self) -> None:
        """Launches what surfaces read of them."""
        touching, surfaces = self.touching, self.surfaces
        self.launch(self.lend_points, [self.strands.strands, touching.motion, self.d, touching.h],
                    [surfaces.state, surfaces.data.far])

    def pushes(self) -> None:
        """Launches the note of what contacts have moved them by, before proofs do."""
        wp.copy(self.company.pushed, self.surfaces.state.d, src_offset=self.first, count=self.points)

    def end(self, clock: Clock) -> None:
        """Takes what surfaces have moved them by, and ends their substep."""
        touching = self.touching
        self.launch(self.give_points, [self.strands.strands, touching.motion, touching.h, self.surfaces.state.d], [self.d])
        touching.close(clock.k)
        self.launch(self.slow, [self.strands.strands], [touching.motion])

    def settled(self, v: wp.array, sweep: Callable[[wp.array], None], past: bool) -> None:
        """Sweeps over velocities of surfaces, with the note of what they change of strands' own. past: of those before."""
        A = self.company
        into = A.past if past else A.settled
        if past:
            self.launch(self.before, [self.touching.motion], [v])
        wp.copy(into, v, src_offset=self.first, count=self.points)
        sweep(v)
        self.launch(self.change, [v], [into])

    def still(self, v: wp.array) -> None:
        """Launches zeros to their part of velocities of surfaces' points."""
        v[self.first:self.first + self.points].zero_()

    def read(self, v: wp.array) -> None:
        """Launches the note of what they are read with where surfaces are read behind a half kick: their part of v [m/s]."""
        self.launch(self.read_points, [v], [self.kick])

    def launch(self, kernel: Any, inputs: list, outputs: list) -> None:
        """Launches a kernel over their points."""
        self.touching.ground.launch(kernel, self.points, [self.company, *inputs], outputs)
