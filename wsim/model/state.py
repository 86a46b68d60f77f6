"""The arrays that change, in parts; each part is a table of (field, unit, persistent).

From the table follow the bytes, the snapshot that a repeated frame starts from, and the fields that a restart needs. What a
scene lacks is not allocated.
"""

from dataclasses import dataclass, field

import numpy as np
import warp as wp


@dataclass(frozen=True)
class Field:
    name: str
    unit: str
    persistent: bool          # outlives a frame: snapshot and restart need it
    meaning: str


POINTS = (
    Field("x", "m", True, "position relative to the object's origin"),
    Field("e", "m", True, "rounding remainder of x"),
    Field("v", "m/s", True, "velocity"),
    Field("d", "m", False, "displacement in this substep"),
)
ANCHOR = (Field("a", "m", False, "what velocity is measured from: v = (d - a) / g"),)
HISTORY = (
    Field("s", "m", True, "step before this one (BDF2)"),
    Field("u", "m/s", True, "velocity before this one (BDF2)"),
)
STAGED = (
    Field("s", "m", False, "step of a step's first stage, then of all of it (sdirk3)"),
    Field("u", "m/s", False, "change of velocity of a step's first stage, then of all of it (sdirk3)"),
)
CARRY = (Field("r", "m/s", True, "rounding remainder of v (explicit)"),)
HALF = (Field("b", "m/s", True, "velocity half a substep before v (leapfrog among others)"),)


@dataclass
class Kept:
    """An array over elements that outlives a frame, its snapshot, and the places of each body's elements in it, in the author's
    order, by the number of the body."""

    array: wp.array
    aside: wp.array
    places: dict[int, np.ndarray]


@dataclass
class State:
    """Device arrays by field name, all of one length; `fields` says what each is."""

    fields: tuple[Field, ...]
    arrays: dict[str, wp.array]
    saved: dict[str, wp.array] = field(default_factory=dict)
    every: wp.array | None = None                 # all persistent fields behind each other, and their snapshot
    aside: wp.array | None = None
    elements: dict[str, Kept] = field(default_factory=dict)       # by name

    @staticmethod
    def allocate(fields: tuple[Field, ...], count: int, dtype, device) -> "State":
        """Zeros for every field and a snapshot for every persistent one. These stand in one array: a copy saves them all."""
        kept = [f.name for f in fields if f.persistent]
        every, aside = (wp.zeros(len(kept) * count, dtype=dtype, device=device) for _ in range(2))

        def part(whole: wp.array, name: str) -> wp.array:
            return whole[kept.index(name) * count:(kept.index(name) + 1) * count]
        arrays = {f.name: part(every, f.name) if f.persistent else wp.zeros(count, dtype=dtype, device=device) for f in fields}
        return State(fields, arrays, {name: part(aside, name) for name in kept}, every, aside)

    def __getattr__(self, name: str) -> wp.array:
        try:
            return self.__dict__["arrays"][name]
        except KeyError:
            raise AttributeError(f"the state has no {name!r}; this scene has {list(self.__dict__['arrays'])}") from None

    def has(self, name: str) -> bool:
        return name in self.arrays

    def snapshot(self) -> None:
        """Copies every persistent field aside (capturable)."""
        if self.every is not None and self.aside is not None and len(self.every):
            wp.copy(self.aside, self.every)
        for kept in self.elements.values():
            wp.copy(kept.aside, kept.array)

    def restore(self) -> None:
        """Puts the snapshot back."""
        if self.every is not None and self.aside is not None and len(self.every):
            wp.copy(self.every, self.aside)
        for kept in self.elements.values():
            wp.copy(kept.array, kept.aside)

    @property
    def bytes(self) -> int:
        elements = [a for kept in self.elements.values() for a in (kept.array, kept.aside)]
        return sum(a.capacity for a in (*self.arrays.values(), *self.saved.values(), *elements))
