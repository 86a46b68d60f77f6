"""Smoke and heat of a fluid that keep their sums: kernels/fluid/passes/conserve.py."""

from typing import Any

import warp as wp

from wsim.kernels.fluid.passes import conserve as kernels
from wsim.physics.fluid.grid.tiles import Tiles


class Conserved(Tiles):
    """Carrying of scalars like that of `Tiles`, by limited cubics. work: two arrays for each of the scalars."""

    def _make_kernels(self, scheme: str, both: bool) -> None:
        threads, dim = self.threads, self.layout.dim
        real, module = threads.model.real, threads.module
        self.carry_kernel, self.sums = (kernels.conservative_advect_kernel(dim, real, module),
                                        kernels.conserved_sum_kernel(dim, real, module))
        self.share, self.keep_kernel = (kernels.correction_share_kernel(module),
                                        kernels.conserved_scalar_kernel(dim, real, module))
        self.parts = threads.zeros(threads.blocks(self.layout.cells), wp.vec3d)
        self.shares = threads.zeros(2, wp.float64)
        self.launches = 4 + 4 * (1 + both)

    def carry(self, u: Any, clock: wp.array) -> None:
        self.find_near_tiles(u, clock)
        self.holds.zero_()
        for q, new, less in zip(self.now, self.new, self.less, strict=True):
            if q is not None:
                self._carry_one(u, clock, q, new, less)

    def _carry_one(self, u: Any, clock: wp.array, q: wp.array, new: wp.array, less: wp.array) -> None:
        threads, cells = self.threads, self.layout.cells
        threads.over(self.carry_kernel, cells, [self.grid, u, q, clock, self.near], [new, less])
        threads.sum(self.sums, self.parts.size, [self.grid, self.near, q, new, less], [self.parts])
        threads.sum(self.share, 1, [self.parts], [self.shares])
        threads.over(self.keep_kernel, cells, [self.grid, self.near, new, less, self.shares], [self.holds, q])
