"""XPBD projection of one colour of constraints. Macklin, Mueller, Chentanez 2016, eq. 17, 18 and 26:

    dlam = (-C - a lam - gamma G.(d - anchor)) / ((1 + gamma) sum_k w_k |G_k|^2 + a)      dd_k = w_k G_k dlam

    a = alpha / h^2 (compliance alpha); gamma = tau / h, tau [s] the relaxation time of stiffness-proportional damping
    d displacement of the substep [m]; (d - anchor) / h its velocity; w inverse mass [1/kg], 0 pins the point

`rate` is 1 / h [1/s], h the effective step of the integrator. No point with w > 0 occurs twice in a colour, so a colour
needs no atomics and its result does not depend on the order of threads. A kernel reads only what its variant needs;
the arrays that it does not need may be None.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.constraint import TABLE
from wsim.kernels.real import types


@cache
def batch(points: int, value, compliance, scalar):
    """Struct of a constraint's tables. No stage writes them, so gradients and the overwrite detector stay right."""

    @wp.struct
    class Batch:
        point: wp.array(dtype=wp.types.vector(points, int))  # points of each constraint, (m,)
        rest: wp.array(dtype=value)                           # rest value, (m,)
        alpha: wp.array(dtype=compliance)                     # compliance, (m,), or (1,) when uniform
        tau: wp.array(dtype=scalar)                           # relaxation time [s], (m,) or (1,); only when damped

    return Batch


@cache
def projection(constraint: str, *, real=wp.float32, module="unique", multipliers: bool = False, damped: bool = False,
               uniform: bool = False, backward: bool = False):
    """(Batch, kernel) of a row of the table of constraints.

    multipliers   lam is read and written: needed when a substep runs more than one iteration
    damped        tau and a (the anchor) are read
    uniform       alpha and tau have one entry for all
    The kernel's arguments: batch, x, w, a, first, rate, d, lam, d_out, lam_out; launched over the constraints of a
    colour, the first of which is `first`.
    """
    row, t = TABLE[constraint], types(real)
    Batch = batch(row.points, real, real, real)
    name = "_".join(["project", constraint, *(word for word, on in (
        ("lam", multipliers), ("damped", damped), ("uniform", uniform)) if on), t.name])
    options = SimpleNamespace(lam=multipliers, damped=damped, uniform=uniform, unilateral=row.unilateral)
    shape = {2: _pair, 4: _hinge}[row.points]
    return Batch, wp.kernel(shape(row.formula, Batch, t, options), name=name, module=module, enable_backward=backward)


def _pair(formula, Batch, t, options):
    """Projection of constraints between two points."""
    real, vec3 = t.scalar, t.vec3

    def project(batch: Batch, x: wp.array(dtype=vec3), w: wp.array(dtype=real), a: wp.array(dtype=vec3),
                first: int, rate: real, d: wp.array(dtype=vec3), lam: wp.array(dtype=real),
                d_out: wp.array(dtype=vec3), lam_out: wp.array(dtype=real)):
        c = first + wp.tid()
        p = batch.point[c]
        i = p[0]
        j = p[1]
        d0 = d[i]
        d1 = d[j]
        w0 = w[i]
        w1 = w[j]
        X1 = (x[j] - x[i]) + (d1 - d0)
        C, G = formula(X1, batch.rest[c])
        k = c
        if wp.static(options.uniform):
            k = 0
        alpha = batch.alpha[k] * rate * rate
        below = (w0 + w1) * wp.dot(G, G)
        r = -C
        if wp.static(options.lam):
            r -= alpha * lam[c]
        if wp.static(options.damped):
            gamma = batch.tau[k] * rate
            r -= gamma * wp.dot(G, (d1 - d0) - (a[j] - a[i]))
            below *= real(1.0) + gamma
        below += alpha
        if below > real(0.0):                              # else all pinned or no direction: nothing to move
            dlam = r / below
            if wp.static(options.unilateral):
                dlam = wp.min(dlam, real(0.0))
            d_out[i] = d0 - (w0 * dlam) * G
            d_out[j] = d1 + (w1 * dlam) * G
            if wp.static(options.lam):
                lam_out[c] = lam[c] + dlam

    return project


def _hinge(formula, Batch, t, options):
    """Projection of constraints between four points."""
    real, vec3 = t.scalar, t.vec3

    def project(batch: Batch, x: wp.array(dtype=vec3), w: wp.array(dtype=real), a: wp.array(dtype=vec3),
                first: int, rate: real, d: wp.array(dtype=vec3), lam: wp.array(dtype=real),
                d_out: wp.array(dtype=vec3), lam_out: wp.array(dtype=real)):
        c = first + wp.tid()
        p = batch.point[c]
        p0 = p[0]
        p1 = p[1]
        p2 = p[2]
        p3 = p[3]
        x0 = x[p0]
        d0 = d[p0]
        d1 = d[p1]
        d2 = d[p2]
        d3 = d[p3]
        w0 = w[p0]
        w1 = w[p1]
        w2 = w[p2]
        w3 = w[p3]
        X1 = (x[p1] - x0) + (d1 - d0)
        X2 = (x[p2] - x0) + (d2 - d0)
        X3 = (x[p3] - x0) + (d3 - d0)
        C, G1, G2, G3 = formula(X1, X2, X3, batch.rest[c])
        G0 = -(G1 + G2 + G3)
        k = c
        if wp.static(options.uniform):
            k = 0
        alpha = batch.alpha[k] * rate * rate
        below = w0 * wp.dot(G0, G0) + w1 * wp.dot(G1, G1) + w2 * wp.dot(G2, G2) + w3 * wp.dot(G3, G3)
        r = -C
        if wp.static(options.lam):
            r -= alpha * lam[c]
        if wp.static(options.damped):
            gamma = batch.tau[k] * rate
            a0 = a[p0]
            r -= gamma * (wp.dot(G1, (d1 - d0) - (a[p1] - a0)) + wp.dot(G2, (d2 - d0) - (a[p2] - a0))
                          + wp.dot(G3, (d3 - d0) - (a[p3] - a0)))
            below *= real(1.0) + gamma
        below += alpha
        if below > real(0.0):
            dlam = r / below
            if wp.static(options.unilateral):
                dlam = wp.min(dlam, real(0.0))
            d_out[p0] = d0 + (w0 * dlam) * G0
            d_out[p1] = d1 + (w1 * dlam) * G1
            d_out[p2] = d2 + (w2 * dlam) * G2
            d_out[p3] = d3 + (w3 * dlam) * G3
            if wp.static(options.lam):
                lam_out[c] = lam[c] + dlam

    return project
