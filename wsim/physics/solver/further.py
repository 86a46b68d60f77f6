"""Further Newton steps in substeps whose residual the integrator needs: kernels/solver/further.py.

A substep of the implicit midpoint may not end unsolved: it damps nothing of what is left. What is kept of the Jacobian is its
positive part, so that steps go to the solution by a ratio only where a sheet is crumpled, and where points slide: most substeps
need no more than the scene's iterations, few need many.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import warp as wp

from wsim.kernels.solver import further as kernels
from wsim.model.stage import Clock

if TYPE_CHECKING:
    from wsim.physics.solver.newton import Implicit

MOST = 40              # further steps of a substep, at most


class Further:
    """words: 1 while a system goes on; steps so far."""

    def __init__(self, newton: Implicit):
        self.newton, self.model, self.residual = newton, newton.model, newton.residual
        real, module = self.model.real, self.model.module
        self.look_kernel, self.stand_kernel = kernels.look(real, module), kernels.stand(real, module)
        self.words = wp.zeros(2, dtype=int, device=self.model.device)

    def go(self, clock: Clock) -> None:
        """Steps while a residual, which is measured, is too large."""
        self.look(clock, 1)
        wp.capture_while(self.words[:1], lambda: self.step(clock))

    def step(self, clock: Clock) -> None:
        self.newton.step(clock, lambda: self.stand(clock))
        self.residual.measure(clock, self.newton.terms)
        self.look(clock, 0)

    def look(self, clock: Clock, first: int) -> None:
        self.model.launch(self.look_kernel, 1, [self.residual.array, clock.integrator.met[0], MOST, first], [self.words])

    def stand(self, clock: Clock) -> None:
        own = self.newton.assembly
        self.model.launch(self.stand_kernel, self.model.points,
                          [own.system.of, self.residual.array, clock.integrator.met[0]], [own.v.y])
