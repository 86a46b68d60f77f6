"""Adjoints of the projection and of viscosity: the solves of the frame, once more, of cotangents."""

from typing import Any

import warp as wp

from wsim.kernels.fluid.adjoint import pressure as kernels
from wsim.kernels.fluid.adjoint import viscosity as viscous
from wsim.kernels.fluid.conjugate import SIZE
from wsim.kernels.fluid.forces import VISCOSITY
from wsim.kernels.math.real import types
from wsim.model.structs import struct_values
from wsim.physics.fluid.adjoint.launches import PLAIN, TIMED, AdjointLaunches, air_number_slot


class ProjectionAdjoint:
    """worst: the largest residual over its right-hand side that an adjoint solve has left. by_solid, by_expansion: cotangents,
    summed over a step, of what moves and of what expands; None where nothing does."""

    def __init__(self, launches: AdjointLaunches):
        self.launches, domain = launches, launches.domain
        dim, real, module, p = domain.layout.dim, launches.real, launches.module, domain.pressure
        self.domain, self.pressure, o = domain, p, domain.obstacles
        fractions, moving = o is not None, o is not None and o.moving
        self.gather = kernels.gradient_transpose_kernel(dim, fractions, real, module)
        self.shut = kernels.closed_cell_kernel(dim, real, module) if fractions else None
        self.spread = [kernels.projection_adjoint_kernel(dim, a, fractions, moving, real, module) for a in range(dim)]
        self.sides_kernels = [kernels.side_adjoint_kernel(dim, a, real, module) for a in range(dim)]
        self.residual, self.worst = kernels.adjoint_residual_kernel(module), domain.threads.zeros(1, wp.float32)
        self.by_solid = domain.faces() if moving else p.none
        self.by_expansion = domain.threads.zeros(domain.layout.cells) if p.expansion is not None else None

    def project(self, by: Any) -> None:
        """by: cotangent of the projected velocity, becomes that of the one before."""
        p, over, cells = self.pressure, self.launches.over, self.domain.layout.cells
        over(self.gather, cells, [p.grid, p.low, p.high, p.open, by], [p.r])
        self._solve_pressure()
        wp.copy(p.r, p.p)
        if self.shut:
            over(self.shut, cells, [p.multigrid.grids[0].table], [p.r])
        p._level()
        for a, out, o, solid in self.launches.each(by, p.open, self.by_solid):
            over(self.spread[a], out.size, [p.grid, p.low, p.high, o, p.r], [out, solid])
        if self.by_expansion is not None:
            self.launches.add(p.r, self.by_expansion, float(p.grid.dx))

    def _solve_pressure(self) -> None:
        """p of r, and what it leaves."""
        p = self.pressure
        p.find()
        p.solver.sum(p.r, p.r)
        self.launches.over(self.residual, 1, [p.solver.numbers, p.solver.part, SIZE], [self.worst])

    def sides(self, by: Any) -> None:
        """Gradient with respect to the velocity before closed sides were set."""
        p, layout = self.pressure, self.domain.layout
        for a, out in self.launches.each(by):
            if not layout.periodic[a]:
                self.launches.blocks(self.sides_kernels[a], self.launches.parts, [p.grid, p.low, p.high],
                                     [out, self.launches.part])
                self.launches.collect(PLAIN, 1.0, air_number_slot(1 + 2 * a, a), air_number_slot(2 + 2 * a, a))


class ViscosityAdjoint:
    def __init__(self, launches: AdjointLaunches):
        self.launches, domain = launches, launches.domain
        dim, real, module, p, slip = domain.layout.dim, launches.real, launches.module, domain.pressure, domain.fluid.slip
        self.domain, self.pressure, self.slip, has = domain, p, slip, bool(p.multigrid.fractions)
        self.apart, self.beside, self.known = ([make(dim, a, has, slip, real, module) for a in range(dim)]
                                               for make in (viscous.fixed_faces_kernel, viscous.fixed_faces_adjoint_kernel,
                                                            viscous.viscosity_gradient_kernel))
        self.walls = [viscous.wall_shear_kernel(dim, a, has, real, module) for a in range(0 if slip else dim)]
        still = struct_values(domain.grid) | {"air": domain.threads.zeros(7, types(real).vec3)}
        self.still, self.fixed = launches.struct(domain.grid._cls, **still), domain.faces()

    def spread(self, by: Any, now: Any, part: float) -> None:
        """by: cotangent of the velocity `now` behind viscosity, becomes that of the one before."""
        run, p, layout = self.launches, self.pressure, self.domain.layout
        sides, v = [p.grid, p.low, p.high], self.domain.viscosity
        for a, out, fixed, o in run.each(by, self.fixed, p.open):
            run.over(self.apart[a], out.size, [*sides, o], [out, fixed])
        p.grid = self.still
        v.spread(by, self.domain.live, self.domain.clock, part)
        p.grid = sides[0]
        for a, y, u, fixed, o in run.each(by, now, self.fixed, p.open):
            run.blocks(self.known[a], run.parts, [*sides, o, u, y], [run.part])
            run.collect(TIMED, part / float(p.grid.dx) ** 2, VISCOSITY)
            for b in range(0 if self.slip else layout.dim):
                if b != a and not layout.periodic[b]:
                    run.blocks(self.walls[a], run.parts, [*sides, o, y, v.scale, b], [run.part])
                    run.collect(PLAIN, 1.0, air_number_slot(1 + 2 * b, a), air_number_slot(2 + 2 * b, a))
            run.over(self.beside[a], y.size, [*sides, o, y, v.scale, fixed], [y])
