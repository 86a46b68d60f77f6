"""The levels of a multigrid cycle (kernels/fluid/multigrid.py): built once, run in every iteration of the pressure."""

from dataclasses import dataclass
from math import prod
from typing import Any

import warp as wp

from wsim.kernels.fluid import multigrid as kernels
from wsim.kernels.fluid.pressure import FREE, levels
from wsim.kernels.math.real import types
from wsim.model.structs import filled
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.threads import Threads

SWEEPS = 2               # before and behind the coarse grid, each of both colours
COARSEST = 8             # there
AXES = "xyz"


@dataclass
class Grid:
    """One level. halved: by which factor each axis is on the way to it."""

    table: Any
    n: tuple[int, ...]
    halved: tuple[int, ...]
    x: wp.array
    b: wp.array

    @property
    def cells(self) -> int:
        return prod(self.n)


def halving(n: tuple[int, ...], periodic: tuple[int, ...]) -> tuple[int, ...]:
    """Factor of each axis to the next coarser level."""
    return tuple(2 if m > 1 and not (p and (m % 2 or (m // 2) % 2)) else 1 for m, p in zip(n, periodic, strict=True))


class Multigrid:
    """of: couplings of the faces of each axis, where there are obstacles; x, b: of the finest level, solution and residual;
    own: couplings of the cells to a free surface."""

    def __init__(self, threads: Threads, layout: Layout, of: Any, x: wp.array, b: wp.array, own: wp.array | None = None):
        self.threads, self.layout, self.fractions = threads, layout, FREE if own is not None else of is not None
        real, module, dim = threads.model.real, threads.module, layout.dim
        self.fresh = kernels.sweep(dim, self.fractions, True, real, module)
        self.sweep = kernels.sweep(dim, self.fractions, False, real, module)
        self.restrict = kernels.restrict(dim, self.fractions, real, module)
        self.prolong = kernels.prolong(dim, real, module)
        self.even, self.sealed = kernels.even(dim, self.fractions, real, module), False
        self.coarsen = [kernels.coarsen(dim, a, real, module) for a in range(dim)] if self.fractions else []
        self.collect = kernels.collect(dim, real, module) if own is not None else None
        self.grids = self._build(of, x, b, own)

    def _build(self, of: Any, x: wp.array, b: wp.array, own: wp.array | None) -> list[Grid]:
        layout, real = self.layout, self.threads.model.real
        Level, vec3 = levels(real), types(real).vec3
        k: tuple[float, ...] = (1.0, 1.0, 1.0)
        n: tuple[int, ...] = layout.n
        halved: tuple[int, ...] = (1, 1, 1)
        found: list[Grid] = []
        while True:
            table = filled(Level, n=wp.vec3i(*n), periodic=wp.vec3i(*layout.periodic), k=vec3(*k), low=vec3(*layout.low),
                           high=vec3(*layout.high))
            for a in range(layout.dim if self.fractions else 0):
                size = prod(m + (i == a and not layout.periodic[i]) for i, m in enumerate(n))
                setattr(table, AXES[a], getattr(of, AXES[a]) if not found else self.threads.zeros(size))
            if own is not None:
                table.own = own if not found else self.threads.zeros(prod(n))
            both = (x, b) if not found else (self.threads.zeros(prod(n)), self.threads.zeros(prod(n)))
            found.append(Grid(table, n, halved, *both))
            halved = halving(n, layout.periodic)
            if max(halved) == 1:
                return found
            k = tuple(v * prod(halved) / halved[a] ** 2 for a, v in enumerate(k))
            n = tuple(-(-m // f) for m, f in zip(n, halved, strict=True))

    def refresh(self) -> None:
        """Couplings of the coarse levels, of the finest ones as they are now."""
        for fine, coarse in zip(self.grids[:-1], self.grids[1:], strict=True):
            for a, kernel in enumerate(self.coarsen):
                shapes = [wp.vec3i(*(m + (i == a and not self.layout.periodic[i]) for i, m in enumerate(g.n)))
                          for g in (coarse, fine)]
                k_out = getattr(coarse.table, AXES[a])
                k = getattr(fine.table, AXES[a])
                self.threads.over(kernel, k_out.size, [*shapes, wp.vec3i(*coarse.halved), k], [k_out])
            if self.collect:
                sizes = [wp.vec3i(*coarse.n), wp.vec3i(*fine.n), wp.vec3i(*coarse.halved)]
                self.threads.over(self.collect, coarse.cells, [*sizes, fine.table.own], [coarse.table.own])

    def cycle(self) -> None:
        """x of the finest level becomes close to A^-1 b."""
        last = len(self.grids) - 1
        for k, grid in enumerate(self.grids[:-1]):
            self.smooth(grid, (0, 1) * SWEEPS, True)
            below = self.grids[k + 1]
            self.threads.over(self.restrict, below.cells, [grid.table, wp.vec3i(*below.n), wp.vec3i(*below.halved), grid.b,
                                                           grid.x], [below.b])
        if self.sealed and last > 0:
            self.threads.over(self.even, 1, [self.grids[last].table, self.grids[last].cells], [self.grids[last].b])
        self.smooth(self.grids[last], (0, 1) * COARSEST, True)
        self.smooth(self.grids[last], (1, 0) * COARSEST, False)
        for k in range(last - 1, -1, -1):
            grid, below = self.grids[k], self.grids[k + 1]
            sizes = [wp.vec3i(*grid.n), wp.vec3i(*below.n), wp.vec3i(*below.halved)]
            self.threads.over(self.prolong, grid.cells, [*sizes, below.x, grid.x], [grid.x])
            self.smooth(grid, (1, 0) * SWEEPS, False)

    def smooth(self, grid: Grid, colors: tuple[int, ...], fresh: bool) -> None:
        """Sweeps of these colours; fresh: from x = 0, which need not stand there."""
        last = grid.n[self.layout.dim - 1]
        half = grid.cells // last * -(-last // 2)
        for k, color in enumerate(colors):
            kernel = self.fresh if fresh and k == 0 else self.sweep
            self.threads.over(kernel, half, [grid.table, grid.b, color, grid.x], [grid.x])

    @property
    def launches(self) -> int:
        """Of a cycle."""
        return (len(self.grids) - 1) * (4 * SWEEPS + 2) + 4 * COARSEST
