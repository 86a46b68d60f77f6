"""Residual of XPBD's sweeps in NumPy and float64, of so few constraints that compiling kernels/solver/sweeps/residual.py costs
more; equations there and in kernels/cloth/constraint.py. The largest over constraints of

    |C + a lam| S / (S + a) / l,   S = sum_k w_k |G_k|^2,   a = alpha / h^2

x     positions [m] of the points of each constraint, (m, points, 3)
rest  values at rest: lengths [m], angles [rad], B = Dm^-1 [1/m] (m, 2, 2)
a     compliances over h^2, (m or 1,), of membranes (uu, uv, shear, vv), (m or 1, 4)
lam   multipliers, (m,), of membranes (m, 3)
w     inverse masses of the points [1/kg], (m, points)
"""

import numpy as np

from wsim.kernels.cloth.constraint import FLAT
from wsim.physics.cloth.kinds.stored import inverse_where_positive, stored_hinge_angles

LEAST = 1e-12            # [m] of a rest length that a residual is divided by


def multiplier_share(S: np.ndarray, a: np.ndarray) -> np.ndarray:
    """S / (S + a); 0 where nothing can move."""
    return S * inverse_where_positive(np.where(S > 0.0, S + a, 0.0))


def spring_residual(x: np.ndarray, rest: np.ndarray, a: np.ndarray, lam: np.ndarray, w: np.ndarray) -> float:
    """Largest residual of springs, a part of their rest length [1]."""
    L = np.linalg.norm(x[:, 1] - x[:, 0], axis=1)
    S = np.where(L > 0.0, w[:, 0] + w[:, 1], 0.0)
    return float((np.abs(L - rest + a * lam) * multiplier_share(S, a) / np.maximum(np.abs(rest), LEAST)).max(initial=0.0))


def of_angles(x: np.ndarray, rest: np.ndarray, a: np.ndarray, lam: np.ndarray, w: np.ndarray) -> float:
    """Largest residual of hinges [rad]."""
    E, X2, X3 = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], x[:, 3] - x[:, 0]
    N2, N3, LL = np.cross(E, X2), np.cross(X3, E), (E * E).sum(1)
    q = inverse_where_positive(LL)
    H2, H3 = q * (N2 * N2).sum(1), q * (N3 * N3).sum(1)
    s = -q * np.sqrt(LL) * inverse_where_positive(np.where(H2 * H3 > FLAT, H2 * H3, 0.0))
    G2, G3 = (s * H3)[:, None] * N2, (s * H2)[:, None] * N3
    G1 = -(q * (E * X2).sum(1))[:, None] * G2 - (q * (E * X3).sum(1))[:, None] * G3
    S = sum(w[:, k] * (G * G).sum(1) for k, G in enumerate((-(G1 + G2 + G3), G1, G2, G3)))
    return float((np.abs(stored_hinge_angles(x, rest) + a * lam) * multiplier_share(S, a)).max(initial=0.0))


def membrane_residual(x: np.ndarray, rest: np.ndarray, a: np.ndarray, lam: np.ndarray, w: np.ndarray) -> float:
    """Largest residual of triangles, a strain [1]. S by `wsim.kernels.cloth.constraint.membrane_response`."""
    F = np.einsum("tkc,tki->tci", rest, x[:, 1:] - x[:, :1])                          # rows F_u, F_v
    u, v = F[:, 0], F[:, 1]
    uu, vv, uv = (u * u).sum(1), (v * v).sum(1), (u * v).sum(1)
    s = np.linalg.norm(np.cross(u, v), axis=1)
    q = inverse_where_positive(np.sqrt(uu + vv + 2.0 * s))
    U, V, m = q * (uu + s), q * (vv + s), q * q * uv
    of_u, of_v = (np.stack([-rest[:, 0, c] - rest[:, 1, c], rest[:, 0, c], rest[:, 1, c]], axis=1) for c in (0, 1))
    Muu, Muv, Mvv = ((w * p * r).sum(1) for p, r in ((of_u, of_u), (of_u, of_v), (of_v, of_v)))
    turned = m * m * (Muu + Mvv) - 2.0 * m * Muv
    S = np.stack([Muu + turned, Mvv + turned, 4.0 * q * q * (Muu * V * V + Mvv * U * U)], axis=1)
    C = np.stack([U - 1.0, V - 1.0, 2.0 * q * uv], axis=1)
    C += np.stack([a[:, 0] * lam[:, 0] + a[:, 1] * lam[:, 1], a[:, 1] * lam[:, 0] + a[:, 3] * lam[:, 1], a[:, 2] * lam[:, 2]],
                  axis=1)
    return float((np.abs(C) * multiplier_share(S, a[:, [0, 3, 2]])).max(initial=0.0))


KINDS = {"distance": spring_residual, "dihedral": of_angles, "membrane": membrane_residual}
