"""Bounds of how fast a frame moves and turns between two times, by formulas: none of its poses is looked at. NumPy only.

    place    value(u), u(s), s = (t - t_k) / span of the piece from key k: |dvalue/dt| <= max |dvalue/du| / (min ds/du span).
             Both are quadratics in u, each within the hull of its three control points on the part that is asked for
    slerp    the angle between its keys times the bound of the pace
    squad    q = p exp(h w), p = slerp(q0, q1), r = slerp(a, b), w = log(p* r), h = 2 s (1 - s)
             (`wsim.geometry.rotation_spline`). With u = log(q0* q1), v = log(a* b) its rate is at most

                 |u| + |h'| W + h k D          k = (W / 2) / sin(W / 2), the norm of the inverse Jacobian at w

             since Jacobians have norm 1. D bounds how fast p and r turn against each other: |u| + |v|, and |v - u| + W |u|;
             W bounds |w|: |log(q0* a)| + s D, or the same from the other end
    stack    outwards from a point that stays within rho of the frame's origin: v += V + Omega rho, rho += |place|, and rates of
             turning add up

    linear   straight ways and slerps at constant rates, held outside: sums of their lengths up to each key say how far it is
             from one time to another

Easings by a name, keys that are held or jumped to, periods that repeat, scale that varies and stretches that are not uniform
have no bound here: it is infinite there.
"""

from __future__ import annotations

import numpy as np

from wsim.geometry import rotation
from wsim.kernels.animation import cubic, outside
from wsim.scene.curve.curve import Curve
from wsim.scene.curve.easing import BEZIER, STRAIGHT, warp_fractions
from wsim.scene.curve.motion import Motion
from wsim.scene.curve.turns import RotationCurve

UNIFORM = 1e-6         # part by which the axes of a constant matrix may differ in length, or be off from square
WIDE = 3.0             # [rad] that squad's inner rotations may be apart at most; at half a turn it may jump


class LinearMotion:
    """A motion that is linear between its keys and held outside: places, rotations and rates, without its matrices."""

    def __init__(self, motion: Motion):
        self.times, self.p, turns = motion.times, motion.values[:, :3, 3], motion.turns
        self.q, n = turns.q, len(motion.times)
        self.turn = np.concatenate([turns.turn, np.zeros((1, 3))]) if n > 1 else np.zeros((1, 3))
        self.span = np.append(np.diff(motion.times), 1.0)
        step = np.stack([np.append(np.linalg.norm(np.diff(self.p, axis=0), axis=1), 0.0), np.linalg.norm(self.turn, axis=1)])
        self.gone = np.concatenate([np.zeros((2, 1)), np.cumsum(step[:, :-1], axis=1)], axis=1)     # way, angle up to a key
        self.rates = step / self.span

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places [m], (n, 3), and quaternions, (n, 4), at times (n,) [s]."""
        k = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 1)
        s = np.where(t < self.times[0], 0.0, t - self.times[k])[:, None] / self.span[k, None]
        last = np.minimum(k + 1, len(self.times) - 1)
        return (self.p[k] + s * (self.p[last] - self.p[k]),
                rotation.quat_product(self.q[k], rotation.quaternion_exponential(s * self.turn[k])))

    def fastest(self, t: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Bounds as the function of that name has them."""
        way, angle = (np.diff(np.interp(t, self.times, gone)) for gone in self.gone)
        last = len(self.times) - 1
        ends = np.stack([np.searchsorted(self.times, t[:-1], side="right") - 1, np.searchsorted(self.times, t[1:])], axis=1)
        ends = np.stack([np.clip(ends[:, 0], 0, max(last - 1, 0)), np.clip(ends[:, 1], 1, max(last, 1))], axis=1).ravel()
        v, omega = (np.maximum.reduceat(np.append(rate, 0.0), ends)[::2] for rate in self.rates)
        arm = float(np.linalg.norm(at))
        return np.stack([way + arm * angle, angle, v + arm * omega, omega], axis=1)


def motion_speed_bounds(motion: Motion, t: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Bounds from each of the times t (n + 1,) [s] to the next, (n, 4): the way [m] of the point `at` (3,) [m] of the moving
    frame, the angle [rad] by which the frame turns on the way, and the greatest of their rates, [m/s] and [rad/s]."""
    parts = getattr(motion, "inner", [motion])
    keys = np.concatenate([t, *(getattr(A, "curve", A).times for A in parts if not isinstance(A, np.ndarray))])
    cuts = np.unique(keys[(keys >= t[0]) & (keys <= t[-1])])
    a, b = cuts[:-1], cuts[1:]                                   # each within one piece of every part
    v, omega, rho = np.zeros(len(a)), np.zeros(len(a)), np.full(len(a), float(np.linalg.norm(at)))
    for A in reversed(parts):
        if isinstance(A, np.ndarray):
            L = A[:3, :3]
            k = float(np.linalg.norm(L, 2))
            if np.abs(L.T @ L - k * k * np.eye(3)).max() > UNIFORM * k * k:
                omega[:] = np.inf
            v, rho = k * v, k * rho + np.linalg.norm(A[:3, 3])
            continue
        own, turn, way = _stack_part_speed(A, a, b)
        with np.errstate(invalid="ignore"):
            v = np.where(rho > 0.0, v + own + turn * rho, v + own)
        omega, rho = omega + turn, rho + way
    first = np.searchsorted(cuts, t[:-1])
    rates, span = np.stack([v, omega], axis=1), (b - a)[:, None]
    return np.concatenate([np.add.reduceat(rates * span, first), np.maximum.reduceat(rates, first)], axis=1)


def _stack_part_speed(A, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(speed [m/s], angular velocity [rad/s], distance [m] of its origin) of a part of a stack from times a to b, (n,) each."""
    none = np.zeros(len(a))
    if isinstance(A, Motion):
        v = curve_rate_bound(A.path, a, b)
        return v, angular_velocity_bound(A, a, b), np.linalg.norm(A.path.sampled(a), axis=1) + v * (b - a)
    v = curve_rate_bound(A.curve, a, b)
    if A.what == "shift":
        return v, none, np.abs(A.curve.sampled(a)) + v * (b - a)
    if A.what == "turn":
        return none, v, none
    same = A.what == "scale" and not v.any() and (A.curve.sampled(a) == 1.0).all()
    return none, none if same else none + np.inf, none


def curve_rate_bound(curve: Curve, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Bound of the length of a curve's rate [unit/s] from times a to b (n,) that have no key between them, (n,)."""
    n, middle = len(curve.times), 0.5 * (a + b)
    if not np.array_equal(curve.until, curve.values):
        return np.full(len(a), np.inf)
    found = np.zeros(len(a))
    if n > 1:
        k = np.clip(np.searchsorted(curve.times, middle) - 1, 0, n - 2)
        of = curve.pieces
        s = [np.clip((t - curve.times[k]) / of.span[k], 0.0, 1.0) for t in (a, b)]
        x, known = of.x[k], np.isin(of.code[k], (STRAIGHT, BEZIER))
        u0, u1 = (warp_fractions(np.where(known, of.code[k], STRAIGHT), x, end)[0] for end in s)
        Q = _derivative_controls([part[k].reshape(len(k), -1) for part in of.part], u0, u1)
        X = _derivative_controls([column[:, None] for column in cubic.hermite_coefficients(
            np.zeros(len(k)), np.ones(len(k)), 3.0 * x[:, 0], 3.0 * (1.0 - x[:, 1]))], u0, u1)
        slow = np.where(of.code[k] == BEZIER, X[..., 0].min(axis=0), 1.0)
        known &= slow > 0.0
        found = np.where(known, np.linalg.norm(Q, axis=-1).max(axis=0) / np.where(known, slow * of.span[k], 1.0), np.inf)
    return _outside_rate_bound(curve, middle, found, lambda side: float(np.linalg.norm(curve.slope(side))))


def _derivative_controls(part: list, u0: np.ndarray, u1: np.ndarray) -> np.ndarray:
    """Control points (3, n, m) of the derivative of cubics (a, b, c, d) (n, m) each, with respect to u, from u0 to u1 (n,)."""
    _, b, c, d = part
    u0, u1 = u0[:, None], u1[:, None]
    first = cubic.cubic_piece_rate(b, c, d, u0)
    return np.stack([first, first + 0.5 * (u1 - u0) * (2.0 * c + 6.0 * u0 * d), cubic.cubic_piece_rate(b, c, d, u1)])


def _outside_rate_bound(curve: Curve, t: np.ndarray, found: np.ndarray, slope) -> np.ndarray:
    """The bound `found`, and what holds outside of the keys. slope(side): of what goes on before (0) or after (1) them."""
    for side, of, there in ((0, curve.before, t < curve.times[0]), (1, curve.after, t > curve.times[-1])):
        if there.any():
            mode = curve.mode(of)
            found[there] = slope(side) if mode == outside.LINEAR else 0.0 if mode == outside.HELD else np.inf
    return found


def angular_velocity_bound(motion: Motion, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Bound of a motion's angular velocity [rad/s] from times a to b (n,) that have no key between them, (n,)."""
    found = np.zeros(len(a))
    if len(motion.times) == 1:
        return found
    turns, k = motion.turns, np.clip(np.searchsorted(motion.times, 0.5 * (a + b)) - 1, 0, len(motion.times) - 2)
    angle = np.linalg.norm(turns.turn, axis=1)[k]
    if turns.slerps:
        still = angle == 0.0
        with np.errstate(invalid="ignore"):
            found = np.where(still, 0.0, angle * curve_rate_bound(turns.pace, a, b))
    else:
        span = np.diff(motion.times)[k]
        found = _squad_rate_bound(turns, k, *(np.clip((t - motion.times[k]) / span, 0.0, 1.0) for t in (a, b))) / span
    return _outside_rate_bound(motion.path, 0.5 * (a + b), found, lambda side: float(np.linalg.norm(turns.end(side))))


def _squad_rate_bound(turns: RotationCurve, k: np.ndarray, s0: np.ndarray, s1: np.ndarray) -> np.ndarray:
    """Bound of the rate of squad [rad a unit of s] in pieces k from s0 to s1, (n,) each."""
    def relative_rotation_vector(p, q):
        return rotation.quaternion_logarithm(rotation.quat_product(rotation.quat_conjugate(p), q))

    def vector_norms(w):
        return np.linalg.norm(w, axis=-1)
    q, (inner, outer) = turns.q, (each[k] for each in turns.inner)
    u, v = turns.turn[k], relative_rotation_vector(inner, outer)
    D, begin, end = (vector_norms(u) + vector_norms(v), vector_norms(relative_rotation_vector(q[k], inner)),
                     vector_norms(relative_rotation_vector(q[k + 1], outer)))
    for _ in range(3):
        W = np.minimum(begin + s1 * D, end + (1.0 - s0) * D)
        D = np.minimum(D, vector_norms(v - u) + W * vector_norms(u))
    h = np.where((s0 < 0.5) & (s1 > 0.5), 0.5, np.maximum(2.0 * s0 * (1.0 - s0), 2.0 * s1 * (1.0 - s1)))
    steep = np.maximum(np.abs(2.0 - 4.0 * s0), np.abs(2.0 - 4.0 * s1))
    return np.where(W <= WIDE, vector_norms(u) + steep * W + h * D / np.sinc(np.minimum(W, WIDE) / (2.0 * np.pi)), np.inf)
