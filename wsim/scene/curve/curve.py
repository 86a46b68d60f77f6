"""A value known for all time: keys, what lies between them, and what is outside. NumPy only.

    kind               between keys                                           more                              default
    linear             straight                                               -
    hold               the earlier key                                        -
    catmull_rom        smooth through the keys                                alpha: None by the times of keys, 0 uniform, 0.5
                                                                              centripetal, 1 chordal            None
    kochanek_bartels   the same with three handles                            tension, bias, continuity [1], one or (keys,)  0
    monotone           smooth, each component within the keys around          -
    hermite            by slopes                                              leave, arrive (arrive: leave): slopes behind and
                                                                              before the keys, (keys, ...) [unit/s]
    bezier             by slopes and handles of any length                    leave, arrive, leave_width, arrive_width: lengths
                                                                              of the handles [s], (keys,)       a third
    eased              straight, at a pace                                    easing: a name, (x1, y1, x2, y2), or one a piece

hermite and bezier also take form ("curve", "linear" or "hold" of each piece) and until (values right before the keys, where
they jump). before and after, outside of the keys: "held", "linear" (on with the slope there), a slope [unit/s], "repeat" (each
period begins where the last ended), "reset", "oscillate". Times in [s] from the start of the scene. Formulas: pieces.py,
slopes.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np

if TYPE_CHECKING:
    from wsim.scene.curve.pieces import Pieces

# What is linear between keys and held outside needs this file alone: the others are imported by what they are for.


def checked_keys(times, values) -> tuple[np.ndarray, np.ndarray]:
    """Times (keys,) and values (keys, ...) as arrays. Raises ValueError where they are no keys of a curve."""
    times, values = np.atleast_1d(np.asarray(times, np.float64)), np.asarray(values)
    if values.ndim == 0 or len(times) != len(values) or len(times) == 0:
        raise ValueError(f"a curve needs one value a time: {len(times)} times, {len(values) if values.ndim else 1} values")
    rises = np.diff(times) > 0
    if not rises.all():
        k = int(np.argmin(rises))
        raise ValueError(f"the times of a curve must increase: key {k + 1} at {times[k + 1]:g} s follows key {k} at "
                         f"{times[k]:g} s; sort the keys, and leave out what is there twice")
    return times, values


class Curve:
    """A value over time, by keys, as in `Curve([0.0, 1.0], [0.0, 5.0], kind="monotone").at(0.5)`. Raises ValueError where
    times do not increase, there is not one value a time, or a kind is unknown, lacks what it needs or has what it does not
    take.

    times     of the keys, (keys,) [s] from the start of the scene, increasing
    values    at the keys, (keys, ...), in the unit of what it stands for
    kind      "linear", "hold", "catmull_rom", "kochanek_bartels", "monotone", "hermite", "bezier" or "eased"
    before    outside, at earlier times: "held", "linear", "repeat", "reset", "oscillate", or a slope [unit/s]
    after     outside, at later times: as before
    how       what the kind takes, by name (module docstring): alpha [1]; tension, bias, continuity [1]; leave, arrive
              [unit/s]; leave_width, arrive_width [s]; easing
    """

    def __init__(self, times, values, kind: str = "linear", before="held", after="held", **how):
        self.times, self.values = checked_keys(times, values)
        self.kind, self.before, self.after, self.how = kind, before, after, how
        if not self.plain or how:
            from wsim.scene.curve import given
            self.values = self.values.astype(np.float64)
            self.how = given.complete_curve_fields(self)
        self.made: Any = None                # pieces and slopes, once asked for

    @property
    def plain(self) -> bool:
        """Linear between keys and held outside: a sum of keys' values with weights."""
        return self.kind == "linear" and self.before == "held" and self.after == "held"

    @property
    def moves(self) -> bool:
        """True if there is more than one key, or it goes on outside of the only one."""
        return len(self.times) > 1 or not (isinstance(self.before, str) and isinstance(self.after, str))

    def replaced(self, values, times=None, **how) -> Self:
        """The same curve with other values, (keys, ...), and times [s] or parts of `how`."""
        return type(self)(self.times if times is None else times, values, self.kind, self.before, self.after, **self.how | how)

    def flat(self) -> Curve:
        """The same curve with values (keys, m), in float64."""
        n, how = len(self.times), {name: self.how[name] for name in ("leave", "arrive", "until") if name in self.how}
        more = {name: v.reshape(n, -1) for name, v in how.items()}
        return self.replaced(np.asarray(self.values, np.float64).reshape(n, -1), **more)

    def scaled(self, s: float) -> Curve:
        """Values times a number."""
        sides = [side if isinstance(side, str) else np.multiply(side, s) for side in (self.before, self.after)]
        return type(self)(self.times, self.values * s, self.kind, *sides, **{
            name: v * s if name in ("leave", "arrive", "until") else v for name, v in self.how.items()})

    def later(self, delay: float) -> Self:
        """The same values `delay` [s] later."""
        return self.replaced(self.values, self.times + delay)

    def at(self, t: float) -> np.ndarray:
        """Value at time t [s], shape (...)."""
        if not self.plain:
            return self.sampled(t)[0]
        b = int(np.searchsorted(self.times, t, side="right"))
        if b == 0 or b == len(self.times):
            return self.values[max(b - 1, 0)]
        s = float((t - self.times[b - 1]) / (self.times[b] - self.times[b - 1]))
        return self.values[b - 1] + s * (self.values[b] - self.values[b - 1])

    def sampled(self, t) -> np.ndarray:
        """Values at times (n,) [s], (n, ...)."""
        return _evaluate_module().found(self, np.atleast_1d(np.asarray(t, np.float64)))[0]

    def rate(self, t) -> np.ndarray:
        """Derivatives at times (n,) [s], (n, ...), the unit a second: at a key the one behind it, 0 where it is held."""
        return _evaluate_module().found(self, np.atleast_1d(np.asarray(t, np.float64)))[1]

    def table(self, t) -> np.ndarray:
        """Table as `sampled` has it; what is linear by weights of the keys, as its gradients are."""
        return self.weights(t) @ self.values if self.plain else self.sampled(t)

    @property
    def until(self) -> np.ndarray:
        """Values right before the keys, (keys, ...)."""
        return self.how.get("until", self.values)

    def weights(self, times) -> np.ndarray:
        """Part of each key in the values at some times, (times, keys): the values are weights @ keys' values; slopes that were
        given are fixed. Raises ValueError where slopes are no linear function of the values."""
        if not self.plain:
            from wsim.scene.curve import gradient
            return gradient.curve_key_weights(self, np.atleast_1d(np.asarray(times, np.float64)))
        t = np.clip(np.asarray(times, np.float64), self.times[0], self.times[-1])
        found = np.zeros((len(t), len(self.times)))
        if not self.moves:
            return found + 1.0
        a = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        s, each = (t - self.times[a]) / (self.times[a + 1] - self.times[a]), np.arange(len(t))
        found[each, a], found[each, a + 1] = 1.0 - s, s
        return found

    def pulled(self, times, by: np.ndarray) -> dict[str, np.ndarray]:
        """Gradient with respect to the keys, from that with respect to the values at some times (n,) [s], `by` (n, ...):
        "values" (keys, ...); "leave" and "arrive" where slopes are given; "easing" (pieces, 4) of what has handles."""
        if self.plain:
            return {"values": np.tensordot(self.weights(np.atleast_1d(times)).T, by, 1)}
        from wsim.scene.curve import gradient
        return gradient.curve_key_gradient(self, np.atleast_1d(np.asarray(times, np.float64)), np.asarray(by, np.float64))

    # what is not plain: wsim/scene/curve/evaluate.py

    def mode(self, side) -> int:
        """Number of a way to go on outside of the keys, which is `before` or `after`. Raises ValueError for another."""
        return _evaluate_module().mode(self, side)

    def slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Slopes [unit/s] before and behind the keys, (keys, ...) each, of kinds that have some."""
        return _evaluate_module().slopes_of(self)

    @property
    def pieces(self) -> Pieces:
        """Pieces of a curve of two keys or more."""
        if self.made is None:
            self.made = _evaluate_module().pieces_of(self)
        return self.made

    def place(self, t: np.ndarray):
        """(piece, fraction [1], periods to add, direction, mode, [s] beyond the end) of times (n,), of two keys or more."""
        return _evaluate_module().place(self, t)

    def slope(self, side: int) -> np.ndarray:
        """Slope [unit/s] of going on before (0) or after (1) the keys."""
        return _evaluate_module().slope(self, side)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """The least and the largest value ever, (...) each: of pieces those of their control points, which hold them; infinite
        where it goes on outside of the keys."""
        low, high = self.values.min(axis=0), self.values.max(axis=0)
        return (low, high) if self.plain else _evaluate_module().widened(self, low, high)

    def __eq__(self, other) -> bool:
        return (type(self) is type(other) and np.array_equal(self.times, other.times)
                and np.array_equal(self.values, other.values) and self.kind == other.kind
                and _equal_curve_parts(self.before, other.before) and _equal_curve_parts(self.after, other.after)
                and self.how.keys() == other.how.keys()
                and all(_equal_curve_parts(v, other.how[k]) for k, v in self.how.items()))

    def __repr__(self) -> str:
        return (f"{type(self).__name__}({self.kind}, {len(self.times)} keys of shape {self.values.shape[1:]} from "
                f"{self.times[0]:g} to {self.times[-1]:g} s)")


def _equal_curve_parts(a, b) -> bool:
    return isinstance(a, str) == isinstance(b, str) and (
        list(a) == list(b) if isinstance(a, (list, tuple)) and isinstance(b, (list, tuple)) else np.array_equal(a, b))


def _evaluate_module():
    from wsim.scene.curve import evaluate
    return evaluate
