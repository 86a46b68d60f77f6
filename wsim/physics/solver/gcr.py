"""Directions of generalised conjugate residuals: systems that are not symmetric. See kernels/solver/gcr.py."""

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.solver import gcr as kernels
from wsim.model.model import Model

KEPT = 10              # directions


class Directions:
    """The last KEPT of them, over the points of a model."""

    def __init__(self, model: Model, lanes: int, module: str):
        """lanes: of sums; module: of kernels."""
        self.model, t, n = model, types(model.real), model.points
        self.along, self.share, self.across, self.store = (
            f(model.real, module) for f in (kernels.gcr_projection_kernel, kernels.gcr_coefficient_kernel,
                                            kernels.gcr_orthogonal_kernel, kernels.gcr_storage_kernel))
        o = self.basis = kernels.gcr_basis(model.real)()

        def gcr_zeros(shape, dtype):
            return wp.zeros(shape, dtype=dtype, device=model.device)
        o.p, o.q = gcr_zeros((KEPT, n), t.vec3), gcr_zeros((KEPT, n), t.vec3)
        o.size, o.beta, o.part = gcr_zeros(KEPT, wp.float64), gcr_zeros(KEPT, wp.float64), gcr_zeros((KEPT, lanes), wp.float64)

    def begin(self) -> None:
        self.basis.size.zero_()

    def turn(self, z: wp.array, q: wp.array) -> None:
        """z and q = B z lose what is along those kept."""
        launch, o = self.model.launch, self.basis
        launch(self.along, o.part.size, [o, q], [])
        launch(self.share, KEPT, [o], [])
        launch(self.across, self.model.points, [o], [z, q])

    def keep(self, z: wp.array, q: wp.array, qq: wp.array, count: wp.array) -> None:
        """They take the place of the oldest. qq: parts of q.q; count: of directions so far."""
        self.model.launch(self.store, self.model.points, [self.basis, z, q, qq, count], [])
