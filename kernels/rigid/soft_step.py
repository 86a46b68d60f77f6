"""Soft Step: the substeps of bodies in contact, all in one launch of one thread, manifold by manifold (Gauss-Seidel).

    impacts            what would touch in this substep faster than a rest is thrown back, see kernels/rigid/impact.py
    forces             p, L by a whole substep
    warm start         the impulses of the substep before
    solve              sweeps: u_n' = u_n + soft (bias - u_n), friction clamped to the cone
    places             free bodies by the mean of the velocities before and behind the forces, others by the solved one
    relax              sweeps without bias: what pushed bodies apart leaves no velocity

Soft contact (Catto 2011, Soft constraints; Solver2D, Soft Step) of damping ratio zeta and angular frequency w:

    a_1 = 2 zeta + h w,  a_2 = h w a_1,  soft = a_2 / (1 + a_2),  give = 1 / (1 + a_2),  rate = w / a_1
    dP = -K_nn^-1 soft (u_n + rate max(gap, -most)) - give P,    P + dP >= 0;   gap > 0: bias = gap / h, soft = 1, give = 0

with h w = pi / 2, a frequency of 0.25 / h: a column of ten boxes of 1 m sinks 1.7 mm at 480 Hz. One sweep never rests: two.
Friction takes the mean of both coefficients, static until it slips (Coulomb). Every impulse acts on both bodies alike: momentum
is conserved to rounding.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import matrix
from wsim.kernels.rigid.contact import against, structs
from wsim.kernels.rigid.motion import double, double3, free_rotation, kicked, near
from wsim.kernels.rigid.motion import structs as of_bodies

SWEEPS = wp.constant(2)
ZETA, TURN = 10.0, 1.5707963267948966      # damping ratio; h w
A1 = 2.0 * ZETA + TURN
A2 = TURN * A1
SOFT, GIVE, RATE = wp.constant(A2 / (1.0 + A2)), wp.constant(1.0 / (1.0 + A2)), wp.constant(TURN / A1)     # rate h
MOST = wp.constant(4.0)                    # [m/s] at which what overlaps is pushed apart, at most


@cache
def formulas(real):
    """(prepare, warm, solve, velocities): functions of a manifold m."""
    t = types(real)
    Bodies, Moving = of_bodies(real)
    Shapes, Still, Contacts, Work = structs(real)

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
    def prepare(m: int, k: int, s: Shapes, b: Bodies, now: Moving, still: Still, c: Contacts, work: Work):
        """Arms, gaps and K of the points of a manifold, as bodies are."""
        n = b.w.shape[0]
        f = s.frame[c.a[m]]
        g = s.frame[c.b[m]]
        away = t.vec3()
        w = real(0.0)
        S_a = t.mat33()
        S_b = t.mat33()
        if f < n:
            away += now.x[f] - work.from_x[f]
            w += b.w[f]
            S_a = work.spread[f]
        else:
            away += still.x[k * still.moving, f - n] - work.from_x[f]
        if g < n:
            away -= now.x[g] - work.from_x[g]
            w += b.w[g]
            S_b = work.spread[g]
        else:
            away -= still.x[k * still.moving, g - n] - work.from_x[g]
        normal = c.n[m]
        for i in range(c.count[m]):
            j = 4 * m + i
            arm_a = work.turn[f] * c.core_a[j]
            arm_b = work.turn[g] * c.core_b[j]
            work.now[j] = c.gap[j] + wp.dot(normal, away + (arm_a - c.first_a[j]) - (arm_b - c.first_b[j]))
            arm_a = arm_a - c.skin[m][0] * normal
            arm_b = arm_b + c.skin[m][1] * normal
            work.r_a[j] = arm_a
            work.r_b[j] = arm_b
            work.K[j] = wp.diag(t.vec3(w, w, w)) + against(arm_a, S_a) + against(arm_b, S_b)

    @wp.func
    def begun(m: int, k: int, s: Shapes, b: Bodies, now: Moving, still: Still, c: Contacts, work: Work):
        """Velocities of the bodies of a manifold."""
        n = b.w.shape[0]
        f = s.frame[c.a[m]]
        g = s.frame[c.b[m]]
        two = Two()
        if f < n:
            two.v_a = b.w[f] * now.p[f]
            two.o_a = work.spread[f] * now.L[f]
        else:
            two.v_a = still.v[k * still.moving, f - n]
            two.o_a = still.omega[k * still.moving, f - n]
        if g < n:
            two.v_b = b.w[g] * now.p[g]
            two.o_b = work.spread[g] * now.L[g]
        else:
            two.v_b = still.v[k * still.moving, g - n]
            two.o_b = still.omega[k * still.moving, g - n]
        return two

    @wp.func
    def pushed(two: Two, m: int, j: int, P: t.vec3, s: Shapes, b: Bodies, c: Contacts, work: Work):
        """After an impulse P on A at point j, and -P on B."""
        n = b.w.shape[0]
        f = s.frame[c.a[m]]
        g = s.frame[c.b[m]]
        out = two
        out.P = two.P + P
        if f < n:
            T = wp.cross(work.r_a[j], P)
            out.T_a = two.T_a + T
            out.v_a = two.v_a + b.w[f] * P
            out.o_a = two.o_a + work.spread[f] * T
        if g < n:
            T = wp.cross(work.r_b[j], P)
            out.T_b = two.T_b - T
            out.v_b = two.v_b - b.w[g] * P
            out.o_b = two.o_b - work.spread[g] * T
        return out

    @wp.func
    def ended(two: Two, m: int, s: Shapes, b: Bodies, now: Moving, c: Contacts, touched: wp.array(dtype=int)):
        n = b.w.shape[0]
        f = s.frame[c.a[m]]
        g = s.frame[c.b[m]]
        if wp.max(wp.max(wp.abs(two.P)), wp.max(wp.max(wp.abs(two.T_a)), wp.max(wp.abs(two.T_b)))) > real(0.0):
            if f < n:
                now.p[f] = now.p[f] + two.P
                now.L[f] = now.L[f] + two.T_a
                touched[f] = 1
            if g < n:
                now.p[g] = now.p[g] - two.P
                now.L[g] = now.L[g] + two.T_b
                touched[g] = 1

    @wp.func
    def slip(two: Two, j: int, work: Work):
        """u of point j."""
        return two.v_a + wp.cross(two.o_a, work.r_a[j]) - two.v_b - wp.cross(two.o_b, work.r_b[j])

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


@cache
def sweeps(real):
    """(warm, solve): functions of a manifold m."""
    t = types(real)
    Bodies, Moving = of_bodies(real)
    Shapes, Still, Contacts, Work = structs(real)
    _, _, begun, pushed, ended, slip, rubbed = formulas(real)

    @wp.func
    def warm(m: int, k: int, s: Shapes, b: Bodies, now: Moving, still: Still, c: Contacts, work: Work):
        two = begun(m, k, s, b, now, still, c, work)
        n = c.n[m]
        for i in range(c.count[m]):
            j = 4 * m + i
            c.rub[j] = c.rub[j] - wp.dot(n, c.rub[j]) * n
            two = pushed(two, m, j, c.push[j] * n + c.rub[j], s, b, c, work)
        ended(two, m, s, b, now, c, work.touched)

    @wp.func
    def solve(m: int, k: int, h: real, biased: int, s: Shapes, b: Bodies, now: Moving, still: Still, c: Contacts, work: Work):
        two = begun(m, k, s, b, now, still, c, work)
        n = c.n[m]
        mu = real(0.5) * (s.friction[c.a[m]] + s.friction[c.b[m]])
        for i in range(c.count[m]):
            j = 4 * m + i
            gap = work.now[j]
            before = c.push[j]
            bias = real(0.0)
            soft = real(1.0)
            give = real(0.0)
            if gap > real(0.0):
                bias = gap / h
            elif biased == 1:
                bias = wp.max(real(RATE) * gap / h, -real(MOST))
                soft = real(SOFT)
                give = real(GIVE)
            if biased == 1 or gap <= real(0.0) or before > real(0.0):      # behind: what is not yet touched keeps its speed
                u = wp.dot(n, slip(two, j, work))
                push = wp.max(before - soft * (u + bias) / wp.dot(n, work.K[j] * n) - give * before, real(0.0))
                c.push[j] = push
                two = pushed(two, m, j, (push - before) * n, s, b, c, work)
        for i in range(c.count[m]):
            j = 4 * m + i
            was = c.rub[j]
            rub = rubbed(was, slip(two, j, work), n, work.K[j], c.push[j], mu)
            c.rub[j] = rub
            two = pushed(two, m, j, rub - was, s, b, c, work)
        ended(two, m, s, b, now, c, work.touched)

    return warm, solve


@cache
def body_steps(real):
    """(forces, place): functions of a body i."""
    Bodies, Moving = of_bodies(real)
    _, _, _, Work = structs(real)

    @wp.func
    def oriented(i: int, b: Bodies, now: Moving, work: Work):
        R = matrix(now.q[i])
        work.turn[i] = R
        work.spread[i] = R * wp.diag(b.inverse[i]) * wp.transpose(R)

    @wp.func
    def forces(i: int, h: real, b: Bodies, now: Moving, work: Work):
        work.p0[i] = now.p[i]
        work.L0[i] = now.L[i]
        now.p[i] = kicked(now.p[i], b.push[i], b.drag[i], h)
        now.L[i] = kicked(now.L[i], b.torque[i], b.spin_drag[i], h)
        work.touched[i] = 0

    @wp.func
    def place(i: int, h: real, b: Bodies, now: Moving, work: Work):
        p = now.p[i]
        L = now.L[i]
        if work.touched[i] == 0:
            p = kicked(work.p0[i], b.push[i], b.drag[i], real(0.5) * h)
            L = kicked(work.L0[i], b.torque[i], b.spin_drag[i], real(0.5) * h)
        step = now.e[i] + h * b.w[i] * p
        x = now.x[i] + step
        now.e[i] = step - (x - now.x[i])
        now.x[i] = x
        q = free_rotation(double(now.q[i], now.o[i]), double3(L), double3(b.inverse[i]), wp.float64(h))
        now.q[i] = near(q, now.q[i])
        now.o[i] = near(q - double(now.q[i], wp.quatd()), now.q[i])

    return oriented, forces, place


def soft_step(real, module, bouncing: bool):
    """Kernel of substeps first .. last of a frame, of h [s]; manifolds (list.count) are those of the first of them."""
    t = types(real)
    Bodies, Moving = of_bodies(real)
    Shapes, Still, Contacts, Work = structs(real)
    prepare = formulas(real)[1]
    warm, solve = sweeps(real)
    oriented, forces, place = body_steps(real)
    if bouncing:
        from wsim.kernels.rigid.impact import impacts
        thrown = impacts(real)
    else:
        @wp.func
        def thrown(k: int, h: real, manifolds: int, s: Shapes, b: Bodies, now: Moving, still: Still, c: Contacts, work: Work):
            return

    @wp.func
    def placed(k: int, count: int, s: Shapes, b: Bodies, now: Moving, still: Still, c: Contacts, work: Work):
        """Arms and gaps as bodies and colliders are where substep k begins."""
        n = b.w.shape[0]
        for i in range(n):
            oriented(i, b, now, work)
        for f in range(work.turn.shape[0] - n):
            work.turn[n + f] = matrix(still.q[k * still.moving, f])
        for m in range(count):
            prepare(m, k, s, b, now, still, c, work)

    def rigid_soft_step(steps: wp.vec2i, h: real, manifolds: wp.array(dtype=int), s: Shapes, b: Bodies, now: Moving,
                        still: Still, c: Contacts, work: Work):
        count = wp.min(manifolds[0], c.a.shape[0])
        n = b.w.shape[0]
        placed(steps[0], count, s, b, now, still, c, work)
        for k in range(steps[0], steps[1]):
            thrown(k, h, count, s, b, now, still, c, work)
            for i in range(n):
                forces(i, h, b, now, work)
            for m in range(count):
                warm(m, k, s, b, now, still, c, work)
            for _sweep in range(int(SWEEPS)):
                for m in range(count):
                    solve(m, k, h, 1, s, b, now, still, c, work)
            for i in range(n):
                place(i, h, b, now, work)
            placed(k + 1, count, s, b, now, still, c, work)
            for m in range(count):
                solve(m, k, h, 0, s, b, now, still, c, work)

    return wp.kernel(rigid_soft_step, name="rigid_soft_step", module=module, enable_backward=False)
