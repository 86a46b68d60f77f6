"""Further Newton steps in substeps whose residual the integrator needs: kernels/solver/further.py.

A substep of the implicit midpoint may not end unsolved: it damps nothing of what is left. What is kept of the Jacobian is its
positive part, so that steps go to the solution by a ratio only where a sheet is crumpled, and where points slide: most substeps
need no more than the scene's iterations, few need many.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.solver import further as kernels
from wsim.model.stage import Clock
from wsim.model.structs import filled

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
        self.keep, self.lead = kernels.keep(real, module), kernels.lead(real, module)
        self.weigh = kernels.weigh(real, self.model.sweep_module)
        n, systems, device, vec3 = self.model.points, newton.assembly.system.systems, self.model.device, types(real).vec3
        rows = kernels.SECANTS
        self.secants = filled(kernels.secants(real), known=wp.zeros(systems, dtype=int, device=device),
                              gamma=wp.zeros((systems, rows), dtype=wp.float64, device=device),
                              scale=wp.ones(systems, dtype=real, device=device),
                              **{name: wp.zeros(n, dtype=vec3, device=device) for name in ("d", "y")},
                              **{name: wp.zeros((rows, n), dtype=vec3, device=device) for name in ("dd", "dy")})

    def go(self, clock: Clock) -> None:
        """Steps while a residual, which is measured, is too large."""
        self.look(clock, 1)
        wp.capture_while(self.words[:1], lambda: self.step(clock))

    def step(self, clock: Clock) -> None:
        self.newton.step(clock, lambda: self.ahead(clock))
        self.residual.measure(clock, self.newton.terms)
        self.look(clock, 0)

    def look(self, clock: Clock, first: int) -> None:
        self.model.launch(self.look_kernel, 1, [self.residual.array, clock.integrator.met[0], MOST, first], [self.words])

    def ahead(self, clock: Clock) -> None:
        """The way of a step, ahead along the last ones, outside of colliders; none for who needs none."""
        newton, own, launch, n = self.newton, self.newton.assembly, self.model.launch, self.model.points
        y, system = own.v.y, own.system
        launch(self.keep, n, [self.words, own.state.d, y], [self.secants])
        system.launch(self.weigh, [self.words, system.first, own.A.own, y, newton.line.step], [system.drop, self.secants])
        launch(self.lead, n, [self.words, system.of, own.rows.w, self.secants, y], [y])
        for term in newton.terms:
            term.clip(clock.g)
        self.model.launch(self.stand_kernel, self.model.points,
                          [own.system.of, self.residual.array, clock.integrator.met[0]], [own.v.y])
