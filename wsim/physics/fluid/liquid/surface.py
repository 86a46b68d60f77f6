"""The pressure of a liquid with a free surface (kernels/particles/surface.py): by conjugate gradients with a multigrid cycle,
of the cells that are liquid in this step."""

from math import prod
from typing import Any

import warp as wp

from wsim.kernels.fluid import conjugate
from wsim.kernels.fluid.conjugate import CHECK, START, TURN
from wsim.kernels.fluid.grid import grid_structs
from wsim.kernels.fluid.pressure import FREE
from wsim.kernels.math.real import types
from wsim.kernels.particles import surface
from wsim.model.structs import fill_struct
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.multigrid import AXES, PressureMultigrid
from wsim.physics.fluid.grid.pressure import Conjugate, Islands
from wsim.physics.fluid.grid.threads import Threads

AGAIN = 1e-2             # tolerance of the second solve with bodies, whose pressure is a hundredth to a tenth of the first


class LiquidSurface:
    """obstacles: `wsim.physics.fluid.grid.obstacles.FluidObstacles`, or None. phi, fill: of the cells. words: of the status."""

    def __init__(self, threads: Threads, layout: Layout, grid: Any, obstacles: Any, phi: wp.array, fill: wp.array,
                 words: dict[str, wp.array]):
        real, module, dim = threads.model.real, threads.module, layout.dim
        self.threads, self.layout, self.grid, self.phi, self.fill = threads, layout, grid, phi, fill
        some = (obstacles is not None, obstacles is not None and obstacles.moving)
        thin = obstacles is not None and bool(obstacles.shapes.thin.any())
        none = fill_struct(grid_structs(real).Faces)
        self.open, self.solid = (obstacles.open, obstacles.solid or none) if obstacles else (none, none)
        self.k, self.own, self.air = self._make_faces(), threads.zeros(layout.cells), threads.zeros(1, int)
        self.p, self.r, self.z, self.d, self.w = (threads.zeros(layout.cells) for _ in range(5))
        self.low, self.high = types(real).vec3(*layout.low), types(real).vec3(*layout.high)
        self.couple = surface.surface_coupling_kernel(dim, some[0], real, module)
        self.own_kernel = surface.surface_diagonal_kernel(dim, some[0], real, module)
        self.ground = surface.sealed_ground_kernel(real, module) if layout.sealed else None
        self.outflow, self.crowding = (surface.liquid_outflow_kernel(dim, *some, real, module),
                                       surface.density_correction_kernel(dim, thin, real, module))
        self.push_kernel = surface.liquid_projection_kernel(dim, *some, real, module)
        self.spread_kernel = surface.liquid_projection_kernel(dim, some[0], False, real, module)
        self.multiply = conjugate.pressure_product_kernel(dim, FREE, real, module)
        self.multigrid = PressureMultigrid(threads, layout, self.k, self.z, self.r, own=self.own)
        self.solver = Conjugate(threads, layout.cells, words)
        self.islands = Islands(threads, layout, True) if obstacles else None     # liquid that walls part from all air

    def _make_faces(self) -> Any:
        sizes = {AXES[a]: self.threads.zeros(prod(self.layout.faces(a))) for a in range(self.layout.dim)}
        return fill_struct(grid_structs(self.threads.model.real).Faces, **sizes)

    @property
    def launches(self) -> int:
        """Number of launches of a solve that takes one iteration."""
        return self.multigrid.launches + (17 if self.islands else 12)

    def refresh(self) -> None:
        """The equation of the surface as it is now."""
        for a in range(self.layout.dim):
            out = getattr(self.k, AXES[a])
            self.threads.over(self.couple, out.size, [self.grid, a, self.phi, getattr(self.open, AXES[a])], [out])
        n = self.layout.cells
        self.air.zero_()
        self.threads.over(self.own_kernel, n, [self.grid, self.phi, self.open], [self.own, self.air])
        if self.ground:
            self.threads.over(self.ground, n, [self.air, self.phi], [self.own])
        self.multigrid.refresh()
        if self.islands:
            self.islands.find(self.multigrid.grids[0].table)

    def project(self, u: Any, known: list[wp.array], tolerance: float, bodies: Any = None, pull: tuple = ()) -> None:
        """Takes the divergence off u, and moves bodies (`Floating`); known: faces of liquid; pull:
        gravity and clock."""
        if bodies:
            bodies.begin(self.multigrid.grids[0].table, self.phi, *pull)
        self.threads.over(self.outflow, self.layout.cells, [self.grid, u, self.open, self.solid, self.phi,
                                                            self.multigrid.grids[0].table], [self.r])
        self._solve_pressure(tolerance, bodies)
        if bodies:
            bodies.lean(self.p, self.phi, self.r)
            self._solve_pressure(AGAIN, bodies)
            bodies.whole(self.p)
            bodies.push(self.p)
        self._push(self.push_kernel, u, known)

    def spread(self, d: Any, known: list[wp.array], tolerance: float, share: wp.array | None) -> None:
        """The displacement of faces [m] into d, which is 0, that brings the liquid to its density at rest. share: of the cells,
        beside thin walls."""
        self.threads.over(self.crowding, self.layout.cells, [self.grid, self.fill, self.phi, self.open, share,
                                                              self.multigrid.grids[0].table], [self.r])
        self._solve_pressure(tolerance)
        self._push(self.spread_kernel, d, known)

    def _push(self, kernel: Any, u: Any, known: list[wp.array]) -> None:
        for a in range(self.layout.dim):
            out = getattr(u, AXES[a])
            both = fill_struct(grid_structs(self.threads.model.real).Faces, x=getattr(self.open, AXES[a]),
                               y=getattr(self.solid, AXES[a]))
            self.threads.over(kernel, out.size, [self.grid, a, self.multigrid.grids[0].table, self.p, self.phi, both],
                              [out, known[a]])

    def _solve_pressure(self, tolerance: float, bodies: Any = None) -> None:
        self.tolerance = tolerance
        self.p.zero_()
        self.solver.sum(self.r, self.r)
        if self.islands and not bodies:                        # bodies that give way leave no liquid shut in
            self.islands.level(self.r, self.solver.part)
            self.solver.sum(self.r, self.r)
        self.solver.conclude(START, tolerance)
        wp.capture_while(self.solver.going, self._iterate, bodies=bodies)

    def _iterate(self, bodies: Any) -> None:
        s, threads, table = self.solver, self.threads, self.multigrid.grids[0].table
        self.multigrid.cycle()                                 # of r into z
        s.sum(self.r, self.z)
        s.conclude(TURN)
        threads.over(s.turn, self.layout.cells, [s.numbers, self.z], [self.d])
        threads.sum(self.multiply, s.parts, [table, self.d], [self.w, s.part])
        if bodies:
            bodies.add(self.d, self.w)
            s.sum(self.d, self.w)
        s.step(self.p, self.r, self.d, self.w)
        s.conclude(CHECK, self.tolerance)

