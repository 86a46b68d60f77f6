"""A value of a scene as data: who has it, its unit and bounds, what may be done with it, and where a stage says it.

Nothing is imported by a row, and no device is named: where a value lives on a device, and how it is set there, is known by the
method that reads it (`wsim.model.stage.Method.set_value`).
"""

from dataclasses import dataclass
from math import inf
from typing import Any

LARGE = 10.0           # [m/s^2, m/s, Pa, N] one unit of theta of a parameter that may have either sign


@dataclass(frozen=True)
class ValueRange:
    """Numbers that a value may be: finite, from `low` (strict: above it), below `high` (closed: or at it). endless: infinite in
    a scene where there is no such limit."""

    low: float = 0.0
    strict: bool = False
    high: float = inf
    closed: bool = False
    endless: bool = False

    def holds(self, value, start: bool = False):
        """True if a number, or each of an array, may be. start: in a scene, where an endless one may be infinite."""
        above = value > self.low if self.strict else value >= self.low
        below = value <= self.high if self.closed else value < self.high
        good = above & below & (value > -inf)
        return good | (value == inf) if start and self.endless else good

    @property
    def words(self) -> str:
        if self.closed:
            return f"{self.low:g} to {self.high:g}"
        if self.low == -inf:
            return "a finite number"
        above = f"{'>' if self.strict else '>='} {self.low:g}"
        return f"{above} and < {self.high:g}" if self.high < inf else f"a finite number {above}"

    def wrong(self, name: str, value: float, start: bool = False) -> str:
        """Text of what is wrong with a number, and what is allowed; "" if nothing is."""
        return "" if self.holds(value, start) else f"{name} is {value:g}; allowed is {self.words}" + (
            " (inf: none)" if start and self.endless else "")


@dataclass(frozen=True)
class ThetaMap:
    """The way in which a fit maps a number to theta, on a line without ends, see
    `wsim.fitting.least_squares.bounds.FittingMap`."""

    kind: str                    # "log", "plain" or "bounded"
    low: float = 0.0
    high: float = 1.0


@dataclass(frozen=True)
class PerElementFit:
    """A fit of a value for each element. near: what neighbours differ by, in units of theta."""

    noun: str                    # tets, springs, hinges ...
    map: ThetaMap
    near: float = 0.3


@dataclass(frozen=True)
class UsdAttribute:
    """The attribute of a schema that carries a value, and its type."""

    schema: str
    attribute: str
    type: str = "double"
    uniform: bool = False


@dataclass(frozen=True)
class ValueRow:
    """One value of the objects of one class.

    owner      name of the class in `wsim.scene`, or of a method's own; the field of that name is of the object or its material
    form       number; vector (3,); array; curve over time (arrays and curves are judged by who takes them); factor, a number
               over time; motion (rigid)
    live       `Simulation.set` takes it; local: of the whole scene, and of one body too
    tets       live with a number for each tet; of constraints, as many as there are have one each
    varies     it may be a curve over time (`wsim.scene.Varying`)
    stiffens   it bounds the steps of explicit integrators
    needs      what must be at the start for it to do anything, see `wsim.scene.check.varying.NEEDS`
    fit, each  how a fit finds it as one number, and for each element; None: it does not
    gradient   kind of input of a recording (`wsim.gradient.inputs.by_name.KINDS`); "": no derivative with respect to it
    why        why there is none
    mend       what to do where a scene has one out of bounds
    """

    owner: str
    name: str
    unit: str = "1"
    range: ValueRange = ValueRange()
    form: str = "number"
    live: bool = True
    local: bool = False
    tets: bool = False
    varies: bool = False
    stiffens: bool = False
    needs: tuple[str, ...] = ()
    fit: ThetaMap | None = None
    each: PerElementFit | None = None
    usd: UsdAttribute | None = None
    gradient: str = ""
    why: str = ""
    mend: str = ""


def value_holder(thing: Any, name: str) -> Any:
    """Object that has the field of a value: itself, or its material."""
    return thing if hasattr(thing, name) else getattr(thing, "material", thing)
