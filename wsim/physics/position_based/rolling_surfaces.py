"""Balls that turn on surfaces and strands, behind the sweeps of their pairs. Equations:
kernels/position_based/rolling/surfaces.py."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.contact.selfcontact import pairs
from wsim.kernels.math.real import types
from wsim.kernels.position_based.rolling import surfaces as kernels
from wsim.model.stage import MET, Clock, Stage
from wsim.model.structs import PlacedStruct

if TYPE_CHECKING:
    from wsim.physics.contact.selfcontact.method import SelfContactMethod
    from wsim.physics.position_based.rolling import RollingContacts

SWEEPS = 2             # of friction in an iteration: a ball has few pairs, which share its mass evenly


class RollingSurfaces:
    """touching: the method of surfaces, which leaves friction of these balls to this one."""

    def __init__(self, rolling: RollingContacts, touching: SelfContactMethod):
        self.rolling, self.touching, self.model = rolling, touching, rolling.model
        real, module, near = self.model.real, self.model.shared_module("rolling_surfaces"), touching.near
        self.open, self.weigh, self.rub, self.turn = (make(real, module) for make in (
            kernels.rolling_row_open_kernel, kernels.rolling_row_weight_kernel, kernels.rolling_row_sweep_kernel,
            kernels.rolling_turn_kernel))
        turns = np.zeros(touching.surfaces.total, np.int32)
        for body in rolling.turning:
            turns[body.first:body.last] = 1
        touching.surfaces.data.rolls = self.model.upload(turns, int)
        self.balls = self.model.upload(np.flatnonzero(turns).astype(np.int32), int)
        self.turns = wp.zeros(3 * len(turns), dtype=wp.int64, device=self.model.device)
        self.rows, self.capacity = PlacedStruct(kernels.rolling_row_type(real), self.model.device), 0
        self.room()
        touching.sized.append(self)
        names = [stage.name for stage in touching.stages]
        for name, stage in (("near pairs", Stage("rolling pairs", "collide", self.begin, 1, 0, what="no friction yet")),
                            ("self-contact", Stage("rolling on surfaces", "solve", self.solve, 1 + 3 * SWEEPS, 0, "iteration",
                                                   f"friction of {len(self.balls)} balls"))):
            stage.frames = MET
            touching.stages.insert(names.index(name) + 1, stage)
            names = [stage.name for stage in touching.stages]
        self.near: Any = near

    def room(self) -> None:
        """Arrays for as many pairs as there is room for; not captured."""
        if self.capacity != self.touching.near.capacity:
            self.capacity = n = self.touching.near.capacity
            vec3, device = types(self.model.real).vec3, self.model.device
            self.rows.put(**{name: wp.zeros(n, dtype=vec3, device=device) for name in ("T", "q")})

    def begin(self, clock: Clock) -> None:
        """No friction yet."""
        self.model.launch(self.open, self.near.threads, [self.near.table, self.rows.at, self.near.threads], [])

    def solve(self, clock: Clock) -> None:
        """Friction of all pairs that push a ball, if there are pairs."""
        self.touching.borrow()
        wp.capture_if(self.near.word(pairs.NEAR), self.sweep)

    def sweep(self) -> None:
        """Sweeps over these pairs."""
        touching, near, launch, table = self.touching, self.near, self.model.launch, self.rolling.table
        data, at, threads = touching.surfaces.data, touching.at(), near.threads
        launch(self.weigh, threads, [near.table, self.rows.at, table, threads], [near.sums])
        for k in range(SWEEPS):
            launch(self.rub, threads, [data, at, near.table, self.rows.at, table, threads], [self.turns, near.sums])
            launch(touching.guarantee.add, len(touching.surfaces.points), [data.point, at.d, int(k == SWEEPS - 1), near.sums],
                   [at.d])
            launch(self.turn, len(self.balls), [self.balls, self.turns], [table])
