"""Rotations and stretches of a motion between its keys: slerp at a pace, or squad; and how fast they turn. NumPy only."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wsim.geometry import rotation, rotation_spline
from wsim.geometry.rotation import polar_decomposition
from wsim.kernels.animation import outside
from wsim.scene.curve.curve import Curve

if TYPE_CHECKING:
    from wsim.scene.curve.motion import Motion

PACED = ("linear", "hold", "eased")      # kinds whose rotations are slerps


class RotationCurve:
    """R S of a motion, and its rate."""

    def __init__(self, motion: Motion):
        self.motion, times, n = motion, motion.times, len(motion.times)
        R, self.S = polar_decomposition(motion.values[:, :3, :3])
        self.q = rotation.matrix_quat(R)
        self.slerps = motion.kind in PACED
        self.pace = Curve(times, np.arange(n), motion.kind if self.slerps else "linear", **motion.how if self.slerps else {})
        if n > 1:
            self.turn = rotation.quaternion_logarithm(rotation.quat_product(rotation.quat_conjugate(self.q[:-1]), self.q[1:]))
            self.inner = rotation_spline.inner_quaternions(times, self.q)
            self.whole = rotation.quaternion_logarithm(rotation.quat_product(self.q[-1], rotation.quat_conjugate(self.q[0])))

    def between(self, k: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(quaternion (n, 4), its rate (n, 3) [rad a unit of s] in world axes) of pieces k at fractions s."""
        q = self.q[k]
        if self.slerps:
            return (rotation.quat_product(q, rotation.quaternion_exponential(s[:, None] * self.turn[k])),
                    rotation.quat_rotate(q, self.turn[k]))
        a, b = self.inner
        found, own = rotation_spline.spherical_quadrangle_rate(q, a[k], b[k], self.q[k + 1], s)
        return found, rotation.quat_rotate(found, own)

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(R S, its rate), (n, 3, 3) each."""
        motion, n = self.motion, len(t)
        if len(motion.times) == 1:
            return np.repeat(motion.values[:, :3, :3], n, 0), np.zeros((n, 3, 3))
        k, s, periods, way, mode, beyond = motion.path.place(t)
        inside = np.maximum(motion.times[k] + s * motion.path.pieces.span[k], motion.times[0])        # s may be -1e-16
        at_end = (s >= 1.0) & (way > 0.0)
        speed = np.where(at_end, 0.0, self.pace.rate(np.where(at_end, motion.times[0], inside))) * way
        along = np.where(at_end, 1.0, self.pace.sampled(np.where(at_end, motion.times[0], inside)) - k)
        q, omega = self.between(k, along)
        omega = omega * speed[:, None]
        way_S = self.S[k + 1] - self.S[k]
        S, dS = self.S[k] + along[:, None, None] * way_S, way_S * speed[:, None, None]
        onward = (mode == outside.LINEAR) & ((t < motion.times[0]) | (t >= motion.times[-1]))
        still = ((t < motion.times[0]) | (t >= motion.times[-1])) & (mode == outside.HELD)
        omega[still], dS[still | onward] = 0.0, 0.0
        for side in (0, 1):
            own = onward & ((t >= motion.times[-1]) if side else (t < motion.times[0]))
            if own.any():
                omega[own] = self.end(side)
                q[own] = rotation.quat_product(rotation.quaternion_exponential(beyond[own, None] * omega[own]), q[own])
        if periods.any():
            D = rotation.quaternion_exponential(periods[:, None] * self.whole)
            q, omega = rotation.quat_product(D, q), rotation.quat_rotate(D, omega)
        R = rotation.quaternion_to_matrix(q)
        return R @ S, np.cross(omega[:, None, :], (R @ S).swapaxes(1, 2)).swapaxes(1, 2) + R @ dS

    def by_pace(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(times within the keys [s], how it turns in world axes [rad] a unit of `pace`) at times (n,) [s]."""
        motion = self.motion
        k, s, _, _, _, _ = motion.path.place(t)
        inside = motion.times[k] + s * motion.path.pieces.span[k]
        return inside, self.between(k, self.pace.sampled(inside) - k)[1]

    def end(self, side: int) -> np.ndarray:
        """Angular velocity [rad/s] in world axes at the first or the last key, from within."""
        k = np.array([-side % (len(self.q) - 1)])
        s = np.array([float(side)])
        u, du = (s, np.ones(1)) if self.motion.kind != "eased" else _piece_fraction_at_pace(self.pace, int(k[0]), float(side))
        return (self.between(k, u)[1] * (0.0 if self.motion.kind == "hold" else du / self.motion.path.pieces.span[k]))[0]


def _piece_fraction_at_pace(pace: Curve, k: int, s: float) -> tuple[np.ndarray, np.ndarray]:
    value, rate = pace.pieces.at(np.array([k]), np.array([s]))
    return value - k, rate * pace.pieces.span[k]
