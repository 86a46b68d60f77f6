"""Rotations on the host: quaternions, matrices, rotation vectors. NumPy only, float64, over any leading axes.

Quaternions are (x, y, z, w), unit, and act as q v q*; q and -q are one rotation. A rotation vector is axis times angle [rad].
Names and formulas are those of kernels/math/rotation.py, which does the same on the device. `polar_decomposition` and
`axis_angle` are here alone: what the device evaluates of keys is prepared here.

    exponential(u) = (sin(a / 2) u / a, cos(a / 2)),  a = |u|         logarithm(q) = 2 atan2(|v|, w) v / |v|,  w >= 0
    slerp          = p exponential(s logarithm(p* q))                 integrated   = exponential(h omega) q

Sola 2017, Quaternion kinematics for the error-state Kalman filter, sections 2.4, 2.7 and 4.6.
"""

import numpy as np


def quat_product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Quaternion (..., 4) of the rotation q, then p (Hamilton)."""
    p, q = np.asarray(p, np.float64), np.asarray(q, np.float64)
    (a, b, c, d), (x, y, z, w) = np.moveaxis(p, -1, 0), np.moveaxis(q, -1, 0)
    return np.stack([d * x + a * w + b * z - c * y, d * y + b * w + c * x - a * z, d * z + c * w + a * y - b * x,
                     d * w - a * x - b * y - c * z], axis=-1)


def quat_conjugate(q: np.ndarray) -> np.ndarray:
    """Quaternion (..., 4) of the rotation back."""
    return np.asarray(q, np.float64) * (-1.0, -1.0, -1.0, 1.0)


def unit_quat(q: np.ndarray) -> np.ndarray:
    """q / |q|, (..., 4); no rotation, (0, 0, 0, 1), where q is 0."""
    q = np.asarray(q, np.float64)
    size = np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(size > 0.0, q / np.where(size > 0.0, size, 1.0), (0.0, 0.0, 0.0, 1.0))


def quat_rotate(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """q v q* of vectors (..., 3): v + w t + u x t, t = 2 u x v with q = (u, w); a small turn keeps its digits."""
    q, v = np.asarray(q, np.float64), np.asarray(v, np.float64)
    u = q[..., :3]
    t = 2.0 * np.cross(u, v)
    return v + q[..., 3:] * t + np.cross(u, t)


def quaternion_to_matrix(q: np.ndarray) -> np.ndarray:
    """R (..., 3, 3) of unit quaternions: 1 + 2 w [v]x + 2 [v]x^2."""
    x, y, z, w = np.moveaxis(np.asarray(q, np.float64), -1, 0)
    xx, yy, zz, xy, xz, yz = 2 * x * x, 2 * y * y, 2 * z * z, 2 * x * y, 2 * x * z, 2 * y * z
    wx, wy, wz = 2 * x * w, 2 * y * w, 2 * z * w
    return np.stack([np.stack([1.0 + (-yy - zz), xy - wz, xz + wy], -1), np.stack([xy + wz, 1.0 + (-xx - zz), yz - wx], -1),
                     np.stack([xz - wy, yz + wx, 1.0 + (-xx - yy)], -1)], axis=-2)


def matrix_quat(R: np.ndarray) -> np.ndarray:
    """(x, y, z, w) with w >= 0 of rotations (..., 3, 3), from the largest of the four squares (Shepperd 1978)."""
    xx, yy, zz = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    s = np.stack([1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz], axis=-1)
    a, b, c = R[..., 2, 1], R[..., 0, 2], R[..., 1, 0]
    p, q, r = R[..., 1, 2], R[..., 2, 0], R[..., 0, 1]
    products = np.stack([np.stack([s[..., 0], c + r, b + q, a - p], -1),       # rows of 4 (x, y, z, w)^T (x, y, z, w)
                         np.stack([c + r, s[..., 1], a + p, b - q], -1),
                         np.stack([b + q, a + p, s[..., 2], c - r], -1),
                         np.stack([a - p, b - q, c - r, s[..., 3]], -1)], axis=-2)
    row = np.take_along_axis(products, np.argmax(s, axis=-1)[..., None, None], axis=-2)[..., 0, :]
    row = row / np.linalg.norm(row, axis=-1, keepdims=True)
    return np.where(row[..., 3:] < 0, -row, row)


def axis_rotation_matrix(axis: np.ndarray, angle) -> np.ndarray:
    """I + sin K + (1 - cos) K K, rotation (..., 3, 3) by angles [rad] (...) about unit axes (..., 3) (Rodrigues).

    The device leaves out the products of K K by zero, which differ by a fused multiply-add: one unit of rounding."""
    if np.ndim(axis) == 1 and np.ndim(angle) == 0:          # a motion asks for one at a time, in each substep
        x, y, z = axis
        K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)
    axis, angle = np.asarray(axis, np.float64), np.asarray(angle, np.float64)
    K = np.zeros((*axis.shape[:-1], 3, 3))
    K[..., 2, 1], K[..., 0, 2], K[..., 1, 0] = np.moveaxis(axis, -1, 0)
    K = K - np.swapaxes(K, -1, -2)
    s, c = np.sin(angle)[..., None, None], 1.0 - np.cos(angle)[..., None, None]
    return np.eye(3) + s * K + c * (K @ K)


def axis_angle(R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit axes (..., 3) and angles [rad] (...) in [0, pi] of rotations (..., 3, 3); the axis of no rotation is x.

    Where the angle is within 1e-6 of pi, R = 2 n n^T - I nearly: the longest column of R + I is the axis.
    """
    R = np.asarray(R, np.float64)
    skew = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1)
    length = _lengths_of_vectors(skew)
    angle = np.arctan2(length, np.trace(R, axis1=-2, axis2=-1) - 1.0)
    axis = skew / np.where(length > 0.0, length, 1.0)[..., None]
    still, half = angle < 1e-12, angle > np.pi - 1e-6
    B = R + np.eye(3)
    column = np.argmax(np.linalg.norm(B, axis=-2), axis=-1)
    n = np.take_along_axis(B, column[..., None, None], axis=-1)[..., 0]
    n = n / np.maximum(_lengths_of_vectors(n), 1e-300)[..., None]
    n = np.where((n * skew).sum(axis=-1, keepdims=True) >= 0, n, -n)
    axis = np.where(half[..., None], n, axis)
    return np.where(still[..., None], (1.0, 0.0, 0.0), axis), np.where(still, 0.0, angle)


def _lengths_of_vectors(v: np.ndarray) -> np.ndarray:
    """|v| (...) of vectors (..., 3), summed as a product of matrices is: the same bits for one vector as for many."""
    return np.sqrt((v[..., None, :] @ v[..., :, None])[..., 0, 0])


def quaternion_exponential(u: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) of rotation vectors [rad] (..., 3); by a series below 0.01 rad."""
    u = np.asarray(u, np.float64)
    aa = (u * u).sum(axis=-1, keepdims=True)
    a, far = np.sqrt(aa), aa > 1.0e-4
    k = np.where(far, np.sin(0.5 * a) / np.where(far, a, 1.0), 0.5 - aa / 48.0 + aa * aa / 3840.0)
    return np.concatenate([k * u, np.cos(0.5 * a)], axis=-1)


def quaternion_logarithm(q: np.ndarray) -> np.ndarray:
    """Rotation vectors [rad] (..., 3) of unit quaternions, the short way: |u| <= pi. Half a turn goes about q's own axis."""
    q = np.asarray(q, np.float64)
    q = np.where(q[..., 3:] < 0.0, -q, q)
    v, c = q[..., :3], q[..., 3:]
    s = np.linalg.norm(v, axis=-1, keepdims=True)
    tt = (s / np.maximum(c, 1.0e-3)) ** 2
    near = 2.0 / np.maximum(c, 1.0e-3) * (1.0 - tt / 3.0 + tt * tt / 5.0)
    far = tt > 1.0e-5
    return np.where(far, 2.0 * np.arctan2(s, c) / np.where(far, s, 1.0), near) * v


def slerp(p: np.ndarray, q: np.ndarray, s) -> np.ndarray:
    """Rotation a part s (...) of the short way from p to q (..., 4), at constant speed about a fixed axis."""
    return quat_product(p, quaternion_exponential(np.asarray(s, np.float64)[..., None]
                                                  * quaternion_logarithm(quat_product(quat_conjugate(p), q))))


def angular_velocity_between(p: np.ndarray, q: np.ndarray, h: float) -> np.ndarray:
    """Angular velocity [rad/s] (..., 3), in world axes, that turns p into q (..., 4) in h [s], the short way."""
    return quaternion_logarithm(quat_product(q, quat_conjugate(p))) / h


def rotate_by_angular_velocity(q: np.ndarray, omega: np.ndarray, h: float) -> np.ndarray:
    """Orientations q (..., 4) after h [s] at angular velocities omega [rad/s] (..., 3) in world axes."""
    return unit_quat(quat_product(quaternion_exponential(h * np.asarray(omega, np.float64)), q))


def _add_cross_products(w: np.ndarray, v: np.ndarray, second, third) -> np.ndarray:
    """v + second w x v + third w x (w x v)."""
    c = np.cross(w, v)
    return v + second * c + third * np.cross(w, c)


def right_jacobian_product(w: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Rate [rad/s] (..., 3) about own axes of exponential(w), where the rotation vector w [rad] (..., 3) changes by v a second
    (Sola, equation 183); by a series below 0.01 rad."""
    aa = (w * w).sum(axis=-1, keepdims=True)
    a, far = np.sqrt(np.where(aa > 1.0e-4, aa, 1.0)), aa > 1.0e-4
    return _add_cross_products(w, v, -np.where(far, (1.0 - np.cos(a)) / (a * a), 0.5 - aa / 24.0 + aa * aa / 720.0),
                               np.where(far, (a - np.sin(a)) / (a * a * a), 1.0 / 6.0 - aa / 120.0 + aa * aa / 5040.0))


def inverse_jacobian_product(w: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Rate (..., 3) of the rotation vector w [rad], |w| < 2 pi, of a rotation that turns by v [rad/s] about own axes (equation
    184)."""
    aa = (w * w).sum(axis=-1, keepdims=True)
    a, far = np.sqrt(np.where(aa > 1.0e-4, aa, 1.0)), aa > 1.0e-4
    near = 1.0 / 12.0 + aa / 720.0 + aa * aa / 30240.0
    return _add_cross_products(w, v, 0.5, np.where(far, (1.0 - 0.5 * a * np.cos(0.5 * a) / np.sin(0.5 * a)) / (a * a), near))


def polar_decomposition(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A = R S with R a rotation (det R = 1) and S symmetric; shape (..., 3, 3). A mirrored A has a negative S."""
    U, sigma, Vt = np.linalg.svd(A)
    sign = np.where(np.linalg.det(U @ Vt) < 0, -1.0, 1.0)
    U[..., 2] *= sign[..., None]
    sigma[..., 2] *= sign
    return U @ Vt, np.swapaxes(Vt, -1, -2) @ (sigma[..., None] * np.eye(3)) @ Vt
