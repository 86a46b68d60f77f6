"""Elastic materials of tets in NumPy: energy density Psi [J/m^3], stress P = dPsi/dF [Pa] and its derivative. Without Warp.

    linear                Psi = mu |e|^2 + lam/2 tr(e)^2,  e = sym(F) - 1
    corotational          the same of S - 1,  S = R^T F                                        (Sifakis, Barbic 2012, 3.4)
    st_venant_kirchhoff   the same of (F^T F - 1)/2
    neo_hookean           m/2 (I - 3 - log((I + 1)/4)) + l/2 (J - a)^2,  m = 4/3 mu, l = lam + 5/6 mu, a = 1 + 3/4 m/l
                                                                                     (Smith, de Goes, Kim 2018, eq. 14)
    neo_hookean_no_log    m/2 (I - 3) + l/2 (J - a)^2,  m = mu, l = lam + mu, a = 1 + m/l        (the same, eq. 13)

I = |F|^2, J = det F; with these m and l each has the E and nu of small strain. R is that of F = U diag(s) V^T by NumPy's SVD.
They share nothing with wsim.kernels, which they check. Arrays of tensors are (tets, 3, 3).
"""

import numpy as np

MODELS = ("linear", "corotational", "st_venant_kirchhoff", "neo_hookean", "neo_hookean_no_log")
ONE = np.eye(3)


def sym(A: np.ndarray) -> np.ndarray:
    return 0.5 * (A + np.swapaxes(A, -1, -2))


def trace(A: np.ndarray) -> np.ndarray:
    """(..., 3, 3) to (..., 1, 1), to multiply tensors with."""
    return np.trace(A, axis1=-2, axis2=-1)[..., None, None]


def inner(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """A : B, (..., 1, 1)."""
    return np.sum(A * B, axis=(-2, -1))[..., None, None]


def cofactor(A: np.ndarray) -> np.ndarray:
    """d det(A) / dA, of any A."""
    a, b, c = A[..., 0, :], A[..., 1, :], A[..., 2, :]
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-2)


def cofactor_change(A: np.ndarray, dA: np.ndarray) -> np.ndarray:
    """Directional derivative of the cofactor: it is quadratic, so this difference is exact."""
    return cofactor(A + dA) - cofactor(A) - cofactor(dA)


def signed_svd(F: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """U, s, V with F = U diag(s) V^T, U and V rotations; s[2] has the sign of det F."""
    U, s, Vt = np.linalg.svd(F)
    for turned, where in ((U, np.s_[..., :, 2]), (Vt, np.s_[..., 2, :])):
        flip = np.sign(np.linalg.det(turned))
        turned[where] *= flip[..., None]
        s[..., 2] *= flip
    return U, s, np.swapaxes(Vt, -1, -2)


def hooke(e: np.ndarray, mu: float, lam: float) -> np.ndarray:
    return 2.0 * mu * e + lam * trace(e) * ONE


def hooke_energy(e: np.ndarray, mu: float, lam: float) -> np.ndarray:
    return (mu * inner(e, e) + 0.5 * lam * trace(e) ** 2)[..., 0, 0]


def green(F: np.ndarray) -> np.ndarray:
    return 0.5 * (np.swapaxes(F, -1, -2) @ F - ONE)


def neo_hookean(mu: float, lam: float, log: bool) -> tuple[float, float, float]:
    """m, l [Pa] and a of the two forms."""
    m, volume = (4.0 / 3.0 * mu, lam + 5.0 / 6.0 * mu) if log else (mu, lam + mu)
    return m, volume, 1.0 + (0.75 if log else 1.0) * m / volume


def density(model: str, F: np.ndarray, mu: float, lam: float) -> np.ndarray:
    """Psi [J/m^3], (...,); zero at rest. Raises ValueError for another model."""
    if model == "linear":
        return hooke_energy(sym(F) - ONE, mu, lam)
    if model == "corotational":
        return hooke_energy((signed_svd(F)[1] - 1.0)[..., None] * ONE, mu, lam)
    if model == "st_venant_kirchhoff":
        return hooke_energy(green(F), mu, lam)
    if model not in MODELS:
        raise ValueError(f"model is {model!r}; allowed is one of {', '.join(MODELS)}")
    m, volume, a = neo_hookean(mu, lam, model == "neo_hookean")
    square, J = np.sum(F * F, axis=(-2, -1)), np.linalg.det(F)
    shear = square - 3.0 - (np.log((square + 1.0) / 4.0) if model == "neo_hookean" else 0.0)
    return 0.5 * m * shear + 0.5 * volume * ((J - a) ** 2 - (1.0 - a) ** 2)


def stress(model: str, F: np.ndarray, mu: float, lam: float) -> np.ndarray:
    """P = dPsi/dF [Pa], (..., 3, 3)."""
    if model == "linear":
        return hooke(sym(F) - ONE, mu, lam)
    if model == "corotational":
        U, s, V = signed_svd(F)
        t = 2.0 * mu * (s - 1.0) + lam * np.sum(s - 1.0, axis=-1, keepdims=True)
        return (U * t[..., None, :]) @ np.swapaxes(V, -1, -2)
    if model == "st_venant_kirchhoff":
        return F @ hooke(green(F), mu, lam)
    m, volume, a = neo_hookean(mu, lam, model == "neo_hookean")
    shear = m * (1.0 - 1.0 / (1.0 + inner(F, F))) if model == "neo_hookean" else m
    return shear * F + volume * (np.linalg.det(F)[..., None, None] - a) * cofactor(F)


def stiffness(model: str, F: np.ndarray, mu: float, lam: float) -> np.ndarray:
    """dP/dF [Pa], (..., 9, 9): [3 i + j, 3 k + l] is dP_ij / dF_kl, row by row as NumPy reshapes."""
    dF = np.eye(9).reshape(9, 3, 3)
    G = F[..., None, :, :]                                      # (..., 1, 3, 3) beside the nine directions
    if model == "linear":
        dP = np.broadcast_to(hooke(sym(dF), mu, lam), (*F.shape[:-2], 9, 3, 3))
    elif model == "corotational":
        dP = _corotational_change(F, dF, mu, lam)
    elif model == "st_venant_kirchhoff":
        dP = dF @ hooke(green(G), mu, lam) + G @ hooke(sym(np.swapaxes(G, -1, -2) @ dF), mu, lam)
    else:
        m, volume, a = neo_hookean(mu, lam, model == "neo_hookean")
        square, C, J = 1.0 + inner(G, G), cofactor(G), np.linalg.det(G)[..., None, None]
        dP = m * dF + volume * (inner(C, dF) * C + (J - a) * cofactor_change(G, dF))
        if model == "neo_hookean":
            dP = dP - m / square * dF + 2.0 * m * inner(G, dF) / square ** 2 * G
    return np.swapaxes(dP.reshape(*F.shape[:-2], 9, 9), -1, -2)


def _corotational_change(F: np.ndarray, dF: np.ndarray, mu: float, lam: float) -> np.ndarray:
    """dP = 2 mu (dF - dR) + lam tr(R^T dF) R + lam tr(S - 1) dR, dR = U [(A_ij - A_ji) / (s_i + s_j)] V^T, A = U^T dF V."""
    U, s, V = signed_svd(F)
    U, V, s = U[..., None, :, :], V[..., None, :, :], s[..., None, :]
    A = np.swapaxes(U, -1, -2) @ dF @ V
    dR = (A - np.swapaxes(A, -1, -2)) / (s[..., :, None] + s[..., None, :])
    volume = lam * np.sum(s - 1.0, axis=-1)[..., None, None]
    return U @ (2.0 * mu * (A - dR) + lam * trace(A) * ONE + volume * dR) @ np.swapaxes(V, -1, -2)
