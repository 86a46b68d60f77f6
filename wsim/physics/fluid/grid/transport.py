"""Advection of one quantity of a fluid by the scheme that is asked for: kernels/fluid/advection.py."""

from typing import Any

import warp as wp

from wsim.kernels.fluid import advection as kernels
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.threads import Threads

THIRD = {"cubic": True, "linear": True, "maccormack": False, "bfecc": False}      # of scalars: way back of order 3


class Transport:
    """axis: of a component, -1 of a scalar. clamped: what cubic rows give is kept within those around. work: arrays r and z,
    for what is carried there and back by schemes that do."""

    def __init__(self, threads: Threads, layout: Layout, grid: Any, axis: int, scheme: str, work: dict[str, wp.array],
                 clamped: bool = True):
        real, module, dim = threads.model.real, threads.module, layout.dim
        self.threads, self.grid, self.scheme, self.work = threads, grid, scheme, work
        self.pairs = scheme in ("maccormack", "bfecc")
        shape, third = "cubic" if scheme == "cubic" else "linear", axis < 0 and THIRD[scheme]
        self.advect = kernels.advect(dim, axis, shape, shape == "cubic" and clamped, third, real, module)
        if self.pairs:
            self.correct = kernels.correct(dim, axis, scheme == "bfecc", real, module)
            self.compensate = kernels.compensate(real, module)

    def carry(self, u: Any, q: wp.array, clock: wp.array, part: float, out: wp.array) -> None:
        """q followed back along u over `part` of the step, into `out`."""
        real, n, over = self.threads.model.real, q.size, self.threads.over
        if not self.pairs:
            over(self.advect, n, [self.grid, u, q, clock, real(part)], [out])
            return
        ahead, turned = (self.work[name][:n] for name in ("r", "z"))
        over(self.advect, n, [self.grid, u, q, clock, real(part)], [ahead])
        over(self.advect, n, [self.grid, u, ahead, clock, real(-part)], [turned])
        if self.scheme == "bfecc":
            over(self.compensate, n, [q, turned], [turned])
            over(self.advect, n, [self.grid, u, turned, clock, real(part)], [ahead])
        over(self.correct, n, [self.grid, u, q, ahead, turned, clock, real(part)], [out])
