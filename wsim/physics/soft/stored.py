"""Strain and elastic energy of four-node tets in NumPy and float64: for bodies of so few that compiling the statistics of
kernels/soft/fem.py costs more. Psi [J/m^3] of H = F - 1, (t, 3, 3), of its stretches less 1 (t, 3), and of mu, lam [Pa]:
equations in kernels/soft/material.py and kernels/soft/neo_hookean.py.
"""

import numpy as np

from wsim.kernels.soft.principal import LARGEST

FEW = 1 << 15          # tets of one material that the host sums in a tenth of a second


def hooke_strain_energy(e: np.ndarray, mu: np.ndarray, lam: np.ndarray) -> np.ndarray:
    """mu |e|^2 + lam/2 tr(e)^2 of symmetric strains (t, 3, 3)."""
    return mu * (e * e).sum(axis=(1, 2)) + 0.5 * lam * np.trace(e, axis1=1, axis2=2) ** 2


def _small_strain_energy(H, E, mu, lam) -> np.ndarray:
    return hooke_strain_energy(0.5 * (H + H.swapaxes(1, 2)), mu, lam)


def _corotational_strain_energy(H, E, mu, lam) -> np.ndarray:
    return mu * (E * E).sum(axis=1) + 0.5 * lam * E.sum(axis=1) ** 2


def _st_venant_kirchhoff(H, E, mu, lam) -> np.ndarray:
    return hooke_strain_energy(0.5 * (H + H.swapaxes(1, 2) + H.swapaxes(1, 2) @ H), mu, lam)


def _neo_hookean(H, E, mu, lam) -> np.ndarray:
    t = np.trace(H, axis1=1, axis2=2)
    hh = 0.5 * (H * H).sum(axis=(1, 2))
    cof = 0.5 * (t * t - np.einsum("tij,tji->t", H, H))
    c = cof + np.linalg.det(H)
    x, j = 0.5 * (t + hh), t + c
    volume, k = lam + 5.0 / 6.0 * mu, np.clip(j, -LARGEST, LARGEST)
    return mu * (hh - c) + 2.0 / 3.0 * mu * (x - np.log1p(x)) + volume * k * (j - 0.5 * k)


ENERGY = {"linear": _small_strain_energy, "corotational": _corotational_strain_energy,
          "st_venant_kirchhoff": _st_venant_kirchhoff, "neo_hookean": _neo_hookean}


def principal_stretches(F: np.ndarray) -> np.ndarray:
    """Principal stretches of F (t, 3, 3) less 1: of what is inside out the least one is negative. (t, 3)."""
    s = np.linalg.svd(F, compute_uv=False)
    s[np.linalg.det(F) < 0.0, 2] *= -1.0
    return s - 1.0


def stored_statistics(material: str, tets, x: np.ndarray) -> np.ndarray:
    """Largest |E|, sum of |E|^2 V [m^3], energy [J]. tets: `wsim.kernels.soft.fem.elements`; x: positions [m], (points, 3)."""
    ids, edge, gradient, volume, mu, lam = (a.numpy().astype(np.float64) for a in (
        tets.point, tets.edge, tets.gradient, tets.volume, tets.mu, tets.lam))
    corner = x[ids.astype(np.int64)]
    u = corner[:, 1:] - corner[:, :1] - edge
    H = np.clip(u.swapaxes(1, 2) @ gradient, -LARGEST, LARGEST)
    E = principal_stretches(np.eye(3) + H)
    ee = (E * E).sum(axis=1)
    return np.array([np.sqrt(ee.max()), (ee * volume).sum(), (volume * ENERGY[material](H, E, mu, lam)).sum()])
