"""Adjoint of the stages of backward Euler of `wsim.points`: see kernels/points_adjoint.py."""

from wsim.kernels import points_adjoint as kernels
from wsim.model import Model
from wsim.tape import adjoint_of


class EulerAdjoint:
    """Of the launches of the prediction and of the end of a substep, of the arrays that they have read and written."""

    def __init__(self, model: Model):
        self.model = model
        self.kernels = kernels.predict_adjoint(model.real, model.module), kernels.finish_adjoint(model.real, model.module)

    def predict(self, read: list, wrote: list) -> None:
        (constants, e, v, g), (a, d) = read, wrote
        self.model.launch(self.kernels[0], self.model.points,
                          [constants, adjoint_of(constants), v, g, a.grad, d.grad], [e.grad, v.grad])

    def finish(self, read: list, wrote: list) -> None:
        (a, d, x, g), (x_out, _, v_out) = read, wrote
        self.model.launch(self.kernels[1], self.model.points, [g, x_out.grad, v_out.grad], [a.grad, d.grad, x.grad])
