"""How a model's kernels are launched: at once, into a tape, written down for one launch of many, or in a loop that the device
counts.

    tape        `wsim.model.tape.Tape`, of recordings with gradients
    recorder    `wsim.physics.motion.fused.recorder.LaunchRecorder`: nothing is launched, and what would be is written down
    fuser       `wsim.physics.motion.fused.kernel_fusion.Fuser`, of explicit steps on a GPU: many substeps in one launch
    Loop        substeps that launch the same: a graph has the launches of three of them, not of all
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from contextlib import nullcontext
from math import prod
from typing import Any

# Compute capability, and the fewest multiprocessors, on which clusters of 16 blocks were run; clusters of 8 fit everywhere.
LARGE_CLUSTER_ARCH, LARGE_CLUSTER_PROCESSORS = 90, 64


def has_large_clusters(device) -> bool:
    """True if clusters of 16 blocks were run on such a device."""
    return device.arch == LARGE_CLUSTER_ARCH and device.sm_count >= LARGE_CLUSTER_PROCESSORS


class KernelLaunches:
    """Launches of a model's kernels."""

    module: str
    step: str
    modules: dict[str, int]
    device: Any
    real: Any
    tape: Any
    recorder: Any
    fuser: Any
    points: Any
    # Many substeps of explicit steps in one launch. None: where it pays
    # (`wsim.physics.motion.fused.kernel_fusion.fusing_pays`).
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

    def shared_module(self, part: str, *what, threads: int = 0) -> str:
        """Module of kernels that depend on nothing of a scene but `what`: the cache of kernels has it once for all scenes.
        threads: of a block, on CUDA; 0: as other kernels have. part: its kernels, in a word."""
        digest = hashlib.blake2b(repr((self.real.__name__, *what)).encode(), digest_size=6).hexdigest()
        name = f"wsim_{part}_{digest}"
        self.modules[name] = (threads or self.block) if self.device.is_cuda else 1
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
            kernel_cache.load_kernel_module(name, self.device, block)


FEW = 4                  # launches of a list from which a GPU takes them as a graph


class LaunchList:
    """Launches in order with arguments that do not change, packed once and issued before every frame.

    seconds     that kernels of all lists took on a CPU, where a launch returns when they are done: no time of the host's own"""

    seconds = 0.0

    def __init__(self, device, launches: list[tuple]):
        """launches: (kernel, dim, inputs, outputs) each; their modules are loaded, and their arrays live as long as this."""
        import warp as wp
        self.held, self.device, self.graph = launches, device, None      # type: list[tuple], Any, Any
        self.each = [wp.launch(kernel, dim, inputs, outputs, device=device, record_cmd=True)
                     for kernel, dim, inputs, outputs in launches]

    def launch(self) -> None:
        began = time.perf_counter()
        if self.device.is_cuda and len(self.each) >= FEW and not self.device.is_capturing:
            self.replay_as_graph()
            return
        for each in self.each:
            each.launch()
        if self.device.is_cpu:
            LaunchList.seconds += time.perf_counter() - began

    def replay_as_graph(self) -> None:
        """Launches a graph of all: a launch of a packed kernel takes Python 10 us, and so does a graph."""
        import warp as wp

        from wsim.model import kernel_cache
        if self.graph is None:
            with kernel_cache.capture_graph(self.device) as capture:
                for each in self.each:
                    each.launch()
            self.graph = capture.graph
        wp.capture_launch(self.graph)


LOOP_LAUNCHES = 1000     # launches of a frame from which substeps are a loop on the device: a GPU captures 30 in a millisecond
PEELED = 3               # substeps whose launches the graph of a loop has
ROOM, OF_POINT, OF_COLLIDER = 1 << 20, 256, 1024       # bytes for rows of tables that a loop reads; more for each of these


def loop_of(plan) -> SubstepLoop | None:
    """The loop of a plan's substeps; None where these differ from each other, or launch little."""
    methods = [m for m in plan.methods if any(s.rate != "frame" for s in m.stages)]
    if plan.model.fuser or plan.model.gradients or not all(m.alike for m in methods):
        return None
    launches = sum(row["launches"] for row in plan.table() if row["rate"] != "frame")
    return SubstepLoop(plan.model, plan.clock) if plan.clock.substeps * launches > LOOP_LAUNCHES else None


class SubstepLoop:
    """Substeps of a frame but the first and the last, as the body of a loop on the device. Tables with a row for each substep
    are read by `Clock.read_rows`."""

    def __init__(self, model: Any, clock):
        import warp as wp

        from wsim.kernels.math import loop
        self.model, self.clock, self.count, self.pick = model, clock, loop.substep_count_kernel(), loop.row_pick_kernel()
        model.modules[loop.MODULE] = model.block
        self.number, self.going = (wp.zeros(1, dtype=int, device=model.device) for _ in range(2))
        self.first = 0                                     # substep that the body begins with
        self.windows: dict[tuple, tuple] = {}              # by table and rows: table, window, both as whole numbers
        # on a GPU, where a loop's body cannot allocate memory
        bytes = ROOM + OF_POINT * model.points + OF_COLLIDER * len(model.scene.colliders)
        room = bytes // 4 if model.device.is_cuda else 0
        self.room = wp.zeros(room, dtype=int, device=model.device)
        self.used = 0                                      # whole numbers of `room`

    def repeat(self, run: Callable[[int], Any], first: int, last: int) -> None:
        """Calls `run(k)`, which launches substep k, for the first, the last and one for all between."""
        import warp as wp
        if last - first <= PEELED:
            self.model.repeat(run, first, last)
            return
        run(first)
        self.first = first + 1
        self.number.fill_(self.first)
        self.going.fill_(1)
        self.clock.loop = self
        try:
            wp.capture_while(self.going, lambda: self._body(run, self.first, last - 1))
        finally:
            self.clock.loop = None
        run(last - 1)

    def _body(self, run: Callable[[int], Any], k: int, last: int) -> None:
        run(k)
        self.model.launch(self.count, 1, [last], [self.number, self.going])

    def rows(self, table, count: int):
        """Rows of a table from that of the present substep on, in an array of their own."""
        import warp as wp
        key = table.ptr, table.shape, table.dtype, count
        if key not in self.windows:
            window = self._window_of_table((count, *table.shape[1:]), table)
            views = [wp.array(ptr=a.ptr, dtype=int, shape=(len(a), a.strides[0] // 4), device=a.device)
                     for a in (table, window)]
            self.windows[key] = table, window, *views
        _, window, source, into = self.windows[key]
        self.model.launch(self.pick, into.shape, [source, self.number], [into])
        return window

    def _window_of_table(self, shape: tuple[int, ...], table):
        """An array of the type of a table, on a GPU cut from `room`."""
        import warp as wp
        if not table.device.is_cuda:
            return wp.zeros(shape, dtype=table.dtype, device=table.device)
        size = -(-prod(shape) * wp.types.type_size_in_bytes(table.dtype) // 16) * 4               # begins at 16 bytes
        if self.used + size > self.room.size:
            raise RuntimeError(f"a loop over substeps reads rows of {4 * (self.used + size)} bytes, and has room for "
                               f"{4 * self.room.size}: raise ROOM in wsim/model/launches.py")
        self.used += size
        return wp.array(ptr=self.room.ptr + 4 * (self.used - size), dtype=table.dtype, shape=shape, device=table.device)
