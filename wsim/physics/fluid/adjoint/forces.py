"""Adjoint of the forces on the air: kernels/fluid/adjoint/forces.py."""

from typing import Any

import warp as wp

from wsim.kernels.fluid.adjoint import forces as kernels
from wsim.kernels.fluid.forces import LIFT, VORTICITY, WEIGHT
from wsim.kernels.math.real import types
from wsim.physics.fluid.adjoint.launches import PLAIN, AdjointLaunches

SIGNS = {"smoke": (WEIGHT, 1.0), "heat": (LIFT, -1.0)}


class ForcesAdjoint:
    def __init__(self, launches: AdjointLaunches):
        self.launches, domain = launches, launches.domain
        self.domain, dim, real, module = domain, domain.layout.dim, launches.real, launches.module
        self.share_kernel, self.scaled = (kernels.face_mean_transpose_kernel(dim, real, module),
                                          kernels.scaled_field_kernel(real, module))
        self.share = domain.threads.zeros(domain.layout.cells)
        self.field = None                                      # what accelerations at the cells' centres get
        if domain.field is not None:
            self.fed, self.field = (kernels.field_adjoint_kernel(real, module),
                                    domain.threads.zeros(domain.layout.cells, types(real).vec3))
        if domain.swirling:
            vec3, n = types(real).vec3, domain.layout.cells
            self.pushed, self.curl = kernels.swirl_push_kernel(real, module), kernels.curl_adjoint_kernel(dim, real, module)
            self.turned, self.whirled = kernels.confinement_adjoint_kernels(dim, real, module)
            self.swirl, self.by_N, self.by_whirl = (domain.threads.zeros(n, vec3) for _ in range(3))
            self.strength = domain.threads.zeros(n)

    def back(self, by: Any, part: float, scalars: dict[str, wp.array], by_scalars: dict[str, wp.array], before: Any) -> None:
        """by: cotangent of the velocity behind forces over `part` of the step; adds those of scalars and, of confinement, that
        of the velocity `before`, to by."""
        run, domain, cells = self.launches, self.domain, self.domain.layout.cells
        for a, u in run.each(by):
            run.over(self.share_kernel, cells, [domain.grid, a, u], [self.share])
            for name, q in scalars.items():
                live, sign = SIGNS[name]
                run.dot(self.share, q, a, sign * part, live)
                run.dot(self.share, q, live, sign * part, a)
                run.over(self.scaled, cells, [self.share, domain.live, domain.clock, a, live, run.real(sign * part)],
                         [by_scalars[name]])
            if self.field is not None:
                run.over(self.fed, cells, [self.share, domain.clock, a, run.real(part)], [self.field])
            if domain.swirling:
                run.over(self.pushed, cells, [self.share, domain.clock, a, run.real(part)], [self.swirl])
        if domain.swirling:
            self._confine_adjoint(by, before)

    def _confine_adjoint(self, by: Any, before: Any) -> None:
        run, domain, cells = self.launches, self.domain, self.domain.layout.cells
        run.over(domain.curl, cells, [domain.grid, before], [domain.whirl])
        rows = [domain.grid, domain.live, domain.whirl, self.swirl]
        run.over(self.turned, cells, rows, [self.by_N, self.strength])
        run.sum(self.strength, PLAIN, 1.0, VORTICITY)
        run.over(self.whirled, cells, [*rows, self.by_N], [self.by_whirl])
        run.over(self.curl, cells, [domain.grid, self.by_whirl], [by])
