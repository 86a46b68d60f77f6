"""Smoke and heat of a fluid carried where there is some: kernels/fluid/passes/tiles.py."""

from math import prod
from typing import Any

import warp as wp

from wsim.kernels.fluid.passes import tiles as kernels
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.threads import BLOCK, Threads
from wsim.physics.fluid.grid.transport import THIRD


class Tiles:
    """scalars: one or two arrays of the state. fastest: kernel of the greatest |u|. work: four for what is carried."""

    def __init__(self, threads: Threads, layout: Layout, grid: Any, scheme: str, scalars: list[wp.array], fastest: Any,
                 work: list[wp.array]):
        real, module, dim = threads.model.real, threads.module, layout.dim
        self.threads, self.layout, self.grid, self.fastest = threads, layout, grid, fastest
        both = len(scalars) == 2
        self.now = [scalars[0], scalars[1] if both else None]
        self.new, self.less = ([a[:layout.cells], b[:layout.cells] if both else None] for a, b in (work[:2], work[2:]))
        self.count = prod(kernels.tile_counts(layout.n))
        self.holds, self.near = (threads.zeros(self.count, int) for _ in range(2))
        self.speed = threads.zeros(1)
        self.mark_kernel, self.near_kernel = (kernels.tile_mark_kernel(dim, both, real, module),
                                              kernels.near_tile_kernel(dim, real, module))
        self.scheme, self.pairs = scheme, False
        self._make_kernels(scheme, both)

    def _make_kernels(self, scheme: str, both: bool) -> None:
        real, module, dim = self.threads.model.real, self.threads.module, self.layout.dim
        self.carry_kernel = kernels.tile_advection_kernel(dim, scheme, THIRD[scheme], both, real, module)
        self.keep_kernel = kernels.tile_scalar_kernel(dim, both, real, module)
        self.launches = 6

    def mark(self) -> None:
        """Finds the tiles that hold some, of whatever has been put into the scalars."""
        self.holds.zero_()
        self.threads.over(self.mark_kernel, self.layout.cells, [self.grid, *self.now], [self.holds])

    def find_near_tiles(self, u: Any, clock: wp.array) -> None:
        """Finds the tiles that are near, where u carries over a step."""
        threads = self.threads
        blocks = threads.blocks(max(u.x.size, u.y.size, u.z.size if self.layout.dim == 3 else 0))
        self.speed.zero_()
        threads.sum(self.fastest, blocks, [u, blocks * (BLOCK if threads.cuda else 1)], [self.speed])
        threads.over(self.near_kernel, self.count, [self.grid, self.holds, self.speed, clock], [self.near])

    def carry(self, u: Any, clock: wp.array) -> None:
        """The scalars followed back along u over a step."""
        threads, cells = self.threads, self.layout.cells
        self.find_near_tiles(u, clock)
        threads.over(self.carry_kernel, cells, [self.grid, u, *self.now, clock, self.near], self.new)
        self.holds.zero_()
        threads.over(self.keep_kernel, cells, [self.grid, self.near, *self.new], [self.holds, *self.now])
