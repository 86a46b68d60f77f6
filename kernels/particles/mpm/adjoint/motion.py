"""Adjoint of a particle's strain and stress in a step (`wsim.kernels.particles.mpm.motion`).

    B1 = F (1 + B) F^T - 1,  F = 1 + L:   B* = F^T B1* F,  L* = 2 B1* F (1 + B),  C* = h L* + 2 eta dev tau*

Of a grain that bears nothing, L is symmetric and no larger than TURN; of what is packed flat C keeps its spin alone.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.adjoint.law_table import choose_law_adjoint
from wsim.kernels.particles.mpm.adjoint.tables import cotangent_rows
from wsim.kernels.particles.mpm.laws import determinant_strain
from wsim.kernels.particles.mpm.motion import PACKED, TURN, motion_functions
from wsim.kernels.particles.mpm.tables import NUMBERS, point_tables


@cache
def motion_adjoint(laws: tuple[str, ...], real):
    """Function deform_back(points, materials, p, h, C, by): cotangents of what `deform_particle` writes become those of what it
    reads; returns that of the gradient C of the velocity."""
    t, T, Rows = types(real), point_tables(real), cotangent_rows(real)
    f, law_back, Numbers = motion_functions(laws, real), choose_law_adjoint(laws, real), wp.types.vector(NUMBERS, wp.float64)

    @wp.func
    def symmetric(b: t.vec3, s: t.vec3):
        """Cotangent of a symmetric matrix, of those of its six numbers."""
        x = real(0.5) * s[0]
        y = real(0.5) * s[1]
        z = real(0.5) * s[2]
        return t.mat33(b[0], z, y, z, b[1], x, y, x, b[2])

    @wp.func
    def deform_back(points: T.PointRows, materials: T.MaterialRows, p: int, h: real, C: t.mat33, by: Rows):
        row = points.row[p]
        m = materials.numbers[row]
        B = f.read_strain(points, p)
        one = wp.identity(n=3, dtype=real)
        L = h * C
        loose = f.bears_nothing(points, p)
        size = real(TURN)
        if loose:
            L = real(0.5) * (L + wp.transpose(L))
            size = wp.max(wp.sqrt(wp.ddot(L, L)), real(TURN))
            L = (real(TURN) / size) * L
        X = L + L * B
        E = B + X + wp.transpose(X) + X * wp.transpose(L)
        by_tau = symmetric(by.T[p], by.S[p])
        by_E, by_q, by_m = law_back(materials.law[row], E, points.q[p], m, symmetric(by.b[p], by.s[p]), by.q[p], by_tau)
        B_out, q_out, tau_out, stiff = f.respond(materials.law[row], E, points.q[p], m)
        by_C = by.C[p]
        if not wp.min(determinant_strain(B_out), q_out) > real(PACKED):
            by_C = real(0.5) * (by_C - wp.transpose(by_C))
        D = C + wp.transpose(C) - (real(2.0 / 3.0) * wp.trace(C)) * one
        by_C += real(2.0) * m[7] * (by_tau - (wp.trace(by_tau) / real(3.0)) * one)
        by_m[7] = wp.ddot(by_tau, D)
        F = one + L
        by_L = real(2.0) * (by_E * F * (one + B))
        if loose:
            by_L = real(0.5) * (by_L + wp.transpose(by_L))
            if size > real(TURN):
                by_L = by_L - (wp.ddot(by_L, L) / (real(TURN) * real(TURN))) * L
            by_L = (real(TURN) / size) * by_L
        by_C += h * by_L
        by_B = wp.transpose(F) * by_E * F
        by.b[p] = wp.get_diag(by_B)
        by.s[p] = real(2.0) * t.vec3(by_B[1, 2], by_B[2, 0], by_B[0, 1])
        by.q[p] = by_q
        numbers = Numbers()
        for k in range(NUMBERS):
            numbers[k] = wp.float64(by_m[k])
        by.numbers[p] = by.numbers[p] + numbers
        return by_C

    return deform_back
