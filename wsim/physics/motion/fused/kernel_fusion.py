"""Many substeps in one launch: what a substep launches, kernel by kernel, becomes one kernel that goes through all of them.

A launch costs a GPU 2 microseconds, and a substep of explicit cloth has five to a dozen launches over a few thousand threads;
a meeting of the threads that stay costs a fraction of it. So the launches of the substeps of a frame are written down
(`recorder`), and where they differ in numbers alone (`program`), one kernel (`source`) takes them: the same functions over
the same arrays in the same order, hence the same bits (tets in float64 alone differ in the last digits on CUDA). What does
not fit is launched as ever, and the plan says why.

On a CPU, where a launch costs little, the gain is in threads: they share each phase (kernels/motion/fast_paths/thread_team.py).
Kernels that are only parts of the fused one are compiled separately as well; this takes a twentieth of a first frame.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.motion.fast_paths.threads import MOST as MOST_THREADS
from wsim.model.structs import struct_leaves
from wsim.physics.cloth.kind import SPRINGS
from wsim.physics.motion.fast_paths.threads import Abreast, count_cores
from wsim.physics.motion.fused.persistent_kernel import Program, array_identity, is_struct, longest_run
from wsim.physics.motion.fused.recorder import LaunchRecorder, Op, recorded_launches
from wsim.physics.motion.fused.source import GRID, TEAM, LaunchShape, make_fused_kernel
from wsim.scene import Surface
from wsim.scene.methods import has_tets, solid_materials

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
# (1705) 36, 28; the shirt (6436) hung 25.8, 22.9, on its dummy, a mesh, with lists of candidates 65, 87 (94, 102 without)
MOST = 8192
SHARE = 100            # items of the widest phase that a CPU thread is worth


def shape_of(device, widest: int) -> LaunchShape:
    """Blocks and threads of a device for the widest phase of a program."""
    if not device.is_cuda:
        return LaunchShape(TEAM, 1, min(count_cores(), MOST_THREADS, max(1, widest // SHARE)))
    if widest <= device.sm_count * FEWER:
        return LaunchShape(GRID, device.sm_count, FEWER)
    return LaunchShape(GRID, device.sm_count, THREADS // 2)


class Fuser:
    """Makes one launch of many substeps of a model. `why` says what it does, or why it does not."""

    def __init__(self, model: Model, shape: LaunchShape | None = None):
        self.model, self.shape = model, shape
        self.known: dict[tuple, set] = {}        # numbers that change, by form of a frame
        self.kernels: dict[tuple, Any] = {}
        self.tried, self.why = False, "nothing was tried"
        self.word = wp.zeros(1, dtype=int, device=model.device)
        self.phases, self.launched = 0, 0        # phases of a substep; launches of many substeps so far
        self.teams: dict[Any, Abreast] = {}      # CPU threads of a kernel
        self.sent: dict[tuple, tuple] = {}       # and what they are sent to, by form of a frame

    def prepare(self, plan) -> None:
        """Makes the kernels of a plan's frames, before they are compiled."""
        self.clock = clock = plan.clock
        model = self.model
        kept = {name: getattr(clock, name) for name in ("substeps", "k", "i", "starting", "free", "after_free")}
        forms = [True, False] if plan.parted else [clock.free]
        model.recorder = LaunchRecorder(model)
        self.tried = True
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
        steps = split_last_launches(recorded_launches(self.model, run, first, last))
        a, b = longest_run(steps)
        found = self.kernel(steps[a:b]) if b - a >= LEAST else None
        if self.tried:
            return
        for step in steps[:a]:
            _launch_all(step)
        if found:
            kernel, given, shape = found
            self.launched += 1
            if shape.kind == TEAM:
                self.walk(kernel, given, shape, b - a)
            else:
                self.fly(kernel, given, shape, b - a)
        else:
            for step in steps[a:b]:
                _launch_all(step)
        for step in steps[b:]:
            _launch_all(step)

    def fly(self, kernel, given: list, shape: LaunchShape, count: int) -> None:
        """Launches a kernel of so many substeps."""
        if shape.kind == GRID:
            self.word.zero_()
        how: dict[str, Any] = {"block_dim": shape.threads} if self.model.device.is_cuda else {}
        wp.launch(kernel, shape.lanes, [count, shape.lanes, self.word, *given], device=self.model.device, **how)

    def walk(self, kernel, given: list, shape: LaunchShape, count: int) -> None:
        """Launches a kernel of so many substeps on a CPU, which other threads join."""
        team, key = self.teams[kernel], (count, *map(argument_contents, given))

        def launch_fused(team) -> None:
            wp.launch(kernel, 1, [count, team, *given], device=self.model.device)
        launch_fused(team.lead(key))
        self.sent[self.form()] = team, key, launch_fused

    def form(self) -> tuple:
        """Form of the frame to come."""
        return self.clock.free, self.clock.starting, self.clock.after_free

    def send(self, clock) -> None:
        """Sends other threads to the frame to come, if it is launched as one before."""
        if self.form() in self.sent:
            team, key, launch = self.sent[self.form()]
            team.send(key, launch)

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
        shape = self.shape or shape_of(self.model.device, program.widest_phase)
        if shape.kind == GRID and (len(program.phases) == 1 or program.widest_phase > LARGEST):
            self.why = "a launch for each pass: launches are not what counts"
            return None
        kernel, given = make_fused_kernel(program, self.model.real, shape, self.module(shape))
        key = form, kernel
        if self.tried:
            self.kernels[key] = kernel
            if shape.kind == TEAM and kernel not in self.teams:
                self.teams[kernel] = Abreast(self.model, np.zeros((shape.threads, 4), int))
            self.phases = len(program.phases)
            self.why = self.words(shape, steps[0])
        elif key not in self.kernels:
            self.why = "what a frame launches was not known when kernels were compiled"
            return None
        return kernel, given, shape

    def module(self, shape: LaunchShape) -> str:
        """Module of the kernel: apart from those that it is made of."""
        if shape.kind == TEAM:
            return self.model.module
        name = f"{self.model.module}_fused_{shape.kind}{shape.blocks}x{shape.threads}"
        self.model.modules[name] = shape.threads
        return name

    def words(self, shape: LaunchShape, ops: list[Op]) -> str:
        blocks = f" of {shape.blocks} blocks" * (shape.kind != TEAM) + f" of {shape.threads} threads" * (shape.threads > 1)
        return f"substeps in one launch{blocks}: {len(ops)} kernels in {self.phases} phases"


def fusing_pays(model: Model) -> bool:
    """True where the fused form is the default: see MOST."""
    scene = model.scene
    elements = has_tets(scene) or any(r.row.gather != SPRINGS for r in model.constraints if not r.hard)
    meshes = any(isinstance(c.shape, Surface) for c in scene.colliders)
    return elements and not model.gradients and (not model.device.is_cuda or model.points <= MOST and not meshes)


def split_last_launches(steps: list[list[Op]]) -> list[list[Op]]:
    """Launches of substeps; what the last one has besides those of the others stands by itself."""
    many = len(steps[-2]) if len(steps) > 1 else 0
    same = [op.form for op in steps[-1][:many]] == [op.form for op in steps[-2]] if many else False
    return [*steps[:-1], steps[-1][:many], steps[-1][many:]] if same and len(steps[-1]) > many else steps


def argument_contents(value: Any) -> tuple:
    """The same for arguments of the same arrays and numbers."""
    if value is None or isinstance(value, wp.array):
        return array_identity(value)
    if is_struct(value):
        return tuple(array_identity(v) if v is None or isinstance(v, wp.array) else float(v)
                     for _, v in struct_leaves(value).values())
    return tuple(map(float, value)) if hasattr(value, "__len__") else (float(value),)


def _launch_all(step: list[Op]) -> None:
    for op in step:
        op.launch()


def why_not_fused(model: Model, reasons: dict[str, str]) -> str:
    """Reason why the substeps of explicit steps are not fused, or "". reasons: of methods, as `wsim.simulation.methods.Build`.
    """
    if model.gradients:
        return "gradients are recorded launch by launch"
    if any(m.yield_strain < inf for m in solid_materials(model.scene)):
        return "tets flow"
    if model.device.is_cuda and any(isinstance(c.shape, Surface) and c.shape.poses is not None for c in model.scene.colliders):
        return "a mesh deforms, whose tree is fitted launch by launch"
    if model.scene.colliders:
        from wsim.physics.contact import contacts, free_flight_test
        if free_flight_test.count_bounded_colliders(model.scene) >= contacts.MANY:
            return "so many colliders that a tree finds them, which is fitted launch by launch"
    others = sorted(name for name, reason in reasons.items() if reason and name not in KNOWN)
    return f"{', '.join(others)} cannot be fused" if others else ""


KNOWN = {"points", "pins", "explicit", "aero", "xpbd", "contact", "watch", "volume", "bones"}
