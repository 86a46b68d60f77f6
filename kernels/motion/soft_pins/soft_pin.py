"""Soft pins in a Newton step (kernels/solver/newton.py): springs without rest length, with drag.

A soft pin k |x + d - target|^2 / 2 + c |d - a|^2 / (2 g) and the inertia are one parabola of stiffness own' = own + k + c / g
about b' = (own b + k (target - x) + (c / g) a) / own'.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.constraint import inverse_or_zero
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import soft_pins
from wsim.kernels.solver.newton import newton_structs


@cache
def pin_stiffness_kernel(real, module):
    """Kernel over softly pinned points: own and b with their pins; at substep k."""
    t, A, SoftPins = types(real), newton_structs(real).Matrix, soft_pins(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def add_pin_stiffness(pins: SoftPins, target: wp.array2d(dtype=t.vec3), x: vec3, a: vec3, k: int, rate: real,
                          A_out: A, b_out: vec3):
        j = wp.tid()
        i = pins.point[pins.item[pins.first[j]]]
        if pins.w[i] > real(0.0):
            own = A_out.own[i]
            whole = own
            force = t.vec3()
            b = b_out[i]
            for m in range(pins.first[j], pins.first[j + 1]):
                pin = pins.item[m]
                stiffness = inverse_or_zero(pins.alpha[pin])
                drag = rate * pins.damping[pin]
                whole += stiffness + drag
                force += stiffness * ((target[k, pin] - x[i]) - b) + drag * (a[i] - b)
            A_out.own[i] = whole
            b_out[i] = b + force / whole

    return add_pin_stiffness
