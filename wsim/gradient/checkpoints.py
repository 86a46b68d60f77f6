"""What a recording keeps at a time, and whether there is memory for it.

    bytes(L) = L each + max(L, S) launches + over + ceil(N / L) point + fixed     of segments of L substeps, N = frames x S
    least where L = sqrt(N point / each), each + launches for each where L > S    (Griewank, Walther 2000)

each    versions of a substep and their gradients               point    arrays with which a segment begins
over    of a segment, whatever its length                       fixed    positions and velocities after every frame
launches     memory of the recorded launches of a substep and of its adjoint, on tapes and in CPU graphs, and of what the host
             keeps for both. Each segment within a frame has its own; `copies`: memory of the launches that begin and end a
             segment

A frame is measured before it is recorded; where that would not fit, its first substep.
"""

import sys
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import ceil, sqrt

import numpy as np
import warp as wp

from wsim.scene import Problem, SceneError
from wsim.simulation.measure.memory import format_bytes, free_bytes

FULL = 1 << 30         # bytes up to which everything is kept, or so much of what is free on a GPU: segments run twice
PART = 0.25
LAUNCH = 6.5e3         # [B] that a CPU keeps for each launch, on the tape and in the graph: 2.3e3 to 8.8e3 in seven scenes


@dataclass
class CheckpointCosts:
    """Cost of a recording; `where` is the device's name."""

    frames: int
    substeps: int          # of a frame; as `wsim.model.stage.Clock` has them
    each: float
    over: float
    point: int
    fixed: int
    room: float            # bytes that are free
    where: str
    solves: int = 1        # substeps of a step: of sdirk3 two
    launches: float = 0.0
    copies: float = 0.0

    @property
    def total(self) -> int:
        return self.frames * self.substeps

    def bytes(self, length: int) -> int:
        """Bytes of checkpoints and segments of so many substeps."""
        launches = max(length, self.substeps) * self.launches + max(ceil(self.substeps / length) - 1, 0) * self.copies
        return int(length * self.each + launches + self.over) + ceil(self.total / length) * self.point + self.fixed

    @property
    def full(self) -> int:
        """Bytes of keeping everything."""
        return int(self.total * (self.each + self.launches)) + self.fixed

    @property
    def best(self) -> int:
        """Substeps of a segment with which least is kept: a part of a frame, or several frames."""
        per = self.frames * max(self.point, 1) / self.substeps
        if self.each >= per:
            return ceil(self.substeps / round(sqrt(self.each / per)))
        return min(self.frames, max(round(sqrt(per / (self.each + self.launches))), 1)) * self.substeps

    def longest(self) -> int:
        """Substeps of the longest segment that fits; 0: none does."""
        def longest_by_quadratic(each: float, free: float) -> int:
            square = free * free - 4.0 * each * self.total * self.point
            return int((free + sqrt(square)) / (2.0 * each)) if free > 0.0 and square >= 0.0 else 0
        free = self.room - self.fixed - self.over
        found = longest_by_quadratic(self.each + self.launches, free)
        if found < self.substeps:
            found = min(longest_by_quadratic(self.each, free - self.substeps * self.launches), self.substeps)
        while found and self.bytes(found) > self.room:            # the number of checkpoints is a whole one
            found -= 1
        return min(found, self.total)

    def most(self) -> int:
        """Frames for which there is room with the best segments; 0: for none."""
        least, most = 0, self.frames
        while least < most:
            middle = (least + most + 1) // 2
            part = replace(self, frames=middle, fixed=int(self.fixed * middle / self.frames))
            least, most = (middle, most) if part.bytes(part.best) <= self.room else (least, middle - 1)
        return least

    @property
    def ample_bytes(self) -> float:
        """Bytes up to which everything is kept unasked."""
        return min(self.room, max(FULL, PART * self.room if self.where.startswith("cuda") else 0.0))

    def choose(self, keep: str) -> int:
        """Substeps of a segment, 0: everything is kept. Raises SceneError where that does not fit."""
        wanted = 0 if keep == "all" or (keep == "auto" and self.full <= self.ample_bytes) else self.best
        need = self.bytes(wanted) if wanted else self.full
        if need > self.room:
            raise SceneError(self.problem(need))
        return wanted

    def problem(self, need: int) -> Problem:
        """Problem that says what is needed, what is there, and what would fit, in steps as a scene counts them."""
        longest, best, frames = self.longest() // self.solves, self.best // self.solves, self.most()
        if longest:
            mend = f"keep=\"checkpoints\" fits, in segments of up to {longest} substeps (of {best} it keeps " \
                   f"{format_bytes(self.bytes(self.best))})"
        elif frames:
            mend = f"record {frames} frames at most, or take fewer substeps or float32"
        else:
            mend = "not even one frame fits: take fewer points, fewer substeps or float32"
        return Problem("memory", f"recording {self.frames} frames of {self.substeps // self.solves} substeps keeps {need} "
                       f"bytes ({format_bytes(need)}), and {format_bytes(self.room)} are free on {self.where}; {mend}")


def measure_recording_cost(recording) -> tuple[CheckpointCosts, tuple[float, ...]]:
    """The cost of a `wsim.gradient.recording.Recording`, and scalars of each kind that a substep takes (`ArraySlots.used`)."""
    sim, slots, S, F = recording.sim, recording.slots, recording.plan.clock.substeps, recording.frames
    room, real = free_bytes(sim.device), wp.types.type_size_in_bytes(sim.model.real)
    recording.plan.before_frame(sim.time)
    one, entries, launches = 0, {}, []

    def record_and_count_bytes(first: int, last: int) -> int:
        slots.drop()
        tape = recording.record(first, last)
        entries.update((id(root), root.base.capacity) for root, _ in tape.entries)
        launches.append(bytes_of_launches(tape, sim.device))
        return slots.bytes
    for first in (*{0, S - 1}, 0):               # again: what is read before it is written is known from then on
        begin = record_and_count_bytes(first, first + 1)
        one = max(one, begin)
    last = S if S * one <= room else min(S, 2)
    whole = record_and_count_bytes(0, last) if last > 1 else begin
    each = whole / last if last == S else float(whole - begin)
    scalars = tuple(n * each / whole for n in slots.used)
    slots.drop()
    copies = max((last * launches[-2] - launches[-1]) / (last - 1), 0.0) if last > 1 else 0.0
    fixed = 6 * (F + 1) * sim.model.points * real + (recording.fluids.bytes(F) if recording.fluids else 0)
    return CheckpointCosts(F, S, each, max(one - each, 0.0), sum(entries.values()), fixed, room, str(sim.device),
                           recording.plan.clock.integrator.solves, launches[-1] / max(last, 1), copies), scalars


def bytes_of_launches(tape, device) -> float:
    """Bytes that the host keeps for a `wsim.model.tape.Tape`: for steps that run there, which contacts decide on as they come,
    and on a CPU for launches, forward and backward."""
    return host_bytes(tape.host, set()) + (0.0 if device.is_cuda else LAUNCH * (len(tape.steps) + len(tape.adjoints)))


def host_bytes(thing, seen: set[int]) -> int:
    """Bytes of what a host keeps in containers, and of what their members keep: NumPy arrays that own their memory, of a view
    those of the array behind it. seen: ids of what is counted already."""
    if thing is None or isinstance(thing, (bool, int, float, str, np.generic)) or id(thing) in seen:
        return 0
    seen.add(id(thing))
    own = sys.getsizeof(thing)
    if isinstance(thing, np.ndarray):
        return own + (host_bytes(thing.base, seen) if isinstance(thing.base, np.ndarray) else 0)
    if isinstance(thing, dict):
        return own + sum(host_bytes(each, seen) for each in thing.values())
    if isinstance(thing, (list, tuple)):
        return own + sum(host_bytes(each, seen) for each in thing)
    return own + host_bytes(getattr(thing, "__dict__", None), seen)


@contextmanager
def in_words(cost: Callable[[], "tuple[CheckpointCosts, int, int] | None"], where: str):
    """An allocation that fails within becomes a SceneError. cost(): segments, what is needed and what was got [bytes]; None
    where that is not known yet."""
    try:
        yield
    except RuntimeError as error:
        if "alloc" not in str(error).lower() and "memory" not in str(error).lower():
            raise
        known = cost()
        if known is None:
            raise SceneError(Problem("memory", f"{where} has too little for a recording of one frame ({error}); take fewer "
                                     "substeps, fewer points or float32")) from None
        segments, need, got = known
        raise SceneError(replace(segments, room=min(segments.room, float(got))).problem(need)) from None
