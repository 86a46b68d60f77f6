"""The arrays that change, in parts: points, elements that flow, whatever a method adds.

A part is a table of fields (name, type, unit, persistent) over rows of one kind. From the table follow the bytes, the snapshot
that a repeated frame starts from, and what a restart needs of each body. What a scene lacks is not allocated.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types


@dataclass(frozen=True)
class StateField:
    """type: "vec3", "mat33", "scalar" (of the simulation's precision), "int", "long" (64 bits); "vec3d" and "double" are
    float64 whatever that precision is."""

    name: str
    unit: str
    persistent: bool          # outlives a frame: snapshot and restart need it
    meaning: str
    type: str = "vec3"

    def dtype(self, real) -> type:
        whole = {"int": int, "long": wp.int64, "double": wp.float64, "vec3d": wp.vec3d}
        return whole[self.type] if self.type in whole else getattr(types(real), self.type)


POINTS = (
    StateField("x", "m", True, "position relative to the object's origin"),
    StateField("e", "m", True, "rounding remainder of x"),
    StateField("v", "m/s", True, "velocity"),
    StateField("d", "m", False, "displacement in this substep"),
)
ANCHOR = (StateField("a", "m", False, "what velocity is measured from: v = (d - a) / g"),)
HISTORY = (
    StateField("s", "m", True, "step before this one (BDF2)"),
    StateField("u", "m/s", True, "velocity before this one (BDF2)"),
)
STAGED = (
    StateField("s", "m", False, "step of a step's first stage, then of all of it (sdirk3)"),
    StateField("u", "m/s", False, "change of velocity of a step's first stage, then of all of it (sdirk3)"),
)
CARRY = (StateField("r", "m/s", True, "rounding remainder of v (explicit)"),)
HALF = (StateField("b", "m/s", True, "velocity that goes on where v is only read: leapfrog's, half a substep before v, that of "
                   "Runge-Kutta steps, less the half of what lasting contacts give; frames taken whole leave it as it was"),)


@dataclass
class StatePart:
    """Device arrays by field name, all of `capacity` rows, of which `count` are in use.

    rows    {(prim path, world): its rows, in the author's order}: what is restarted by prim path
    common  its rows stand for no world in particular, such as a list of contacts of all
    every   the persistent fields of the table's first type behind each other, so that a copy saves them all; `aside`: saved
    """

    name: str
    count: int
    capacity: int
    fields: tuple[StateField, ...] = ()
    arrays: dict[str, wp.array] = field(default_factory=dict)
    rows: dict[tuple[str, int], np.ndarray] = field(default_factory=dict)
    every: Any = None
    aside: Any = None
    saved: dict[str, tuple[wp.array, wp.array]] = field(default_factory=dict)      # persistent ones beside `every`
    common: bool = False

    @staticmethod
    def allocate(name: str, fields: tuple[StateField, ...], count: int, real, device,
                 capacity: int | None = None) -> "StatePart":
        """Zeros for every field, and a snapshot for every persistent one. capacity: rows that there is room for."""
        room = count if capacity is None else capacity
        kept = [f for f in fields if f.persistent and f.type == fields[0].type]
        every, aside = (wp.zeros(len(kept) * room, dtype=fields[0].dtype(real), device=device) for _ in range(2))
        part = StatePart(name, count, room, every=every, aside=aside)
        for f in fields:
            if f in kept:
                k = kept.index(f)
                part.fields += (f,)
                part.arrays[f.name] = every[k * room:(k + 1) * room] if room else wp.empty_like(every)
            else:
                part.take(f, wp.zeros(room, dtype=f.dtype(real), device=device))
        return part

    def take(self, what: StateField, array: wp.array) -> wp.array:
        """Makes an array that a method has allocated a field of this part. Raises ValueError for a name that is taken, or
        another number of rows."""
        if what.name in self.arrays or array.shape[0] != self.capacity:
            raise ValueError(f"part {self.name}: field {what.name} of {array.shape[0]} rows; it has {list(self.arrays)}, "
                             f"{self.capacity} rows each")
        self.fields += (what,)
        self.arrays[what.name] = array
        if what.persistent:
            self.saved[what.name] = array, wp.clone(array)
        return array

    def snapshot_of(self, name: str) -> wp.array:
        """A persistent field as it was where the frame began."""
        if name in self.saved:
            return self.saved[name][1]
        k = self.names.index(name)
        assert self.aside is not None
        return self.aside[k * self.capacity:(k + 1) * self.capacity]

    def enlarge_part(self, capacity: int, real, device) -> None:
        """Room for more rows, by new arrays: what is there stays, and in the snapshot, which a repeated frame starts from."""
        other, before = StatePart.allocate(self.name, self.fields, self.count, real, device, capacity), self.capacity
        for k in range(len(self.names)):
            assert other.aside is not None and self.aside is not None
            wp.copy(other.aside, self.aside, k * capacity, k * before, before)
        for name, array in self.arrays.items():
            wp.copy(other.arrays[name], array, count=before)
        for name, (_, aside) in self.saved.items():
            wp.copy(other.saved[name][1], aside, count=before)
        self.capacity, self.arrays, self.every, self.aside, self.saved = (
            capacity, other.arrays, other.every, other.aside, other.saved)

    def refresh(self) -> None:
        """Fills what is only there while it is asked for."""

    @property
    def kept(self) -> list[StateField]:
        """Fields that outlive a frame."""
        return [f for f in self.fields if f.persistent]

    @property
    def names(self) -> list[str]:
        """Fields that stand behind each other in `every`."""
        return [f.name for f in self.kept if f.name not in self.saved]

    def copies(self) -> Iterator[tuple[wp.array, wp.array]]:
        """(array, its snapshot) of all that outlives a frame."""
        if self.every is not None and self.aside is not None and len(self.every):
            yield self.every, self.aside
        yield from self.saved.values()

    @property
    def bytes(self) -> int:
        inside = {f.name for f in self.kept} - self.saved.keys()
        own = [array for name, array in self.arrays.items() if name not in inside and name not in self.saved]
        return sum(a.capacity for a in own) + sum(a.capacity + b.capacity for a, b in self.copies())


@dataclass
class SimulationState:
    """Parts by name. The fields of the points are attributes too: `state.x` is `state.parts["points"].arrays["x"]`."""

    parts: dict[str, StatePart] = field(default_factory=dict)

    def add(self, *parts: StatePart) -> None:
        """Raises ValueError for a name that is taken."""
        for part in parts:
            if part.name in self.parts:
                raise ValueError(f"there is a part {part.name} already")
            self.parts[part.name] = part

    @property
    def points(self) -> StatePart:
        return self.parts["points"]

    def __getattr__(self, name: str) -> wp.array:
        part = self.__dict__.get("parts", {}).get("points")
        if part is None or name not in part.arrays:
            raise AttributeError(f"the points have no {name!r}; they have {list(part.arrays) if part else 'no fields here'}")
        return part.arrays[name]

    def has_point_field(self, name: str) -> bool:
        """True if the points have this field."""
        return "points" in self.parts and name in self.points.arrays

    def copies(self) -> Iterator[tuple[wp.array, wp.array]]:
        """(array, its snapshot) of all that outlives a frame."""
        for part in self.parts.values():
            yield from part.copies()

    def take_snapshot(self) -> None:
        """Copies all that outlives a frame aside (capturable)."""
        for array, aside in self.copies():
            wp.copy(aside, array)

    def restore_snapshot(self) -> None:
        """Puts the snapshot back."""
        for array, aside in self.copies():
            wp.copy(array, aside)

    def of(self, path: str, world: int = 0, own: bool = False) -> Iterator[tuple[str, wp.array, np.ndarray]]:
        """(name, array, rows in the author's order) of every field of a prim that outlives a frame; own: but those of lists
        that worlds have in common."""
        for part in self.parts.values():
            if (path, world) in part.rows and not (own and part.common):
                part.refresh()
                yield from ((f.name, part.arrays[f.name], part.rows[path, world]) for f in part.kept)

    def paths(self) -> list[str]:
        """Prims that something of the state belongs to."""
        return list(dict.fromkeys(path for part in self.parts.values() for path, _ in part.rows))

    @property
    def bytes(self) -> int:
        return sum(part.bytes for part in self.parts.values())
