"""Euler angles of rotations, in all twelve orders. NumPy only, float64, over any leading axes.

An order is three letters of x, y, z, no letter beside itself. Turns are about axes that stay (as rotateXYZ of USD has it): of
"xyz" first about x, then y, then z, R = Rz Ry Rx; about axes that turn along, the same angles stand for the order read
backwards. Angles a, b, c [rad] belong to the letters.

    three letters   b in -pi/2 .. pi/2, sin b = the one element that a and c do not enter
    two letters     b in 0 .. pi, cos b likewise

Where both outer axes come to lie in one line (|b| = pi/2, or b = 0, pi) only a + c or a - c is known: gimbal lock. c = 0 is
taken there and `locked` says so; nearer than LOCK, a and c are each uncertain by rounding over the distance.

Shoemake 1994, Euler angle conversion (Graphics Gems IV, III.5).
"""

from itertools import product

import numpy as np

from wsim.geometry.rotation import axis_rotation_matrix, matrix_quat, quaternion_to_matrix

ORDERS = tuple("".join(o) for o in product("xyz", repeat=3) if o[0] != o[1] != o[2])
LOCK = 1.0e-6                             # [rad] between the outer axes, below which they count as one


def _axes_of_order(order: str) -> tuple[int, int, int]:
    if order not in ORDERS:
        raise ValueError(f"an order of Euler angles is one of {', '.join(ORDERS)}, not {order!r}")
    i, j, k = ("xyz".index(letter) for letter in order)
    return i, j, k


def from_euler(angles: np.ndarray, order: str = "xyz") -> np.ndarray:
    """Quaternion (..., 4), (x, y, z, w), of angles (..., 3) [rad] about the axes of `order`, first letter first. Raises
    ValueError for an unknown order."""
    angles = np.asarray(angles, np.float64)
    R = np.eye(3)
    for k, axis in enumerate(_axes_of_order(order)):
        R = axis_rotation_matrix(np.eye(3)[axis], angles[..., k]) @ R
    return matrix_quat(R)


def to_euler(q: np.ndarray, order: str = "xyz") -> tuple[np.ndarray, np.ndarray]:
    """(angles (..., 3) [rad], locked (...)) of unit quaternions (..., 4), (x, y, z, w). locked: gimbal lock, the last angle is
    0 there by choice. Raises ValueError for an unknown order."""
    i, j, k = _axes_of_order(order)
    R = quaternion_to_matrix(q)
    two = i == k
    third = 3 - i - j if two else k
    sign = 1.0 if (j - i) % 3 == 1 else -1.0                   # of the permutation (i, j, third)
    # columns and rows are those of R = R_k(c) R_j(b) R_i(a)
    if two:
        flat = np.hypot(R[..., i, j], R[..., i, third])        # sin b
        b = np.arctan2(flat, R[..., i, i])
        a = np.arctan2(R[..., i, j], sign * R[..., i, third])
        c = np.arctan2(R[..., j, i], -sign * R[..., third, i])
    else:
        flat = np.hypot(R[..., i, i], R[..., j, i])            # cos b
        b = np.arctan2(-sign * R[..., k, i], flat)
        a = np.arctan2(sign * R[..., k, j], R[..., k, k])
        c = np.arctan2(sign * R[..., j, i], R[..., i, i])
    locked = flat < LOCK
    alone = np.arctan2(-sign * R[..., j, third], R[..., j, j])     # R_j(b) R_i(a) without c, in row j
    return np.stack([np.where(locked, alone, a), b, np.where(locked, 0.0, c)], -1), locked
