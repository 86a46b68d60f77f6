"""Advection-reflection (Zehnder, Narain, Thomaszewski 2018): a step of two half advections A and two projections P.

    v = A(u; u) u,   w = P v,   u' = P A(2 w - u; .) (2 w - v)

The energy that a projection takes away is put back by reflection at it: what swirls goes on swirling. The paper carries the
second half by w. Here it is carried by 2 w - u, which is u at the end of the step to order 2: the first half is carried by u
where it begins, the second by u where it ends, and what both are early and late by cancels. So the order in time is 2 where the
flow changes too (Narain, Zehnder, Thomaszewski 2019 reach it by a midpoint).
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import grid_structs
from wsim.kernels.fluid.pressure import pressure_gradient_function
from wsim.kernels.math.real import types


@cache
def reflection_kernel(dim: int, axis: int, fractions: bool, moving: bool, real, module):
    """Kernel over the faces of an axis: of v and u, and the pressure of v: w_out = v - grad p, v_out = 2 w - v,
    u_out = 2 w - u. o, s: openings and velocities of what covers faces."""
    t, S = types(real), grid_structs(real)
    take = pressure_gradient_function(dim, axis, fractions, moving, real)

    def reflect_velocity(g: S.Grid, low: t.vec3, high: t.vec3, p: wp.array(dtype=real), o: S.Faces, v_out: wp.array(dtype=real),
                         u_out: wp.array(dtype=real), w_out: wp.array(dtype=real)):
        c = wp.tid()
        v = v_out[c]
        u = u_out[c]
        w = take(g, low, high, p, o.x, o.y, c, v)
        w_out[c] = w
        v_out[c] = real(2.0) * w - v
        u_out[c] = real(2.0) * w - u

    name = f"reflect_{'xyz'[axis]}{'_fractions' * fractions}{'_moving' * moving}_{dim}d_{t.name}"
    return wp.kernel(reflect_velocity, name=name, module=module, enable_backward=False)
