"""Points that others push by impulses between the Newton steps of a substep: the target b of a step goes along.

    Phi(d) = 1/2 sum own |d - b|^2 + ...           an impulse that moves a point by D while nothing else acts: b <- b + D

b is where a point would be without forces (kernels/solver/newton.py), so that an impulse p moves it by w g p, as it moves d.
Sweeps of contacts and Newton steps so take turns (block Gauss-Seidel); at their fixed point both hold.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types


@cache
def pushed_target_kernel(real, module):
    """Kernel over points: b goes as far as d went since `before` [m]."""
    t = types(real)

    def push_targets(d: wp.array(dtype=t.vec3), before: wp.array(dtype=t.vec3), b_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        b_out[i] = b_out[i] + (d[i] - before[i])

    return wp.kernel(push_targets, name=f"push_targets_{t.name}", module=module, enable_backward=False)
