"""Gradients of a curve's values with respect to its keys, slopes and easing handles: reverse mode, exact. NumPy only.

A value is H00 p + H10 m + H01 q + H11 n of the piece's ends p, q and slopes m, n per unit of u (straight: 1 - u, 0, u, 0).
Of handles (x1, y1, x2, y2), with B1 = 3 u (1 - u)^2 and B2 = 3 u^2 (1 - u):

    dy/dy1 = B1,  dy/dy2 = B2,  dy/dx1 = -y'(u) / x'(u) B1,  dy/dx2 = -y'(u) / x'(u) B2          (x(u; x1, x2) = s holds)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wsim.kernels.animation import cubic, outside
from wsim.scene.curve import easing, slopes
from wsim.scene.curve.slopes import broadcast_column

if TYPE_CHECKING:
    from wsim.scene.curve.curve import Curve


class _CurveGradientSums:
    """What is gathered: by p and q of pieces, by slopes m and n a unit of u, by slopes a second at the ends, by handles."""

    def __init__(self, curve: Curve):
        shape, n = curve.values.shape, len(curve.times)
        self.values, self.until, self.leave, self.arrive = (np.zeros(shape) for _ in range(4))
        self.handles = np.zeros((max(n - 1, 0), 4))


def _straight_pieces(curve: Curve) -> np.ndarray:
    """Which pieces are straight in u, (pieces,)."""
    n = len(curve.times) - 1
    if curve.kind in ("linear", "hold", "eased"):
        return np.ones(n, bool)
    return np.array([f != "curve" for f in curve.how.get("form", ["curve"] * n)], bool)


def _slope_time_steps(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """[s] of slopes that are m and n a unit of u, (pieces,) each."""
    span = curve.pieces.span
    if curve.kind == "bezier":
        return 3.0 * curve.how["leave_width"][:-1], 3.0 * curve.how["arrive_width"][1:]
    return span, span


def _accumulate_key_gradients(curve: Curve, t: np.ndarray, by: np.ndarray, sums: _CurveGradientSums) -> None:
    k, s, n, _, mode, beyond = curve.place(t)
    of = curve.pieces
    u, _ = easing.warp_fractions(of.code[k], of.x[k], s)
    ended = (t >= curve.times[-1]) & (mode < outside.REPEAT)
    early = (t < curve.times[0]) & (mode < outside.REPEAT)
    line = _straight_pieces(curve)[k]
    if curve.kind == "eased":
        within = ~(ended | early)
        _accumulate_handle_gradients(curve, k[within], u[within], by[within], sums)
        u = np.where(of.code[k] == easing.BEZIER, _easing_height(curve, k, u), u)
    a, b, c, d = cubic.hermite_coefficients(*(np.eye(4)[j] for j in (0, 1, 2, 3)))  # of (p, q, m, n)
    basis = cubic.cubic_piece_value(a, b, c, d, u[:, None])
    basis[line] = np.stack([1.0 - u, u, 0.0 * u, 0.0 * u], 1)[line]
    basis[ended | early] = 0.0
    p, q, m, r = (broadcast_column(w, by) * by for w in basis.T)
    first, last = _slope_time_steps(curve)
    np.add.at(sums.values, k, p)
    np.add.at(sums.until, k + 1, q)
    np.add.at(sums.leave, k, broadcast_column(first[k], by) * m)
    np.add.at(sums.arrive, k + 1, broadcast_column(last[k], by) * r)
    sums.values[-1] += by[ended].sum(0)
    sums.until[0] += by[early].sum(0)
    for own, part in ((sums.values, np.maximum(n, 0.0)), (sums.until, np.minimum(n, 0.0))):
        periods = (broadcast_column(part, by) * by).sum(0)
        own[-1] += periods
        own[0] -= periods
    for side, at in ((0, (t < curve.times[0]) & (mode == outside.LINEAR)), (1, ended & (mode == outside.LINEAR))):
        if at.any() and isinstance((curve.before, curve.after)[side], str):
            _accumulate_outside_slope(curve, side, (broadcast_column(beyond[at], by) * by[at]).sum(0), sums)


def _accumulate_outside_slope(curve: Curve, side: int, by: np.ndarray, sums: _CurveGradientSums) -> None:
    """By the slope of going on outside of the keys."""
    k = -side
    if not np.array_equal(curve.until[k], curve.values[k]):    # it is held there
        return
    if not _straight_pieces(curve)[k]:
        (sums.arrive if side else sums.leave)[k] += by
        return
    of = curve.pieces
    if curve.kind == "eased" and of.code[k] == easing.BEZIER:
        raise ValueError("a curve that goes on with the slope of an easing with handles has no gradient; let it be held")
    _, du = easing.warp_fractions(of.code[[k]], of.x[[k]], np.array([float(side)]))
    part = by * (du[0] / of.span[k])
    sums.until[k if side else 1] += part
    sums.values[-2 if side else 0] -= part


def _easing_height(curve: Curve, k: np.ndarray, u: np.ndarray) -> np.ndarray:
    """y(u) [1] of easings with handles."""
    y = _easing_handle_rows(curve)[:, 1::2][k]
    return _unit_interval_cubic(y[:, 0], y[:, 1], u)[0]


def _unit_interval_cubic(first: np.ndarray, second: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(value, rate) at u (n,) of the cubics of control values 0, first, second, 1."""
    a, b, c, d = cubic.hermite_coefficients(0.0, 1.0, 3.0 * first, 3.0 * (1.0 - second))
    return cubic.cubic_piece_value(a, b, c, d, u), cubic.cubic_piece_rate(b, c, d, u)


def _easing_handle_rows(curve: Curve) -> np.ndarray:
    """Handles of each piece, (pieces, 4); NaN of easings without."""
    return np.array([easing.easing_handles(e) or (np.nan,) * 4 for e in curve.how["easing"]]).reshape(-1, 4)


def _accumulate_handle_gradients(curve: Curve, k: np.ndarray, u: np.ndarray, by: np.ndarray, sums: _CurveGradientSums) -> None:
    bezier = curve.pieces.code[k] == easing.BEZIER
    k, u, by = k[bezier], u[bezier], by[bezier]
    x1, y1, x2, y2 = _easing_handle_rows(curve)[k].T
    ends = curve.until
    rise = (by * (ends[k + 1] - curve.values[k])).reshape(len(k), -1).sum(1)
    one, two = 3.0 * u * (1.0 - u)**2, 3.0 * u * u * (1.0 - u)
    of = [_unit_interval_cubic(a, b, u)[1] for a, b in ((y1, y2), (x1, x2))]
    ratio = of[0] / np.where(of[1] * easing.easing.LIMIT > 1.0, of[1], 1.0 / easing.easing.LIMIT)
    np.add.at(sums.handles, k, (rise * np.stack([-ratio * one, one, -ratio * two, two])).T)


def curve_key_gradient(curve: Curve, t: np.ndarray, by: np.ndarray) -> dict[str, np.ndarray]:
    """Gradient as `Curve.pulled` has it."""
    sums = _CurveGradientSums(curve)
    if len(curve.times) == 1:
        return {"values": by.sum(0)[None]}                     # slopes outside are fixed
    _accumulate_key_gradients(curve, t, by, sums)
    found: dict[str, np.ndarray] = {"values": sums.values}
    if "until" in curve.how:
        found["until"] = sums.until
    else:
        sums.values += sums.until
    if curve.kind in slopes.RULES:
        sums.values += slopes.slope_rule_gradient(curve.kind, curve.how, curve.times, curve.values, sums.arrive, sums.leave)
    elif curve.kind in ("hermite", "bezier"):
        found |= {"leave": sums.leave, "arrive": sums.arrive}
    elif curve.kind == "eased":
        found["easing"] = sums.handles
    return found


def curve_key_weights(curve: Curve, t: np.ndarray) -> np.ndarray:
    """Weights as `Curve.weights` has them."""
    if curve.kind == "monotone" or curve.how.get("alpha") is not None:
        raise ValueError(f"slopes of a curve of kind {curve.kind} {curve.how or ''} are no linear function of its values: "
                         "there are no weights of its keys; take `Curve.pulled`, or catmull_rom without alpha")
    eye: np.ndarray = np.eye(len(curve.times))
    flat = {"leave": np.zeros_like(eye), "arrive": np.zeros_like(eye), "until": eye}
    how = curve.how | {name: value for name, value in flat.items() if name in curve.how}
    sides = [s if isinstance(s, str) else 0.0 for s in (curve.before, curve.after)]
    return type(curve)(curve.times, eye, curve.kind, *sides, **how).sampled(t)
