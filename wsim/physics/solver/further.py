"""Further Newton steps in substeps whose residual the integrator needs: kernels/solver/further.py.

A substep of the implicit midpoint may not end unsolved: it damps nothing of what is left. What is kept of the Jacobian is its
positive part, so that steps go to the solution by a ratio only where a sheet is crumpled, and where points slide: most substeps
need no more than the scene's iterations, few need many. Where surfaces touch, steps go on to a smaller residual, which they may
miss: angular momentum is kept by solved steps alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.solver import further as kernels
from wsim.model.stage import Clock
from wsim.model.structs import fill_struct

if TYPE_CHECKING:
    from wsim.physics.solver.newton import Implicit

MOST = 40              # further steps of a substep, at most
CLOSE = 1e-3           # of the residual that is needed: wanted where surfaces touch. Angular momentum errs by the moment of
CLOSE_STEPS = 24       # what is left, by 2e-4 of it at 1; of sheets that meet by 6e-8 with this, by 2e-6 with 3e-3


class Further:
    """words: 1 while a system goes on; steps so far."""

    def __init__(self, newton: Implicit):
        self.newton, self.model, self.residual = newton, newton.model, newton.residual
        real, module = self.model.real, self.model.module
        self.look_kernel, self.stand_kernel = (kernels.further_look_kernel(real, module),
                                               kernels.stand_still_kernel(real, module))
        self.words = wp.zeros(2, dtype=int, device=self.model.device)
        self.keep, self.lead = kernels.secant_storage_kernel(real, module), kernels.secant_step_kernel(real, module)
        self.weigh = kernels.secant_weight_kernel(real, self.model.sweep_module)
        n, systems, device, vec3 = self.model.points, newton.assembly.system.systems, self.model.device, types(real).vec3
        rows = kernels.SECANTS
        self.secants = fill_struct(kernels.newton_secants(real), known=wp.zeros(systems, dtype=int, device=device),
                                   gamma=wp.zeros((systems, rows), dtype=wp.float64, device=device),
                                   scale=wp.ones(systems, dtype=real, device=device),
                                   **{name: wp.zeros(n, dtype=vec3, device=device) for name in ("d", "y")},
                                   **{name: wp.zeros((rows, n), dtype=vec3, device=device) for name in ("dd", "dy")})

    def go(self, clock: Clock) -> None:
        """Steps while a residual, which is measured, is too large."""
        if joined := self.newton.assembly.system.joined:
            joined.when_near(lambda: self.repeat(clock, CLOSE, CLOSE_STEPS))
        self.repeat(clock, 1.0, MOST)

    def repeat(self, clock: Clock, part: float, most: int) -> None:
        """Steps while a residual is above so much of what is needed, `most` at most."""
        def look_at_residual(first: int) -> None:
            self.model.launch(self.look_kernel, 1, [self.residual.array, part * clock.integrator.met[0], most, first],
                              [self.words])

        def step_further() -> None:
            self.newton.step(clock, lambda: self.ahead(clock))
            self.residual.measure(clock, self.newton.terms)
            look_at_residual(0)
        look_at_residual(1)
        wp.capture_while(self.words[:1], step_further)

    def ahead(self, clock: Clock) -> None:
        """The way of a step, ahead along the last ones, outside of colliders; none for who needs none. Bodies that touch go
        ahead as one, and all of them: else pushes between them would have moved one alone."""
        own, line = self.newton.assembly, self.newton.line
        system, joined = own.system, own.system.joined

        def each_body() -> None:
            self.lead_on(system.first, system.of, line.step, system.drop)
        if joined:
            joined.when_near(lambda: self.lead_on(joined.starts, joined.world, joined.step, joined.drop), each_body)
        else:
            each_body()
        for term in self.newton.terms:
            term.clamp_step(clock.effective_step)
        if joined:
            joined.when_near(lambda: None, lambda: self.stop_solved(clock))
        else:
            self.stop_solved(clock)

    def lead_on(self, first: wp.array, of: wp.array, step: wp.array, drop: wp.array) -> None:
        """Along the last steps of each system: the points from first[i] to first[i + 1], of [system of each point]."""
        own, launch = self.newton.assembly, self.model.launch
        y = own.v.y
        launch(self.keep, self.model.points, [self.words, own.state.d, y], [self.secants])
        own.system.launch(self.weigh, [self.words, first, own.A.own, y, step], [drop, self.secants], first.size - 1)
        launch(self.lead, self.model.points, [self.words, of, own.rows.w, self.secants, y], [y])

    def stop_solved(self, clock: Clock) -> None:
        """No step for bodies that have met the residual."""
        own = self.newton.assembly
        self.model.launch(self.stand_kernel, self.model.points,
                          [own.system.of, self.residual.array, clock.integrator.met[0]], [own.v.y])
