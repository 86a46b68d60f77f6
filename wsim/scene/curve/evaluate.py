"""Curves that are not linear between keys and held outside, evaluated: their values and rates, and what lies outside. NumPy
only. Formulas: pieces.py, slopes.py and kernels/animation/outside.py."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wsim.kernels.animation import cubic, outside
from wsim.scene.curve import pieces, slopes
from wsim.scene.curve.easing import HOLD, warp_fractions
from wsim.scene.curve.slopes import broadcast_column

if TYPE_CHECKING:
    from wsim.scene.curve.curve import Curve

INSIDE = outside.extrapolation_formulas(np, float).inside


def mode(curve: Curve, side) -> int:
    """Number of a way to go on outside of the keys, which is `before` or `after`. Raises ValueError for another."""
    if isinstance(side, str):
        if side not in outside.NAMES:
            raise ValueError(f"outside of its keys a curve is {', '.join(outside.NAMES)} or has a slope, not {side!r}")
        return outside.NAMES[side] if len(curve.times) > 1 else outside.HELD
    if np.shape(side) not in ((), curve.values.shape[1:]) or not np.isfinite(side).all():
        raise ValueError(f"a slope outside of keys is finite, one number or of shape {curve.values.shape[1:]}, not {side}")
    return outside.LINEAR


def slopes_of(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """Slopes [unit/s] before and behind the keys, (keys, ...) each, of kinds that have some."""
    if curve.kind in slopes.RULES:
        none = np.zeros_like(curve.values)
        return slopes.RULES[curve.kind](curve.times, curve.values, **curve.how) if len(curve.times) > 1 else (none, none)
    return curve.how["arrive"], curve.how["leave"]


def pieces_of(c: Curve) -> pieces.Pieces:
    """Pieces of a curve of two keys or more."""
    p = c.values[:-1].astype(np.float64)
    q = c.until[1:].astype(np.float64)
    if c.kind in ("linear", "hold"):
        return pieces.straight_curve_pieces(c.times, p, q, np.full(len(p), HOLD if c.kind == "hold" else 0))
    if c.kind == "eased":
        return pieces.eased_curve_pieces(c.times, p, q, c.how["easing"])
    arrive, leave = c.slopes()
    widths = np.stack([c.how["leave_width"][:-1], c.how["arrive_width"][1:]], 1) if c.kind == "bezier" else None
    found = pieces.hermite_curve_pieces(c.times, p, q, leave[:-1], arrive[1:], widths)
    return pieces.override_piece_forms(found, p, q, np.array(c.how["form"])) if "form" in c.how and len(p) else found


def place(curve: Curve, t: np.ndarray):
    """(piece, fraction [1], periods to add, direction, mode, [s] beyond the end) of times (n,), of two keys or more."""
    first, last = curve.times[0], curve.times[-1]
    mode = np.where(t < first, curve.mode(curve.before), np.where(t >= last, curve.mode(curve.after), outside.HELD))
    inside, n, way = INSIDE(t, first, last, mode)
    k = np.where(way < 0.0, np.searchsorted(curve.times, inside, "left"), np.searchsorted(curve.times, inside, "right")) - 1
    k = np.clip(k, 0, len(curve.times) - 2)
    return k, (inside - curve.times[k]) / curve.pieces.span[k], n, way, mode, t - inside


def found(curve: Curve, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(values, rates) at times (n,) [s], (n, ...) each."""
    first, last, until = curve.times[0], curve.times[-1], curve.until
    if len(curve.times) == 1:
        value, rate = np.repeat(curve.values, len(t), 0), np.zeros((len(t), *curve.values.shape[1:]))
        value[t < first] = until[0]
        beyond, n, way, mode = t - first, np.zeros(len(t)), np.ones(len(t)), np.where(
            t < first, curve.mode(curve.before), curve.mode(curve.after))
    else:
        k, s, n, way, mode, beyond = curve.place(t)
        value, rate = curve.pieces.at(k, s)
        rate = rate * broadcast_column(way, rate)
        value[(t >= last) & (mode < outside.REPEAT)] = curve.values[-1]
        value[(t < first) & (mode < outside.REPEAT)] = until[0]
    rate[((t < first) | (t >= last)) & (mode < outside.REPEAT)] = 0.0
    for side, at in ((0, (t < first) & (mode == outside.LINEAR)), (1, (t >= last) & (mode == outside.LINEAR))):
        if at.any():
            slope = curve.slope(side)
            value[at], rate[at] = value[at] + broadcast_column(beyond[at], value) * slope, slope
    if n.any():
        each = np.where(broadcast_column(n > 0.0, value), curve.values[-1] - curve.values[0], until[-1] - until[0])
        value = value + broadcast_column(n, value) * each
    return value, rate


def slope(curve: Curve, side: int) -> np.ndarray:
    """Slope [unit/s] of going on before (0) or after (1) the keys."""
    given = (curve.before, curve.after)[side]
    if not isinstance(given, str):
        return np.broadcast_to(np.asarray(given, np.float64), curve.values.shape[1:])
    of, k = curve.pieces, -side
    if not np.array_equal(curve.until[k], curve.values[k]):          # USD: it jumps there, and is held
        return np.zeros(curve.values.shape[1:])
    if curve.kind in (*slopes.RULES, "hermite", "bezier") and curve.how.get("form", ("curve",))[k] == "curve":
        return curve.slopes()[1 - side][k]
    u, du = warp_fractions(of.code[[k]], of.x[[k]], np.array([float(side)]))
    b, c, d = (part[k] for part in of.part[1:])
    return cubic.cubic_piece_rate(b, c, d, u[0]) * (du[0] / of.span[k])


def widened(curve: Curve, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least and the largest value ever, from those at the keys."""
    if curve.kind != "linear" and len(curve.times) > 1:
        held = pieces.piece_control_hull(curve.pieces)
        low, high = np.minimum(low, held.min(axis=0)), np.maximum(high, held.max(axis=0))
    for side, of in enumerate((curve.before, curve.after)):
        grows = curve.slope(side) if curve.mode(of) == outside.LINEAR else curve.values[-1] - curve.values[0]
        step = grows * (2 * side - 1) if curve.mode(of) in (outside.LINEAR, outside.REPEAT) else 0.0
        low, high = np.where(np.less(step, 0.0), -np.inf, low), np.where(np.greater(step, 0.0), np.inf, high)
    return low, high
