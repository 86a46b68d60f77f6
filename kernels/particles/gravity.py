"""Gravity on the faces of a liquid: u += h g where particles have mass."""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types


@cache
def liquid_gravity_kernel(real, module):
    """Kernel over the faces of an axis."""

    def apply_liquid_gravity(axis: int, gravity: wp.array(dtype=real), clock: wp.array(dtype=real), mass: wp.array(dtype=real),
                             u_out: wp.array(dtype=real)):
        c = wp.tid()
        if mass[c] > real(0.0):
            u_out[c] = u_out[c] + clock[0] * gravity[axis]

    return wp.kernel(apply_liquid_gravity, name=f"particles_pull_{types(real).name}", module=module, enable_backward=False)
