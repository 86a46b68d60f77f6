"""Soft pins of an implicit substep as forces, and their adjoints: kernels/motion/soft_pins/soft_pin.py and
kernels/solver/newton_adjoint.py.

    F = K (target - x - d) - c v,   v = (d - a) / g,   K = 1 / alpha       of each pin at a free point

so that with q the gradient by F those by d and x are -K q, by v -c q, by the target K q, by alpha -K^2 q.(target - x - d),
by c -q.v. Points gather their pins, in order.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.constraint import inverse_or_zero
from wsim.kernels.math.real import types


@cache
def pin_gradients(real):
    """Struct of soft pins by point, and their gradients, which are added to."""
    t = types(real)

    @wp.struct
    class PinGradients:
        point: wp.array(dtype=int)               # of each pin, (pins,)
        alpha: wp.array(dtype=t.scalar)          # [m/N], (pins,)
        damping: wp.array(dtype=t.scalar)        # [N s/m], (pins,)
        target: wp.array2d(dtype=t.vec3)         # [m], (substeps, pins)
        first: wp.array(dtype=int)               # pins of the j-th pinned point: item[first[j]] .. item[first[j + 1]]
        item: wp.array(dtype=int)
        by_alpha: wp.array(dtype=t.scalar)
        by_damping: wp.array(dtype=t.scalar)
        by_target: wp.array2d(dtype=t.vec3)

    return PinGradients


@cache
def pin_force_kernel(real, module):
    """Kernel over softly pinned points: adds their forces at substep k to f. pair: d and v, as kernels/solver/newton_adjoint.py
    has them."""
    t, Held = types(real), pin_gradients(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def soft_pin_forces(h: Held, x: vec3, pair: vec3, k: int, f_out: vec3):
        j = wp.tid()
        i = h.point[h.item[h.first[j]]]
        f = f_out[i]
        for m in range(h.first[j], h.first[j + 1]):
            pin = h.item[m]
            f += inverse_or_zero(h.alpha[pin]) * ((h.target[k, pin] - x[i]) - pair[i]) - h.damping[pin] * pair[2 * x.shape[0]
                                                                                                               + i]
        f_out[i] = f

    return soft_pin_forces


@cache
def pin_adjoint_kernel(real, module):
    """Kernel over softly pinned points: adds the gradients by d and v and, if whole, by x and the pins. p: those by forces."""
    t, Held = types(real), pin_gradients(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def adjoint_of_soft_pins(h: Held, x: vec3, pair: vec3, p: vec3, k: int, whole: int, by_x: vec3, by_pair: vec3):
        j = wp.tid()
        i = h.point[h.item[h.first[j]]]
        row = 2 * x.shape[0] + i
        by_d = t.vec3()
        by_v = t.vec3()
        for m in range(h.first[j], h.first[j + 1]):
            pin = h.item[m]
            stiffness = inverse_or_zero(h.alpha[pin])
            by_d -= stiffness * p[i]
            by_v -= h.damping[pin] * p[i]
            if whole != 0:
                off = (h.target[k, pin] - x[i]) - pair[i]
                h.by_alpha[pin] = h.by_alpha[pin] - stiffness * stiffness * wp.dot(p[i], off)
                h.by_damping[pin] = h.by_damping[pin] - wp.dot(p[i], pair[row])
                h.by_target[k, pin] = h.by_target[k, pin] + stiffness * p[i]
        by_pair[i] = by_pair[i] + by_d
        by_pair[row] = by_pair[row] + by_v
        if whole != 0:
            by_x[i] = by_x[i] + by_d

    return adjoint_of_soft_pins
