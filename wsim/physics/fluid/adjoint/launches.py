"""Launches of the adjoints of a fluid, in a module of their own, and the sums that numbers of a scene get."""

from typing import Any

import warp as wp

from wsim.kernels.fluid.adjoint import forces, reflection
from wsim.kernels.fluid.forces import NUMBERS
from wsim.model import kernel_cache
from wsim.model.structs import fill_struct
from wsim.physics.fluid.grid.multigrid import AXES
from wsim.physics.fluid.grid.threads import BLOCK

AIR, ROWS = NUMBERS, 7                    # of `numbers`: live ones of the fluid, then those of the air around and the sides
PLAIN, TIMED = -1, -2                     # what `collect` multiplies by: 1, the length of the step; else that times a number


class AdjointLaunches:
    """numbers: what live numbers and the velocities of air and sides get, summed over steps, (NUMBERS + 21,) float64."""

    def __init__(self, domain: Any):
        self.domain, self.threads = domain, domain.threads
        threads, self.real = domain.threads, domain.threads.model.real
        self.module = f"{threads.module}_back"
        self.over, self.blocks = threads.over, threads.sum
        self.parts = threads.blocks(max(*domain.sizes, domain.layout.cells))
        self.part = threads.zeros(self.parts, wp.vec2d)
        self.numbers = threads.zeros(NUMBERS + 3 * ROWS, wp.float64)
        self.sum_kernel, self.collect_kernel = (forces.field_sum_kernel(self.real, self.module),
                                                forces.collect_gradient_kernel(self.real, self.module))
        self.add_kernel, self.keep, self.fetch = (make(self.real, self.module) for make in (
            reflection.row_addition_kernel, reflection.step_storage_kernel, reflection.step_fetch_kernel))

    def load(self) -> None:
        """Compiles the module, once all its kernels are made."""
        kernel_cache.load_kernel_module(self.module, self.threads.model.device, BLOCK if self.threads.cuda else None)

    def collect(self, by: int, factor: float, slot: int, other: int = -1) -> None:
        """The parts of a sum, times a factor, into slots of `numbers`."""
        self.over(self.collect_kernel, 1, [self.part, self.domain.live, self.domain.clock, by, wp.float64(factor), slot, other],
                  [self.numbers])

    def sum(self, a: wp.array, by: int, factor: float, slot: int) -> None:
        self.blocks(self.sum_kernel, self.parts, [a], [self.part])
        self.collect(by, factor, slot)

    def dot(self, a: wp.array, b: wp.array, by: int, factor: float, slot: int) -> None:
        self.blocks(self.domain.pressure.solver.dot, self.parts, [a, b], [self.part])
        self.collect(by, factor, slot)

    def add(self, x: wp.array, y: wp.array, factor: float = 1.0) -> None:
        """y += factor x."""
        self.over(self.add_kernel, y.size, [x, self.real(factor)], [y])

    # faces

    def each(self, *faces: Any):
        """(axis, arrays of these faces) of the grid's axes."""
        for a in range(self.domain.layout.dim):
            yield (a, *(getattr(f, AXES[a]) for f in faces))

    def zero(self, faces: Any) -> None:
        for _, array in self.each(faces):
            array.zero_()

    def copy(self, source: Any, into: Any) -> None:
        for _, a, b in self.each(source, into):
            wp.copy(b, a)

    def struct(self, Struct: Any, **values: Any) -> Any:
        return fill_struct(Struct, **values)


def air_number_slot(row: int, axis: int) -> int:
    """Slot of `numbers`: a component of a row of the air (0: the wind; 1 + 2 a, 2 + 2 a: the sides of an axis)."""
    return AIR + 3 * row + axis
