"""Sweeps of others before each Newton step of a substep: kernels.solver.contact.pushed.py."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import warp as wp

from wsim.kernels.solver.contact.pushed import pushed_target_kernel
from wsim.model.stage import Clock

if TYPE_CHECKING:
    from wsim.physics.solver.assembly import Assembly


class NewtonSweeps(list[Callable[[Clock], None]]):
    """Steps that move points by impulses before a Newton step, in this order."""

    def __init__(self, own: Assembly):
        super().__init__()
        self.own, self.model = own, own.model
        self.before = wp.zeros_like(own.state.d)
        self.kernel = pushed_target_kernel(self.model.real, self.model.module)

    def run(self, clock: Clock) -> None:
        """Launches all of them. Before the first step of a substep d is the prediction, which becomes the target anyway."""
        if clock.i > 0:
            self.model.copy(self.before, self.own.state.d)
        for sweep in self:
            sweep(clock)
        if clock.i > 0:
            self.model.launch(self.kernel, self.model.points, [self.own.state.d, self.before], [self.own.b])
