"""Soft pins of an implicit substep that is solved to a residual, and their adjoint:
kernels/motion/soft_pins/soft_pin_adjoint.py."""

import warp as wp

from wsim.kernels.motion.soft_pins import soft_pin_adjoint as kernels
from wsim.model.model import Model


class PinsAdjoint:
    """The adjoint of soft pins."""

    def __init__(self, model: Model, pins, term):
        """pins: `wsim.physics.motion.pins.Pins`; term: `wsim.physics.motion.soft_pins.soft_pin.NewtonSoftPins`, its pins by
        point."""
        self.model, self.pins, self.soft = model, pins, [term.first, term.item]
        self.forces, self.adjoint = (f(model.real, model.module)
                                     for f in (kernels.pin_force_kernel, kernels.pin_adjoint_kernel))

    def table(self):
        held, soft, target = kernels.pin_gradients(self.model.real)(), self.pins.soft, self.pins.target["soft"]
        held.point, held.alpha, held.damping, held.target = soft.point, soft.alpha, soft.damping, target
        held.by_alpha, held.by_damping, held.by_target = soft.alpha.grad, soft.damping.grad, target.grad
        held.first, held.item = self.soft
        return held

    def add(self, x: wp.array, pair: wp.array, k: int, f: wp.array) -> None:
        """Forces at substep k to those in f."""
        self.model.launch(self.forces, self.soft[0].size - 1, [self.table(), x, pair, k], [f])

    def transposed(self, x: wp.array, pair: wp.array, p: wp.array, k: int, whole: bool) -> None:
        """Adds to the gradients of pair and, if whole, of x and the pins."""
        self.model.launch(self.adjoint, self.soft[0].size - 1, [self.table(), x, pair, p, k, int(whole)], [x.grad, pair.grad])
