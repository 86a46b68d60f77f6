"""XPBD projection of coloured constraints. Macklin, Mueller, Chentanez 2016, eq. 17, 18 and 26:

    r = -C - a lam - gamma G.(d - anchor)      dlam = r / ((1 + gamma) sum_k w_k |G_k|^2 + a)      dd_k = w_k G_k dlam

    a = alpha / h^2 (compliance alpha); gamma = tau / h, tau [s] the relaxation time of stiffness-proportional damping
    d displacement of the substep [m]; (d - anchor) / h its velocity; w inverse mass [1/kg], 0 pins the point

`omega` over-relaxes: dlam is multiplied by it (1: XPBD; up to 2 the fixed point is the same and may be reached sooner).
`rate` is 1 / h [1/s], h the effective step of the integrator (2/3 of the substep for BDF2). No point with w > 0 occurs
twice in a colour, so a colour needs no atomics and does not depend on the order of threads. A kernel reads only what
its variant needs; the arrays that it does not need may be None.

Two kernels share one formula: `xpbd_projection_kernel` gives a thread to each constraint of a colour, a launch a colour;
`sweep` is one launch for all colours, by one block of threads that meet after each (on the CPU one thread takes everything in
turn). Where colours are small a sweep costs a fraction of the launches it replaces. Worlds have a block each, which goes
through the colours of its own: their points stay in the caches for all of a sweep.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.cloth.constraint import Constraint, membrane_response, membrane_shear, membrane_slender
from wsim.kernels.cloth.terms import constraint_variant, plane_stress_matrix, rest_length_function
from wsim.kernels.math import block
from wsim.kernels.math.matrix import solve_block
from wsim.kernels.motion.points import point_states

TINY = {wp.float32: 4.0 * 2.0**-23, wp.float64: 4.0 * 2.0**-52}       # roundings left where elimination ends in 0
CALM = 1e-2            # strain below which no step of a membrane is too long, up to triangles of 1 : 800


@cache
def xpbd_projection_kernel(constraint: Constraint, *, real=wp.float32, module="unique", multipliers: bool = False,
                           damped: bool = False, uniform: bool = False, backward: bool = False, exact: bool = False):
    """(Batch, kernel) of a kind of constraint.

    multipliers   lam is read and written: needed when a substep runs more than one iteration
    damped        tau and a (the anchor) are read
    uniform       alpha and tau have one entry for all
    exact         lengths are compared beyond float32, by what it has left of them (kernels/math/compensated.py)
    The kernel's arguments: batch, at (x, d, a of the points), first, rate, omega, lam, d_out, lam_out (lam vec3 for the
    membrane); launched over the constraints of a colour, the first of which is `first`.
    """
    o = constraint_variant(constraint, real, multipliers, damped, uniform, exact=exact)
    vec3, value, PointState, one = o.t.vec3, o.value, point_states(real), one_of(o, backward)

    def project_colour(batch: o.Batch, at: PointState, first: int, rate: real, omega: real, lam: wp.array(dtype=value),
                       d_out: wp.array(dtype=vec3), lam_out: wp.array(dtype=value)):
        one(first + wp.tid(), batch, at, rate, omega, lam, d_out, lam_out)

    name = f"project_{o.name}" + ("_backward" if backward else "")
    return o.Batch, wp.kernel(project_colour, name=name, module=module, enable_backward=backward)


@cache
def xpbd_sweep_kernel(constraint: Constraint, *, real=wp.float32, module="unique", **kind):
    """(Batch, kernel) as `xpbd_projection_kernel`, kind: multipliers, damped, uniform, exact; for all colours in one launch: of
    a block of threads a world on a GPU, of a thread on the CPU.

    The kernel's arguments: batch, at, colours, rate, omega, lam, d_out, lam_out; colours (colours,): where each begins, and its
    constraints of a world, which stand behind those of the world before.
    """
    o = constraint_variant(constraint, real, **kind)
    vec3, value, PointState, one = o.t.vec3, o.value, point_states(real), one_of(o, False)

    def xpbd_sweep(batch: o.Batch, at: PointState, colours: wp.array(dtype=wp.vec2i), rate: real, omega: real,
                   lam: wp.array(dtype=value), d_out: wp.array(dtype=vec3), lam_out: wp.array(dtype=value)):
        world = wp.tid() // wp.block_dim()
        i = wp.tid() - world * wp.block_dim()
        for k in range(colours.shape[0]):
            colour = colours[k]
            first = colour[0] + world * colour[1]
            for c in range(first + i, first + colour[1], wp.block_dim()):
                one(c, batch, at, rate, omega, lam, d_out, lam_out)
            block.block_barrier()

    return o.Batch, wp.kernel(xpbd_sweep, name=f"sweep_{o.name}", module=module, enable_backward=False, grid_stride=False,
                               launch_bounds=block.BLOCK)


def one_of(o, backward: bool):
    """Function: projection of constraint c. at: a struct that has x, d, a."""
    o.read_points, o.read_rest = block.table_read_functions(o.points, o.t.mat22 if o.rows == 3 else o.t.scalar, plain=backward)
    return _block_projection(o) if o.rows == 3 else _row_projection(o)


@wp.func
def weights_of_2(w: wp.array(dtype=Any), p: wp.vec2i):
    """Inverse masses of two points."""
    return wp.vector(w[p[0]], w[p[1]])


@wp.func
def weights_of_4(w: wp.array(dtype=Any), p: wp.vec4i):
    """Inverse masses of four points."""
    return wp.vector(w[p[0]], w[p[1]], w[p[2]], w[p[3]])


@wp.func
def weights_of_3(w: wp.array(dtype=Any), p: wp.vec3i):
    """Inverse masses of three points."""
    return wp.vector(w[p[0]], w[p[1]], w[p[2]])


@cache
def weights_of(n: int, real):
    """Function (w, p): inverse masses of the n points p."""
    if n in (2, 3, 4):
        return {2: weights_of_2, 3: weights_of_3, 4: weights_of_4}[n]
    ids, inverses = wp.types.vector(n, int), wp.types.vector(n, real)

    @wp.func
    def point_weights(w: wp.array(dtype=real), p: ids):
        W = inverses()
        for k in range(n):
            W[k] = w[p[k]]
        return W

    return point_weights


def _row_projection(o):
    """Projection of constraints with one row."""
    real, vec3, n, terms, place = o.t.scalar, o.t.vec3, o.points - 1, o.terms, o.place
    weights, read_points, read_length = weights_of(o.points, real), o.read_points, rest_length_function(o)

    @wp.func
    def project_row_constraint(c: int, batch: o.Batch, at: Any, rate: real, omega: real, lam: wp.array(dtype=real),
                               d_out: wp.array(dtype=vec3), lam_out: wp.array(dtype=real)):
        p = read_points(batch.point, c)
        rest = read_length(batch, c)
        alpha = real(0.0)
        gamma = real(0.0)
        if wp.static(not o.unilateral):
            alpha = rate * rate * batch.alpha[place(c)]
        if wp.static(o.damped):
            gamma = rate * batch.tau[place(c)]
        before = real(0.0)
        if wp.static(o.lam):
            before = lam[c]
        W = weights(batch.w, p)                           # read before C is known: the reads then wait together
        C, r, G0, G, N = terms(p, rest, at.x, at.d, at.a, alpha, gamma, before)
        below = real(0.0)
        for k in range(n):
            below += W[k + 1] * wp.dot(G[k], G[k])
        if wp.static(not o.anchored):
            below += W[0] * wp.dot(G0, G0)
        below = (real(1.0) + gamma) * below + alpha
        if below > real(0.0):                          # else all pinned or no direction: nothing to move
            dlam = (omega * r) / below
            if wp.static(not o.anchored):
                d_out[p[0]] = N[0] + (W[0] * dlam) * G0
            for k in range(n):
                d_out[p[k + 1]] = N[k + 1] + (W[k + 1] * dlam) * G[k]
            if wp.static(o.lam or o.stored):
                lam_out[c] = before + dlam

    return project_row_constraint


def _block_projection(o):
    """Projection of constraints with three rows on three points: the three multipliers are solved for together."""
    real, vec3, terms, place = o.t.scalar, o.t.vec3, o.terms, o.place
    read_points, read_rest, tiny = o.read_points, o.read_rest, TINY[real]

    @wp.func
    def project_block_constraint(c: int, batch: o.Batch, at: Any, rate: real, omega: real, lam: wp.array(dtype=vec3),
                                 d_out: wp.array(dtype=vec3), lam_out: wp.array(dtype=vec3)):
        p = read_points(batch.point, c)
        rest = read_rest(batch.rest, c)
        alpha = (rate * rate) * batch.alpha[place(c)]
        gamma = real(0.0)
        if wp.static(o.damped):
            gamma = rate * batch.tau[place(c)]
        before = vec3()
        if wp.static(o.lam):
            before = lam[c]
        w0 = batch.w[p[0]]
        w1 = batch.w[p[1]]
        w2 = batch.w[p[2]]
        C, r, G1, G2, N = terms(p, rest, at.x, at.d, at.a, alpha, gamma, before)
        G0 = -(G1 + G2)
        S = membrane_response(C, rest, w0, w1, w2)
        dlam = omega * solve_block((real(1.0) + gamma) * S + plane_stress_matrix(alpha), r, real(tiny))
        if wp.dot(r, r) > real(CALM * CALM):
            slender = membrane_slender(rest)
            most = real(2.0) * slender[1]
            step = wp.abs(membrane_shear(rest, S * dlam)) * (slender[0] - most)        # half a square, 1 : 2, stands any step
            if step > most:
                dlam *= most / step
        d_out[p[0]] = N[0] + w0 * (wp.transpose(G0) * dlam)
        d_out[p[1]] = N[1] + w1 * (wp.transpose(G1) * dlam)
        d_out[p[2]] = N[2] + w2 * (wp.transpose(G2) * dlam)
        if wp.static(o.lam):
            lam_out[c] = before + dlam

    return project_block_constraint
