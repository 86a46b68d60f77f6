"""Adjoint of the forces of membranes (kernels/cloth/element.py), by hand and gathered; of hinges:
kernels/cloth/curvature_adjoint.py.

With p_k the gradients by the forces of the points, P_k = p_k - p_0, V_k velocities, a = G P and b = G V (sums over k):

    sum_k p_k.f_k = -s.a,   s = S (C + tau b),   sigma = S a

C has symmetric second derivatives H, whose products with a motion are how G changes along it. The gradients are

    by positions  -(G^T sigma + s.(H P) + tau sigma.(H V))        by velocities  -tau G^T sigma
    by S  -(C + tau b) a^T      by tau  -sigma.b

Of a membrane C, G and H are those of F = X B, and so are V and P: with g, the gradient by F, that by B is
X^T g - P^T G_F^T s - V^T tau G_F^T sigma.

Warp's own adjoint takes 2.4 times as long as the forces; this takes 1.4 times as long (CPU, float32).
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.cloth.constraint import MEMBRANE, inverse_or_zero, polar_rows
from wsim.kernels.cloth.corner_gradients import adjoint_works, corner_reader
from wsim.kernels.cloth.element import force_elements, plane_stress_product
from wsim.kernels.math.real import types


@wp.func
def stretch_change(dFu: Any, dFv: Any, ru: Any, rv: Any, n: Any, U: Any, q: Any, over: Any):
    """How U = (uu, vv, uv) changes along dF; and how R does: by w in its plane, by a and b out of it. over: 1 / det U."""
    w = q * (wp.dot(rv, dFu) - wp.dot(ru, dFv))
    u = over * wp.dot(n, dFu)
    v = over * wp.dot(n, dFv)
    return (wp.vector(wp.dot(ru, dFu) + w * U[2], wp.dot(rv, dFv) - w * U[2], wp.dot(ru, dFv) + w * U[1]),
            wp.vector(w, u * U[1] - v * U[2], v * U[0] - u * U[2]))


@wp.func
def cross_row_stress(s: Any, U: Any, q: Any):
    """What s.(dC/dF_u) has of r_v, and s.(dC/dF_v) of r_u; the others are s[0] of r_u and s[1] of r_v."""
    e = q * U[2] * (s[0] - s[1])
    b = (q + q) * s[2]
    return e + b * U[1], b * U[0] - e


@wp.func
def cross_row_stress_change(s: Any, dU: Any, turn: Any, ru: Any, rv: Any, n: Any, U: Any, q: Any):
    """How both change while s stays, along what `stretch_change` tells."""
    u, v = cross_row_stress(s, U, q)
    dq = -q * q * (dU[0] + dU[1])
    de = (dq * U[2] + q * dU[2]) * (s[0] - s[1])
    b = (q + q) * s[2]
    db = (dq + dq) * s[2]
    dru = turn[0] * rv + turn[1] * n
    drv = turn[2] * n - turn[0] * ru
    return (s[0] * dru + (de + db * U[1] + b * dU[1]) * rv + u * drv,
            s[1] * drv + (db * U[0] + b * dU[0] - de) * ru + v * dru)


@cache
def membrane_adjoint_function(real, damped: bool):
    """Function of one triangle: gradients by X, by V, and by stiffness, edges at rest and tau."""
    t = types(real)
    vec3, rows = t.vec3, wp.types.matrix((2, 3), real)

    @wp.func
    def membrane_adjoint(X: rows, V: rows, P: rows, B: t.mat22, S: t.vec4, tau: real):
        A = wp.transpose(B)
        F = A * X
        ru, rv, n, size, q = polar_rows(F[0], F[1])
        over = inverse_or_zero(size)
        U = vec3(wp.dot(ru, F[0]), wp.dot(rv, F[1]), wp.dot(ru, F[1]))
        FP = A * P
        UP, turn = stretch_change(FP[0], FP[1], ru, rv, n, U, q, over)
        a = vec3(UP[0], UP[1], UP[2] + UP[2])
        sigma = plane_stress_product(S, a)
        C = vec3(U[0] - real(1.0), U[1] - real(1.0), U[2] + U[2])
        u, v = cross_row_stress(sigma, U, q)
        by_V = wp.matrix_from_rows(sigma[0] * ru + u * rv, sigma[1] * rv + v * ru)           # over tau
        more = rows()
        b = vec3()
        if wp.static(damped):
            FV = A * V
            UV, turn_V = stretch_change(FV[0], FV[1], ru, rv, n, U, q, over)
            b = vec3(UV[0], UV[1], UV[2] + UV[2])
            C += tau * b
            du, dv = cross_row_stress_change(sigma, UV, turn_V, ru, rv, n, U, q)
            more = tau * wp.matrix_from_rows(du, dv)
        s = plane_stress_product(S, C)
        u, v = cross_row_stress(s, U, q)
        by_P = wp.matrix_from_rows(s[0] * ru + u * rv, s[1] * rv + v * ru)
        du, dv = cross_row_stress_change(s, UP, turn, ru, rv, n, U, q)
        by_F = by_V + more + wp.matrix_from_rows(du, dv)
        by_B = X * wp.transpose(by_F) + P * wp.transpose(by_P)
        if wp.static(damped):
            by_B += tau * (V * wp.transpose(by_V))
        return (-B * by_F, -tau * (B * by_V), t.vec4(-C[0] * a[0], -C[0] * a[1] - C[1] * a[0], -C[2] * a[2], -C[1] * a[1]),
                -by_B, -wp.dot(sigma, b))

    return membrane_adjoint


@cache
def membrane_adjoint_kernel(real, module, damped: bool, parameters: bool, direct: bool):
    """Kernel over triangles: at the places of the points' forces the gradients by their positions, and those by their
    velocities at `rates`; direct: of p, else of what stands at those places; parameters: adds by stiffness, rest, tau.
    Arguments: those of the kernel of the forces but these, work, by."""
    t, Elements, Work = types(real), force_elements(MEMBRANE, real), adjoint_works(real)
    vec3, by_force = wp.array(dtype=t.vec3), corner_reader(real, direct)
    rows, formula = wp.types.matrix((2, 3), real), membrane_adjoint_function(real, damped)

    def membrane_corner_adjoint(batch: Elements, x: vec3, d: vec3, source: int, first: int, w: Work, by: Elements):
        c = wp.tid()
        m = x.shape[0]
        p = batch.point[c]
        i = p[0]
        at = first + 3 * c
        X = rows()
        V = rows()
        P = rows()
        x0 = x[i]
        d0 = d[source * m + i]
        p0 = by_force(w, i, at)
        for k in range(2):
            j = p[k + 1]
            X[k] = (x[j] - x0) + (d[source * m + j] - d0)
            P[k] = by_force(w, j, at + k + 1) - p0
            if wp.static(damped):
                V[k] = d[(2 + source) * m + j] - d[(2 + source) * m + i]
        tau = real(0.0)
        if wp.static(damped):
            tau = batch.tau[c]
        by_X, by_V, by_S, by_rest, by_tau = formula(X, V, P, batch.rest[c], batch.stiffness[c], tau)
        sum = t.vec3()
        rate = t.vec3()
        for k in range(2):
            sum += by_X[k]
            rate += by_V[k]
            w.corners[at + k + 1] = by_X[k]
            if wp.static(damped):
                w.rates[at + k + 1] = by_V[k]
        w.corners[at] = -sum
        if wp.static(damped):
            w.rates[at] = -rate
        if wp.static(parameters):
            by.stiffness[c] = by.stiffness[c] + by_S
            by.rest[c] = by.rest[c] + by_rest
            if wp.static(damped):
                by.tau[c] = by.tau[c] + by_tau

    name = "_".join(["adjoint_membrane", *["damped"] * damped, *["parameters"] * parameters, *["direct"] * direct, t.name])
    return wp.kernel(membrane_corner_adjoint, name=name, module=module, enable_backward=False)
