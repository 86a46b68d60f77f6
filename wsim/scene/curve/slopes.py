"""Slopes of piecewise cubic curves at their keys, by rule. NumPy only.

    rule               slopes m_k [unit/s] from the chords c_k = (p_{k+1} - p_k) / dt_k
    catmull_rom        (p_{k+1} - p_{k-1}) / (t_{k+1} - t_{k-1}), by the times of the keys; with alpha by knots
                       |p_{k+1} - p_k|^alpha instead: 0 uniform, 1/2 centripetal (no loops or cusps within a piece; Yuksel,
                       Schaefer, Keyser 2011), 1 chordal. The path is smooth then, its speed need not be (Barry, Goldman 1988)
    kochanek_bartels   tension, bias and continuity of the mean of both chords, with their correction for unequal times
                       (Kochanek, Bartels 1984, equations 8, 9 and section 4)
    monotone           0 where chords change sign, else their weighted harmonic mean: a value stays between its keys
                       (Fritsch, Butland 1984; three-point ends)

At the ends Catmull-Rom and Kochanek-Bartels take the one chord there is. Times in [s], (keys,); values (keys, ...); slopes are
those before and behind the keys. Values may be complex: a small imaginary part finds derivatives (`slope_rule_gradient`).
"""

from collections.abc import Callable

import numpy as np

Slopes = tuple[np.ndarray, np.ndarray]


def broadcast_column(v: np.ndarray, like: np.ndarray) -> np.ndarray:
    """(k,) against (k, ...)."""
    return v.reshape(-1, *(1,) * (like.ndim - 1))


def _chord_slopes(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    dt = broadcast_column(np.diff(times), values)
    return dt, np.diff(values, axis=0) / dt


def catmull_rom(times: np.ndarray, values: np.ndarray, alpha: float | None = None) -> Slopes:
    """Slopes by knots: tangents to the path, in the time of the piece that arrives and of the one that leaves."""
    if alpha is None:
        return kochanek_bartels(times, values)
    if not 0.0 <= alpha <= 1.0:
        raise ValueError(f"alpha of a Catmull-Rom spline is within 0 .. 1, not {alpha}")
    dt, _ = _chord_slopes(times, values)
    way = np.diff(values, axis=0)
    long = np.sqrt((way.reshape(len(way), -1) ** 2).sum(1))
    d = broadcast_column(np.where(long.real > 0.0, long, 1.0) ** alpha, values)
    tangent = np.empty_like(values)                            # by the knot
    tangent[0], tangent[-1] = way[0] / d[0], way[-1] / d[-1]
    tangent[1:-1] = way[:-1] / d[:-1] - (values[2:] - values[:-2]) / (d[:-1] + d[1:]) + way[1:] / d[1:]
    speed = d / dt
    return tangent * np.concatenate([speed[:1], speed]), tangent * np.concatenate([speed, speed[-1:]])


def kochanek_bartels(times: np.ndarray, values: np.ndarray, tension=0.0, bias=0.0, continuity=0.0) -> Slopes:
    dt, chord = _chord_slopes(times, values)
    t, b, c = (np.broadcast_to(np.asarray(v, np.float64), len(times)) for v in (tension, bias, continuity))
    before, after = np.concatenate([chord[:1], chord]), np.concatenate([chord, chord[-1:]])
    part = np.concatenate([dt[:1], dt]), np.concatenate([dt, dt[-1:]])
    share = [p / (part[0] + part[1]) for p in part]            # of chords as speeds: dt_{k-1} c_{k-1} + dt_k c_k over both

    def tension_weighted_chords(sign: float) -> np.ndarray:
        first, second = (1 - t) * (1 + b) * (1 + sign * c), (1 - t) * (1 - b) * (1 - sign * c)
        return broadcast_column(first, values) * share[0] * before + broadcast_column(second, values) * share[1] * after
    return tension_weighted_chords(-1.0), tension_weighted_chords(1.0)


def monotone_slopes(times: np.ndarray, values: np.ndarray) -> Slopes:
    dt, chord = _chord_slopes(times, values)
    m = np.zeros_like(values)
    if len(times) == 2:
        m[:] = chord
        return m, m
    same = (chord[:-1] * chord[1:]).real > 0.0
    a, b = dt[1:] * 2.0 + dt[:-1], dt[1:] + 2.0 * dt[:-1]
    safe = [np.where(same, c, 1.0) for c in (chord[:-1], chord[1:])]
    m[1:-1] = np.where(same, (a + b) / (a / safe[0] + b / safe[1]), 0.0)
    for end, (h, k), (c, d) in ((0, (dt[0], dt[1]), (chord[0], chord[1])), (-1, (dt[-1], dt[-2]), (chord[-1], chord[-2]))):
        slope = ((2.0 * h + k) * c - h * d) / (h + k)
        slope = np.where((slope * c).real <= 0.0, 0.0, slope)
        m[end] = np.where(((c * d).real <= 0.0) & (np.abs(slope) > 3.0 * np.abs(c)), 3.0 * c, slope)
    return m, m


RULES: dict[str, Callable[..., Slopes]] = {"catmull_rom": catmull_rom, "kochanek_bartels": kochanek_bartels,
                                           "monotone": monotone_slopes}
LINEAR = ("kochanek_bartels", "catmull_rom")        # in the values, but for catmull_rom with alpha


def slope_rule_gradient(rule: str, how: dict, times: np.ndarray, values: np.ndarray, before: np.ndarray,
                        behind: np.ndarray) -> np.ndarray:
    """Gradient with respect to the values (keys, ...) of what has these with respect to slopes before and behind the keys.
    Exact: a rule that is linear by its matrix, others by complex steps."""
    if len(times) < 2:
        return np.zeros_like(values)
    if rule in LINEAR and how.get("alpha") is None:
        a, b = RULES[rule](times, np.eye(len(times)), **how)
        return np.tensordot(a.T, before, 1) + np.tensordot(b.T, behind, 1)
    found, tiny = np.zeros(values.size), 1e-40
    for k in range(values.size):
        moved = values.astype(np.complex128)
        moved.reshape(-1)[k] += 1j * tiny
        a, b = RULES[rule](times, moved, **how)
        found[k] = ((a.imag * before).sum() + (b.imag * behind).sum()) / tiny
    return found.reshape(values.shape)
