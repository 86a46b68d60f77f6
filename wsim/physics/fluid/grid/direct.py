"""Fast diagonalisation in the place of conjugate gradients: what it makes of a residual is A^-1 of it to rounding, so that one
step is enough, or two (kernels/fluid/solver/diagonal.py)."""

from math import prod

import numpy as np
import warp as wp

from wsim.kernels.fluid.solver import diagonal as kernels
from wsim.kernels.fluid.solver.diagonal import SIDE
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.threads import Threads

MOST = 800               # cells along all axes together. 256 each, a step of smoke on an H200: 17 ms, by multigrid 46 ms
LEAST = 1e-9             # of the greatest eigenvalue: below it is 0


def axis_operator(n: int, low: float, high: float, periodic: bool) -> np.ndarray:
    """T of one axis, (n, n)."""
    T = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    if periodic:
        T[0, -1] -= 1.0
        T[-1, 0] -= 1.0
    else:
        T[0, 0], T[-1, -1] = 1.0 + low, 1.0 + high
    return T


def even_odd_eigenvectors(n: int, low: float, high: float, periodic: bool) -> tuple[np.ndarray, np.ndarray, int]:
    """Eigenvalues (n,) and eigenvectors (n, n) of T of one axis, and how many of them are even. Where its ends are alike,
    `fold` has been applied to what they act on: the first ones stand for what is even, the others for what is odd."""
    T = axis_operator(n, low, high, periodic)
    if low != high:
        return *np.linalg.eigh(T), n
    half = 0.5 ** 0.5 * np.ones(n)
    B = np.diag(half * np.where(np.arange(n) < n // 2, 1.0, -1.0)) + np.diag(half)[::-1]
    if n % 2:
        B[n // 2] = np.eye(n)[n // 2]
    T, even, Q, values = B @ T @ B, n - n // 2, np.zeros((n, n)), np.zeros(n)
    for block in (slice(0, even), slice(even, n)):
        values[block], Q[block, block] = np.linalg.eigh(T[block, block])
    return values, Q, even


class Direct:
    """x, b: solution and right-hand side; work: two arrays of as many cells."""

    def __init__(self, threads: Threads, layout: Layout, x: wp.array, b: wp.array, work: tuple[wp.array, wp.array]):
        real, model, dim = threads.model.real, threads.model, layout.dim
        self.threads, self.layout, self.x, self.b = threads, layout, x, b
        self.work = tuple(w[:layout.cells] for w in work)
        axes = [even_odd_eigenvectors(layout.n[a], layout.low[a], layout.high[a], bool(layout.periodic[a])) for a in range(dim)]
        self.even = [even for _, _, even in axes]
        values = np.concatenate([v for v, _, _ in axes])
        self.least = model.real(LEAST * sum(float(v.max()) for v, _, _ in axes))
        self.values = model.upload(values.astype(model.dtype), real)
        self.vectors = [(model.upload(np.ascontiguousarray(Q, model.dtype).ravel(), real),
                         model.upload(np.ascontiguousarray(Q.T, model.dtype).ravel(), real)) for _, Q, _ in axes]
        self.products = [kernels.axis_product_kernel(last, real, threads.module) for last in (False, True)]
        folded = [int(a < dim and self.even[a] < layout.n[a]) for a in range(3)]
        some = [n - n // 2 if by else n for n, by in zip(layout.n, folded, strict=True)]
        self.corner = [wp.vec3i(*layout.n), wp.vec3i(*some), wp.vec3i(*folded)]
        self.some = prod(some)
        self.folds, self.folded = kernels.fold_halves_kernel(dim, real, threads.module), any(folded)

    def along(self, axis: int, back: bool, x: wp.array, y: wp.array) -> None:
        """y = Q^T x along an axis, along the last one over the eigenvalues; back: Q x."""
        n, even, (Q, turned) = self.layout.n, self.even[axis], self.vectors[axis]
        last = axis == self.layout.dim - 1
        batch, M, N = (1, prod(n[:axis]), n[axis]) if last else (prod(n[:axis]), n[axis], prod(n[axis + 1:]))
        own = -(-even // SIDE) + -(-(n[axis] - even) // SIDE)
        tiles = batch * own * -(-(M if last else N) // SIDE)
        values = self.values if last and not back else None
        self.threads.sum(self.products[last], tiles, [turned if back else Q, x, wp.vec3i(M, N, n[axis]), even, values,
                                                      n[1] if self.layout.dim == 3 else 0, self.least], [y])

    def fold(self, x: wp.array, y: wp.array) -> None:
        self.threads.over(self.folds, self.some, [*self.corner, x], [y])

    def cycle(self) -> None:
        """x becomes A^-1 b."""
        dim, (one, two) = self.layout.dim, self.work
        now = self.b
        if self.folded:
            self.fold(now, two)
            now = two
        for back in (False, True):
            for a in range(dim):
                out = self.x if back and a == dim - 1 else two if now is one else one
                self.along(a, back, now, out)
                now = out
        if self.folded:
            self.fold(now, now)

    @property
    def launches(self) -> int:
        """Number of launches of a cycle."""
        return 2 * self.layout.dim + 2 * self.folded
