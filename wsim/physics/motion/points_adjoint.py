"""Adjoint of the stages of backward Euler of `wsim.physics.motion.points`, of the last of an explicit step, and of what loads
add to gravity: kernels/motion/points_adjoint.py, load.py."""

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion import load
from wsim.kernels.motion import points_adjoint as kernels
from wsim.model.model import Model
from wsim.model.tape import adjoint_of
from wsim.model.vjp import fixed_adjoint


class EulerAdjoint:
    """The adjoint of the launches of the prediction and of the end of a substep, of the arrays that they have read and
    written."""

    def __init__(self, euler):
        """euler: `wsim.physics.motion.points.Euler`."""
        model = self.model = euler.model
        self.kernels = (kernels.prediction_adjoint_kernel(model.real, model.module),
                        kernels.finish_adjoint_kernel(model.real, model.module))
        self.vjp = {euler.kernels[name]: fixed_adjoint(getattr(self, name)) for name in ("predict", "finish")}

    def predict(self, read: list, wrote: list) -> None:
        (constants, e, v, g), (a, d) = read, wrote
        self.model.launch(self.kernels[0], self.model.points,
                          [constants, adjoint_of(constants), v, g, a.grad, d.grad], [e.grad, v.grad])

    def finish(self, read: list, wrote: list) -> None:
        (a, d, x, g), (x_out, _, v_out) = read, wrote
        self.model.launch(self.kernels[1], self.model.points, [g, x_out.grad, v_out.grad], [a.grad, d.grad, x.grad])


class CorrectAdjoint:
    """The adjoint of the launch that makes velocities of what others have changed, in `wsim.physics.motion.explicit`."""

    def __init__(self, model: Model, correct):
        """correct: the kernel."""
        self.model, self.kernel = model, kernels.correction_adjoint_kernel(model.real, model.module)
        self.vjp = {correct: fixed_adjoint(self.backward)}

    def backward(self, read: list, wrote: list) -> None:
        (at, pair, step), (x_out, _, v_out, pair_out, change) = read, wrote
        by = kernels.correction_gradients(self.model.real)()
        arrays = {"x_out": x_out, "v_out": v_out, "pair_out": pair_out, "change": change, "pair": pair,
                  **{name: getattr(at, name) for name in "daexv"}}
        for name, array in arrays.items():
            setattr(by, name, array.grad)
        self.model.launch(self.kernel, self.model.points, [by, step.h, step.source], [])


class LoadsAdjoint:
    """The adjoint of the accelerations that `wsim.physics.motion.loads.Loads` puts."""

    def __init__(self, loads):
        self.loads, model = loads, loads.model
        self.shares, self.release = (load.load_share_kernel(model.real, model.module),
                                     load.load_release_kernel(model.real, model.module))
        self.part = wp.zeros(len(loads.borne) * load.LANES, dtype=types(model.real).vec3, device=model.device)

    def take(self, row: int) -> None:
        """Passes from the gradient of gravity to those of the values of a row, of gravity alone and of inverse masses."""
        own, by = self.loads, self.loads.gravity.grad
        own.launch(self.shares, self.part.size, [own.entries, by], [self.part])
        own.launch(self.release, max(len(own.point), len(own.borne)), [own.entries, own.value, self.part, row],
                   [by, own.own.grad, own.entries.w.grad, own.value.grad])
