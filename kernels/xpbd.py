"""XPBD projection of one colour of constraints. Macklin, Mueller, Chentanez 2016, eq. 17, 18 and 26:

    dlam = (-C - a lam - gamma G.(d - anchor)) / ((1 + gamma) sum_k w_k |G_k|^2 + a)      dd_k = w_k G_k dlam

    a = alpha / h^2 (compliance alpha); gamma = tau / h, tau [s] the relaxation time of stiffness-proportional damping
    d displacement of the substep [m]; (d - anchor) / h its velocity; w inverse mass [1/kg], 0 pins the point

`rate` is 1 / h [1/s], h the effective step of the integrator (2/3 of the substep for BDF2). No point with w > 0 occurs
twice in a colour, so a colour needs no atomics and does not depend on the order of threads. A kernel reads only what
its variant needs; the arrays that it does not need may be None.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from wsim.kernels.constraint import TABLE
from wsim.kernels.real import types


@cache
def batch(points: int, value, compliance, scalar):
    """Struct of a constraint's tables. No stage writes them, so gradients and the overwrite detector stay right."""

    @wp.struct
    class Batch:
        point: wp.array(dtype=wp.types.vector(points, int))  # points of each constraint, (m,)
        rest: wp.array(dtype=value)           # rest value: a length, an angle, or Dm^-1, (m,)
        alpha: wp.array(dtype=compliance)     # compliance, (m,), or (1,) for all; unused by a unilateral constraint
        tau: wp.array(dtype=scalar)           # relaxation time [s], (m,) or (1,); only when damped

    return Batch


def batch_of(constraint: str, real):
    """Struct for a row of the table. The membrane's alpha has its three different entries: (uu, uv, shear)."""
    row, t = TABLE[constraint], types(real)
    return batch(row.points, t.mat22, t.vec3, real) if row.rows == 3 else batch(row.points, real, real, real)


@cache
def projection(constraint: str, *, real=wp.float32, module="unique", multipliers: bool = False, damped: bool = False,
               uniform: bool = False, backward: bool = False):
    """(Batch, kernel) of a row of the table of constraints.

    multipliers   lam is read and written: needed when a substep runs more than one iteration
    damped        tau and a (the anchor) are read
    uniform       alpha and tau have one entry for all
    The kernel's arguments: batch, x, w, a, first, rate, d, lam, d_out, lam_out (lam vec3 for the membrane); launched
    over the constraints of a colour, the first of which is `first`.
    """
    row, t, Batch = TABLE[constraint], types(real), batch_of(constraint, real)
    flags = {"lam": multipliers, "damped": damped, "uniform": uniform, "backward": backward}
    name = "_".join(["project", constraint, *(word for word, on in flags.items() if on), t.name])
    options = SimpleNamespace(unilateral=row.unilateral, anchored=row.anchored, **flags)
    make = _block if row.rows == 3 else _row
    return Batch, wp.kernel(make(row, Batch, t, options), name=name, module=module, enable_backward=backward)


def _row(row, Batch, t, options):
    """Projection of constraints with one row."""
    real, vec3, formula, n = t.scalar, t.vec3, row.formula, row.points - 1
    rows = wp.types.matrix((n, 3), real)

    def project(batch: Batch, x: wp.array(dtype=vec3), w: wp.array(dtype=real), a: wp.array(dtype=vec3),
                first: int, rate: real, d: wp.array(dtype=vec3), lam: wp.array(dtype=real),
                d_out: wp.array(dtype=vec3), lam_out: wp.array(dtype=real)):
        c = first + wp.tid()
        p = batch.point[c]
        i = p[0]
        x0 = x[i]
        d0 = d[i]
        D = rows()
        X = rows()
        for k in range(n):
            j = p[k + 1]
            D[k] = d[j] - d0
            X[k] = (x[j] - x0) + D[k]
        C, G = formula(X, batch.rest[c])
        G0 = vec3()
        below = real(0.0)
        for k in range(n):
            G0 -= G[k]
            below += w[p[k + 1]] * wp.dot(G[k], G[k])
        if wp.static(not options.anchored):
            below += w[i] * wp.dot(G0, G0)
        r = -C
        if wp.static(options.unilateral):
            r = wp.min(r, real(0.0))
        else:
            u = c
            if wp.static(options.uniform):
                u = 0
            alpha = batch.alpha[u] * rate * rate
            if wp.static(options.lam):
                r -= alpha * lam[c]
            if wp.static(options.damped):
                gamma = batch.tau[u] * rate
                a0 = a[i]
                for k in range(n):
                    r -= gamma * wp.dot(G[k], D[k] - (a[p[k + 1]] - a0))
                below *= real(1.0) + gamma
            below += alpha
        if below > real(0.0):                          # else all pinned or no direction: nothing to move
            dlam = r / below
            if wp.static(not options.anchored):
                d_out[i] = d0 + (w[i] * dlam) * G0
            for k in range(n):
                j = p[k + 1]
                d_out[j] = d[j] + (w[j] * dlam) * G[k]
            if wp.static(options.lam and not options.unilateral):
                lam_out[c] = lam[c] + dlam

    return project


@wp.func
def pivot(s: Any, before: Any, tiny: Any):
    """1 / s, or 0 where elimination has left only rounding of what stood there `before`."""
    r = type(s)(0.0)
    if s > tiny * before:
        r = type(s)(1.0) / s
    return r


@wp.func
def solve_block(S: Any, r: Any, tiny: Any):
    """y with S y = r, S symmetric, positive or semidefinite (L D L^T). A row that depends on earlier ones gets y = 0."""
    q0 = pivot(S[0, 0], S[0, 0], tiny)
    l10 = S[1, 0] * q0
    l20 = S[2, 0] * q0
    q1 = pivot(S[1, 1] - l10 * S[1, 0], S[1, 1], tiny)
    s21 = S[2, 1] - l20 * S[1, 0]
    l21 = s21 * q1
    q2 = pivot(S[2, 2] - l20 * S[2, 0] - l21 * s21, S[2, 2], tiny)
    z1 = r[1] - l10 * r[0]
    z2 = r[2] - l20 * r[0] - l21 * z1
    y2 = z2 * q2
    y1 = z1 * q1 - l21 * y2
    y0 = r[0] * q0 - l10 * y1 - l20 * y2
    return wp.vector(y0, y1, y2)


@wp.func
def plane_stress(alpha: Any):
    """Compliance matrix [[uu, uv, 0], [uv, uu, 0], [0, 0, shear]]."""
    o = type(alpha[0])(0.0)
    return wp.matrix_from_rows(wp.vector(alpha[0], alpha[1], o), wp.vector(alpha[1], alpha[0], o),
                               wp.vector(o, o, alpha[2]))


def _block(row, Batch, t, options):
    """Projection of constraints with three rows on three points: the three multipliers are solved for together."""
    real, vec3, formula = t.scalar, t.vec3, row.formula
    tiny = 4.0 * (1.2e-7 if real is wp.float32 else 2.3e-16)

    def project(batch: Batch, x: wp.array(dtype=vec3), w: wp.array(dtype=real), a: wp.array(dtype=vec3),
                first: int, rate: real, d: wp.array(dtype=vec3), lam: wp.array(dtype=vec3),
                d_out: wp.array(dtype=vec3), lam_out: wp.array(dtype=vec3)):
        c = first + wp.tid()
        p = batch.point[c]
        i = p[0]
        j = p[1]
        k = p[2]
        x0 = x[i]
        d0 = d[i]
        D1 = d[j] - d0
        D2 = d[k] - d0
        C, G1, G2 = formula(wp.matrix_from_rows((x[j] - x0) + D1, (x[k] - x0) + D2), batch.rest[c])
        G0 = -(G1 + G2)
        S = (w[i] * (G0 * wp.transpose(G0)) + w[j] * (G1 * wp.transpose(G1)) + w[k] * (G2 * wp.transpose(G2)))
        u = c
        if wp.static(options.uniform):
            u = 0
        alpha = (rate * rate) * plane_stress(batch.alpha[u])
        r = -C
        if wp.static(options.lam):
            r -= alpha * lam[c]
        if wp.static(options.damped):
            gamma = batch.tau[u] * rate
            a0 = a[i]
            r -= gamma * (G1 * (D1 - (a[j] - a0)) + G2 * (D2 - (a[k] - a0)))
            S *= real(1.0) + gamma
        dlam = solve_block(S + alpha, r, real(tiny))
        d_out[i] = d0 + w[i] * (wp.transpose(G0) * dlam)
        d_out[j] = d[j] + w[j] * (wp.transpose(G1) * dlam)
        d_out[k] = d[k] + w[k] * (wp.transpose(G2) * dlam)
        if wp.static(options.lam):
            lam_out[c] = lam[c] + dlam

    return project
