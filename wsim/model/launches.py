"""How a model's kernels are launched: at once, into a tape, or written down for one launch of many.

    tape        `wsim.model.tape.Tape`, of recordings with gradients
    recorder    `wsim.physics.fused.recorder.Recorder`: nothing is launched, and what would be is written down
    fuser       `wsim.physics.fused.fuser.Fuser`, of explicit steps on a GPU: many substeps in one launch
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any


class Launches:
    """Launches of a model's kernels."""

    module: str
    step: str
    modules: dict[str, int]
    device: Any
    tape: Any
    recorder: Any
    fuser: Any
    points: Any
    # Many substeps of explicit steps in one launch. None: where it pays (`wsim.physics.fused.fuser.pays`).
    fuses: bool | None = None

    @property
    def block(self) -> int:
        """Threads of a block on CUDA: small scenes end sooner in small blocks (10k points, 8 colours: 18.2 us with 64,
        18.8 with 128, 20.2 with 256), a million points do not care. One size for a plan: each is compiled apart."""
        return 64 if self.points < 100_000 else 128

    def launch(self, kernel, dim: int | tuple[int, ...], inputs: list, outputs: list) -> None:
        """Launches a kernel of this model's module."""
        from wsim.model.compiler import recorded
        how = {"device": self.device, **({"block_dim": self.block} if self.device.is_cuda else {})}
        (self.recorder or self.tape or recorded).launch(kernel, dim, inputs, outputs, **how)

    def copy(self, into, source, *parts: int) -> None:
        """Copies arrays of vectors, as `wp.copy`."""
        import warp as wp
        (self.recorder or self.tape or wp).copy(into, source, *parts)

    def zero(self, array) -> None:
        """Zeros an array; no version of it: see `wsim.model.tape`."""
        (self.recorder.zero if self.recorder else type(array).zero_)(array)

    def repeat(self, run: Callable[[int], Any], first: int, last: int) -> None:
        """Calls `run(k)`, which launches substep k, for first .. last - 1; or makes fewer launches of what it launches."""
        if self.fuser and not self.tape:
            self.fuser.repeat(run, first, last)
            return
        for k in range(first, last):
            run(k)

    def together(self):
        """A block of launches that need nothing of each other."""
        return self.recorder.together() if self.recorder else nullcontext()

    @property
    def sweep_module(self) -> str:
        """Module of kernels that a block runs by itself. CUDA compiles a module for each block size, so they stand apart."""
        return f"{self.module}_sweep" if self.device.is_cuda else self.module

    @property
    def step_modules(self) -> tuple[str, str]:
        """Modules of kernels of a Newton step, and of those of them that a block runs by itself."""
        return (self.step, self.step) if self.step else (self.module, self.sweep_module)

    def sweep(self, kernel, inputs: list, outputs: list, blocks: int = 1) -> None:
        """Launches a kernel of one block, or of so many that do not meet; on the CPU of a thread for each."""
        from wsim.kernels.math.block import BLOCK
        from wsim.model.compiler import recorded
        if self.recorder:
            self.recorder.opaque(lambda: self.sweep(kernel, inputs, outputs, blocks))
        elif self.device.is_cuda:
            self.launch_blocks(kernel, blocks, BLOCK, inputs, outputs)
        else:
            recorded.launch(kernel, blocks, inputs, outputs, device=self.device)

    def module_of(self, threads: int, part: str = "") -> str:
        """Module of kernels with blocks of so many threads, on CUDA. part: name of one of several, compiled side by side."""
        name = f"{self.module}_{threads}" + f"_{part}" * bool(part)
        self.modules[name] = threads
        return name

    def launch_blocks(self, kernel, blocks: int, threads: int, inputs: list, outputs: list) -> None:
        """Launches so many blocks of a kernel on CUDA."""
        import warp as wp
        if self.recorder:
            self.recorder.opaque(lambda: self.launch_blocks(kernel, blocks, threads, inputs, outputs))
            return
        wp.launch(kernel, blocks * threads, inputs, outputs, device=self.device, block_dim=threads)

    def load(self) -> None:
        """Compiles the kernels that the plan has made, once: before the first launch, since a capture cannot."""
        import warp as wp

        from wsim.kernels.math.block import BLOCK
        from wsim.model import kernel_cache
        cuda = self.device.is_cuda
        own = {self.module: self.block, self.sweep_module: BLOCK} if cuda else {self.module: 1}
        blocks = {name: block for name, block in own.items() if wp.get_module(name).kernels} | self.modules
        if len(blocks) > 1:                                    # rods alone have all theirs in modules of their own
            from wsim.model.compiler.parallel import compile_all
            compile_all(blocks, self.device)
        for name, block in blocks.items():
            kernel_cache.load(name, self.device, block)


class LaunchList:
    """Launches in order with arguments that do not change, packed once and issued before every frame."""

    def __init__(self, device, launches: list[tuple]):
        """launches: (kernel, dim, inputs, outputs) each; their modules are loaded, and their arrays live as long as this."""
        import warp as wp
        self.held = launches
        self.each = [wp.launch(kernel, dim, inputs, outputs, device=device, record_cmd=True)
                     for kernel, dim, inputs, outputs in launches]

    def launch(self) -> None:
        for each in self.each:
            each.launch()
