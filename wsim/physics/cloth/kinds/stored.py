"""Elastic energy of constraints in NumPy and float64: for scenes of so few that compiling kernels/cloth/energy.py and the
energies of kernels/cloth/curvature.py costs more. Equations there and in kernels/cloth/constraint.py.

x   positions [m] of the points of each constraint, (m, points, 3)
"""

import numpy as np

from wsim.kernels.cloth.constraint import FLAT

FEW = 1 << 16          # constraints of one kind that the host sums in a tenth of a second


def inverse_where_positive(a: np.ndarray) -> np.ndarray:
    """1 / a for a > 0, else 0."""
    return np.divide(1.0, a, out=np.zeros_like(a), where=a > 0.0)


def spring_energy(x: np.ndarray, rest: np.ndarray, alpha: np.ndarray) -> float:
    """[J] of springs: rest lengths [m], compliances [m/N]."""
    C = np.linalg.norm(x[:, 1] - x[:, 0], axis=1) - rest
    return float(0.5 * np.sum(C * C * inverse_where_positive(alpha)))


def membrane_energy(x: np.ndarray, rest: np.ndarray, alpha: np.ndarray) -> float:
    """[J] of triangles: B = Dm^-1 [1/m], (t, 2, 2), and compliances (uu, uv, shear, vv) [1/J], (t or 1, 4).

    U = sqrt(F^T F) = (F^T F + s 1) / t,  s = |F_u x F_v|,  t = (tr F^T F + 2 s)^1/2."""
    F = np.einsum("tkc,tki->tci", rest, x[:, 1:] - x[:, :1])                          # rows F_u, F_v
    u, v = F[:, 0], F[:, 1]
    uu, vv, uv = (u * u).sum(1), (v * v).sum(1), (u * v).sum(1)
    s = np.linalg.norm(np.cross(u, v), axis=1)
    q = inverse_where_positive(np.sqrt(uu + vv + 2.0 * s))
    C0, C1, C2 = q * (uu + s) - 1.0, q * (vv + s) - 1.0, 2.0 * q * uv
    a, b, shear, c = alpha.T
    plane = c * C0 * C0 + a * C1 * C1 - 2.0 * b * C0 * C1
    return float(0.5 * np.sum(plane * inverse_where_positive(a * c - b * b) + C2 * C2 * inverse_where_positive(shear)))


KINDS = {"distance": spring_energy, "membrane": membrane_energy}


def stored_hinge_angles(x: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """theta - theta_0 in [-pi, pi] [rad] of hinges; 0 where a triangle has no height."""
    E, X2, X3 = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], x[:, 3] - x[:, 0]
    N2, N3 = np.cross(E, X2), np.cross(X3, E)
    LL = (E * E).sum(1)
    q = inverse_where_positive(LL)
    D = np.arctan2(-np.sqrt(LL) * (X3 * N2).sum(1), (N2 * N3).sum(1)) - rest
    D -= 2.0 * np.pi * np.sign(D) * (np.abs(D) > np.pi)
    return np.where(q * (N2 * N2).sum(1) * q * (N3 * N3).sum(1) > FLAT, D, 0.0)


def of_sheets(x: np.ndarray, rest: np.ndarray, alpha: np.ndarray, sheet) -> float:
    """[J] of hinges: angles at rest, compliances [rad/(N m)]; sheet: `wsim.kernels.cloth.curvature.sheet_curvatures`."""
    D, k = stored_hinge_angles(x, rest), inverse_where_positive(np.asarray(alpha, np.float64))
    s = np.sin(D)
    f = s + s**3 / 6.0
    count, value = sheet.count.numpy(), sheet.value.numpy().astype(np.float64)
    slots = len(value) // len(count)
    used = np.arange(slots) < count[:, None]
    z = (np.sqrt(k) * f)[sheet.slot.numpy().reshape(-1, slots)] * used
    C = np.einsum("ts,tsc->tc", z, value.reshape(-1, slots, 3))
    return float(0.5 * np.sum(C * C) + 0.5 * np.sum(k * sheet.own.numpy() * (D - f) * (D + f)))
