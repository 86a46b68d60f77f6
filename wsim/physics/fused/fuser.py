"""Many substeps in one launch: what a substep launches, kernel by kernel, becomes one kernel that goes through all of them.

A launch costs a GPU 2 microseconds, and a substep of explicit cloth has five to a dozen launches over a few thousand threads;
a meeting of the threads that stay costs a fraction of it. So the launches of the substeps of a frame are written down
(`recorder`), and where they differ in numbers alone (`program`), one kernel (`source`) takes them: the same functions over
the same arrays in the same order, hence the same bits (tets in float64 alone differ in the last digits on CUDA). What does
not fit is launched as ever, and the plan says why.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import TYPE_CHECKING, Any

import warp as wp

from wsim.physics.cloth.kind import SPRINGS
from wsim.physics.fused.program import Program, longest
from wsim.physics.fused.recorder import Op, Recorder, recorded
from wsim.physics.fused.source import ALONE, GRID, Shape, make
from wsim.scene import Surface

if TYPE_CHECKING:
    from wsim.model.model import Model

LEAST = 4              # substeps that one launch takes at least
TRIED = 8              # substeps from which the kernels of a frame follow
# threads of a block, one for each multiprocessor. H200, few threads a point, ms a frame: sheet of 33 x 33, 203 substeps: apart
# 3.66, cluster of 16 x 512 3.51, 16 x 256 3.23, 66 blocks x 128 2.78, 132 x 128 2.73; the shirt, 2983: apart 79, 132 x 256 61,
# 132 x 512 87, the cluster 142
THREADS, FEWER = 512, 128
LARGEST = 200_000      # items of a phase from which launches are no more what counts
# points up to which it is the default, of elements on anything but a mesh. H100, ms a frame, launched and fused: squeezed cube
# (343 points) 9.3, 6.3; flag (925) 9.2, 6.9; bear (961) 1.6, 1.0; sheet of 33 x 33 (1089) 3.7, 3.2, damped 21.3, 17.4; cape
# (1705) 36, 28; the shirt (6436) hung 25.8, 22.9, on its dummy, a mesh, 94, 102
MOST = 8192


def shape_of(device, widest: int) -> Shape:
    """Blocks and threads of a device for the widest phase of a program."""
    if not device.is_cuda:
        return Shape(ALONE, 1, 1)
    if widest <= device.sm_count * FEWER:
        return Shape(GRID, device.sm_count, FEWER)
    return Shape(GRID, device.sm_count, THREADS // 2)


class Fuser:
    """Makes one launch of many substeps of a model. `why` says what it does, or why it does not."""

    def __init__(self, model: Model, shape: Shape | None = None):
        self.model, self.shape = model, shape
        self.known: dict[tuple, set] = {}        # numbers that change, by form of a frame
        self.kernels: dict[tuple, Any] = {}
        self.tried, self.why = False, "nothing was tried"
        self.word = wp.zeros(1, dtype=int, device=model.device)
        self.phases, self.launched = 0, 0        # phases of a substep; launches of many substeps so far

    def prepare(self, plan) -> None:
        """Makes the kernels of a plan's frames, before they are compiled."""
        clock, model = plan.clock, self.model
        kept = {name: getattr(clock, name) for name in ("substeps", "k", "i", "starting", "free", "after_free")}
        forms = [True, False] if plan.parted else [clock.free]
        model.recorder, self.tried = Recorder(model), True
        clock.substeps = min(clock.substeps, TRIED)
        try:
            for clock.free in forms:
                for clock.starting in (True, False):
                    plan.stretch(0, clock.substeps)
        finally:
            model.recorder, self.tried = None, False
            for name, value in kept.items():
                setattr(clock, name, value)

    def repeat(self, run: Callable[[int], Any], first: int, last: int) -> None:
        """Does what `run(k)` launches for each k in first .. last - 1."""
        steps = recorded(self.model, run, first, last)
        a, b = longest(steps)
        found = self.kernel(steps[a:b]) if b - a >= LEAST else None
        if self.tried:
            return
        for step in steps[:a]:
            _launch(step)
        if found:
            kernel, given, shape = found
            self.launched += 1
            if shape.kind == GRID:
                self.word.zero_()
            how = {"block_dim": shape.threads} if self.model.device.is_cuda else {}
            wp.launch(kernel, shape.lanes, [b - a, shape.lanes, self.word, *given], device=self.model.device, **how)
        else:
            for step in steps[a:b]:
                _launch(step)
        for step in steps[b:]:
            _launch(step)

    def kernel(self, steps: list[list[Op]]) -> tuple | None:
        """Kernel, arguments and blocks of a run of substeps; None where they are launched as ever."""
        if sum(map(len, steps[:1])) == 0:
            return None
        form = tuple(op.form for op in steps[0])
        program = Program(steps, self.known.get(form))
        if program.why:
            self.why = program.why
            return None
        self.known[form] = program.varying
        shape = self.shape or shape_of(self.model.device, program.widest)
        if shape.kind == GRID and (len(program.phases) == 1 or program.widest > LARGEST):
            self.why = "a launch for each pass: launches are not what counts"
            return None
        kernel, given = make(program, self.model.real, shape, self.module(shape))
        key = form, kernel
        if self.tried:
            self.kernels[key] = kernel
            self.phases = len(program.phases)
            self.why = self.words(shape, steps[0])
        elif key not in self.kernels:
            self.why = "what a frame launches was not known when kernels were compiled"
            return None
        return kernel, given, shape

    def module(self, shape: Shape) -> str:
        """Module of the kernel: apart from those that it is made of."""
        name = f"{self.model.module}_fused_{shape.kind}{shape.blocks}x{shape.threads}"
        self.model.modules[name] = shape.threads
        return name

    def words(self, shape: Shape, ops: list[Op]) -> str:
        blocks = "" if shape.kind == ALONE else f" of {shape.blocks} blocks of {shape.threads} threads"
        return f"substeps in one launch{blocks}: {len(ops)} kernels in {self.phases} phases"


def pays(model: Model) -> bool:
    """True where the fused form is the default: see MOST."""
    scene = model.scene
    elements = bool(scene.softs) or any(r.row.gather != SPRINGS for r in model.constraints if not r.hard)
    return (model.device.is_cuda and elements and model.points <= MOST and not model.gradients
            and not any(isinstance(c.shape, Surface) for c in scene.colliders))


def _launch(step: list[Op]) -> None:
    for op in step:
        op.launch()


def apart(model: Model, reasons: dict[str, str]) -> str:
    """Reason why the substeps of explicit steps are not fused, or "". reasons: of methods, as `wsim.simulation.methods.Build`.
    """
    if model.gradients:
        return "gradients are recorded launch by launch"
    if any(m.yield_strain < inf for soft in model.scene.softs for m in soft.materials):
        return "tets flow"
    others = sorted(name for name, reason in reasons.items() if reason and name not in KNOWN)
    return f"{', '.join(others)} cannot be fused" if others else ""


KNOWN = {"points", "pins", "explicit", "aero", "xpbd", "contact", "watch", "bones"}
