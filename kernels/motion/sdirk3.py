"""A step of H [s] by two implicit stages, order 3: where stage 2 begins, and where the step ends. Symbols:
kernels/motion/points.py.

Each stage is a step of backward Euler of g = c H, c = (3 + sqrt(3))/6, from its own start, in displacement form:

    stage 1 from x, v gives s = d - e, u = (d - a)/g - v;       x, v += (1 - 2 c)/c times s, u
    stage 2 from there gives s', u';                            x, v += s'/(2 c) + (4 c - 1)/(2 c) s, and so with u', u

which is x' = x + H/2 (V1 + V2), v' = v + H/2 (A1 + A2) with X1 = x + c H V1, X2 = x + (1 - 2 c) H V1 + c H V2, and V from A so.
Stable for every H; what is not resolved falls by 0.73 a step and changes its sign (Norsett 1974; Crouzeix 1975; Hairer, Wanner
1996, Solving Ordinary Differential Equations II, IV.6). Drag of the air, taken as in points.py, leaves order 1.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import writes_all
from wsim.kernels.math.real import has_adjoint, types
from wsim.kernels.motion.points import point_states

C = (3.0 + 3.0**0.5) / 6.0


@cache
def stage_finish_kernel(real, module):
    """Kernel: from stage 1 to where stage 2 begins; s, u of it. Reads x, e, v, d."""
    t, PointState, on = types(real), point_states(real), real((1.0 - 2.0 * C) / C)

    @writes_all
    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def finish_stage(at: PointState, g: real, x_out: wp.array(dtype=t.vec3), e_out: wp.array(dtype=t.vec3),
                     v_out: wp.array(dtype=t.vec3), s_out: wp.array(dtype=t.vec3), u_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        x0 = at.x[i]
        e0 = at.e[i]
        v0 = at.v[i]
        own = at.d[i] - e0
        gained = own / g - v0
        step = e0 + on * own
        v_out[i] = v0 + on * gained
        x1 = x0 + step
        x_out[i] = x1
        e_out[i] = step - (x1 - x0)
        s_out[i] = own
        u_out[i] = gained

    return finish_stage


@cache
def sdirk3_finish_kernel(real, module):
    """Kernel: from stage 2 to the end of the step; s, u of all of it. Reads x, e, v, d, s, u."""
    t, PointState, half, before = types(real), point_states(real), real(0.5 / C), real((4.0 * C - 1.0) / (2.0 * C))

    @writes_all
    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def finish_step(at: PointState, g: real, x_out: wp.array(dtype=t.vec3), e_out: wp.array(dtype=t.vec3),
                    v_out: wp.array(dtype=t.vec3), s_out: wp.array(dtype=t.vec3), u_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        x0 = at.x[i]
        e0 = at.e[i]
        v0 = at.v[i]
        s0 = at.s[i]
        u0 = at.u[i]
        own = at.d[i] - e0
        gained = own / g - v0
        step = e0 + (half * own + before * s0)
        v_out[i] = v0 + (half * gained + before * u0)
        x1 = x0 + step
        x_out[i] = x1
        e_out[i] = step - (x1 - x0)
        s_out[i] = half * (own + s0)
        u_out[i] = half * (gained + u0)

    return finish_step


@cache
def sdirk3_pin_kernel(real, module):
    """Kernel: at the end of a step of H [s], which went s far, a hard-pinned point is where its frame is, row of
    target [m], and has its mean velocity. Reads x, e, s."""
    t, PointState = types(real), point_states(real)

    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def place_pins(point: wp.array(dtype=int), target: wp.array2d(dtype=t.vec3), at: PointState, row: int, H: real,
                   x_out: wp.array(dtype=t.vec3), e_out: wp.array(dtype=t.vec3), v_out: wp.array(dtype=t.vec3)):
        p = wp.tid()
        i = point[p]
        x0 = at.x[i]
        missing = target[row, p] - x0
        v_out[i] = ((missing - at.e[i]) + at.s[i]) / H
        x1 = x0 + missing
        x_out[i] = x1
        e_out[i] = missing - (x1 - x0)

    return place_pins
