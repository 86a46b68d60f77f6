"""The kernel of a program: its text, its arguments, and the blocks that it is launched over.

A loop over the substeps, in it the phases, and behind each phase all threads wait for each other: those of a block, of a
cluster of blocks, of as many blocks as a GPU has multiprocessors, which are all there at a time, or of a CPU
(kernels/motion/fast_paths/thread_team.py). Threads take the items of a phase in turn, on a CPU a share of them each, whatever
their number; each item is taken by the function of the kernel that launches it otherwise, so that the bits are the same. What
threads of a CPU share in its own way (`part` of its kernel) is a phase of its own.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import warp as wp

from wsim.kernels.math import block
from wsim.kernels.motion.fast_paths import thread_team
from wsim.kernels.motion.fused.body import MODULE, kernel_body
from wsim.model.structs import fill_struct, struct_leaves, struct_values
from wsim.physics.motion.fused.persistent_kernel import Column, Program, ProgramPhase, array_identity, is_struct

WARP = 32              # launches beside each other begin at multiples of it
ALONE, BLOCK, CLUSTER, GRID, TEAM = "alone", "block", "cluster", "grid", "team"
MEETINGS = {ALONE: {"meet": block.no_barrier}, BLOCK: {"meet": block.block_barrier}, CLUSTER: {"meet": block.cluster_barrier},
            GRID: {"meet": block.grid_barrier},
            TEAM: {name: getattr(thread_team, name) for name in ("join", "since", "together", "meet", "leave")}}


@dataclass(frozen=True)
class LaunchShape:
    """Blocks of so many threads, and how they wait for each other."""

    kind: str
    blocks: int
    threads: int

    @property
    def lanes(self) -> int:
        return self.blocks * self.threads


class Text:
    """Arguments and lines of a kernel."""

    def __init__(self, program: Program, real, kind: str):
        self.program, self.real, self.kind = program, real, kind
        more = {"team": thread_team.Team} if kind == TEAM else {"lanes": int, "word": wp.array(dtype=int)}
        self.types: dict[str, Any] = {"count": int, **more}
        self.given: list[Any] = []
        self.names: dict[tuple, str] = {}
        self.bodies: dict[str, Any] = {}
        self.top: list[str] = []             # lines where a substep begins
        self.lines: list[str] = []           # lines of the phases

    def name_argument(self, letter: str, key: tuple, kind: Any, value: Any) -> str:
        """Name of an argument; the same for the same key."""
        if key not in self.names:
            self.names[key] = name = f"{letter}{len(self.names)}"
            self.types[name] = kind
            self.given.append(value)
        return self.names[key]

    def number(self, numbers: Any, key: tuple) -> str:
        """Expression of a number that changes; it is found where a substep begins."""
        kind: Any
        p: list[Any]
        if numbers.kind in (int, wp.int32):
            kind, p = wp.vec4i, [*map(int, numbers.params)]
            step = " + (k - 1) * {0}[3]"
        else:
            kind, p = wp.types.vector(3, numbers.kind), [*map(float, numbers.params[:3])]
            step = ""
        name, local = self.name_argument("n", key, kind, kind(*p)), f"v{len(self.top)}"
        self.top += [f"{local} = wp.where(k % 2 == 1, {name}[1], {name}[2]){step.format(name)}",
                     f"if k == 0:\n            {local} = {name}[0]"]
        return local

    def call(self, number: int, c: Column, variant: int, item: str) -> str:
        """A launch's call for an item."""
        op, found = c.variants[variant], [item]
        for a, (value, kind) in enumerate(zip(op.args, op.kernel.adj.arg_types.values(), strict=True)):
            changing = [name for (p, at, name) in sorted(self.program.varying) if p == number and at == a]
            if value is None or isinstance(value, wp.array):
                found.append(self.name_argument("a", ("array", array_identity(value), str(kind)), kind, value))
            elif item == PART and getattr(value, "_cls", None) is thread_team.Team:
                found.append("team")
            elif is_struct(value):
                found.append(self.struct(number, a, variant, value, kind, changing, c))
            elif changing:
                found.append(self.number(c.numbers[a, ""], (number, a, "")))
            else:
                found.append(self.name_argument("c", ("number", number, a), kind, value))
        name = f"f{number}"
        self.bodies[name] = op.kernel.part if item == PART else kernel_body(op.kernel, number)
        return f"{name}({', '.join(found)})"

    def struct(self, number: int, a: int, variant: int, value, kind, changing: list[str], c: Column) -> str:
        if not changing:
            parts = tuple(array_identity(v) if v is None or isinstance(v, wp.array) else float(v)
                          for _, v in struct_leaves(value).values())
            return self.name_argument("s", ("struct", str(kind), parts), kind, value)
        name = self.name_argument("s", ("struct", number, a, variant), kind, fill_struct(value._cls, **struct_values(value)))
        for part in changing:
            self.top.append(f"{name}.{part} = {self.number(c.numbers[a, part], (number, a, part))}")
        return name

    def calls(self, number: int, item: str, indent: str) -> None:
        """Lines by which an item of a launch is taken: of the variant whose turn it is."""
        c = self.program.columns[number]
        if len(c.variants) == 1:
            self.lines.append(indent + self.call(number, c, 0, item))
            return
        turn = self.number(self.program.turns[number], (number, "turn"))
        for v in range(len(c.variants)):
            self.lines += [f"{indent}if {turn} == {v}:", f"{indent}    {self.call(number, c, v, item)}"]

    def size(self, name: tuple, value: int) -> str:
        return self.name_argument("m", name, int, value)

    def items(self, number: int, size: int) -> str:
        """Line of the loop over a thread's items of a phase."""
        name = self.size((number, "items"), size)
        if self.kind == TEAM:
            return f"for i in range({name} * thread // lanes, {name} * (thread + 1) // lanes):"
        return f"for i in range(thread, {name}, lanes):"

    def phase(self, number: int, phase: ProgramPhase) -> None:
        columns = self.program.columns
        if self.kind == TEAM and hasattr(columns[phase.ops[0]].op.kernel, "part"):
            self.calls(phase.ops[0], PART, "")
            return
        if phase.points:
            most = max(phase.lanes)
            self.lines.append(self.items(number, phase.points * most))
            for op, lanes in zip(phase.ops, phase.lanes, strict=True):
                if lanes == most:
                    self.calls(op, "i", "    ")
                else:
                    self.lines.append(f"    if i % {most // lanes} == 0:")
                    self.calls(op, f"i // {most // lanes}", "        ")
            return
        sizes = [columns[op].op.dim for op in phase.ops]
        begins = [0]
        for size in sizes:
            begins.append(begins[-1] + -(-size // WARP) * WARP)
        self.lines.append(self.items(number, begins[-2] + sizes[-1]))
        for n, op in enumerate(phase.ops):
            if len(phase.ops) == 1:
                self.calls(op, "i", "    ")
                continue
            at = self.size((number, "begin", n), begins[n])
            self.lines.append(f"    if i >= {at} and i - {at} < {self.size((number, 'size', n), sizes[n])}:")
            self.calls(op, f"i - {at}", "        ")

    def whole(self) -> str:
        """The text of the kernel."""
        for number, phase in enumerate(self.program.phases):
            self.phase(number, phase)
            self.lines.append(WAIT.get(self.kind, "meet()"))
        inner = "\n".join("        " + line for line in (*self.top, *self.lines))
        if self.kind == TEAM:
            inner = inner.replace("\n", "\n    ")
            return TOGETHER.format(arguments=", ".join(self.types), inner=inner)
        return (f"def fused({', '.join(self.types)}):\n    thread = wp.tid()\n    turn = int(0)\n"
                f"    for k in range(count):\n{inner}\n")


PART = "thread, lanes"
WAIT = {GRID: "turn = turn + 1\n        meet(word, turn)", TEAM: "meet(team, thread, lanes)"}
TOGETHER = """def fused({arguments}):
    thread = join(team)
    if thread >= 0:
        k = since(team, thread)
        lanes = together(team, thread, 0, k, count)
        while k < count:
    {inner}
            lanes = together(team, thread, lanes, k, count)
            k = k + 1
        leave(team, thread, lanes)
"""
_MADE: dict[tuple, wp.Kernel] = {}


def make_fused_kernel(program: Program, real, shape: LaunchShape, module: str) -> tuple[wp.Kernel, list]:
    """Kernel of a program, and the arguments behind `word`."""
    text = Text(program, real, shape.kind)
    source = text.whole()
    key = source, tuple(map(str, text.types.values())), tuple(text.bodies.values()), shape.kind, shape.threads, module
    if key not in _MADE:
        names = {"wp": wp, **MEETINGS[shape.kind], **text.bodies}
        exec(source, names)                                                 # noqa: S102  (of no text but the above)
        f: Any = names["fused"]
        f.__annotations__, f.__module__ = dict(text.types), MODULE
        options: dict[str, Any] = {"enable_backward": False, "grid_stride": False}
        if shape.kind not in (ALONE, TEAM):
            options |= {"launch_bounds": shape.threads}
        if shape.kind == CLUSTER:
            options |= {"cluster_dim": shape.blocks}
        called = [k.key for k in text.bodies.values()]
        name = hashlib.sha256(str((source, called)).encode()).hexdigest()[:8]
        _MADE[key] = wp.Kernel(f, f"fused_{name}", wp.get_module(module), options, source=source)
    return _MADE[key], text.given
