"""The arrays that change, in parts; each part is a table of (field, unit, persistent).

From the table follow the bytes, the snapshot that a repeated frame starts from, and the fields that a restart needs. What a
scene lacks is not allocated.
"""

from dataclasses import dataclass, field

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
CARRY = (Field("r", "m/s", True, "rounding remainder of v (explicit)"),)
HALF = (Field("b", "m/s", True, "velocity half a substep before v (leapfrog among others)"),)


@dataclass
class State:
    """Device arrays by field name, all of one length; `fields` says what each is."""

    fields: tuple[Field, ...]
    arrays: dict[str, wp.array]
    saved: dict[str, wp.array] = field(default_factory=dict)

    @staticmethod
    def allocate(fields: tuple[Field, ...], count: int, dtype, device) -> "State":
        """Zeros for every field and a snapshot for every persistent one."""
        def zeros():
            return wp.zeros(count, dtype=dtype, device=device)
        return State(fields, {f.name: zeros() for f in fields}, {f.name: zeros() for f in fields if f.persistent})

    def __getattr__(self, name: str) -> wp.array:
        try:
            return self.__dict__["arrays"][name]
        except KeyError:
            raise AttributeError(f"the state has no {name!r}; this scene has {list(self.__dict__['arrays'])}") from None

    def has(self, name: str) -> bool:
        return name in self.arrays

    def snapshot(self) -> None:
        """Copies every persistent field aside (capturable)."""
        for name, kept in self.saved.items():
            wp.copy(kept, self.arrays[name])

    def restore(self) -> None:
        """Puts the snapshot back."""
        for name, kept in self.saved.items():
            wp.copy(self.arrays[name], kept)

    @property
    def bytes(self) -> int:
        return sum(a.capacity for a in (*self.arrays.values(), *self.saved.values()))
