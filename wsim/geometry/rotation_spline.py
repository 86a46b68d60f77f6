"""Rotations between rotations and over time: nlerp, squad, averages. NumPy only, float64, over any leading axes. Quaternions
are (x, y, z, w), unit; q and -q are one rotation, and the short way round is taken.

    nlerp   normalized((1 - s) p + s q): the great circle of slerp at another speed, at most 1e-6 rad off below 3.6 degrees
    squad   slerp(slerp(q0, q1, s), slerp(a, b, s), 2 s (1 - s))                                       Shoemake 1987
            d/ds at 0: log(q0* q1) + 2 log(q0* a)       at 1: log(q0* q1) - 2 log(q1* b)               about own axes

From the angular velocities omega_k at the keys, about own axes, follow the inner quaternions of pieces of any length dt:

    a_k = q_k exp((omega_k dt_k - d_k) / 2)     b_k = q_k exp((d_{k-1} - omega_k dt_{k-1}) / 2)         d_k = log(q_k* q_{k+1})
    omega_k = (d_{k-1} + d_k) / (t_{k+1} - t_{k-1})        at the ends: the one there is

so that the angular velocity is continuous at unequal times too; at equal ones a = b = Shoemake's. The mean is the eigenvector
of the largest eigenvalue of the sum of w q q^T (Markley, Cheng, Crassidis, Oshman 2007), whatever the signs of q.
"""

import numpy as np

from wsim.geometry.rotation import (
    inverse_jacobian_product,
    quat_conjugate,
    quat_product,
    quat_rotate,
    quaternion_exponential,
    quaternion_logarithm,
    right_jacobian_product,
    slerp,
    unit_quat,
)


def lerp_normalized(p: np.ndarray, q: np.ndarray, s) -> np.ndarray:
    """Rotations from p (..., 4) to q the short way, fraction s; no rotation where they are opposite (half a turn apart) and s
    is 1/2."""
    p, q, s = np.asarray(p, np.float64), np.asarray(q, np.float64), np.asarray(s, np.float64)[..., None]
    near = np.where((p * q).sum(-1, keepdims=True) < 0.0, -q, q)
    return unit_quat(p + s * (near - p))


def spherical_quadrangle(q0: np.ndarray, a: np.ndarray, b: np.ndarray, q1: np.ndarray, s) -> np.ndarray:
    """Rotations from q0 to q1 (..., 4), inner quaternions a and b, fraction s of the time."""
    s = np.asarray(s, np.float64)
    return slerp(slerp(q0, q1, s), slerp(a, b, s), 2.0 * s * (1.0 - s))


def spherical_quadrangle_rate(q0: np.ndarray, a: np.ndarray, b: np.ndarray, q1: np.ndarray, s) -> tuple[np.ndarray, np.ndarray]:
    """(squad (..., 4), its angular velocity about own axes (..., 3) [rad a unit of s]), exact.

    With p = slerp(q0, q1, s), r = slerp(a, b, s), w = log(p* r), h = 2 s (1 - s) squad is p exp(h w). w changes by the inverse
    right Jacobian of what turns r against p, exp(h w) by the right Jacobian of h' w + h w'."""
    s = np.asarray(s, np.float64)
    u, v = quaternion_logarithm(quat_product(quat_conjugate(q0), q1)), quaternion_logarithm(quat_product(quat_conjugate(a), b))
    p, r = quat_product(q0, quaternion_exponential(s[..., None] * u)), quat_product(a, quaternion_exponential(s[..., None] * v))
    E = quat_product(quat_conjugate(p), r)
    w = quaternion_logarithm(E)
    h, rate = (2.0 * s * (1.0 - s))[..., None], (2.0 - 4.0 * s)[..., None]
    dw = inverse_jacobian_product(w, v - quat_rotate(quat_conjugate(E), u))
    e = quaternion_exponential(h * w)
    return quat_product(p, e), quat_rotate(quat_conjugate(e), u) + right_jacobian_product(h * w, rate * w + h * dw)


def inner_quaternions(times: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(a, b): inner quaternions of the pieces between keys q (keys, 4) at times (keys,) [s], (keys - 1, 4) each: a belongs to
    the earlier key of a piece, b to the later. Two keys turn at constant speed."""
    dt = np.diff(np.asarray(times, np.float64))[:, None]
    d = quaternion_logarithm(quat_product(quat_conjugate(q[:-1]), q[1:]))
    omega = np.empty((len(q), 3))
    omega[0], omega[-1] = d[0] / dt[0], d[-1] / dt[-1]
    omega[1:-1] = (d[:-1] + d[1:]) / (dt[:-1] + dt[1:])
    a = quat_product(q[:-1], quaternion_exponential(0.5 * (omega[:-1] * dt - d)))
    b = quat_product(q[1:], quaternion_exponential(0.5 * (d - omega[1:] * dt)))
    return a, b


def average_rotation(q: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """Average (4,) with w >= 0 of rotations (n, 4), weights (n,) [1] or equal ones. Raises ValueError where there is none, or
    where weights are negative or all 0."""
    q = np.asarray(q, np.float64).reshape(-1, 4)
    w = np.ones(len(q)) if weights is None else np.asarray(weights, np.float64)
    if len(q) == 0 or w.shape != (len(q),) or np.any(w < 0.0) or not w.sum() > 0.0:
        raise ValueError(f"a mean of rotations needs one weight >= 0 each and not all 0: {len(q)} rotations, weights {w}")
    found = np.linalg.eigh(np.einsum("n,ni,nj->ij", w, q, q))[1][:, -1]
    return found if found[3] >= 0.0 else -found
