"""Kernels of the backward pass.

An implicit substep solves  r(d) = own (d - b) - f(x + d, (d - a) / g) = 0  at free points, d = b at pinned ones; own is
m / g^2, b the prediction, a the anchor, f all elastic and damping forces. With y the gradient by d and (dr/dd)^T q = y at free
points, 0 at pinned ones, the gradients are

    by b: own q (pinned: y + (df/dd)^T q)     by x: (df/dx)^T q     by a: -(df/dv)^T q / g     by any parameter: (df/d..)^T q

Products with df/d.. transposed are adjoints of what makes f, by hand (kernels/motion/explicit_adjoint.py, fem_adjoint.py) or
Warp's: nothing is clamped, dropped or formed (the Jacobian of kernels/solver/newton.py is its positive part, and only a
preconditioner here).
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.spring import spring_gather_function, spring_nets
from wsim.kernels.math.real import types

LESS = 0.8                 # of a squared residual: what falls by a tenth a step goes on
PATIENCE = 10              # steps without, after which a solve ends where it is


@cache
def gradient_transfer_kernel(dtype):
    """Kernel: adds a gradient to another and clears it."""
    real = getattr(dtype, "_wp_scalar_type_", dtype)

    @wp.kernel(module="unique", enable_backward=False)
    def transfer_gradient(grad: wp.array(dtype=dtype), into: wp.array(dtype=dtype)):
        i = wp.tid()
        g = grad[i]
        into[i] = into[i] + g
        grad[i] = dtype(real(0.0))

    return transfer_gradient


@cache
def implicit_force_kernel(real, module, flags: tuple):
    """Kernel over points: all elastic and damping forces [N]. pair: d and velocities, as kernels/motion/explicit.py has
    them."""
    t, one = types(real), spring_gather_function(real, **dict(flags))
    Net, vec3 = spring_nets(real), t.vec3

    @wp.kernel(module=module, enable_backward=False)
    def implicit_forces(net: Net, f: wp.array(dtype=vec3), x: wp.array(dtype=vec3), pair: wp.array(dtype=vec3),
                        f_out: wp.array(dtype=vec3)):
        i = wp.tid()
        f_out[i] = one(net, f, x, pair, i, 0, 0)

    return implicit_forces


@cache
def pairs(real, module):
    """Kernel over points: rows 0 and 2 of pair are d and the velocities (d - a) / g; rate 1 / g."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=False)
    def form_velocity_pairs(d: wp.array(dtype=t.vec3), a: wp.array(dtype=t.vec3), rate: real, pair_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        pair_out[i] = d[i]
        pair_out[2 * d.shape[0] + i] = rate * (d[i] - a[i])

    return form_velocity_pairs


@cache
def residual(real, module):
    """Kernel over points: -r [N], 0 of pinned ones, and the force own (d - a) that it is small beside."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=False)
    def implicit_residual(w: wp.array(dtype=real), f: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3),
                          b: wp.array(dtype=t.vec3),
                          a: wp.array(dtype=t.vec3), rate: real, r_out: wp.array(dtype=t.vec3),
                          scale_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        r = t.vec3()
        scale = t.vec3()
        if w[i] > real(0.0):
            own = rate * rate / w[i]
            r = f[i] - own * (d[i] - b[i])
            scale = own * (d[i] - a[i])
        r_out[i] = r
        scale_out[i] = scale

    return implicit_residual


@cache
def product(real, module):
    """Kernel over points: (dr/dd)^T p of free points, from the gradient `pair` of f p; 0 of pinned ones."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=False)
    def transpose_jacobian_product(w: wp.array(dtype=real), p: wp.array(dtype=t.vec3), pair: wp.array(dtype=t.vec3), rate: real,
                                   q_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        q = t.vec3()
        if w[i] > real(0.0):
            q = (rate * rate / w[i]) * p[i] - (pair[i] + rate * pair[2 * p.shape[0] + i])
        q_out[i] = q

    return transpose_jacobian_product


@cache
def free(real, module):
    """Kernel over points: v of free points, 0 of pinned ones."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=False)
    def mask_pinned_points(w: wp.array(dtype=real), v: wp.array(dtype=t.vec3), v_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        v_out[i] = wp.where(w[i] > real(0.0), v[i], t.vec3())

    return mask_pinned_points


@cache
def spread(real, module):
    """Kernel over points: adds what q gives by b and a; y: the gradient by d."""
    t = types(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def spread_implicit_adjoint(w: wp.array(dtype=real), q: vec3, y: vec3, pair: vec3, rate: real, by_b: vec3, by_a: vec3):
        i = wp.tid()
        moved = rate * pair[2 * q.shape[0] + i]
        if w[i] > real(0.0):
            by_b[i] = by_b[i] + (rate * rate / w[i]) * q[i]
        else:
            by_b[i] = by_b[i] + y[i] + pair[i] + moved
        by_a[i] = by_a[i] - moved

    return spread_implicit_adjoint


@cache
def weigh(real, module):
    """Kernel over points: adds what q gives by the inverse masses."""
    t = types(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def add_mass_gradient(w: wp.array(dtype=real), q: vec3, d: vec3, b: vec3, rate: real, by_w: wp.array(dtype=real)):
        i = wp.tid()
        if w[i] > real(0.0):
            by_w[i] = by_w[i] + (rate * rate / (w[i] * w[i])) * wp.dot(q[i], d[i] - b[i])

    return add_mass_gradient


@cache
def dot(real, module):
    """Kernel over lanes: their shares of the sum of u.v in float64."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=False)
    def dot_product_parts(u: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3), part_out: wp.array(dtype=wp.float64)):
        lane = wp.tid()
        sum = wp.float64(0.0)
        for i in range(lane, u.shape[0], part_out.shape[0]):
            a = u[i]
            b = v[i]
            for k in range(3):
                sum += wp.float64(a[k]) * wp.float64(b[k])
        part_out[lane] = sum

    return dot_product_parts


@wp.func
def sum_both_parts(u: wp.array(dtype=wp.float64), v: wp.array(dtype=wp.float64)):
    """Sums of both, which are as long."""
    a = wp.float64(0.0)
    b = wp.float64(0.0)
    for k in range(u.shape[0]):
        a += u[k]
        b += v[k]
    return a, b


@cache
def add(real, module):
    """Kernel over points: u + s v, s the sum of `over` over that of `under` (0 where that is 0), times sign."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=False)
    def add_scaled_vector(u: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3), over: wp.array(dtype=wp.float64),
                          under: wp.array(dtype=wp.float64), sign: wp.float64, u_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        a, b = sum_both_parts(over, under)
        s = wp.float64(0.0)
        if b != wp.float64(0.0):
            s = sign * a / b
        u_out[i] = u[i] + real(s) * v[i]

    return add_scaled_vector


@cache
def going(real, module):
    """Kernel over one thread: going becomes 1 while the sum of `now` exceeds that of `least` times tolerance^2, and count is
    below most; count goes up by one."""

    @wp.kernel(module=module, enable_backward=False)
    def continue_iterations(now: wp.array(dtype=wp.float64), least: wp.array(dtype=wp.float64), tolerance: wp.float64,
                            most: int, count: wp.array(dtype=int), going_out: wp.array(dtype=int)):
        a, b = sum_both_parts(now, least)
        n = count[0]
        count[0] = n + 1
        going_out[0] = wp.where(a > tolerance * tolerance * b and n < most, 1, 0)

    return continue_iterations


@cache
def falling(real, module):
    """Kernel over one thread: as `going`, while the sum of `now` is below LESS times the least of the last PATIENCE; least, and
    how often it was not, are kept in `best`. Rounding may keep it above the tolerance."""

    @wp.kernel(module=module, enable_backward=False)
    def continue_while_falling(now: wp.array(dtype=wp.float64), least: wp.array(dtype=wp.float64), tolerance: wp.float64,
                               most: int,
                               count: wp.array(dtype=int), best: wp.array(dtype=wp.float64), going_out: wp.array(dtype=int)):
        a, b = sum_both_parts(now, least)
        n = count[0]
        count[0] = n + 1
        stale = best[1] + wp.float64(1.0)
        if n == 0 or a < wp.float64(wp.static(LESS)) * best[0]:
            stale = wp.float64(0.0)
            best[0] = a
        best[1] = stale
        goes = a > tolerance * tolerance * b and n < most and stale < wp.float64(wp.static(PATIENCE))
        going_out[0] = wp.where(goes, 1, 0)

    return continue_while_falling


@cache
def worst(real, module):
    """Kernel over one thread: the largest so far of the root of the sum of `now` over that of `first`."""

    @wp.kernel(module=module, enable_backward=False)
    def record_worst_ratio(now: wp.array(dtype=wp.float64), first: wp.array(dtype=wp.float64),
                           worst_out: wp.array(dtype=wp.float64)):
        a, b = sum_both_parts(now, first)
        if b > wp.float64(0.0):
            worst_out[0] = wp.max(worst_out[0], wp.sqrt(a / b))

    return record_worst_ratio
