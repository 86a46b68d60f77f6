"""Paths by their length: where a curve is once it has gone so far, and curves that are passed at an even pace. NumPy only.

    L(t) = integral of |dp/dt| dt         by Gauss and Legendre with 12 points on parts of each piece, halved until L stays

`evenly` gives a curve of slopes through points at equal steps of time, each where L is what the pace asks for, its slope the
tangent times the pace: between keys it errs by the fourth power of a step, which is halved until the whole is met.
"""

from functools import cached_property

import numpy as np

from wsim.scene.curve.curve import Curve
from wsim.scene.curve.motion import Motion

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
EXACT = 1e-10                        # of the whole length, to which integrals and times are found
MOST = 4096                          # keys of an even curve


class ArcLength:
    """The length along a path. Raises ValueError for a curve without length.

    curve     places over time, values (keys, n) [m], or a `Motion`: the way of its origin
    """

    def __init__(self, curve: Curve):
        self.curve = curve.path if isinstance(curve, Motion) and hasattr(curve, "path") else curve
        if self.curve.values.ndim != 2 or len(self.curve.times) < 2 or not self.whole > 0.0:
            raise ValueError("a path needs two keys or more, places (keys, n) that are not all the same")

    @cached_property
    def table(self) -> tuple[np.ndarray, np.ndarray]:
        """Times [s] and the length up to them [m], fine enough."""
        parts, last = 4, -1.0
        while True:
            times = np.unique(np.concatenate([np.linspace(a, b, parts + 1) for a, b in zip(
                self.curve.times[:-1], self.curve.times[1:], strict=True)]))
            length = np.concatenate([[0.0], np.cumsum(self._between(times[:-1], times[1:]))])
            if abs(length[-1] - last) <= EXACT * length[-1] or parts >= 1024:
                return times, length
            parts, last = 2 * parts, length[-1]

    def _between(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Length from times a to b (n,)."""
        half, middle = 0.5 * (b - a), 0.5 * (a + b)
        t = middle[:, None] + half[:, None] * NODES
        speed = np.linalg.norm(self.curve.rate(t.ravel()).reshape(*t.shape, -1), axis=-1)
        return half * (speed @ WEIGHTS)

    @property
    def whole(self) -> float:
        """Length of the path [m]."""
        return float(self.table[1][-1])

    def length(self, t) -> np.ndarray:
        """Length [m] up to times (n,) [s] within the keys."""
        times, length = self.table
        t = np.clip(np.atleast_1d(np.asarray(t, np.float64)), times[0], times[-1])
        k = np.clip(np.searchsorted(times, t, "right") - 1, 0, len(times) - 2)
        return length[k] + self._between(times[k], t)

    def time(self, s) -> np.ndarray:
        """Times [s] at which the path has gone s (n,) [m], in 0 .. whole: Newton with a bracket."""
        times, length = self.table
        s = np.clip(np.atleast_1d(np.asarray(s, np.float64)), 0.0, length[-1])
        k = np.clip(np.searchsorted(length, s, "right") - 1, 0, len(times) - 2)
        low, high = times[k], times[k + 1]
        part = (s - length[k]) / np.maximum(length[k + 1] - length[k], 1e-300)
        t = low + np.clip(part, 0.0, 1.0) * (high - low)
        for _ in range(60):
            off = length[k] + self._between(times[k], t) - s
            if np.abs(off).max() <= EXACT * self.whole:
                break
            low, high = np.where(off < 0.0, t, low), np.where(off < 0.0, high, t)
            step = t - off / np.maximum(np.linalg.norm(self.curve.rate(t), axis=-1), 1e-300)
            t = np.where((step > low) & (step < high), step, 0.5 * (low + high))
        return t

    def at(self, s) -> np.ndarray:
        """Places (n, ...) [m] of the path where it has gone s (n,) [m]."""
        return self.curve.sampled(self.time(s))

    def tangent(self, t: np.ndarray, before: bool = False) -> np.ndarray:
        """Unit tangents (n, ...) behind times, or before them: they differ at corners; where the path stands still, of the way
        it goes next, or came."""
        first, last = self.curve.times[0], self.curve.times[-1]
        step = 1e-6 * (last - first)
        rate = self.curve.rate(np.clip(t - 1e-12 * (last - first) if before else t, first, np.nextafter(last, first)))
        low, high = (t - step, t) if before else (t, t + step)
        ahead = self.curve.sampled(np.minimum(high, last)) - self.curve.sampled(np.maximum(low, first))
        end = (t <= first) if before else (t >= last)
        ahead[end] = (self.curve.sampled(t + step) - self.curve.sampled(t - step))[end]
        slow = np.linalg.norm(rate, axis=-1, keepdims=True) < 1e-6 * self.whole / (last - first)
        found = np.where(slow, ahead, rate)
        return found / np.maximum(np.linalg.norm(found, axis=-1, keepdims=True), 1e-300)


def evenly(path: Curve, pace: Curve | None = None, accuracy: float = 1e-6) -> Curve:
    """The same path at an even pace: a Curve of slopes, or a Motion whose orientations go along. Raises ValueError for a path
    without length, or a pace that leaves 0 .. 1.

    path        places (keys, n) [m], or a Motion
    pace        part of the whole length over time, values (keys,) in 0 .. 1; None: evenly from the first key to the last
    accuracy    of the length gone at any time, as a part of the whole
    """
    arc = ArcLength(path)
    pace = pace or Curve([path.times[0], path.times[-1]], [0.0, 1.0])
    low, high = pace.bounds()
    if pace.values.ndim != 1 or low < -1e-9 or high > 1.0 + 1e-9:
        raise ValueError(f"a pace goes from 0 to 1, one number a key, not from {np.min(low):g} to {np.max(high):g}")
    parts = 4
    while True:
        found = _resample_at_pace(path, arc, pace, parts)
        middle = 0.5 * (found.times[:-1] + found.times[1:])
        off = (found.path if isinstance(found, Motion) else found).sampled(middle) - arc.at(arc.whole * pace.sampled(middle))
        if np.linalg.norm(off, axis=-1).max() <= accuracy * arc.whole or len(found.times) > MOST:
            return found
        parts = 2 * parts


def _resample_at_pace(path: Curve, arc: ArcLength, pace: Curve, parts: int) -> Curve:
    """By keys at `parts` equal steps of each piece of the pace, and where it passes the path's own keys."""
    ends = zip(pace.times[:-1], pace.times[1:], strict=True)
    own = np.unique(np.concatenate([np.linspace(a, b, parts + 1) for a, b in ends]))
    passed = _pace_passing_times(pace, arc.length(path.times) / arc.whole, own)
    times = np.unique(np.concatenate([own, passed]))
    times = times[np.concatenate([[True], np.diff(times) > 1e-9 * (times[-1] - times[0])])]
    at = arc.time(arc.whole * pace.sampled(times))
    key = path.times[np.abs(at[:, None] - path.times).argmin(axis=1)]
    at = np.where(np.abs(at - key) < 1e-8 * (path.times[-1] - path.times[0]), key, at)
    speed = arc.whole * pace.rate(np.where(times >= pace.times[-1], np.nextafter(pace.times[-1], -np.inf), times))
    how = {"leave": arc.tangent(at) * speed[:, None], "arrive": arc.tangent(at, True) * speed[:, None]}
    if not isinstance(path, Motion):
        return Curve(times, arc.curve.sampled(at), "hermite", **how)
    return Motion(times, path.sampled(at), "hermite", **how)


def _pace_passing_times(pace: Curve, parts: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Times between those given at which the pace first reaches some parts, by bisection: there the path has a key."""
    values, found = pace.sampled(times), []
    for part in parts[1:-1]:
        k = int(np.argmax(values >= part))
        low, high = times[max(k - 1, 0)], times[k]
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if pace.at(middle) < part else (low, middle)
        found.append(high)
    return np.array(found)
