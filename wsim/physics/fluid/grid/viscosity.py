"""Implicit viscosity of a fluid: kernels/fluid/viscosity.py for each component in turn."""

from typing import Any

import warp as wp

from wsim.kernels.fluid import viscosity as kernels
from wsim.kernels.fluid.conjugate import CHECK, START, TURN
from wsim.physics.fluid.grid.multigrid import AXES
from wsim.physics.fluid.grid.pressure import Conjugate, PressureProjection
from wsim.physics.fluid.grid.threads import Threads

MOST = 500               # iterations
TOLERANCE = 1e-4         # of the change, over what viscosity does in the step; the fluid's own where that is smaller


class Viscosity:
    """work: arrays p, r, d, w with room for the faces of any axis, which the pressure uses in turn. walls: `slip` and
    `layers` of the fluid."""

    def __init__(self, threads: Threads, pressure: PressureProjection, walls: tuple[bool, bool], work: dict[str, wp.array],
                 sizes: list[int], words: dict[str, wp.array]):
        slip, layers = walls
        real, module, layout = threads.model.real, threads.module, pressure.layout
        self.threads, self.pressure, self.work = threads, pressure, work
        has = bool(pressure.multigrid.fractions)
        self.begin = [kernels.viscosity_start_kernel(layout.dim, a, has, slip, real, module, layers and not slip)
                      for a in range(layout.dim)]
        self.multiply = [kernels.viscosity_product_kernel(layout.dim, a, has, slip, real, module) for a in range(layout.dim)]
        self.scaled, self.scale = kernels.viscosity_scale_kernel(real, module), threads.zeros(1)
        words["spreads"] = threads.zeros(2, int)
        self.solvers = [Conjugate(threads, n, words, "spreads") for n in sizes]

    def spread(self, u: Any, live: wp.array, clock: wp.array, part: float) -> None:
        """u after `part` of the step of viscosity."""
        g, real, tolerance = self.pressure.grid, self.threads.model.real, min(TOLERANCE, self.pressure.tolerance)
        self.threads.over(self.scaled, 1, [live, clock, real(part), g.dx], [self.scale])
        for a, solver in enumerate(self.solvers):
            now = getattr(u, AXES[a])
            p, r, d, w = (self.work[name][:now.size] for name in ("p", "r", "d", "w"))
            rows = [g, self.pressure.low, self.pressure.high, getattr(self.pressure.open, AXES[a])]
            self.threads.sum(self.begin[a], solver.parts, [*rows, now, self.scale], [r, solver.part])
            solver.conclude(START, tolerance)

            def iterate_viscosity_cg(a=a, solver=solver, now=now, rows=rows, r=r, d=d, w=w) -> None:
                solver.conclude(TURN)
                self.threads.over(solver.turn, now.size, [solver.numbers, r], [d])
                self.threads.sum(self.multiply[a], solver.parts, [*rows, d, self.scale], [w, solver.part])
                solver.step(now, r, d, w)
                solver.conclude(CHECK, tolerance, MOST)
            wp.capture_while(solver.going, iterate_viscosity_cg)
