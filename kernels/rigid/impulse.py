"""Impulses at the points of one manifold, on both bodies alike: momentum is conserved to rounding.

Velocities follow from momenta, v = w p and omega = I^-1 L, which alone are kept. Friction stops the slip along its direction,
or gives all that it has: static mu times the push until it slips, then dynamic mu (Coulomb).
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import against, whole


@cache
def formulas(real):
    """(Two, prepare, begun, pushed, ended, slip, rubbed): functions of a manifold m."""
    t, Rig = types(real), whole(real)

    @wp.struct
    class Two:
        """Velocities of both bodies of a manifold, and the impulses that they have taken."""
        v_a: t.vec3
        v_b: t.vec3
        o_a: t.vec3
        o_b: t.vec3
        P: t.vec3
        T_a: t.vec3
        T_b: t.vec3

    @wp.func
    def prepare(m: int, k: int, rig: Rig):
        """Arms, gaps and K of the points of a manifold, as bodies are."""
        n = rig.b.w.shape[0]
        f = rig.s.frame[rig.c.a[m]]
        g = rig.s.frame[rig.c.b[m]]
        away = t.vec3()
        w = real(0.0)
        S_a = t.mat33()
        S_b = t.mat33()
        if f < n:
            away += rig.now.x[f] - rig.work.from_x[f]
            w += rig.b.w[f]
            S_a = rig.work.spread[f]
        else:
            away += rig.still.x[k * rig.still.moving, f - n] - rig.work.from_x[f]
        if g < n:
            away -= rig.now.x[g] - rig.work.from_x[g]
            w += rig.b.w[g]
            S_b = rig.work.spread[g]
        else:
            away -= rig.still.x[k * rig.still.moving, g - n] - rig.work.from_x[g]
        normal = rig.c.n[m]
        for i in range(rig.c.count[m]):
            j = 4 * m + i
            arm_a = rig.work.turn[f] * rig.c.core_a[j]
            arm_b = rig.work.turn[g] * rig.c.core_b[j]
            rig.work.now[j] = rig.c.gap[j] + wp.dot(normal, away + (arm_a - rig.c.first_a[j]) - (arm_b - rig.c.first_b[j]))
            arm_a = arm_a - rig.c.skin[m][0] * normal
            arm_b = arm_b + rig.c.skin[m][1] * normal
            rig.work.r_a[j] = arm_a
            rig.work.r_b[j] = arm_b
            rig.work.K[j] = wp.diag(t.vec3(w, w, w)) + against(arm_a, S_a) + against(arm_b, S_b)

    @wp.func
    def begun(m: int, k: int, rig: Rig):
        """Velocities of the bodies of a manifold."""
        n = rig.b.w.shape[0]
        f = rig.s.frame[rig.c.a[m]]
        g = rig.s.frame[rig.c.b[m]]
        two = Two()
        if f < n:
            two.v_a = rig.b.w[f] * rig.now.p[f]
            two.o_a = rig.work.spread[f] * rig.now.L[f]
        else:
            two.v_a = rig.still.v[k * rig.still.moving, f - n]
            two.o_a = rig.still.omega[k * rig.still.moving, f - n]
        if g < n:
            two.v_b = rig.b.w[g] * rig.now.p[g]
            two.o_b = rig.work.spread[g] * rig.now.L[g]
        else:
            two.v_b = rig.still.v[k * rig.still.moving, g - n]
            two.o_b = rig.still.omega[k * rig.still.moving, g - n]
        return two

    @wp.func
    def pushed(two: Two, m: int, j: int, P: t.vec3, rig: Rig):
        """After an impulse P on A at point j, and -P on B."""
        n = rig.b.w.shape[0]
        f = rig.s.frame[rig.c.a[m]]
        g = rig.s.frame[rig.c.b[m]]
        out = two
        out.P = two.P + P
        if f < n:
            T = wp.cross(rig.work.r_a[j], P)
            out.T_a = two.T_a + T
            out.v_a = two.v_a + rig.b.w[f] * P
            out.o_a = two.o_a + rig.work.spread[f] * T
        if g < n:
            T = wp.cross(rig.work.r_b[j], P)
            out.T_b = two.T_b - T
            out.v_b = two.v_b - rig.b.w[g] * P
            out.o_b = two.o_b - rig.work.spread[g] * T
        return out

    @wp.func
    def ended(two: Two, m: int, rig: Rig):
        n = rig.b.w.shape[0]
        f = rig.s.frame[rig.c.a[m]]
        g = rig.s.frame[rig.c.b[m]]
        if wp.max(wp.max(wp.abs(two.P)), wp.max(wp.max(wp.abs(two.T_a)), wp.max(wp.abs(two.T_b)))) > real(0.0):
            if f < n:
                rig.now.p[f] = rig.now.p[f] + two.P
                rig.now.L[f] = rig.now.L[f] + two.T_a
                rig.work.touched[f] = 1
            if g < n:
                rig.now.p[g] = rig.now.p[g] - two.P
                rig.now.L[g] = rig.now.L[g] + two.T_b
                rig.work.touched[g] = 1

    @wp.func
    def slip(two: Two, j: int, rig: Rig):
        """u of point j."""
        return two.v_a + wp.cross(two.o_a, rig.work.r_a[j]) - two.v_b - wp.cross(two.o_b, rig.work.r_b[j])

    @wp.func
    def rubbed(before: t.vec3, u: t.vec3, n: t.vec3, K: t.mat33, push: real, mu: t.vec2):
        """Impulse across n that stops the slip, or all that friction has; before: what there is of it."""
        across = u - wp.dot(n, u) * n
        speed = wp.length(across)
        P = before - wp.dot(n, before) * n
        if speed > real(0.0):
            way = across / speed
            P = P - (speed / wp.dot(way, K * way)) * way
        size = wp.length(P)
        if size > mu[0] * push:
            P = (mu[1] * push / wp.max(size, real(1.0e-30))) * P
        return P

    return Two, prepare, begun, pushed, ended, slip, rubbed
