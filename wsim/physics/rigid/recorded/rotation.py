"""Turns of bodies and coordinates of joints on the host, of complex numbers too: a step of i 1e-30 in an argument gives its
derivative to the last digit, since nothing is subtracted (Squire, Trapp 1998). NumPy only, over any leading axes.

Formulas and names are those of kernels/rigid/motion.py and kernels/rigid/joint/coordinates.py; conjugates and lengths are
algebraic, never those of complex numbers.
"""

import numpy as np

C = 0.1931833275037836


def complex_quaternion_product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Quaternion (..., 4) of the rotation q, then p."""
    (a, b, c, d), (x, y, z, w) = np.moveaxis(p, -1, 0), np.moveaxis(q, -1, 0)
    return np.stack([d * x + a * w + b * z - c * y, d * y + b * w + c * x - a * z, d * z + c * w + a * y - b * x,
                     d * w - a * x - b * y - c * z], axis=-1)


def complex_quaternion_conjugate(q: np.ndarray) -> np.ndarray:
    """Quaternion (..., 4) of the rotation back."""
    return q * np.array([-1.0, -1.0, -1.0, 1.0])


def complex_rotation_matrix(q: np.ndarray) -> np.ndarray:
    """R (..., 3, 3) of unit quaternions."""
    x, y, z, w = np.moveaxis(q, -1, 0)
    one = np.ones_like(x)
    return np.stack([np.stack([one - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
                     np.stack([2 * (x * y + w * z), one - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
                     np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), one - 2 * (x * x + y * y)], -1)], axis=-2)


def matrix_times_vector(A: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A v of matrices (..., 3, 3) and vectors (..., 3)."""
    return (A @ v[..., None])[..., 0]


def transpose_times_vector(A: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A^T v."""
    return (np.swapaxes(A, -1, -2) @ v[..., None])[..., 0]


def complex_vector_length(v: np.ndarray) -> np.ndarray:
    """|v| of vectors (..., n)."""
    return np.sqrt((v * v).sum(axis=-1))


def small_turn_applied(q: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """q (..., 4) after a small turn theta (..., 3) [rad] before it, to first order: for steps of derivatives."""
    return complex_quaternion_product(np.concatenate([0.5 * theta, np.ones_like(theta[..., :1])], axis=-1), q)


def complex_atan2(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """atan2 and its first derivatives."""
    size = (x * x + y * y).real
    found = np.arctan2(y.real, x.real)
    return found + 1j * (x.real * y.imag - y.real * x.imag) / np.where(size > 0.0, size, 1.0) if np.iscomplexobj(y) else found


def turn_about_own_axis(q: np.ndarray, L: np.ndarray, rate: np.ndarray, axis: int) -> np.ndarray:
    """q after a turn about an axis of its own by an angle of rate times the momentum along it."""
    half = 0.5 * rate * transpose_times_vector(complex_rotation_matrix(q), L)[..., axis]
    turn = np.zeros((*half.shape, 4), np.result_type(half, q))
    turn[..., axis], turn[..., 3] = np.sin(half), np.cos(half)
    return complex_quaternion_product(q, turn)


def complex_free_rotation(q: np.ndarray, L: np.ndarray, inverse: np.ndarray, h: float) -> np.ndarray:
    """q after h [s] without a torque, see kernels/rigid/motion.py; inverse (..., 3): 1 / I."""
    a, b = h * (inverse[..., 0] - inverse[..., 1]), h * (inverse[..., 2] - inverse[..., 1])
    for part, rate, axis in ((C, a, 0), (0.5, b, 2), (1.0 - 2.0 * C, a, 0), (0.5, b, 2), (C, a, 0)):
        q = turn_about_own_axis(q, L, part * rate, axis)
    size = complex_vector_length(L)
    still = np.abs(size) < 1.0e-150
    half = 0.5 * h * inverse[..., 1] * np.where(still, 0.0, size)
    k = np.where(still, 0.5 * h * inverse[..., 1], np.sin(half) / np.where(still, 1.0, size))
    q = complex_quaternion_product(np.concatenate([k[..., None] * L, np.cos(half)[..., None]], axis=-1), q)
    return q / complex_vector_length(q)[..., None]


def complex_damped_kick(p: np.ndarray, push: np.ndarray, decay: np.ndarray, h: float) -> np.ndarray:
    """p after h [s] of p' = push - decay p; decay (...,)."""
    z = (decay * h)[..., None]
    left, large = np.exp(-z), z.real > 1.0e-2
    part = np.where(large, (1.0 - left) / np.where(large, z, 1.0), 1.0 - z * (0.5 - z / 6.0))
    return left * p + h * part * push


def skew_symmetric_matrix(v: np.ndarray) -> np.ndarray:
    """[v] with [v] u = v x u."""
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], axis=-2)


def complex_swing_twist(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(phi, s_y, s_z) (..., 3) and the quaternion of the swing."""
    q = np.where(q[..., 3:].real < 0.0, -q, q)
    x, w = q[..., 0], q[..., 3]
    size = np.sqrt(x * x + w * w)
    none = np.abs(size) <= 1.0e-12
    phi = np.where(none, 0.0, 2.0 * complex_atan2(x, w))
    zero = np.zeros_like(x)
    safe = np.where(none, 1.0, size)
    twist = np.stack([np.where(none, 0.0, x / safe), zero, zero, np.where(none, 1.0, w / safe)], axis=-1)
    swing = complex_quaternion_product(q, complex_quaternion_conjugate(twist))
    v, c = swing[..., 1:3], swing[..., 3]
    sine = complex_vector_length(v)
    small = np.abs(sine) < 1.0e-9
    k = np.where(small, 2.0 / np.where(np.abs(c) > 0.0, c, 1.0), 2.0 * complex_atan2(sine, c) / np.where(small, 1.0, sine))
    return np.concatenate([phi[..., None], k[..., None] * v], axis=-1), swing


def swing_rate_inverse(s: np.ndarray, swing: np.ndarray) -> np.ndarray:
    """M^-1 (..., 3, 3) of a swing, whose size is below half a turn."""
    v = s * np.array([0.0, 1.0, 1.0])
    tt = (v * v).sum(axis=-1)
    large = tt.real > 1.0e-4
    z = np.where(large, tt, 1.0)
    t = np.sqrt(z)
    first = np.where(large, (1.0 - np.cos(t)) / z, 0.5 - tt / 24.0)
    second = np.where(large, (t - np.sin(t)) / (z * t), 1.0 / 6.0 - tt / 120.0)
    X = skew_symmetric_matrix(v)
    M = np.eye(3) + first[..., None, None] * X + second[..., None, None] * (X @ X)
    M[..., :, 0] = complex_rotation_matrix(swing)[..., :, 0]
    return np.linalg.inv(M)
