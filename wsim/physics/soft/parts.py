"""What a soft body is made of: its tets by material model, their moduli, and how stiff they are at rest. NumPy."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import sqrt
from typing import cast

import numpy as np

from wsim.geometry.tetra.tets import EDGES, barycentric_gradients, signed_tet_volumes
from wsim.kernels.soft.material import lame_parameters
from wsim.model.model import PointBody
from wsim.physics.soft.objects import Soft
from wsim.scene.nodal.masses import soft_share

NEAR, FAR = (5.0 + 3.0 * sqrt(5.0)) / 20.0, (5.0 - sqrt(5.0)) / 20.0      # barycentric coordinates of four points


@dataclass
class Region:
    """Tets of one material model in one body."""

    body: PointBody
    rows: np.ndarray              # of `PointBody.tets`, in the order of memory
    material: np.ndarray          # number of each in `Soft.materials`, (t,)
    values: dict = field(default_factory=dict)       # live: {name: (t,)} of young, poisson, damping

    def lame(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """mu, lam [Pa] times the part of a tet that is body, and tau [s], each (t,)."""
        young, poisson = self.values["young"], self.values["poisson"]
        pairs, which = np.unique(np.stack([young, poisson]), axis=1, return_inverse=True)
        found = np.array([lame_parameters(float(E), float(nu)) for E, nu in pairs.T])[which.reshape(-1)]
        share = np.broadcast_to(soft_share(self.soft), len(self.body.tets))[self.rows]
        return found[:, 0] * share, found[:, 1] * share, self.values["damping"]

    def cut(self, most: int) -> Iterator["Region"]:
        """Parts of at most so many tets."""
        for k in range(0, len(self.rows), most):
            some = slice(k, k + most)
            yield Region(self.body, self.rows[some], self.material[some], {name: v[some] for name, v in self.values.items()})

    @property
    def soft(self) -> Soft:
        return cast(Soft, self.body.source)


def parts_of(body: PointBody, model: str) -> list[Region]:
    """The tets of a body that are of that model; none for what is no soft body."""
    if not body.source.is_solid:
        return []
    soft = cast(Soft, body.source)
    which = np.zeros(len(body.tets), np.int32) if soft.which is None else soft.which
    mine = np.array([m.model == model for m in soft.materials])[which]
    rows = np.flatnonzero(mine)
    rows = rows[np.argsort(body.tets[rows].min(axis=1), kind="stable")]
    if not len(rows):
        return []
    part = Region(body, rows, which[rows])
    for name in ("young", "poisson", "damping"):
        part.values[name] = np.array([getattr(m, name) for m in soft.materials])[part.material]
    return [part]


def strain_rows(part: Region) -> np.ndarray:
    """J with the energy 1/2 |J u|^2 of small displacements u of the nodes, (t, rows, k, 3): normal strains, then shears, of
    linear tets (6 rows, 4 nodes), or of the four points of quadratic ones (24 rows, 10 nodes)."""
    mu, lam, _ = part.lame()
    ids = part.body.tets[part.rows, :4] - part.body.first
    g, V = barycentric_gradients(part.body.rest, ids), signed_tet_volumes(part.body.rest, ids)
    if part.body.tets.shape[1] == 4:
        return _linear_strain_rows(g, V, mu, lam)
    return np.concatenate([_linear_strain_rows(quadratic_slopes(g, a), 0.25 * V, mu, lam) for a in range(4)], axis=1)


def quadratic_slopes(g: np.ndarray, a: int) -> np.ndarray:
    """Gradients of the shape functions of ten nodes at point a (kernels/soft/fem10.py), (t, 10, 3), from those of barycentric
    coordinates, (t, 4, 3) [1/m]."""
    L = np.where(np.arange(4) == a, NEAR, FAR)
    i, j = np.array(EDGES).T
    return np.concatenate([(4.0 * L - 1.0)[:, None] * g, 4.0 * (L[i, None] * g[:, j] + L[j, None] * g[:, i])], axis=1)


def _linear_strain_rows(g: np.ndarray, V: np.ndarray, mu: np.ndarray, lam: np.ndarray) -> np.ndarray:
    """Of gradients g (t, k, 3) [1/m] and volumes V (t,) [m^3]."""
    hooke = 2.0 * mu[:, None, None] * np.eye(3) + lam[:, None, None] * np.ones((3, 3))
    root = np.linalg.cholesky(V[:, None, None] * hooke)                           # L: e.He = |L^T e|^2
    J = np.zeros((len(V), 6, g.shape[1], 3))
    J[:, :3] = np.einsum("tir,tki->trki", root, g)                                # e_ii = sum_k g_ki u_ki
    shear = np.sqrt(V * mu)
    for row, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        J[:, 3 + row, :, i], J[:, 3 + row, :, j] = shear[:, None] * g[:, :, j], shear[:, None] * g[:, :, i]
    return J
