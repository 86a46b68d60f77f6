"""A box of linear or quadratic tets on the CPU, evaluated by the kernels of one material: forces, energy, stiffness."""

from itertools import combinations

import numpy as np
import warp as wp

from wsim.geometry.tetra import tets
from wsim.geometry.tetra.lattice import tet_box
from wsim.kernels.cloth.hessian import elements_of
from wsim.kernels.math.real import types
from wsim.kernels.soft import fem, fem10
from wsim.kernels.soft.material import lame_parameters
from wsim.kernels.solver import line_search

E, NU, TAU = 1e5, 0.3, 0.01
SIZE = (0.3, 0.2, 0.2)


class TetBox:
    """points (n, 3) [m] about the origin; tets (t, nodes), of 4 or 10 nodes; material, real: those of the kernels."""

    def __init__(self, material: str, real=wp.float64, cells=(3, 2, 2), *, nodes: int = 4, size=SIZE, nu: float = NU):
        self.material, self.real, self.t, self.nodes = material, real, types(real), nodes
        points, corners = tet_box(size, cells)
        self.points, self.tets = (points, corners) if nodes == 4 else tets.ten_node_mesh(points, corners)
        self.pairs, self.of = list(combinations(range(nodes), 2)), fem if nodes == 4 else fem10
        self.batch, t, count, (mu, lam) = self.of.elements(real)(), self.t, len(corners), lame_parameters(E, nu)
        at = points[corners]
        self.batch.point = wp.array(self.tets, dtype=wp.vec4i if nodes == 4 else int, device="cpu")
        self.batch.edge = self.array(at[:, 1:] - at[:, :1], t.mat33)
        self.batch.gradient = self.array(tets.barycentric_gradients(points, corners)[:, 1:], t.mat33)
        self.batch.volume = self.array(tets.signed_tet_volumes(points, corners), real)
        self.batch.mu, self.batch.lam, self.batch.tau = (self.array(np.full(count, v), real) for v in (mu, lam, TAU))
        self.x = self.array(self.points, t.vec3)
        self.q = wp.zeros(count if nodes == 4 else 4 * count, dtype=t.quat, device="cpu")      # one a point of quadrature
        # At once: a kernel that came later would compile its module again. In float32 forces alone are looked at.
        self.kernels = {name: getattr(self.of, name)(material, True, real=real, module=f"test_{nodes}_{material}_{t.name}")
                        for name in ("forces", "energy_change", "linearise")[:3 if real is wp.float64 else 1]}

    def array(self, values, dtype):
        return wp.array(np.asarray(values, np.float32 if self.real is wp.float32 else np.float64), dtype=dtype, device="cpu")

    @property
    def inside(self) -> np.ndarray:
        """Which points are not on the surface."""
        return (np.abs(self.points) / self.points.max(axis=0) < 1.0 - 1e-9).all(axis=1)

    def gathered(self, parts) -> np.ndarray:
        total = np.zeros((len(self.points), 3))
        np.add.at(total, self.tets.ravel(), parts.numpy().astype(np.float64))
        return total

    def force(self, u, v=None) -> np.ndarray:
        """Forces at displacements u [m] and velocities v [m/s]."""
        parts, t = wp.zeros(self.tets.size, dtype=self.t.vec3, device="cpu"), self.t
        velocities = self.array(np.zeros_like(self.points) if v is None else v, t.vec3)
        wp.launch(self.kernels["forces"], len(self.tets), [self.batch, self.x, self.array(u, t.vec3), velocities, self.q],
                  [parts, wp.zeros_like(self.q)], device="cpu")
        return self.gathered(parts)

    def change(self, u, p, rate=0.0, a=None) -> float:
        """Of energy (and, with the anchor a, damping) from u to u + p."""
        t, trial = self.t, line_search.LineSearchTrial()
        trial.first = wp.array([0, len(self.tets)], dtype=int, device="cpu")
        trial.lanes, trial.begin, trial.end = 1, 0, 1
        trial.step = wp.array([-1.0], dtype=wp.float64, device="cpu")
        trial.change = wp.zeros((1, 9), dtype=wp.float64, device="cpu")
        where = [self.array(z, t.vec3) for z in (u, u if a is None else a, p)]
        wp.launch(self.kernels["energy_change"], 1, [trial, self.batch, self.x, *where, self.q, rate], [], device="cpu")
        return float(trial.change.numpy()[0, 0])

    def stiffness(self, u, rate=0.0) -> tuple[np.ndarray, np.ndarray]:
        """K (3n, 3n) with the damping's part, and forces at rest, of the kernel that Newton's method takes."""
        t, out, n, each = self.t, elements_of(self.real)(), len(self.points), len(self.pairs)
        out.block = wp.zeros(each * len(self.tets), dtype=t.mat33, device="cpu")
        out.force = wp.zeros(self.tets.size, dtype=t.vec3, device="cpu")
        where = self.array(u, t.vec3)
        wp.launch(self.kernels["linearise"], len(self.tets), [self.batch, self.x, where, where, self.q, rate],
                  [wp.zeros_like(self.q), out], device="cpu")
        K, blocks = np.zeros((n, n, 3, 3)), out.block.numpy().astype(np.float64).reshape(-1, each, 3, 3)
        for pair, (k, m) in enumerate(self.pairs):
            i, j, A = self.tets[:, k], self.tets[:, m], blocks[:, pair]
            for at, value in (((i, j), A), ((j, i), A.transpose(0, 2, 1)), ((i, i), -A), ((j, j), -A.transpose(0, 2, 1))):
                np.add.at(K, at, value)
        return K.transpose(0, 2, 1, 3).reshape(3 * n, 3 * n), self.gathered(out.force)


def turn(seed: int = 3) -> np.ndarray:
    """Some proper rotation."""
    Q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return Q * np.sign(np.linalg.det(Q))


def bent(body: TetBox, size: float = 0.02) -> np.ndarray:
    """Random displacements of `size` [m], a fifth of a cell, on top of a turn; a linear body is not turned."""
    u = size * np.random.default_rng(1).normal(size=body.points.shape)
    return u if body.material == "linear" else body.points @ (turn() - np.eye(3)).T + u
