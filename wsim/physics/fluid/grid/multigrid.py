"""The levels of a multigrid cycle (kernels/fluid/solver/multigrid.py): built once, run in every iteration of the pressure."""

from dataclasses import dataclass
from math import prod
from typing import Any

import warp as wp

from wsim.kernels.fluid.pressure import FREE, pressure_levels
from wsim.kernels.fluid.solver import coarse
from wsim.kernels.fluid.solver import multigrid as kernels
from wsim.kernels.math.real import types
from wsim.model.structs import fill_struct
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.threads import Threads

SWEEPS = 2               # before and behind the coarse grid, each of both colours
COARSEST = 8             # there
SMALL = 16 ** 3           # cells of a level that one block takes: 13 us with all below it, where its own launches take 21
AXES = "xyz"


@dataclass
class MultigridLevel:
    """One level. halved: by which factor each axis is on the way to it."""

    table: Any
    n: tuple[int, ...]
    halved: tuple[int, ...]
    x: wp.array
    b: wp.array

    @property
    def cells(self) -> int:
        return prod(self.n)


def coarsening_factors(n: tuple[int, ...], periodic: tuple[int, ...]) -> tuple[int, ...]:
    """Factor of each axis to the next coarser level."""
    return tuple(2 if m > 1 and not (p and (m % 2 or (m // 2) % 2)) else 1 for m, p in zip(n, periodic, strict=True))


class PressureMultigrid:
    """of: couplings of the faces of each axis, where there are obstacles; x, b: of the finest level, solution and residual.
    cycles: False where only the finest level is asked for. own: of a free surface, couplings of the cells themselves."""

    def __init__(self, threads: Threads, layout: Layout, of: Any, x: wp.array, b: wp.array, cycles: bool = True,
                 own: wp.array | None = None):
        self.threads, self.layout, self.sealed = threads, layout, False
        self.fractions = FREE if own is not None else int(of is not None)
        self.grids = self._build(of, (x, b), cycles, own)
        if cycles:
            self._make_kernels()

    def _make_kernels(self) -> None:
        threads, dim, has = self.threads, self.layout.dim, self.fractions
        real, module = threads.model.real, threads.module
        small = [k for k, grid in enumerate(self.grids) if grid.cells <= SMALL]
        last = len(self.grids) - 1
        self.first = small[0] if small else last                # of those that one block takes
        self.sweep = kernels.gauss_seidel_kernel(dim, has, False, real, module)
        self.fresh = kernels.gauss_seidel_kernel(dim, has, True, real, module) if has else kernels.first_sweep_kernel(dim, real,
                                                                                                                      module)
        self.restrict, self.rise = (kernels.restriction_kernel(dim, has, real, module),
                                    kernels.prolongation_kernel(dim, has, real, module))
        self.coarsen = [kernels.face_coarsening_kernel(dim, a, real, module) for a in range(dim)] if has else []
        self.collect = kernels.cell_coarsening_kernel(dim, real, module) if has == FREE else None
        self.coarse = coarse.small_levels_kernel(dim, has, SWEEPS, COARSEST, real, threads.module_of(coarse.BLOCK))
        self.table = self._table()

    def _table(self) -> wp.array:
        Rung = coarse.coarse_rungs(self.threads.model.real)
        found = []
        for k, grid in enumerate(self.grids[self.first:], self.first):
            halved = self.grids[k + 1].halved if k + 1 < len(self.grids) else (1, 1, 1)
            found.append(fill_struct(Rung, level=grid.table, halved=wp.vec3i(*halved), x=grid.x, b=grid.b))
        return wp.array(found, dtype=Rung, device=self.threads.model.device)

    def _build(self, of: Any, finest: tuple[wp.array, wp.array], deep: bool, own: wp.array | None) -> list[MultigridLevel]:
        layout, real = self.layout, self.threads.model.real
        Level, vec3 = pressure_levels(real), types(real).vec3
        k: tuple[float, ...] = (1.0, 1.0, 1.0)
        n: tuple[int, ...] = layout.n
        halved: tuple[int, ...] = (1, 1, 1)
        found: list[MultigridLevel] = []
        while True:
            table = fill_struct(Level, n=wp.vec3i(*n), periodic=wp.vec3i(*layout.periodic), k=vec3(*k), low=vec3(*layout.low),
                                high=vec3(*layout.high))
            for a in range(layout.dim if self.fractions else 0):
                size = prod(m + (i == a and not layout.periodic[i]) for i, m in enumerate(n))
                setattr(table, AXES[a], getattr(of, AXES[a]) if not found else self.threads.zeros(size))
            if own is not None:
                table.own = own if not found else self.threads.zeros(prod(n))
            both = finest if not found else (self.threads.zeros(prod(n)), self.threads.zeros(prod(n)))
            found.append(MultigridLevel(table, n, halved, *both))
            halved = coarsening_factors(n, layout.periodic)
            if max(halved) == 1 or not deep:
                return found
            k = tuple(v * prod(halved) / halved[a] ** 2 for a, v in enumerate(k))
            n = tuple(-(-m // f) for m, f in zip(n, halved, strict=True))

    def refresh(self) -> None:
        """Couplings of the coarse levels, of the finest ones as they are now."""
        for fine, below in zip(self.grids[:-1], self.grids[1:], strict=True):
            for a, kernel in enumerate(self.coarsen):
                shapes = [wp.vec3i(*(m + (i == a and not self.layout.periodic[i]) for i, m in enumerate(g.n)))
                          for g in (below, fine)]
                k_out = getattr(below.table, AXES[a])
                k = getattr(fine.table, AXES[a])
                self.threads.over(kernel, k_out.size, [*shapes, wp.vec3i(*below.halved), k], [k_out])
            if self.collect:
                self.threads.over(self.collect, below.cells, [wp.vec3i(*below.n), wp.vec3i(*fine.n), wp.vec3i(*below.halved),
                                                              fine.table.own], [below.table.own])

    def cycle(self) -> None:
        """x of the finest level becomes close to A^-1 b."""
        above = self.grids[:self.first]
        for grid, below in zip(above, self.grids[1:], strict=False):
            self.smooth(grid, (0, 1) * SWEEPS, True)
            self.threads.over(self.restrict, below.cells, [*self.sizes(grid, below), grid.b, grid.x], [below.b])
        self.threads.one(self.coarse, coarse.BLOCK, [self.table, int(self.sealed)])
        for k in range(self.first - 1, -1, -1):
            grid, below = self.grids[k], self.grids[k + 1]
            self.threads.over(self.rise, self.half(grid), [*self.sizes(grid, below), grid.b, below.x, grid.x], [grid.x])
            self.smooth(grid, ((1, 0) * SWEEPS)[1:], False)

    def sizes(self, grid: MultigridLevel, below: MultigridLevel) -> list:
        return [grid.table, wp.vec3i(*below.n), wp.vec3i(*below.halved)]

    def half(self, grid: MultigridLevel) -> int:
        """Threads for the cells of a colour."""
        last = grid.n[self.layout.dim - 1]
        return grid.cells // last * -(-last // 2)

    def smooth(self, grid: MultigridLevel, colors: tuple[int, ...], fresh: bool) -> None:
        """Sweeps of these colours; fresh: from x = 0, which need not stand there."""
        if fresh and not self.fractions:
            self.threads.over(self.fresh, grid.cells, [grid.table, grid.b], [grid.x])
            colors = colors[2:]
        for k, color in enumerate(colors):
            kernel = self.fresh if fresh and self.fractions and k == 0 else self.sweep
            self.threads.over(kernel, self.half(grid), [grid.table, grid.b, color, grid.x], [grid.x])

    @property
    def launches(self) -> int:
        """Number of launches of a cycle."""
        return self.first * (4 * SWEEPS + bool(self.fractions)) + 1
