"""Forces of hinges and triangles, and the positive part of their Jacobian: what kernels/solver/newton.py gathers.

    force = -G^T alpha^-1 (C + tau G v)         v = (d - a) / g, a the anchor, tau [s] the relaxation time of damping

What is kept of the Jacobian:

    sheet      (1 + tau/g) J^T J of the curvatures of its triangles (kernels/cloth/curvature.py): exact where it is unbent
               (Gauss-Newton). Of hinges that are folded, f' K f' + k q (1 - f'^2) has the same diagonal k q: K alone is kept
    membrane   (1 + tau/g) G^T alpha^-1 G, and of the stress Sigma = [[s0, s2], [s2, s1]], s = alpha^-1 C, what stiffens
               motion across the triangle and turns in its plane, where that is positive; see `membrane_tension`

A hinge keeps alpha^-1/2 G (12 numbers), and of these each point of a curvature its rows of J (9 numbers; blocks are sums of
three outer products); a membrane keeps its blocks of pairs (27). Blocks sum to zero along a row, so those of a point with
itself are not stored.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.cloth.constraint import DIHEDRAL, MEMBRANE, cross_and_normal, inverse_or_zero, membrane_constraint
from wsim.kernels.cloth.curvature import folded_angle, hinge_moment, hinge_of, sheet_curvatures
from wsim.kernels.cloth.terms import batch_of
from wsim.kernels.math.real import types

WHOLE, TURNED = -1, -2         # second number of a part of a block: that of a triangle or tet, or its transpose; >= 0: spans


@cache
def elements_of(real):
    """Struct of what elements leave for their points."""
    t = types(real)

    @wp.struct
    class HessianElements:
        G: wp.array(dtype=t.vec3)            # (1 + tau/g)^1/2 alpha^-1/2 G of each corner of a hinge, (4 hinges,)
        J: wp.array(dtype=t.vec3)            # rows of the curvature of a triangle by a point, (3 spans,)
        block: wp.array(dtype=t.mat33)       # A_01, A_02, A_12 of each triangle, then of tets as kernels/soft/fem.py says
        force: wp.array(dtype=t.vec3)        # [N] on each corner: of hinges, then of triangles, then of tets

    return HessianElements


@wp.func
def plane_stiffness(alpha: Any):
    """Inverse of `plane_stress`."""
    o = type(alpha[0])(0.0)
    q = inverse_or_zero(alpha[0] * alpha[3] - alpha[1] * alpha[1])
    return wp.matrix_from_rows(wp.vector(q * alpha[3], -q * alpha[1], o), wp.vector(-q * alpha[1], q * alpha[0], o),
                               wp.vector(o, o, inverse_or_zero(alpha[2])))


@wp.func
def psd_part_2x2(M: Any):
    """The part of a symmetric 2 x 2 matrix with eigenvalues >= 0."""
    zero = type(M[0, 0])(0.0)
    half = type(M[0, 0])(0.5)
    mean = half * (M[0, 0] + M[1, 1])
    skew = half * (M[0, 0] - M[1, 1])
    reach = wp.sqrt(skew * skew + M[0, 1] * M[0, 1])
    low = mean - reach
    scale = type(M[0, 0])(1.0)
    if low < zero:
        scale = wp.max(zero, mean + reach) * half * inverse_or_zero(reach)
    else:
        low = zero
    return scale * wp.matrix_from_rows(wp.vector(M[0, 0] - low, M[0, 1]), wp.vector(M[0, 1], M[1, 1] - low))


@wp.func
def membrane_tension(C: Any, s: Any):
    """What stress s of a membrane adds: the positive part of 2 T (2 x 2), and that of tr(Sigma U).

    Move the triangle across its plane, dF = n w^T: U^2 becomes U^2 + w w^T, so U changes by V with U V + V U = w w^T in
    second order, and the energy by Sigma:V = w^T T w where U T + T U = Sigma. Turn it in its plane by the spin of
    `membrane_constraint`, R^T dF = J U: U^2 becomes U^2 + U^2 and the energy changes by T:U^2 = tr(Sigma U) / 2. (What couples
    turns to strains is left out: it has no sign.) T = (det Sigma + adj Sigma adj) / (2 tr det) with adj = tr I - U;
    where the triangle is nearly a line, det is kept above 1e-4 tr^2.
    """
    one = type(C[0])(1.0)
    half = type(C[0])(0.5)
    U = wp.matrix_from_rows(wp.vector(C[0] + one, half * C[2]), wp.vector(half * C[2], C[1] + one))
    S = wp.matrix_from_rows(wp.vector(s[0], s[2]), wp.vector(s[2], s[1]))
    t = U[0, 0] + U[1, 1]
    det = wp.max(U[0, 0] * U[1, 1] - U[0, 1] * U[0, 1], type(one)(1.0e-4) * t * t)
    adj = wp.matrix_from_rows(wp.vector(U[1, 1], -U[0, 1]), wp.vector(-U[0, 1], U[0, 0]))
    spin = wp.max(s[0] * U[0, 0] + s[1] * U[1, 1] + s[2] * C[2], type(one)(0.0))
    return psd_part_2x2(inverse_or_zero(t * det) * (det * S + adj * S * adj)), spin


@wp.func
def membrane_frame(X: Any, B: Any):
    """Unit normal, and r_u / t, r_v / t of `membrane_constraint`: a spin of the triangle is (r_v.dF_u - r_u.dF_v) / t."""
    Fu = B[0, 0] * X[0] + B[1, 0] * X[1]
    Fv = B[0, 1] * X[0] + B[1, 1] * X[1]
    s, n = cross_and_normal(Fu, Fv)
    q = inverse_or_zero(wp.dot(Fu, Fu) + wp.dot(Fv, Fv) + type(s)(2.0) * s)
    return n, q * (Fu + wp.cross(Fv, n)), q * (Fv + wp.cross(n, Fu))


@cache
def hinge_hessian_kernel(real, module):
    """Kernel over hinges: z, alpha^-1/2 G, and slope and kept by which alpha^1/2 m = slope u + kept."""
    t, Batch, Elements, Curvatures, hinge = (types(real), batch_of(DIHEDRAL, real), elements_of(real), sheet_curvatures(real),
                                             hinge_of(real, True))
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def linearise_hinges(batch: Batch, x: vec3, d: vec3, a: vec3, rate: real, cur: Curvatures, out: Elements):
        c = wp.tid()
        _X, V, C, G = hinge(batch, batch.rest, x, d, a, c)
        gamma = rate * batch.tau[c]
        root = wp.sqrt(inverse_or_zero(batch.alpha[c]))
        f, slope, rest = folded_angle(C)
        b = gamma * wp.ddot(G, V)
        cur.z[c] = root * (f + slope * b)
        cur.slope[c] = slope
        cur.kept[c] = root * cur.own[c] * (C - f * slope + rest * b)
        root *= wp.sqrt(real(1.0) + gamma)
        out.G[4 * c] = -root * (G[0] + G[1] + G[2])
        for k in range(3):
            out.G[4 * c + k + 1] = root * G[k]

    return linearise_hinges


@cache
def hinge_moment_kernel(real, module):
    """Kernel over hinges: forces on corners, from C."""
    Batch, Elements, Curvatures = batch_of(DIHEDRAL, real), elements_of(real), sheet_curvatures(real)

    @wp.kernel(module=module, enable_backward=False)
    def hinge_moment_forces(batch: Batch, rate: real, cur: Curvatures, out: Elements):
        c = wp.tid()
        s = -(cur.slope[c] * hinge_moment(cur, cur.C, c) + cur.kept[c]) / wp.sqrt(real(1.0) + rate * batch.tau[c])
        for k in range(4):
            out.force[4 * c + k] = s * out.G[4 * c + k]

    return hinge_moment_forces


@cache
def curvature_span_kernel(real, module):
    """Kernel over the points of curvatures: rows of J. Those of span s are sums over part[s] .. part[s + 1] of value[slot]
    times G of a corner of a hinge, item = (slot, corner)."""
    t, Elements, Curvatures = types(real), elements_of(real), sheet_curvatures(real)

    @wp.kernel(module=module, enable_backward=False)
    def curvature_spans(cur: Curvatures, part: wp.array(dtype=int), item: wp.array(dtype=wp.vec2i), out: Elements):
        s = wp.tid()
        J = t.mat33()
        for k in range(part[s], part[s + 1]):
            at = item[k]
            J += wp.outer(cur.value[at[0]], out.G[at[1]])
        for r in range(3):
            out.J[3 * s + r] = J[r]

    return curvature_spans


@cache
def membrane_hessian_kernel(real, module):
    """Kernel over membranes: forces on corners, the first of which has place `first`, and the three blocks of pairs."""
    t, Batch, Elements = types(real), batch_of(MEMBRANE, real), elements_of(real)

    @wp.kernel(module=module, enable_backward=False)
    def linearise_membranes(batch: Batch, x: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3), a: wp.array(dtype=t.vec3),
                            rate: real, first: int, out: Elements):
        c = wp.tid()
        p = batch.point[c]
        i = p[0]
        D1 = d[p[1]] - d[i]
        D2 = d[p[2]] - d[i]
        X = wp.matrix_from_rows((x[p[1]] - x[i]) + D1, (x[p[2]] - x[i]) + D2)
        B = batch.rest[c]
        C, G1, G2 = membrane_constraint(X, B)
        S = plane_stiffness(batch.alpha[c])
        gamma = rate * batch.tau[c]
        V1 = D1 - (a[p[1]] - a[i])
        V2 = D2 - (a[p[2]] - a[i])
        s = S * (C + gamma * (G1 * V1 + G2 * V2))
        f1 = -(wp.transpose(G1) * s)
        f2 = -(wp.transpose(G2) * s)
        out.force[first + 3 * c] = -(f1 + f2)
        out.force[first + 3 * c + 1] = f1
        out.force[first + 3 * c + 2] = f2
        S *= real(1.0) + gamma
        M, spin = membrane_tension(C, plane_stiffness(batch.alpha[c]) * C)
        n, ru, rv = membrane_frame(X, B)
        nn = wp.outer(n, n)
        b1 = B[0]
        b2 = B[1]
        y1 = b1[0] * rv - b1[1] * ru
        y2 = b2[0] * rv - b2[1] * ru
        A11 = wp.transpose(G1) * S * G1 + wp.dot(b1, M * b1) * nn + spin * wp.outer(y1, y1)
        A12 = wp.transpose(G1) * S * G2 + wp.dot(b1, M * b2) * nn + spin * wp.outer(y1, y2)
        A22 = wp.transpose(G2) * S * G2 + wp.dot(b2, M * b2) * nn + spin * wp.outer(y2, y2)
        out.block[3 * c] = -(A11 + wp.transpose(A12))
        out.block[3 * c + 1] = -(A12 + A22)
        out.block[3 * c + 2] = A12

    return linearise_membranes
