"""Advection of one quantity of a fluid by the scheme that is asked for: kernels/fluid/advection.py."""

from dataclasses import dataclass
from typing import Any

import warp as wp

from wsim.kernels.fluid import advection as kernels
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.threads import Threads

PAIRS = ("maccormack", "bfecc")
THIRD = {"cubic": True, "linear": True, "maccormack": False, "bfecc": False}      # of scalars: way back of order 3


@dataclass(frozen=True)
class AdvectionScheme:
    """scheme: of advection. clamped: what cubic rows give is kept within those around. pushed: what lifts the air on the way,
    by schemes that carry nothing back: "smoke", "heat", "smoke_heat", "" of `lifting`. sharp: velocities on the way back
    are cubics too."""

    scheme: str
    clamped: bool = True
    sharp: bool = False
    pushed: str = ""
    lifting: Any = None


class Transport:
    """axis: of a component, -1 of a scalar. work: arrays r and z, for what is carried there and back by schemes that do."""

    def __init__(self, threads: Threads, layout: Layout, grid: Any, axis: int, how: AdvectionScheme, work: dict[str, wp.array]):
        real, module, dim, scheme = threads.model.real, threads.module, layout.dim, how.scheme
        self.threads, self.grid, self.scheme, self.work = threads, grid, scheme, work
        self.lifting = how.lifting or kernels.buoyancy_inputs(real)()
        self.pairs = scheme in PAIRS
        shape, third = "cubic" if scheme == "cubic" else "linear", axis < 0 and THIRD[scheme]
        self.advect = kernels.advection_kernel(dim, axis, (shape, shape == "cubic" and how.clamped, third, how.sharp),
                                               how.pushed, real, module)
        if self.pairs:
            self.correct = kernels.maccormack_kernel(dim, axis, scheme == "bfecc", real, module)
            self.compensate = kernels.bfecc_kernel(real, module)

    def carry(self, u: Any, q: wp.array, clock: wp.array, part: float, out: wp.array) -> None:
        """q followed back along u over `part` of the step, into `out`."""
        real, n, over = self.threads.model.real, q.size, self.threads.over

        def advect_pass(q: wp.array, part: float, out: wp.array) -> None:
            over(self.advect, n, [self.grid, u, q, self.lifting, clock, real(part)], [out])
        if not self.pairs:
            advect_pass(q, part, out)
            return
        ahead, turned = (self.work[name][:n] for name in ("r", "z"))
        advect_pass(q, part, ahead)
        advect_pass(ahead, -part, turned)
        if self.scheme == "bfecc":
            over(self.compensate, n, [q, turned], [turned])
            advect_pass(turned, part, ahead)
        over(self.correct, n, [self.grid, u, q, ahead, turned, clock, real(part)], [out])
