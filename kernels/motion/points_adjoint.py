"""Adjoint of the prediction and the end of a substep of backward Euler (kernels/motion/points.py), by hand: each point has an
object of its own where gradients are asked for, so nothing is added by atomics, and what was computed is not computed again.

    a = e,  d = e + g (rate v + g G),  rate = 1 / (1 + g decay)            of free points; G gravity
    v' = (d - a) / g,  x' = x + d,  e' = what rounding leaves of x', which has no derivative

and of what others have changed in an explicit substep (kernels/motion/explicit.py, `correct`), whose copy of x' is that
remainder:

    x' = x + d,  v' = v + c,  q' = q + c,  c = ((d - a) - (d~ - e)) / h
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_constants


@cache
def prediction_adjoint_kernel(real, module):
    """Kernel over points. by_a, by_d: of what was written; the others are added to."""
    t, Constants = types(real), point_constants(real)
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
def finish_adjoint_kernel(real, module):
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


@cache
def correction_gradients(real):
    """Struct of gradients by what `correct` has written, and has read."""
    vec3 = wp.array(dtype=types(real).vec3)

    @wp.struct
    class CorrectionGradients:
        x_out: vec3
        v_out: vec3
        pair_out: vec3
        change: vec3         # taken away: nobody may have read what it is of
        d: vec3              # this and the others are added to
        a: vec3
        e: vec3
        pair: vec3
        x: vec3
        v: vec3

    return CorrectionGradients


@cache
def correction_adjoint_kernel(real, module):
    """Kernel over points: from what was written to what was read; d~ is row `source` of pair."""
    t, Corrected = types(real), correction_gradients(real)

    @wp.kernel(module=module, enable_backward=False)
    def correct_adjoint(by: Corrected, h: real, source: int):
        i = wp.tid()
        n = by.x.shape[0]
        rate = (2 + source) * n + i
        X = by.x_out[i]
        V = by.v_out[i]
        Q = by.pair_out[rate]
        C = (V + Q + by.change[i]) / h
        by.change[i] = t.vec3()
        by.d[i] = by.d[i] + (X + C)
        by.a[i] = by.a[i] - C
        by.e[i] = by.e[i] + C
        by.x[i] = by.x[i] + X
        by.v[i] = by.v[i] + V
        by.pair[source * n + i] = by.pair[source * n + i] - C
        by.pair[rate] = by.pair[rate] + Q

    return correct_adjoint
