"""Launches that are written down instead of made: what a `wsim.physics.motion.fused.kernel_fusion.Fuser` makes one launch
of."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import warp as wp

from wsim.kernels.motion.fused import body

if TYPE_CHECKING:
    from wsim.model.model import Model


@dataclass(eq=False)
class Op:
    """One launch of a kernel over `dim` threads; kernel None: something that no other kernel can run."""

    kernel: Any
    dim: int
    args: list
    launch: Callable[[], Any]
    beside: bool = False          # needs nothing that the one before writes, nor writes what that one reads

    @property
    def form(self) -> tuple:
        """Kernel and threads of a launch, which are the same where one kernel runs many of it."""
        return self.kernel, self.dim, self.beside


class LaunchRecorder:
    """Takes launches in the place of Warp, see `wsim.model.model.Model.recorder`."""

    def __init__(self, model: Model):
        self.model, self.ops = model, list[Op]()
        self.group, self.open = 0, False          # of launches that do not wait for each other

    def add(self, kernel, dim: int, args: list, launch: Callable) -> None:
        self.ops.append(Op(kernel, dim, args, launch, self.open and self.group > 0))
        self.group += 1

    def launch(self, kernel, dim, inputs: list, outputs: list, **how) -> None:
        self.add(kernel if isinstance(dim, int) else None, dim, [*inputs, *outputs],
                 partial(wp.launch, kernel, dim, inputs, outputs, **how))

    def copy(self, into: wp.array, source: wp.array, to: int = 0, first: int = 0, count: int = 0) -> None:
        """A copy of vectors, like `wp.copy`."""
        count = count or source.size - first
        self.add(body.copy_array_kernel(source.dtype), count, [source, to, first, into],
                 partial(wp.copy, into, source, to, first, count))

    def zero(self, array: wp.array) -> None:
        if array.size:
            self.add(body.zero_array_kernel(array.dtype), array.size, [array], array.zero_)

    def opaque(self, launch: Callable) -> None:
        """Something that is launched by itself."""
        self.add(None, 0, [], launch)

    @contextmanager
    def together(self) -> Iterator[None]:
        """Launches that need nothing of each other."""
        self.group, self.open = 0, True
        yield
        self.open = False


def recorded_launches(model: Model, run: Callable[[int], Any], first: int, last: int) -> list[list[Op]]:
    """Launches of `run(k)` for each k, in order."""
    steps, before = [], model.recorder
    for k in range(first, last):
        model.recorder = LaunchRecorder(model)
        try:
            run(k)
            steps.append(model.recorder.ops)
        finally:
            model.recorder = before
    return steps
