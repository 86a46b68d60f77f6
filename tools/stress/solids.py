"""What a soft body's state holds, in float64 NumPy, independent of the solvers: the counterpart of `energy.Elastic` for tets.

    stored   sum of V Psi(F), energies of tools/bench/soft/material.py
    strain   |S - 1| of every tet, S the stretch in F = R S with R a rotation, so that what is turned inside out is strained
"""

from dataclasses import dataclass

import numpy as np

from tools.bench.soft.material import density, signed_svd
from wsim.geometry.tetra.tets import barycentric_gradients, signed_tet_volumes
from wsim.model.model import PointBody
from wsim.scene import Soft


@dataclass
class Solid:
    """Tets of one material in the order of the author's points."""

    tets: np.ndarray             # (t, 4)
    gradients: np.ndarray        # of the barycentric coordinates [1/m], (t, 4, 3)
    volumes: np.ndarray          # [m^3], (t,)
    model: str
    moduli: tuple[float, float]  # mu, lam [Pa]
    weights: np.ndarray          # inverse masses [1/kg], (n,); 0 where a hard pin holds
    masses: np.ndarray           # [kg], (n,)

    def deformation(self, x: np.ndarray) -> np.ndarray:
        """F of every tet, (t, 3, 3)."""
        return np.swapaxes(x[self.tets], 1, 2) @ self.gradients

    def strain(self, x: np.ndarray) -> np.ndarray:
        """Of every tet, (t,)."""
        s = signed_svd(self.deformation(x))[1]
        return np.linalg.norm(s - 1.0, axis=1)

    def stored(self, x: np.ndarray, h: float = 0.0) -> float:
        """Elastic energy [J] at positions x (n, 3) [m], all of it whatever the substep h [s] resolves."""
        return float(self.volumes @ density(self.model, self.deformation(x), *self.moduli))

    def fastest(self) -> float:
        """Highest frequency [rad/s] at rest, where every material is Hooke's: exact, by all eigenvalues of M^-1/2 K M^-1/2."""
        n, g, (mu, lam) = len(self.masses), self.gradients, self.moduli
        gg = np.einsum("tia,tja->tij", g, g)[..., None, None] * np.eye(3)
        gh = np.einsum("tia,tjb->tijab", g, g)
        blocks = self.volumes[:, None, None, None, None] * (mu * (gg + np.swapaxes(gh, 3, 4)) + lam * gh)
        K, root = np.zeros((n, 3, n, 3)), np.sqrt(self.weights)
        for i in range(4):
            for j in range(4):
                np.add.at(K, (self.tets[:, i], slice(None), self.tets[:, j]), blocks[:, i, j])
        K *= root[:, None, None, None] * root[None, None, :, None]
        return float(np.sqrt(np.linalg.eigvalsh(K.reshape(3 * n, 3 * n))[-1]))


def solid(source: Soft, body: PointBody, held: np.ndarray) -> Solid:
    """`held` (k,) points of hard pins. ValueError for a body of several materials: one is enough for abuse."""
    if source.others or source.filled is not None:
        raise ValueError(f"{source.path}: a body of one material, filled everywhere, is what is understood here")
    rest = body.rest[body.index]
    m, masses = source.material, body.masses[body.index]
    weights = 1.0 / masses
    weights[held] = 0.0
    mu, lam = m.young / (2.0 * (1.0 + m.poisson)), m.young * m.poisson / ((1.0 + m.poisson) * (1.0 - 2.0 * m.poisson))
    return Solid(source.tets, barycentric_gradients(rest, source.tets), signed_tet_volumes(rest, source.tets), m.model,
                 (mu, lam), weights, masses)
