"""The measuring instrument for soft bodies: linear tets in float64, by NumPy and SciPy, without Warp and without wsim.kernels.

    M x'' = m g - dU/dx,   U = sum over tets V Psi(F),   F = sum_i x_i g_i^T,   masses lumped; pinned points stay

    rest            where the body comes to rest: Newton's method with a line search
    frequencies     lowest ones of K, M about rest or any other place, and their shapes
    exact           classical Runge-Kutta of order 4, steps halved until Richardson's estimate of its error is small

Energies: material.py. What a beam theory says of the same body: beam.py. Runge-Kutta is stable for h omega < 2.83;
`exact` starts below that by the highest frequency about rest. A tet's stiffness is exact, so Newton's is the true tangent.
Sifakis, Barbic 2012; Nocedal, Wright 2006, ch. 3 (line search); Hairer, Norsett, Wanner 1993, II.4 (Richardson).
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import pi
from pathlib import Path

import numpy as np
from scipy.sparse import csc_matrix, diags
from scipy.sparse.linalg import eigsh, splu

from tools.bench.nets.reference import halved, kept
from tools.bench.soft.material import density, stiffness, stress


@dataclass
class Solid:
    """A body of linear tets in float64.

    points (n, 3) [m] at rest, tets (t, 4) of positive volume, pinned (k,), young [Pa], poisson, density [kg/m^3],
    gravity (3,) [m/s^2]."""

    points: np.ndarray
    tets: np.ndarray
    pinned: np.ndarray
    young: float = 1e6
    poisson: float = 0.3
    density: float = 1e3
    model: str = "corotational"
    gravity: tuple[float, float, float] = (0.0, -9.81, 0.0)
    volumes: np.ndarray = field(init=False, repr=False)      # of each tet [m^3], (t,)
    gradients: np.ndarray = field(init=False, repr=False)    # of each barycentric coordinate [1/m], (t, 4, 3)
    masses: np.ndarray = field(init=False, repr=False)       # of each point [kg], (n,): a quarter of each of its tets
    free: np.ndarray = field(init=False, repr=False)         # (n, 1) 1 moves, 0 is pinned

    def __post_init__(self):
        self.points, self.tets = np.asarray(self.points, np.float64), np.asarray(self.tets, np.int64)
        self.pinned = np.asarray(self.pinned, np.int64)
        X = self.points[self.tets]
        sides = np.swapaxes(X[:, 1:] - X[:, :1], 1, 2)          # columns x_i - x_0
        self.volumes = np.linalg.det(sides) / 6.0
        if not np.all(self.volumes > 0.0):
            raise ValueError(f"tet {int(np.argmin(self.volumes))} has the volume {self.volumes.min():g} m^3; it must be > 0")
        inverse = np.linalg.inv(sides)
        self.gradients = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)
        self.masses = np.bincount(self.tets.ravel(), np.repeat(0.25 * self.density * self.volumes, 4), len(self.points))
        self.free = np.ones((len(self.points), 1))
        self.free[self.pinned] = 0.0

    @property
    def lame(self) -> tuple[float, float]:
        E, nu = self.young, self.poisson
        return E / (2.0 * (1.0 + nu)), E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))

    def strains(self, x: np.ndarray) -> np.ndarray:
        """F of each tet, (t, 3, 3)."""
        return np.swapaxes(x[self.tets], 1, 2) @ self.gradients

    def elastic(self, x: np.ndarray) -> float:
        """Elastic energy [J]."""
        return float(self.volumes @ density(self.model, self.strains(x), *self.lame))

    def energy(self, x: np.ndarray, v: np.ndarray) -> float:
        """Kinetic, elastic and gravitational energy [J]; the last from the place at rest."""
        weight = self.masses @ ((x - self.points) @ np.asarray(self.gravity))
        return 0.5 * float(self.masses @ np.sum(v * v, axis=1)) + self.elastic(x) - float(weight)

    def forces(self, x: np.ndarray) -> np.ndarray:
        """Elastic forces [N], (n, 3)."""
        P = stress(self.model, self.strains(x), *self.lame) * -self.volumes[:, None, None]
        f = self.gradients @ np.swapaxes(P, 1, 2)                # row i: P g_i
        return np.stack([np.bincount(self.tets.ravel(), f[..., k].ravel(), len(x)) for k in range(3)], axis=1)

    def acceleration(self, x: np.ndarray) -> np.ndarray:
        """[m/s^2], (n, 3); zero at pins."""
        return self.free * (self.forces(x) / self.masses[:, None] + np.asarray(self.gravity))

    def tangent(self, x: np.ndarray) -> csc_matrix:
        """K = -df/dx [N/m] of all points, (3 n, 3 n); exact, so not always positive."""
        D = stiffness(self.model, self.strains(x), *self.lame).reshape(-1, 3, 3, 3, 3)
        K = np.einsum("t,tabcd,tib,tld->tialc", self.volumes, D, self.gradients, self.gradients, optimize=True)
        row = (3 * self.tets[:, :, None] + np.arange(3)).reshape(-1, 12)
        return csc_matrix((K.ravel(), (np.repeat(row, 12, axis=1).ravel(), np.tile(row, (1, 12)).ravel())),
                          shape=(3 * len(x), 3 * len(x)))

    def moving(self) -> np.ndarray:
        """Numbers of the coordinates that are not pinned."""
        return np.flatnonzero(np.repeat(self.free[:, 0], 3))


def solver(matrix: csc_matrix):
    """Its factors; for symmetric matrices, whose order is kept."""
    return splu(csc_matrix(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def rest(solid: Solid, start: np.ndarray | None = None, tolerance: float = 1e-12, most: int = 100) -> np.ndarray:
    """Positions (n, 3) [m] at rest under gravity, near `start` (None: the shape without load).

    Newton's method on U - m g x: steps are halved until the energy falls (Armijo), and where the tangent is not
    positive, mass is added to it. Done when the largest force left over is under tolerance times the weight (or what
    rounding leaves). RuntimeError if it is not reached, as without pins."""
    x, moving = (solid.points if start is None else start).copy(), solid.moving()
    load = solid.masses[:, None] * np.asarray(solid.gravity)
    mass, shift = diags(np.repeat(solid.masses, 3)[moving]), 0.0
    weight = np.abs(load).sum()

    def energy(y):
        return solid.elastic(y) - float(np.sum(load * (y - solid.points)))

    for _ in range(most):
        residual = (solid.forces(x) + load).ravel()[moving]
        if np.max(np.abs(residual)) <= tolerance * weight:
            return x
        K = solid.tangent(x)[moving][:, moving]
        change, slope = np.zeros_like(x), 0.0
        for _ in range(40):
            change.ravel()[moving] = solver(K + shift * mass).solve(residual)
            slope = -float(residual @ change.ravel()[moving])
            if slope < 0.0:
                break
            shift = max(10.0 * shift, 1e-3 * K.diagonal().max() / mass.diagonal().max())
        step, before = 1.0, energy(x)
        while step > 1e-6 and energy(x + step * change) > before + 1e-4 * step * slope + 1e-12 * abs(before):
            step *= 0.5
        x, shift = x + step * change, 0.1 * shift if shift > 1e-6 else 0.0
    raise RuntimeError(f"Newton's method left {np.max(np.abs(residual)) / weight:.1e} of the weight after {most} steps")


def frequencies(solid: Solid, count: int = 1, x: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The lowest frequencies [Hz] (count,) of small motion about x (None: rest shape), rising, and their shapes
    (count, n, 3) with sum m |shape|^2 = 1 kg. Without pins the first six are those of rigid motion: 0."""
    moving = solid.moving()
    root = np.sqrt(np.repeat(solid.masses, 3)[moving])
    K = solid.tangent(solid.points if x is None else x)[moving][:, moving]
    A = csc_matrix(diags(1.0 / root) @ K @ diags(1.0 / root))
    low = -1e-6 * A.diagonal().max()                            # near 0, where a free body's matrix is singular
    squares, vectors = eigsh(A, k=count, sigma=low, which="LM", v0=np.ones(len(moving)))
    shapes = np.zeros((count, len(solid.points), 3))
    order = np.argsort(squares)
    shapes.reshape(count, -1)[:, moving] = (vectors[:, order] / root[:, None]).T
    return np.sqrt(np.maximum(squares[order], 0.0)) / (2.0 * pi), shapes


def highest(solid: Solid) -> float:
    """Highest frequency [rad/s] about rest."""
    moving = solid.moving()
    root = diags(1.0 / np.sqrt(np.repeat(solid.masses, 3)[moving]))
    K = solid.tangent(solid.points)[moving][:, moving]
    return float(np.sqrt(eigsh(root @ K @ root, k=1, which="LA", tol=1e-3, v0=np.ones(len(moving)))[0][0]))


def exact(solid: Solid, times: Sequence[float], tolerance: float = 1e-8, folder: Path | str | None = None,
          frame: float = 1.0 / 60.0) -> tuple[np.ndarray, float]:
    """Positions (times, n, 3) [m] at increasing times [s], multiples of `frame`, from rest, and an estimate of their RMS error.

    Steps are halved until |x_h - x_2h| / 15 (Richardson, order 4) is under tolerance at every time. A folder keeps the
    result, keyed by the body and the arguments. RuntimeError when six halvings do not reach the tolerance."""
    file = None
    if folder is not None:
        key = hashlib.sha256(repr((tuple(times), tolerance, frame, solid.gravity, solid.young, solid.poisson, solid.density,
                                   solid.model)).encode())
        for array in (solid.points, solid.tets, solid.pinned):
            key.update(np.ascontiguousarray(array).tobytes())
        file = Path(folder) / f"soft_{key.hexdigest()[:16]}.npz"
    return kept(file, lambda: halved(solid, times, tolerance, frame, highest(solid), 6))
