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


def operator(n: int, low: float, high: float, periodic: bool) -> np.ndarray:
    """T of one axis, (n, n)."""
    T = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    if periodic:
        T[0, -1] -= 1.0
        T[-1, 0] -= 1.0
    else:
        T[0, 0], T[-1, -1] = 1.0 + low, 1.0 + high
    return T


class Direct:
    """x, b: solution and right-hand side; work: two arrays of as many cells."""

    def __init__(self, threads: Threads, layout: Layout, x: wp.array, b: wp.array, work: tuple[wp.array, wp.array]):
        real, model = threads.model.real, threads.model
        self.threads, self.layout, self.x, self.b = threads, layout, x, b
        self.work = tuple(w[:layout.cells] for w in work)
        pairs = [np.linalg.eigh(operator(layout.n[a], layout.low[a], layout.high[a], bool(layout.periodic[a])))
                 for a in range(layout.dim)]
        values, self.least = np.concatenate([v for v, _ in pairs]), LEAST * sum(float(v.max()) for v, _ in pairs)
        self.values = model.upload(values.astype(model.dtype), real)
        self.vectors = [(model.upload(np.ascontiguousarray(Q, model.dtype).ravel(), real),
                         model.upload(np.ascontiguousarray(Q.T, model.dtype).ravel(), real)) for _, Q in pairs]
        self.products = [kernels.product(last, real, threads.module) for last in (False, True)]
        self.divide = kernels.divide(layout.dim, real, threads.module)

    def along(self, axis: int, back: bool, x: wp.array, y: wp.array) -> None:
        """y = Q^T x along an axis; back: Q x."""
        n, (Q, turned) = self.layout.n, self.vectors[axis]
        last = axis == self.layout.dim - 1
        batch, M, N = (1, prod(n[:axis]), n[axis]) if last else (prod(n[:axis]), n[axis], prod(n[axis + 1:]))
        tiles = batch * -(-M // SIDE) * -(-N // SIDE)
        self.threads.sum(self.products[last], tiles, [turned if back else Q, x, wp.vec3i(M, N, n[axis])], [y])

    def cycle(self) -> None:
        """x becomes A^-1 b."""
        dim, (one, two) = self.layout.dim, self.work
        now = self.b
        for a in range(dim):
            out = two if now is one else one
            self.along(a, False, now, out)
            now = out
        least = self.threads.model.real(self.least)
        self.threads.over(self.divide, self.layout.cells, [wp.vec3i(*self.layout.n), self.values, least], [now])
        for a in range(dim):
            out = self.x if a == dim - 1 else two if now is one else one
            self.along(a, True, now, out)
            now = out

    @property
    def launches(self) -> int:
        """Number of launches of a cycle."""
        return 2 * self.layout.dim + 1
