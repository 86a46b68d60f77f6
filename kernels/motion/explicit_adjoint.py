"""Adjoint of the forces on points and of a leap (kernels/cloth/spring.py, kernels/motion/explicit.py), by hand: gathered,
without atomics.

A spring F = s r pulls at i and, as the entry of its other end, at j. With p the gradient by the forces, e = p_i - p_j:

    F = (k (1 - L / |r|) + c (r.u) / |r|^2) r,   u = v~_j - v~_i
    by r: s e + (r.e) (k L / |r|^3 r + c (u - 2 (r.u) r / |r|^2) / |r|^2)        by u: c (r.e) r / |r|^2

Positions and displacements of i get minus those. An entry's own k, L, c get what its force on i says, so that both entries of
a spring make up the whole. Sums do not depend on the order of threads. Warp's own adjoint scatters with atomics: a run of a
sheet forward and back took 28.8 ms with it and takes 20.7 (H200; on a CPU the half, tools/bench/gradients.py).
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.constraint import inverse_or_zero
from wsim.kernels.cloth.spring import lane_sum_function, spring_nets
from wsim.kernels.math.compensated import squared_length_gain
from wsim.kernels.math.real import types
from wsim.kernels.motion.explicit import explicit_steps


@cache
def point_gradients(real):
    """Struct of gradients over points: p by the forces, read; the others are added to."""
    t = types(real)

    @wp.struct
    class PointGradients:
        p: wp.array(dtype=t.vec3)            # [1/N], (points,)
        x: wp.array(dtype=t.vec3)            # by positions at the start of the frame
        pair: wp.array(dtype=t.vec3)         # by displacements and velocities v~, four rows
        corner: wp.array(dtype=t.vec3)       # by the forces of corners

    return PointGradients


@cache
def spring_adjoint(real, flags: tuple, parameters: bool):
    """Function of entry c, of point i: gradients by r and by u, and its force; adds those by its k, L and c."""
    t, Net, Grads, kinds = types(real), spring_nets(real), point_gradients(real), dict(flags)
    vec3, damped = t.vec3, kinds["damped"]

    @wp.func
    def spring_pair_adjoint(net: Net, x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), c: int, i: int, source: int, by: Net,
                            g: Grads):
        n = x.shape[0]
        j = net.other[c]
        k = net.k[c]
        rest = net.rest[c]
        r = (x[j] - x[i]) + (d[source * n + j] - d[source * n + i])
        L = wp.length(r)
        over = inverse_or_zero(L)
        if wp.static(kinds["exact"]):
            strain = over * inverse_or_zero(L + rest) * squared_length_gain(x[i], x[j], d[source * n + i], d[source * n + j],
                                                                            rest, net.left[c])
        else:
            strain = real(1.0) - rest * over             # over what it is now
        pi = g.p[i]
        e = pi - g.p[j]
        re = wp.dot(r, e) * over * over
        s = k * strain
        by_r = (k * rest * over * re) * r
        by_u = vec3()
        if wp.static(damped):
            u = d[(2 + source) * n + j] - d[(2 + source) * n + i]
            rate = wp.dot(r, u) * over * over
            damping = net.damping[c]
            s += damping * rate
            by_r += (damping * re) * (u - (real(2.0) * rate) * r)
            by_u = (damping * re) * r
            if wp.static(parameters):
                by.damping[c] = by.damping[c] + wp.dot(pi, r) * rate
        if wp.static(parameters):
            own = wp.dot(pi, r)
            by.k[c] = by.k[c] + own * strain
            by.rest[c] = by.rest[c] - own * k * over
        return by_r + s * e, by_u, s * r

    return spring_pair_adjoint


@cache
def force_adjoint(real, module, flags: tuple, parameters: bool, masses: bool):
    """Kernel over the lanes of points: gradients by what `gather` reads, from those by its forces. flags: items of what
    `gather` takes. parameters: by those of the springs, and by x, too; masses: by inverse masses of a = w f, where p is w times
    that by a."""
    t, Net, Grads, kinds = types(real), spring_nets(real), point_gradients(real), dict(flags)
    vec3, width, damped, lanes = t.vec3, kinds["width"], kinds["damped"], kinds["lanes"]
    total, spring = lane_sum_function(vec3, lanes), spring_adjoint(real, flags, parameters)

    def spring_force_adjoint(net: Net, f: wp.array(dtype=vec3), x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), source: int,
                             by: Net, g: Grads):
        i = wp.tid() // lanes
        lane = wp.tid() % lanes
        n = x.shape[0]
        by_d = vec3()
        by_v = vec3()
        force = vec3()
        if wp.static(kinds["springs"]):
            first = i * width
            last = first + width
            if wp.static(width == 0):
                first = net.start[i]
                last = net.start[i + 1]
            for c in range(first + lane, last, lanes):
                by_r, by_u, pulled = spring(net, x, d, c, i, source, by, g)
                by_d -= by_r
                by_v -= by_u
                force += pulled
        if wp.static(kinds["corners"]):
            for c in range(net.first[i] + lane, net.first[i + 1], lanes):
                at = net.item[c]
                g.corner[at] = g.corner[at] + g.p[i]
                if wp.static(masses):
                    force += f[at]
        if wp.static(lanes > 1):
            by_d = total(by_d)
            if wp.static(damped):
                by_v = total(by_v)
            if wp.static(masses):
                force = total(force)
        if lane > 0:
            return
        if wp.static(kinds["springs"]):
            g.pair[source * n + i] = g.pair[source * n + i] + by_d
            if wp.static(damped):
                g.pair[(2 + source) * n + i] = g.pair[(2 + source) * n + i] + by_v
            if wp.static(parameters):
                g.x[i] = g.x[i] + by_d
        if wp.static(masses):
            if net.w[i] > real(0.0):
                by.w[i] = by.w[i] + wp.dot(g.p[i], force) / net.w[i]

    name = "_".join(["force_adjoint", *["parameters"] * parameters, *["masses"] * masses])      # two of one name would be one
    return wp.kernel(spring_force_adjoint, name=name, module=module, enable_backward=False)


@cache
def leap_gradients(real):
    """Struct of gradients by what a leap has written, read."""
    t = types(real)

    @wp.struct
    class Outs:
        pair: wp.array(dtype=t.vec3)
        v: wp.array(dtype=t.vec3)

    return Outs


@cache
def leap_adjoint(real, module, corners: bool, lanes: int):
    """Kernel over the lanes of points: gradients by what a leap reads but for the forces, and p, the gradient by these.
    Remainders have none: what they carry is rounding. corners: what forces at corners say of masses too. Arguments: net, those
    forces, d, step, gradients by what was written, into: by v, pair, x, net."""
    t, Net, Step, Grads, Outs = (types(real), spring_nets(real), explicit_steps(real), point_gradients(real),
                                 leap_gradients(real))
    vec3, total = t.vec3, lane_sum_function(t.vec3, lanes)

    def leapfrog_adjoint(net: Net, f: wp.array(dtype=vec3), d: wp.array(dtype=vec3), step: Step, out: Outs,
                         v_grad: wp.array(dtype=vec3), by: Net, g: Grads):
        i = wp.tid() // lanes
        lane = wp.tid() % lanes
        n = v_grad.shape[0]
        force = vec3()
        if wp.static(corners):
            for c in range(net.first[i] + lane, net.first[i + 1], lanes):
                force += f[net.item[c]]
            if wp.static(lanes > 1):
                force = total(force)
        if lane > 0:
            return
        into = 1 - step.source
        at = step.source * n + i
        rate = (2 + step.source) * n + i
        D = out.pair[into * n + i]
        Q = out.pair[(2 + into) * n + i]
        V = out.v[i]
        p = vec3()
        if net.w[i] > real(0.0):
            o = net.object[i]
            v1 = V + Q + step.drift * D
            a = step.kick * v1 + step.ahead * Q
            p = net.w[i] * a
            if wp.static(corners):
                by.w[i] = by.w[i] + wp.dot(a, force)
            by.gravity[o] = by.gravity[o] + a
            by.decay[o] = by.decay[o] - wp.dot(a, d[rate])
            g.pair[rate] = g.pair[rate] - net.decay[o] * a
            v_grad[i] = v_grad[i] + v1
            g.pair[at] = g.pair[at] + D
        elif step.drift == real(0.0):
            v_grad[i] = v_grad[i] + V
            g.pair[at] = g.pair[at] + D
        elif net.pin[i] < 0:
            g.pair[at] = g.pair[at] + D
        else:
            v1 = (Q + V) / step.h
            goal = D + v1
            by.target[step.row, net.pin[i]] = by.target[step.row, net.pin[i]] + goal
            g.x[i] = g.x[i] - goal
            g.pair[at] = g.pair[at] - v1
        g.p[i] = p

    return wp.kernel(leapfrog_adjoint, name="leap_adjoint" + "_corners" * corners, module=module, enable_backward=False)
