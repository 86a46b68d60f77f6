"""Splines: piecewise cubic curves over time, by the rule of their slopes at the keys. NumPy only.

    rule               slopes m_k [unit/s] from the chords c_k = (p_{k+1} - p_k) / dt_k
    catmull_rom        (p_{k+1} - p_{k-1}) / (t_{k+1} - t_{k-1}), by the times of the keys; with alpha by knots
                       |p_{k+1} - p_k|^alpha instead: 0 uniform, 1/2 centripetal (no loops or cusps within a piece; Yuksel,
                       Schaefer, Keyser 2011), 1 chordal. The path is smooth then, its speed need not be (Barry, Goldman 1988)
    kochanek_bartels   tension, bias and continuity of the mean of both chords, with their correction for unequal times
                       (Kochanek, Bartels 1984, equations 8, 9 and section 4)
    monotone           0 where chords change sign, else their weighted harmonic mean: a value stays between its keys
                       (Fritsch, Butland 1984; three-point ends)
    hermite            given

At the ends Catmull-Rom and Kochanek-Bartels take the one chord there is. Times in [s] from the start of the scene; held outside
of the keys. Pieces: kernels/animation/cubic.py.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wsim.kernels.animation import cubic
from wsim.scene.curve import Curve

Slopes = tuple[np.ndarray, np.ndarray]


def _column(v: np.ndarray, like: np.ndarray) -> np.ndarray:
    """(k,) against (k, ...)."""
    return v.reshape(-1, *(1,) * (like.ndim - 1))


def _chords(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    dt = _column(np.diff(times), values)
    return dt, np.diff(values, axis=0) / dt


def catmull_rom(times: np.ndarray, values: np.ndarray, alpha: float | None = None) -> Slopes:
    """By knots: tangents to the path, in the time of the piece that arrives and of the one that leaves."""
    if alpha is None:
        return kochanek_bartels(times, values)
    dt, _ = _chords(times, values)
    way = np.diff(values, axis=0)
    long = np.sqrt((way.reshape(len(way), -1) ** 2).sum(1))
    d = _column(np.where(long > 0.0, long, 1.0) ** alpha, values)
    tangent = np.empty_like(values)                            # by the knot
    tangent[0], tangent[-1] = way[0] / d[0], way[-1] / d[-1]
    tangent[1:-1] = way[:-1] / d[:-1] - (values[2:] - values[:-2]) / (d[:-1] + d[1:]) + way[1:] / d[1:]
    speed = d / dt
    return tangent * np.concatenate([speed[:1], speed]), tangent * np.concatenate([speed, speed[-1:]])


def kochanek_bartels(times: np.ndarray, values: np.ndarray, tension=0.0, bias=0.0, continuity=0.0) -> Slopes:
    dt, chord = _chords(times, values)
    t, b, c = (np.broadcast_to(np.asarray(v, np.float64), len(times)) for v in (tension, bias, continuity))
    before, after = np.concatenate([chord[:1], chord]), np.concatenate([chord, chord[-1:]])
    part = np.concatenate([dt[:1], dt]), np.concatenate([dt, dt[-1:]])
    share = [p / (part[0] + part[1]) for p in part]            # of chords as speeds: dt_{k-1} c_{k-1} + dt_k c_k over both

    def mixed(sign: float) -> np.ndarray:
        first, second = (1 - t) * (1 + b) * (1 + sign * c), (1 - t) * (1 - b) * (1 - sign * c)
        return _column(first, values) * share[0] * before + _column(second, values) * share[1] * after
    return mixed(-1.0), mixed(1.0)


def monotone(times: np.ndarray, values: np.ndarray) -> Slopes:
    dt, chord = _chords(times, values)
    m = np.zeros_like(values)
    if len(times) == 2:
        m[:] = chord
        return m, m
    same = chord[:-1] * chord[1:] > 0.0
    a, b = dt[1:] * 2.0 + dt[:-1], dt[1:] + 2.0 * dt[:-1]
    safe = [np.where(same, c, 1.0) for c in (chord[:-1], chord[1:])]
    m[1:-1] = np.where(same, (a + b) / (a / safe[0] + b / safe[1]), 0.0)
    for end, (h, k), (c, d) in ((0, (dt[0], dt[1]), (chord[0], chord[1])), (-1, (dt[-1], dt[-2]), (chord[-1], chord[-2]))):
        slope = ((2.0 * h + k) * c - h * d) / (h + k)
        slope = np.where(slope * c <= 0.0, 0.0, slope)
        m[end] = np.where((c * d <= 0.0) & (np.abs(slope) > 3.0 * np.abs(c)), 3.0 * c, slope)
    return m, m


RULES: dict[str, Callable[..., Slopes]] = {"catmull_rom": catmull_rom, "kochanek_bartels": kochanek_bartels,
                                           "monotone": monotone}


@dataclass(eq=False)
class Spline(Curve):
    """A piecewise cubic value over time. Made by `hermite`, `catmull_rom`, `kochanek_bartels` or `monotone`. Raises ValueError
    as a Curve does, and where slopes are not finite.

    times     of the keys, (keys,) [s] from the start of the scene, increasing
    values    at the keys, (keys, ...), in the unit of what it stands for
    rule      of the slopes: one of RULES, or hermite
    how       parameters of the rule, by name [1]
    arrive    slopes before the keys, (keys, ...) [unit/s]
    leave     slopes behind the keys, (keys, ...) [unit/s]
    """

    rule: str = "catmull_rom"
    how: dict = field(default_factory=dict)
    arrive: Any = None
    leave: Any = None

    def __post_init__(self):
        super().__post_init__()
        self.values = np.asarray(self.values, np.float64)
        if self.rule in RULES:
            none = np.zeros_like(self.values)
            self.arrive, self.leave = RULES[self.rule](self.times, self.values, **self.how) if self.moves else (none, none)
        self.arrive, self.leave = (np.asarray(m, np.float64) for m in (self.arrive, self.leave))
        if self.arrive.shape != self.values.shape or self.leave.shape != self.values.shape:
            raise ValueError(f"a spline needs one slope a value: values {self.values.shape}, slopes {self.arrive.shape}, "
                             f"leaving {self.leave.shape}")
        if not (np.all(np.isfinite(self.arrive)) and np.all(np.isfinite(self.leave))):
            raise ValueError("the slopes of a spline must be finite")

    @staticmethod
    def hermite(times, values, slopes, leaving=None) -> "Spline":
        """Through values (keys, ...) with slopes of that shape [unit/s]; leaving: others behind the keys (a corner)."""
        return Spline(times, values, "hermite", {}, slopes, slopes if leaving is None else leaving)

    @staticmethod
    def catmull_rom(times, values, alpha: float | None = None) -> "Spline":
        """Through values, smoothly; alpha: None by the times of the keys, else the power of the distance between them (0
        uniform, 0.5 centripetal, 1 chordal)."""
        if alpha is not None and not 0.0 <= alpha <= 1.0:
            raise ValueError(f"alpha of a Catmull-Rom spline is within 0 .. 1, not {alpha}")
        return Spline(times, values, "catmull_rom", {"alpha": alpha})

    @staticmethod
    def kochanek_bartels(times, values, tension=0.0, bias=0.0, continuity=0.0) -> "Spline":
        """Through values, with tension, bias and continuity [1], one for all keys or (keys,)."""
        return Spline(times, values, "kochanek_bartels", {"tension": tension, "bias": bias, "continuity": continuity})

    @staticmethod
    def monotone(times, values) -> "Spline":
        """Through values, each component within the range of the keys around."""
        return Spline(times, values, "monotone")

    def pieces(self) -> tuple[np.ndarray, ...]:
        """(a, b, c, d) of the pieces between keys over the fraction of the way, (keys - 1, ...) each."""
        dt = _column(np.diff(self.times), self.values)
        return cubic.hermite(self.values[:-1], self.values[1:], dt * self.leave[:-1], dt * self.arrive[1:])

    def _along(self, t) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Piece, fraction and length [s] of it at times (n,) within the keys."""
        t = np.clip(np.asarray(t, np.float64), self.times[0], self.times[-1])
        k = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        dt = self.times[k + 1] - self.times[k]
        return k, (t - self.times[k]) / dt, dt

    def sampled(self, t) -> np.ndarray:
        """Values at times (n,) [s], (n, ...)."""
        t = np.atleast_1d(np.asarray(t, np.float64))
        if not self.moves:
            return np.repeat(self.values, len(t), 0)
        k, s, _ = self._along(t)
        a, b, c, d = (part[k] for part in self.pieces())
        found = cubic.value(a, b, c, d, _column(s, self.values))
        late = t >= self.times[-1]
        found[late] = self.values[-1]
        return found

    def at(self, t: float) -> np.ndarray:
        return self.sampled(t)[0]

    def rate(self, t) -> np.ndarray:
        """Derivative at times (n,) [s], (n, ...), the unit a second; 0 outside of the keys, and the leaving one at a key."""
        t = np.atleast_1d(np.asarray(t, np.float64))
        if not self.moves:
            return np.zeros((len(t), *self.values.shape[1:]))
        k, s, dt = self._along(t)
        _, b, c, d = (part[k] for part in self.pieces())
        found = cubic.rate(b, c, d, _column(s, self.values)) / _column(dt, self.values)
        found[(t < self.times[0]) | (t >= self.times[-1])] = 0.0
        return found

    def weights(self, times: np.ndarray) -> np.ndarray:
        """Part of each key in the values at some times, (times, keys); slopes that were given are fixed. Raises ValueError
        where slopes are no linear function of the values."""
        if self.rule == "monotone" or self.how.get("alpha"):
            raise ValueError(f"slopes of a spline by {self.rule} {self.how or ''} are no linear function of its values: there "
                             "are no weights of its keys; use catmull_rom without alpha")
        eye, none = np.eye(len(self.times)), np.zeros((len(self.times),) * 2)
        return Spline(self.times, eye, self.rule, self.how, none, none).sampled(times)

    def __eq__(self, other) -> bool:
        return (super().__eq__(other) and np.array_equal(self.arrive, other.arrive)
                and np.array_equal(self.leave, other.leave))
