"""Substeps that launch the same kernels, as one program: what stays from substep to substep, what changes and how, and where
threads have to wait for each other.

    argument    an array; a struct of arrays and numbers; a number
    variant     the arrays of a launch: they may take turns from substep to substep
    number      of substep k: first (k = 0), else (odd or even by k) + (k - 1) step. What does not go so is not fused
    phase       launches without a wait between: those that were recorded beside each other, or a chain over points in which
                every launch reads and writes what changes in its phase at its own point alone
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp

from wsim.model.structs import struct_leaves
from wsim.physics.motion.fused.recorder import Op

LARGE = (wp.uint64, wp.int64)            # numbers that are compared, not counted with


def lanes_of(op: Op) -> int:
    """Threads a point of a launch that may be chained with others, by the marks of kernels/math/marks.py; 0: it may not."""
    return 0 if op.kernel is None or hasattr(op.kernel, "part") else getattr(op.kernel, "own", 0)


@dataclass
class ProgramPhase:
    """Launches by their numbers; lanes: of the points of a chain, each; 0: beside each other."""

    ops: list[int]
    lanes: list[int]
    points: int = 0


def group_phases(ops: list[Op]) -> list[ProgramPhase]:
    found = list[ProgramPhase]()
    for number, op in enumerate(ops):
        lanes = lanes_of(op)
        points = op.dim // lanes if lanes else 0
        if lanes and found and found[-1].points == points and not op.beside:
            found[-1].ops.append(number)
            found[-1].lanes.append(lanes)
        elif op.beside and found and not found[-1].points:
            found[-1].ops.append(number)
        else:
            found.append(ProgramPhase([number], [lanes] if lanes else [], points))
    return found


def array_identity(array) -> tuple:
    """Identity of an array."""
    return (0,) if array is None else (array.ptr, array.shape, array.strides)


def is_struct(value: Any) -> bool:
    return hasattr(value, "_cls")


@dataclass
class Numbers:
    """A number of a launch over the substeps: first, odd, even, step."""

    kind: Any
    values: np.ndarray
    params: tuple = ()

    @property
    def varies(self) -> bool:
        return bool((self.values != self.values[0]).any())

    def fit(self) -> bool:
        """Finds how it goes; False where it does not go so."""
        v = self.values
        later, k = v[1:], np.arange(len(v) - 1)
        if not len(later):
            self.params = (v[0], v[0], v[0], 0)
            return True
        for step in {0, (later[2] - later[0]) / 2 if len(later) > 2 else 0}:
            odd = later[0]
            even = later[1] - step if len(later) > 1 else odd
            if np.array_equal(np.where(k % 2 == 0, odd, even) + k * step, later):
                self.params = (v[0], odd, even, step)
                return True
        return False


@dataclass
class Column:
    """One launch over the substeps."""

    op: Op
    variants: list[Op] = field(default_factory=list)
    which: list[int] = field(default_factory=list)         # variant of each substep
    numbers: dict[tuple, Numbers] = field(default_factory=dict)         # by argument and name of the field


def launch_column(ops: list[Op]) -> Column:
    """One launch of each substep."""
    found, keys, rows = Column(ops[0]), dict[tuple, int](), []
    last: tuple = ()
    for op in ops:
        if last and all(a is b for a, b in zip(op.args, last[0], strict=True)):
            found.which.append(found.which[-1])
            rows.append(rows[-1])
            continue
        last = (op.args,)
        key, row = _arrays_and_numbers(op)
        if key not in keys:
            keys[key] = len(found.variants)
            found.variants.append(op)
        found.which.append(keys[key])
        rows.append(row)
    kinds = _number_kinds(ops[0])
    for n, (name, kind) in enumerate(kinds):
        found.numbers[name] = Numbers(kind, np.array([row[n] for row in rows], np.float64))
    return found


def _arrays_and_numbers(op: Op) -> tuple[tuple, list[float]]:
    """Arrays of a launch, and its numbers in the order of `_number_kinds`."""
    key, row = [], []
    for value in op.args:
        if value is None or isinstance(value, wp.array):
            key.append(array_identity(value))
        elif is_struct(value):
            for kind, part in struct_leaves(value).values():
                if isinstance(kind, wp.array):
                    key.append(array_identity(part))
                elif kind in LARGE:
                    key.append((int(part),))
                else:
                    row.append(float(part))
        else:
            row.append(float(value))
    return tuple(key), row


def _number_kinds(op: Op) -> list[tuple[tuple, Any]]:
    """(argument, field) and type of each number."""
    found = list[tuple[tuple, Any]]()
    for a, (value, kind) in enumerate(zip(op.args, op.kernel.adj.arg_types.values(), strict=True)):
        if is_struct(value):
            found += [((a, name), of) for name, (of, _) in struct_leaves(value).items()
                      if not isinstance(of, wp.array) and of not in LARGE]
        elif value is not None and not isinstance(value, wp.array):
            found.append(((a, ""), kind))
    return found


class Program:
    """The program of a run of substeps."""

    def __init__(self, steps: list[list[Op]], known: set[tuple] | None = None):
        """known: numbers (launch, argument, field) that change in other frames."""
        self.count, ops = len(steps), steps[0]
        self.columns = [launch_column([step[p] for step in steps]) for p in range(len(ops))]
        self.phases = group_phases(ops)
        self.varying = {(p, *name) for p, c in enumerate(self.columns) for name, n in c.numbers.items() if n.varies}
        self.varying |= known or set()
        self.turns = [Numbers(int, np.array(c.which, np.float64)) for c in self.columns]
        fits = [self.columns[p].numbers[a, name].fit() for p, a, name in sorted(self.varying)]
        fits += [t.fit() for t in self.turns]
        self.why = "" if all(fits) else "numbers change from substep to substep in a way that one kernel does not know"

    @property
    def widest_phase(self) -> int:
        """Threads that the widest phase has work for."""
        return max(max(p.points * max(p.lanes, default=1), sum(self.columns[n].op.dim for n in p.ops) * (not p.points))
                   for p in self.phases)


def longest_run(steps: list[list[Op]]) -> tuple[int, int]:
    """The longest run of substeps that launch the same."""
    forms = [[op.form for op in step] for step in steps]
    best, first = (0, 0), 0
    for k in range(1, len(forms) + 1):
        if k == len(forms) or forms[k] != forms[first]:
            if k - first > best[1] - best[0]:
                best = first, k
            first = k
    if any(op.kernel is None for op in steps[best[0]] if steps):
        return (0, 0)
    return best
