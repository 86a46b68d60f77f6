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

from typing import Any

import numpy as np

from wsim.kernels.animation import cubic, outside
from wsim.scene.curve import given, gradient, pieces, slopes
from wsim.scene.curve.easing import HOLD
from wsim.scene.curve.given import FORMS, KINDS
from wsim.scene.curve.slopes import column

INSIDE = outside.outsides(np, float).inside


def keyed(times, values) -> tuple[np.ndarray, np.ndarray]:
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
    """A value over time, by keys. Raises ValueError where times do not increase, there is not one value a time, or a kind is
    unknown, lacks what it needs or has what it does not take.

    times     of the keys, (keys,) [s] from the start of the scene, increasing
    values    at the keys, (keys, ...), in the unit of what it stands for
    kind      "linear", "hold", "catmull_rom", "kochanek_bartels", "monotone", "hermite", "bezier" or "eased"
    before    outside, at earlier times: "held", "linear", "repeat", "reset", "oscillate", or a slope [unit/s]
    after     outside, at later times: as before
    how       what the kind takes, by name (module docstring): alpha [1]; tension, bias, continuity [1]; leave, arrive
              [unit/s]; leave_width, arrive_width [s]; easing
    """

    def __init__(self, times, values, kind: str = "linear", before="held", after="held", **how):
        self.times, self.values = keyed(times, values)
        self.kind, self.before, self.after, self.how = kind, before, after, how
        if kind not in KINDS:
            raise ValueError(f"no kind of curve is called {kind!r}; there are {', '.join(KINDS)}")
        if extra := [name for name in how if name not in KINDS[kind]]:
            raise ValueError(f"a curve of kind {kind} has no {', '.join(extra)}; it takes "
                             f"{', '.join(KINDS[kind]) or 'nothing'}")
        if not self.plain:
            self.values = self.values.astype(np.float64)
            if not (np.isfinite(self.times).all() and np.isfinite(self.values).all()):
                raise ValueError("the keys of a curve must be finite numbers")
            for side in (before, after):
                self.mode(side)
            self.how = given.completed(self)
        self.made: Any = None                # pieces and slopes, once asked for

    @property
    def plain(self) -> bool:
        """Linear between keys and held outside: a sum of keys' values with weights."""
        return self.kind == "linear" and self.before == "held" and self.after == "held"

    @property
    def moves(self) -> bool:
        """True if there is more than one key, or it goes on outside of the only one."""
        return len(self.times) > 1 or not (isinstance(self.before, str) and isinstance(self.after, str))

    def mode(self, side) -> int:
        """Number of a way to go on outside of the keys, which is `before` or `after`. Raises ValueError for another."""
        if isinstance(side, str):
            if side not in outside.NAMES:
                raise ValueError(f"outside of its keys a curve is {', '.join(outside.NAMES)} or has a slope, not {side!r}")
            return outside.NAMES[side] if len(self.times) > 1 else outside.HELD
        if np.shape(side) not in ((), self.values.shape[1:]) or not np.isfinite(side).all():
            raise ValueError(f"a slope outside of keys is finite, one number or of shape {self.values.shape[1:]}, not {side}")
        return outside.LINEAR

    def replaced(self, values, times=None, **how) -> "Curve":
        """The same curve with other values, (keys, ...), and times [s] or parts of `how`."""
        return type(self)(self.times if times is None else times, values, self.kind, self.before, self.after, **self.how | how)

    def flat(self) -> "Curve":
        """The same curve with values (keys, m), in float64."""
        n, how = len(self.times), {name: self.how[name] for name in ("leave", "arrive", "until") if name in self.how}
        more = {name: v.reshape(n, -1) for name, v in how.items()}
        return self.replaced(np.asarray(self.values, np.float64).reshape(n, -1), **more)

    def scaled(self, s: float) -> "Curve":
        """Values times a number."""
        sides = [side if isinstance(side, str) else np.multiply(side, s) for side in (self.before, self.after)]
        return type(self)(self.times, self.values * s, self.kind, *sides, **{
            name: v * s if name in ("leave", "arrive", "until") else v for name, v in self.how.items()})

    def later(self, delay: float) -> "Curve":
        """The same values `delay` [s] later."""
        return self.replaced(self.values, self.times + delay)

    def slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Slopes [unit/s] before and behind the keys, (keys, ...) each, of kinds that have some."""
        if self.kind in slopes.RULES:
            none = np.zeros_like(self.values)
            return slopes.RULES[self.kind](self.times, self.values, **self.how) if len(self.times) > 1 else (none, none)
        return self.how["arrive"], self.how["leave"]

    @property
    def pieces(self) -> pieces.Pieces:
        """Pieces of a curve of two keys or more."""
        if self.made is None:
            self.made = _pieces(self)
        return self.made

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
        return self._found(np.atleast_1d(np.asarray(t, np.float64)))[0]

    def rate(self, t) -> np.ndarray:
        """Derivatives at times (n,) [s], (n, ...), the unit a second: at a key the one behind it, 0 where it is held."""
        return self._found(np.atleast_1d(np.asarray(t, np.float64)))[1]

    def table(self, t) -> np.ndarray:
        """Table as `sampled` has it; what is linear by weights of the keys, as its gradients are."""
        return self.weights(t) @ self.values if self.plain else self.sampled(t)

    def place(self, t: np.ndarray):
        """(piece, fraction [1], periods to add, direction, mode, [s] beyond the end) of times (n,), of two keys or more."""
        first, last = self.times[0], self.times[-1]
        mode = np.where(t < first, self.mode(self.before), np.where(t >= last, self.mode(self.after), outside.HELD))
        inside, n, way = INSIDE(t, first, last, mode)
        k = np.where(way < 0.0, np.searchsorted(self.times, inside, "left"), np.searchsorted(self.times, inside, "right")) - 1
        k = np.clip(k, 0, len(self.times) - 2)
        return k, (inside - self.times[k]) / self.pieces.span[k], n, way, mode, t - inside

    def _found(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        first, last, until = self.times[0], self.times[-1], self.until
        if len(self.times) == 1:
            value, rate = np.repeat(self.values, len(t), 0), np.zeros((len(t), *self.values.shape[1:]))
            value[t < first] = until[0]
            beyond, n, way, mode = t - first, np.zeros(len(t)), np.ones(len(t)), np.where(
                t < first, self.mode(self.before), self.mode(self.after))
        else:
            k, s, n, way, mode, beyond = self.place(t)
            value, rate = self.pieces.at(k, s)
            rate = rate * column(way, rate)
            value[(t >= last) & (mode < outside.REPEAT)] = self.values[-1]
            value[(t < first) & (mode < outside.REPEAT)] = until[0]
        rate[((t < first) | (t >= last)) & (mode < outside.REPEAT)] = 0.0
        for side, at in ((0, (t < first) & (mode == outside.LINEAR)), (1, (t >= last) & (mode == outside.LINEAR))):
            if at.any():
                slope = self.slope(side)
                value[at], rate[at] = value[at] + column(beyond[at], value) * slope, slope
        if n.any():
            each = np.where(column(n > 0.0, value), self.values[-1] - self.values[0], until[-1] - until[0])
            value = value + column(n, value) * each
        return value, rate

    @property
    def until(self) -> np.ndarray:
        """Values right before the keys, (keys, ...)."""
        return self.how.get("until", self.values)

    def slope(self, side: int) -> np.ndarray:
        """Slope [unit/s] of going on before (0) or after (1) the keys."""
        given = (self.before, self.after)[side]
        if not isinstance(given, str):
            return np.broadcast_to(np.asarray(given, np.float64), self.values.shape[1:])
        of, k = self.pieces, -side
        if not np.array_equal(self.until[k], self.values[k]):          # USD: it jumps there, and is held
            return np.zeros(self.values.shape[1:])
        if self.kind in (*slopes.RULES, "hermite", "bezier") and self.how.get("form", FORMS[:1])[k] == "curve":
            return self.slopes()[1 - side][k]
        u, du = pieces.easing.warped(of.code[[k]], of.x[[k]], np.array([float(side)]))
        b, c, d = (part[k] for part in of.part[1:])
        return cubic.rate(b, c, d, u[0]) * (du[0] / of.span[k])

    def weights(self, times) -> np.ndarray:
        """Part of each key in the values at some times, (times, keys): the values are weights @ keys' values; slopes that were
        given are fixed. Raises ValueError where slopes are no linear function of the values."""
        if not self.plain:
            return gradient.weights(self, np.atleast_1d(np.asarray(times, np.float64)))
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
        return gradient.pulled(self, np.atleast_1d(np.asarray(times, np.float64)), np.asarray(by, np.float64))

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """The least and the largest value ever, (...) each: of pieces those of their control points, which hold them; infinite
        where it goes on outside of the keys."""
        low, high = self.values.min(axis=0), self.values.max(axis=0)
        if self.kind != "linear" and len(self.times) > 1:
            held = pieces.hull(self.pieces)
            low, high = np.minimum(low, held.min(axis=0)), np.maximum(high, held.max(axis=0))
        for side, of in enumerate((self.before, self.after)):
            grows = self.slope(side) if self.mode(of) == outside.LINEAR else self.values[-1] - self.values[0]
            step = grows * (2 * side - 1) if self.mode(of) in (outside.LINEAR, outside.REPEAT) else 0.0
            low, high = np.where(np.less(step, 0.0), -np.inf, low), np.where(np.greater(step, 0.0), np.inf, high)
        return low, high

    def __eq__(self, other) -> bool:
        return (type(self) is type(other) and np.array_equal(self.times, other.times)
                and np.array_equal(self.values, other.values) and self.kind == other.kind
                and _same(self.before, other.before) and _same(self.after, other.after)
                and self.how.keys() == other.how.keys() and all(_same(v, other.how[k]) for k, v in self.how.items()))

    def __repr__(self) -> str:
        return (f"{type(self).__name__}({self.kind}, {len(self.times)} keys of shape {self.values.shape[1:]} from "
                f"{self.times[0]:g} to {self.times[-1]:g} s)")


def _same(a, b) -> bool:
    return isinstance(a, str) == isinstance(b, str) and (
        list(a) == list(b) if isinstance(a, (list, tuple)) and isinstance(b, (list, tuple)) else np.array_equal(a, b))


def _pieces(c: Curve) -> pieces.Pieces:
    p = c.values[:-1].astype(np.float64)
    q = c.until[1:].astype(np.float64)
    if c.kind in ("linear", "hold"):
        return pieces.straight(c.times, p, q, np.full(len(p), HOLD if c.kind == "hold" else 0))
    if c.kind == "eased":
        return pieces.eased(c.times, p, q, c.how["easing"])
    arrive, leave = c.slopes()
    widths = np.stack([c.how["leave_width"][:-1], c.how["arrive_width"][1:]], 1) if c.kind == "bezier" else None
    found = pieces.hermite(c.times, p, q, leave[:-1], arrive[1:], widths)
    return pieces.formed(found, p, q, np.array(c.how["form"])) if "form" in c.how and len(p) else found
