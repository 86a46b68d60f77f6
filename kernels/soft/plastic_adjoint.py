"""Adjoint of plastic flow (kernels/soft/plastic.py), F_p -> G F_p / det^(1/3), tet by tet. With Y the gradient by F_p after it:

    A = G F_p,  YA = (Y - (Y : A) A^-T / 3) / det(A)^(1/3)           by F_p   G YA - F_e^T W F_p^-T
    M = V^T sym(YA F_p^T) V, by G in the axes of the stretches       by x_k   W g_k
    K_ij = M_ij (g_i - g_j) / (s_i - s_j),  K_jj = sum_i M_ii dg_i/ds_j       by r_k   -(F_e F_p)^T W g_k  (edges at the start)
    W = 2 F_e V Z V^T by F_e,  Z_ij = K_ij / (s_i + s_j)             by y     sum_i M_ii dg_i/dy

g = exp(a b), a = 1 - theta, b = dev log s; (g_i - g_j) / (s_i - s_j) = g_j / s_j expm1(a t) / expm1(t) with t = log(s_i / s_j).
theta is differentiated as it was found, round by round. A tet that has not flowed hands Y on. Forces read edges r_k = F_p r_k0:
with E_k the gradient by r_k, that by F_p is sum_k E_k r_k0^T, and by r_k0 it is F_p^T E_k.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import identity_like
from wsim.kernels.soft.fem import elements, linear_displacement, spread_corner_forces
from wsim.kernels.soft.plastic import ROUNDS, deviatoric_part, exponential_entries, flow_is_bounded, plastic_tets, yield_test
from wsim.kernels.soft.principal import clamp_entries, symmetrised_matrix

SERIES = wp.constant(0.02)        # |t| below which expm1(a t) / expm1(t) is a series, right to 1e-16; quotients lose 1e-14


@cache
def flow_gradients(real):
    """Struct of what a flow has read, and gradients: by F, added to; by F after it, 0 where a tet has flowed; by corners,
    from 0 on."""
    t = types(real)

    @wp.struct
    class FlowGradients:
        x: wp.array(dtype=t.vec3)
        d: wp.array(dtype=t.vec3)
        q: wp.array(dtype=t.quat)
        F: wp.array(dtype=t.mat33)               # before it, (t,)
        by_F: wp.array(dtype=t.mat33)
        by_F_out: wp.array(dtype=t.mat33)
        corners: wp.array(dtype=t.vec3)          # (4 t,)

    return FlowGradients


@wp.func
def plastic_portion(s: Any, b: Any, y: Any):
    """theta of `plastic_stretch`, and its derivatives by s and y, as the rounds there make them."""
    one = type(y)(1.0)
    three = type(y)(3.0)
    theta = one
    by_s = b - b
    by_y = y - y
    size = wp.exp((wp.log(s[0]) + wp.log(s[1]) + wp.log(s[2])) / three)
    n = int(ROUNDS)
    for _i in range(n):
        z = size * exponential_entries(theta * b)
        dev = deviatoric_part(z)
        psi = wp.length(dev)
        nearer = theta * y / psi
        if nearer < one:
            wz = wp.cw_mul(dev, z) / psi
            m = (one - theta) * (wz[0] + wz[1] + wz[2]) / three
            slope = wp.dot(wz, b)
            k = nearer / psi
            by_s = (y / psi - k * slope) * by_s - k * wp.cw_div(wp.vector(m, m, m) + theta * wz, s)
            by_y = (y / psi - k * slope) * by_y + theta / psi
            theta = nearer
        else:
            theta = one
            by_s = b - b
            by_y = y - y
    return theta, by_s, by_y


@wp.func
def exponential_ratio(a: Any, t: Any):
    """(e^(a t) - 1) / (e^t - 1): sum over n of (B_n(a) - B_n) t^(n - 1) / n! of Bernoulli's polynomials for a small t."""
    one = type(a)(1.0)
    if wp.abs(t) > type(a)(SERIES):
        return (wp.exp(a * t) - one) / (wp.exp(t) - one)
    c = a * (a - one)
    c2 = c / type(a)(2.0)
    c3 = c * (type(a)(2.0) * a - one) / type(a)(12.0)
    c4 = c * c / type(a)(24.0)
    c5 = c * (a * (a * (type(a)(6.0) * a - type(a)(9.0)) + one) + one) / type(a)(720.0)
    c6 = c * c * (type(a)(2.0) * c - one) / type(a)(1440.0)
    return a + t * (c2 + t * (c3 + t * (c4 + t * (c5 + t * c6))))


@cache
def flow_adjoint(real, module):
    """Kernel over tets. The tets are those before the flow; `by`: gradients by limits and edges of the start, added to."""
    t, Tets, Plastic, Flow = types(real), elements(real), plastic_tets(real), flow_gradients(real)
    gradient, _ = linear_displacement(real, real)
    M33 = t.mat33

    def plastic_flow_adjoint(p: Plastic, tets: Tets, f: Flow, by: Plastic):
        c = wp.tid()
        for k in range(4):
            f.corners[4 * c + k] = t.vec3()
        H = gradient(tets, c, f.x, f.d)
        flowed, s, V = yield_test(H, f.q[c], p.limit[c])
        if not flowed:
            return
        b = deviatoric_part(t.vec3(wp.log(s[0]), wp.log(s[1]), wp.log(s[2])))
        theta, theta_s, theta_y = plastic_portion(s, b, p.limit[c])
        a = real(1.0) - theta
        g = exponential_entries(a * b)
        F = f.F[c]
        G = V * wp.diag(g) * wp.transpose(V)
        A = G * F
        size = real(1.0) / wp.cbrt(wp.determinant(A))
        now = size * A
        turned = wp.inverse(now)
        if not flow_is_bounded(now, turned):
            return
        Y = f.by_F_out[c]
        f.by_F_out[c] = M33()
        Y = size * (Y - (wp.ddot(Y, now) / real(3.0)) * wp.transpose(turned))
        M = wp.transpose(V) * symmetrised_matrix(Y * wp.transpose(F)) * V
        m = wp.cw_mul(wp.get_diag(M), g)
        along = wp.dot(m, b)
        by.limit[c] = by.limit[c] - along * theta_y
        K = (a * wp.cw_div(deviatoric_part(m), s)) - along * theta_s
        Z = wp.diag(wp.cw_div(K, s)) * real(0.5)
        for i in range(3):
            for j in range(3):
                if i != j:
                    Z[i, j] = M[i, j] * (g[j] / s[j]) * exponential_ratio(a, b[i] - b[j]) / (s[i] + s[j])
        Fe = identity_like(H) + clamp_entries(H)
        W = real(2.0) * (Fe * V * Z * wp.transpose(V))
        f.by_F[c] = f.by_F[c] + G * Y - wp.transpose(Fe) * W * wp.transpose(wp.inverse(F))
        rows = tets.gradient[c]
        spread_corner_forces(4 * c, W, rows, f.corners)
        by.edge[c] = by.edge[c] - rows * wp.transpose(W) * Fe * F

    return wp.kernel(plastic_flow_adjoint, name=f"plastic_flow_adjoint_{t.name}", module=module, enable_backward=False)


@cache
def shape_adjoint(real, module):
    """Kernel over tets: from the gradient E by the edges that forces have read, which becomes 0, to those by F and by the edges
    of the start."""
    t, Plastic = types(real), plastic_tets(real)
    mat33 = wp.array(dtype=t.mat33)

    def plastic_shape_adjoint(p: Plastic, F: mat33, E: mat33, by: Plastic, by_F: mat33):
        c = wp.tid()
        own = E[c]
        by_F[c] = by_F[c] + wp.transpose(own) * p.edge[c]
        by.edge[c] = by.edge[c] + own * F[c]
        E[c] = t.mat33()

    return wp.kernel(plastic_shape_adjoint, name=f"plastic_shape_adjoint_{t.name}", module=module, enable_backward=False)
