"""Guards parts of the state but the points, which have a stage of their own: a frame that leaves a value in them that is not
finite is repeated with smaller substeps, and refused by prim path in the end."""

import warp as wp

from wsim.kernels.math.finite import finite_check_kernel
from wsim.kernels.math.real import types
from wsim.model.model import Model
from wsim.model.stage import Clock, Method, Remedy, Stage
from wsim.model.state import StatePart
from wsim.model.status import FrameStatus

THREADS = 1 << 18        # that look at numbers: one each takes an H200 203 us for 17M of them, where a copy takes 31


class FiniteGuard(Method):
    def __init__(self, model: Model, parts: list[StatePart], status: FrameStatus):
        super().__init__("guard")
        self.model, self.status, self.parts = model, status, parts
        own = {real for _, (_, _, _, real) in self.flat()}         # of some parts another precision than the simulation's
        self.kernels = {real: finite_check_kernel(real,
                                                  model.module if real is model.real else f"wsim_guard_{types(real).name}")
                        for real in own}
        model.modules.update({k.module.name: model.block for k in self.kernels.values() if k.module.name != model.module})
        for part in parts:
            status.reserve(_guard_word(part.name))
        size = sum(numbers.capacity for _, (numbers, _, _, _) in self.flat())
        self.stages.append(Stage("guard of parts", "deform", self.look, len(self.flat()), size, "frame",
                                 ", ".join(p.name for p in parts)))

    def flat(self) -> list[tuple[str, tuple[wp.array, int, int, type]]]:
        """Part and what `_flat_numbers` says of its arrays, as they are now: lists grow by new ones."""
        return [(p.name, _flat_numbers(self.model, array, p.capacity)) for p in self.parts for array, _ in p.copies()
                if array.dtype not in (wp.int32, wp.int64)]

    def look(self, clock: Clock) -> None:
        for name, (numbers, width, rows, real) in self.flat():
            threads = min(numbers.size, THREADS if self.model.device.is_cuda else 1)
            self.model.launch(self.kernels[real], threads, [numbers, threads, width, rows],
                              [self.status.word(_guard_word(name))])

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        bad = {p.name: int(status.said(_guard_word(p.name))[0]) for p in self.parts}
        return [Remedy("refine", part=name, row=word - 1) for name, word in bad.items() if word]


def _guard_word(part: str) -> str:
    return f"{part}: not finite"


def _flat_numbers(model: Model, array: wp.array, rows: int) -> tuple[wp.array, int, int, type]:
    """The same memory as numbers, how many a row has, the rows of a field, and the type of its numbers."""
    width, real = wp.types.type_size(array.dtype), getattr(array.dtype, "_wp_scalar_type_", array.dtype)
    numbers = wp.array(ptr=array.ptr, dtype=real, shape=array.size * width, device=array.device, copy=False)
    return numbers, width, rows, real
