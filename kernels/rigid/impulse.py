"""Impulses at the points of one manifold, on both bodies alike: momentum is conserved to rounding.

Velocities follow from momenta, v = w p and omega = I^-1 L, which alone are kept. Impulses along the normal n of all points of
a manifold are found together,

    A_ij = w_a + w_b + (r_ai x n) . I_a^-1 (r_aj x n) + (r_bi x n) . I_b^-1 (r_bj x n)        u_n changes by A P, (4, 4)

so that what is symmetric stays so; friction, point by point, stops the slip along its direction, or gives all that it has:
static mu times the push until it slips, then dynamic mu (Coulomb). It is told in tangents t_1, t_2 that n alone decides.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type, rim_axis_functions


@cache
def tangent_func(real):
    """Function: a unit vector across the unit vector n; the other tangent is n x t."""
    t = types(real)

    @wp.func
    def unit_tangent_across(n: t.vec3):
        x = t.vec3(real(0.0), -n[2], n[1])
        if wp.abs(n[0]) > wp.abs(n[1]) and wp.abs(n[0]) > wp.abs(n[2]):
            x = t.vec3(-n[2], real(0.0), n[0])
        return wp.normalize(x)

    return unit_tangent_across


@cache
def impulse_formulas(real, held: bool = False):
    """(Two, prepare, begun, shoved, pushed, ended, slip, rubbed): functions of a manifold m. held: with drift, see
    kernels/rigid/complementarity/drift.py."""
    t, Rig, first, (axis, across) = types(real), rig_type(real), tangent_func(real), rim_axis_functions(real)
    rows = wp.types.matrix((4, 3), real)

    @wp.struct
    class BodyPair:
        """Both bodies of a manifold (w = 0, S = 0 of a collider), their velocities, and the impulses that they have taken."""
        f: int
        g: int
        w_a: real
        w_b: real
        S_a: t.mat33
        S_b: t.mat33
        v_a: t.vec3
        v_b: t.vec3
        o_a: t.vec3
        o_b: t.vec3
        P: t.vec3
        T_a: t.vec3
        T_b: t.vec3

    @wp.func(inline=False)
    def masses_of_pair(m: int, rig: Rig):
        n = rig.b.w.shape[0]
        two = BodyPair()
        two.f = rig.s.frame[rig.c.a[m]]
        two.g = rig.s.frame[rig.c.b[m]]
        if two.f < n:
            two.w_a = rig.b.w[two.f]
            two.S_a = rig.work.spread[two.f]
        if two.g < n:
            two.w_b = rig.b.w[two.g]
            two.S_b = rig.work.spread[two.g]
        return two

    @wp.func
    def displacement_since_made(f: int, since: t.vec3, k: int, rig: Rig):
        """Displacement of a frame since a manifold was made."""
        n = rig.b.w.shape[0]
        x = -since
        if f < n:
            x += rig.now.x[f]
        else:
            x += rig.still.x[k * rig.still.moving, f - n]
        return x

    @wp.func
    def collider_moves(g: int, k: int, rig: Rig):
        """Whether a frame is that of a collider that moves."""
        g -= rig.b.w.shape[0]
        moves = bool(False)
        if g >= 0 and rig.still.moving == 1:
            moves = wp.length_sq(rig.still.v[k, g]) + wp.length_sq(rig.still.omega[k, g]) > real(0.0)
        return moves

    @wp.func
    def contact_point_arms(m: int, j: int, two: BodyPair, rig: Rig):
        """p_a and p_b of point j."""
        R_a = rig.work.turn[two.f]
        R_b = rig.work.turn[two.g]
        n = rig.c.n[m]
        arm_a = R_a * rig.c.core_a[j]
        arm_b = R_b * rig.c.core_b[j]
        if rig.c.rim[j][0] > real(0.0):
            arm_a -= rig.c.rim[j][0] * across(axis(rig.c.a[m], R_a, rig), n)
        if rig.c.rim[j][1] > real(0.0):
            arm_b += rig.c.rim[j][1] * across(axis(rig.c.b[m], R_b, rig), n)
        return arm_a, arm_b

    @wp.func
    def normal_delassus_matrix(m: int, count: int, two: BodyPair, rig: Rig):
        """A of a manifold."""
        n = rig.c.n[m]
        w = two.w_a + two.w_b
        turn_a = rows()
        turn_b = rows()
        for i in range(4):
            if i < count:
                turn_a[i] = wp.cross(rig.work.r_a[4 * m + i], n)
                turn_b[i] = wp.cross(rig.work.r_b[4 * m + i], n)
        A = t.mat44()
        for i in range(4):
            A[i, i] = real(1.0)
            if i < count:
                S = two.S_a * turn_a[i]
                Z = two.S_b * turn_b[i]
                for e in range(4):
                    if e < count:
                        A[i, e] = w + wp.dot(turn_a[e], S) + wp.dot(turn_b[e], Z)
        return A

    @wp.func(inline=False)
    def prepare_manifold(m: int, k: int, rig: Rig):
        """Arms, gaps and responses of the points of a manifold, as bodies are."""
        count = rig.c.count[m]
        if count > 0:
            two = masses_of_pair(m, rig)
            away = displacement_since_made(two.f, rig.c.from_a[m], k, rig) - displacement_since_made(two.g, rig.c.from_b[m], k,
                                                                                                     rig)
            n = rig.c.n[m]
            t1 = first(n)
            t2 = wp.cross(n, t1)
            w = two.w_a + two.w_b
            for i in range(count):                              # a loop: a GPU waits for code that it runs through once
                j = 4 * m + i
                arm_a, arm_b = contact_point_arms(m, j, two, rig)
                d = away + (arm_a - rig.c.first_a[j]) - (arm_b - rig.c.first_b[j])
                rig.work.now[j] = rig.c.gap[j] + wp.dot(n, d)
                if wp.static(held):
                    rig.c.drift[j] = t.vec3()
                    if collider_moves(two.g, k, rig) and rig.c.skin[m] == t.vec2() and rig.c.rim[j] == t.vec2():
                        rig.c.drift[j] = d - wp.dot(n, d) * n
                arm_a = arm_a - rig.c.skin[m][0] * n
                arm_b = arm_b + rig.c.skin[m][1] * n
                rig.work.r_a[j] = arm_a
                rig.work.r_b[j] = arm_b
                a1 = wp.cross(arm_a, t1)
                a2 = wp.cross(arm_a, t2)
                b1 = wp.cross(arm_b, t1)
                b2 = wp.cross(arm_b, t2)
                S1 = two.S_a * a1
                Z1 = two.S_b * b1
                rig.work.K[j] = t.vec3(w + wp.dot(a1, S1) + wp.dot(b1, Z1), wp.dot(a2, S1) + wp.dot(b2, Z1),
                                       w + wp.dot(a2, two.S_a * a2) + wp.dot(b2, two.S_b * b2))
            rig.work.A[m] = normal_delassus_matrix(m, count, two, rig)

    @wp.func(inline=False)
    def velocities_of_pair(m: int, k: int, rig: Rig):
        """Velocities of the bodies of a manifold."""
        n = rig.b.w.shape[0]
        two = masses_of_pair(m, rig)
        if two.f < n:
            two.v_a = two.w_a * rig.now.p[two.f]
            two.o_a = two.S_a * rig.now.L[two.f]
        else:
            two.v_a = rig.still.v[k * rig.still.moving, two.f - n]
            two.o_a = rig.still.omega[k * rig.still.moving, two.f - n]
        if two.g < n:
            two.v_b = two.w_b * rig.now.p[two.g]
            two.o_b = two.S_b * rig.now.L[two.g]
        else:
            two.v_b = rig.still.v[k * rig.still.moving, two.g - n]
            two.o_b = rig.still.omega[k * rig.still.moving, two.g - n]
        return two

    @wp.func
    def apply_pair_impulse(two: BodyPair, P: t.vec3, T_a: t.vec3, T_b: t.vec3):
        """After an impulse P and its moment T_a on A, -P and -T_b on B."""
        out = two
        out.P = two.P + P
        out.T_a = two.T_a + T_a
        out.T_b = two.T_b - T_b
        out.v_a = two.v_a + two.w_a * P
        out.o_a = two.o_a + two.S_a * T_a
        out.v_b = two.v_b - two.w_b * P
        out.o_b = two.o_b - two.S_b * T_b
        return out

    @wp.func
    def apply_point_impulse(two: BodyPair, j: int, P: t.vec3, rig: Rig):
        """After an impulse P on A at point j, and -P on B."""
        return apply_pair_impulse(two, P, wp.cross(rig.work.r_a[j], P), wp.cross(rig.work.r_b[j], P))

    @wp.func(inline=False)
    def store_pair_momenta(two: BodyPair, rig: Rig):
        n = rig.b.w.shape[0]
        f = two.f
        g = two.g
        if wp.max(wp.max(wp.abs(two.P)), wp.max(wp.max(wp.abs(two.T_a)), wp.max(wp.abs(two.T_b)))) > real(0.0):
            if f < n:
                rig.now.p[f] = rig.now.p[f] + two.P
                rig.now.L[f] = rig.now.L[f] + two.T_a
                rig.work.touched[f] = 1
            if g < n:
                rig.now.p[g] = rig.now.p[g] - two.P
                rig.now.L[g] = rig.now.L[g] + two.T_b
                rig.work.touched[g] = 1
            if rig.still.moving == 1:            # P . (v + omega x r) of the collider
                if f < n and g >= n:
                    rig.work.given[f] += wp.float64(wp.dot(two.P, two.v_b) - wp.dot(two.T_b, two.o_b))
                if g < n and f >= n:
                    rig.work.given[g] -= wp.float64(wp.dot(two.P, two.v_a) + wp.dot(two.T_a, two.o_a))

    @wp.func
    def contact_point_slip(two: BodyPair, j: int, rig: Rig):
        """u of point j."""
        return two.v_a + wp.cross(two.o_a, rig.work.r_a[j]) - two.v_b - wp.cross(two.o_b, rig.work.r_b[j])

    @wp.func(inline=False)
    def coulomb_friction_impulse(before: t.vec3, u: t.vec3, n: t.vec3, K: t.vec3, push: real, mu: t.vec2):
        """Impulse across n that stops the slip, or all that friction has; before: what there is of it. K: 11, 12, 22 of the
        response along the tangents of n. Where it slips, the step is that of the larger principal response: a longer one may
        turn about the direction of the slip for ever."""
        t1 = first(n)
        t2 = wp.cross(n, t1)
        u1 = wp.dot(t1, u)
        u2 = wp.dot(t2, u)
        q1 = wp.dot(t1, before)
        q2 = wp.dot(t2, before)
        p1 = q1
        p2 = q2
        square = u1 * u1 + u2 * u2
        along = K[0] * u1 * u1 + real(2.0) * K[1] * u1 * u2 + K[2] * u2 * u2
        if square > real(1.0e-30) and along > real(0.0):       # float32 has no product of 1e-20 / kg and a slip of 1e-14 m/s
            part = square / along
            p1 -= part * u1
            p2 -= part * u2
        if p1 * p1 + p2 * p2 > mu[0] * mu[0] * push * push:
            half = real(0.5) * (K[0] - K[2])
            part = real(1.0) / (real(0.5) * (K[0] + K[2]) + wp.sqrt(half * half + K[1] * K[1]))
            p1 = q1 - part * u1
            p2 = q2 - part * u2
            most = mu[1] * push
            size = p1 * p1 + p2 * p2
            if size > most * most:
                part = most / wp.sqrt(size)
                p1 *= part
                p2 *= part
        return p1 * t1 + p2 * t2

    return (BodyPair, prepare_manifold, velocities_of_pair, apply_pair_impulse, apply_point_impulse, store_pair_momenta,
            contact_point_slip, coulomb_friction_impulse)
