"""An inverse of the Hessian to begin from, for L-BFGS: beliefs exactly, what was seen by a sketch.

    H = R + w Y Y^T        R of the beliefs (a graph's Laplacian), w Y Y^T ~ J^T J / s^2 from probes, Y (n, k)

by the formula of Woodbury, R^-1 by conjugate gradients on all columns at once. Beliefs make every element's neighbours its
own: without R the steps needed grow with the mesh (Bui-Thanh, Ghattas, Martin, Stadler 2013); without the sketch with what is
seen.
"""

from collections.abc import Callable

import numpy as np

from wsim.fitting.fields.prior import NeighbourBelief

CLOSE, MOST = 1e-6, 300      # conjugate gradients: of the right side, iterations


class SketchedHessian:
    """beliefs, of each field; parts: where each stands, (n, c); Y (n, k) of all."""

    def __init__(self, beliefs: list[NeighbourBelief], parts: list[np.ndarray], Y: np.ndarray):
        self.shapes = [p.shape for p in parts]
        self.ends = np.cumsum([0, *(p.size for p in parts)])
        self.matrices = [graph_laplacian(b.pairs, b.curvature(t), b.wide**-2, len(t))
                         for b, t in zip(beliefs, parts, strict=True)]
        self.Y = Y
        self.Z = self.solve_belief_hessian(Y)
        self.inner = Y.T @ self.Z

    def solve_belief_hessian(self, q: np.ndarray) -> np.ndarray:
        """R^-1 q, q (n, k)."""
        return np.concatenate([solve_laplacian_columns(A, q[i:j].reshape(shape[0], -1)).reshape(j - i, -1) for A, shape, i, j in
                               zip(self.matrices, self.shapes, self.ends[:-1], self.ends[1:], strict=True)])

    def __call__(self, q: np.ndarray, weight: float) -> np.ndarray:
        """H^-1 q with w = weight."""
        r = self.solve_belief_hessian(q[:, None])[:, 0]
        small = np.eye(self.Y.shape[1]) / weight + self.inner
        return r - self.Z @ np.linalg.solve(small, self.Y.T @ r)


def graph_laplacian(pairs: np.ndarray, weight: np.ndarray, own: float, n: int) -> tuple[Callable, np.ndarray]:
    """x (n, m) -> own x_i + sum_j w_ij (x_i - x_j), and its diagonal (n, 1)."""
    row = np.concatenate([np.arange(n), pairs[:, 0], pairs[:, 1]]).astype(np.int64)          # a row has itself at least
    column = np.concatenate([np.arange(n), pairs[:, 1], pairs[:, 0]]).astype(np.int64)
    w = np.concatenate([np.zeros(n), weight, weight])
    order = np.argsort(row, kind="stable")
    column, w = column[order], w[order][:, None]
    start = np.searchsorted(row[order], np.arange(n))
    diagonal = own + np.add.reduceat(w, start)
    return (lambda x: diagonal * x - np.add.reduceat(w * x[column], start)), diagonal


def solve_laplacian_columns(A: tuple[Callable, np.ndarray], b: np.ndarray) -> np.ndarray:
    """A^-1 b by conjugate gradients, each column by itself."""
    product, diagonal = A
    x, r = np.zeros_like(b), b.copy()
    z = r / diagonal
    p, rz = z.copy(), (r * z).sum(axis=0)
    least = CLOSE**2 * (b**2).sum(axis=0)
    for _ in range(MOST):
        if ((r**2).sum(axis=0) <= least).all():
            break
        q = product(p)
        pq = (p * q).sum(axis=0)
        a = rz / np.where(pq > 0.0, pq, np.inf)
        x, r = x + a * p, r - a * q
        z = r / diagonal
        rz, before = (r * z).sum(axis=0), rz
        p = z + rz / np.where(before > 0.0, before, np.inf) * p
    return x
