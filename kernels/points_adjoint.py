"""Adjoint of the prediction and the end of a substep of backward Euler (kernels/points.py), by hand: each point has an object
of its own where gradients are asked for, so nothing is added by atomics, and what was computed is not computed again.

    a = e,  d = e + g (rate v + g G),  rate = 1 / (1 + g decay)            of free points; G gravity
    v' = (d - a) / g,  x' = x + d,  e' = what rounding leaves of x', which has no derivative
"""

from functools import cache

import warp as wp

from wsim.kernels.points import constants
from wsim.kernels.real import types


@cache
def predict_adjoint(real, module):
    """Kernel over points. by_a, by_d: of what was written; the others are added to."""
    t, Constants = types(real), constants(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def predict_adjoint(c: Constants, by: Constants, v: vec3, g: real, by_a: vec3, by_d: vec3, by_e: vec3, by_v: vec3):
        i = wp.tid()
        D = by_d[i]
        by_e[i] = by_e[i] + (by_a[i] + D)
        if c.w[i] > real(0.0):
            o = c.object[i]
            rate = real(1.0) / (real(1.0) + g * c.decay[o])
            by_v[i] = by_v[i] + (g * rate) * D
            by.gravity[o] = by.gravity[o] + (g * g) * D
            by.decay[o] = by.decay[o] - (g * g * rate * rate) * wp.dot(v[i], D)

    return predict_adjoint


@cache
def finish_adjoint(real, module):
    """Kernel over points. by_x_out, by_v: of what was written; the others are added to."""
    vec3 = wp.array(dtype=types(real).vec3)

    @wp.kernel(module=module, enable_backward=False)
    def finish_adjoint(g: real, by_x_out: vec3, by_v: vec3, by_a: vec3, by_d: vec3, by_x: vec3):
        i = wp.tid()
        X = by_x_out[i]
        V = by_v[i] / g
        by_x[i] = by_x[i] + X
        by_d[i] = by_d[i] + (X + V)
        by_a[i] = by_a[i] - V

    return finish_adjoint
