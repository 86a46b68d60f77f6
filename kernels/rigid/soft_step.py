"""Soft Step: the passes of a substep of bodies in contact, manifold by manifold (Gauss-Seidel), see kernels/rigid/passes.py.

    impacts            what would touch in this substep faster than a rest is thrown back, see kernels/rigid/impact.py
    forces             p, L by a whole substep
    warm start         the impulses of the substep before
    solve              sweeps: u_n' = u_n + soft (bias - u_n), friction clamped to the cone
    places             free bodies by the mean of the velocities before and behind the forces, others by the solved one
    relax              sweeps without bias: what pushed bodies apart leaves no velocity

Soft contact (Catto 2011, Soft constraints; Solver2D, Soft Step) of damping ratio zeta and angular frequency w: the velocity u'
behind an impulse P of a whole substep and a point's own response A_ii (kernels/rigid/impulse.py) have

    0 <= P,  u' + bias + A_ii P / a_2 >= 0,  one of them 0          a_1 = 2 zeta + h w,  a_2 = h w a_1,  rate = w / a_1
    bias = max(rate gap, -sqrt(2 g L));     gap > 0: bias = gap / h, and nothing gives way: A_ii P / a_2 is left out

with L the radius of the smaller of both: what overlaps is pushed apart no faster than it would fall by so much.

Sweeps with bias stop the mean velocity of contact points over a substep, see kernels/rigid/complementarity/mean_velocity.py.

Friction with bias stops u + BACK drift / h, see kernels/rigid/complementarity/drift.py.

Here h w = pi / 2, a frequency of 0.25 / h. Sweeps are the scene's iterations. At 480 Hz, columns of boxes of 1 m sink by 1.73
mm (ten), 6.90 mm (twenty) and 32 mm (100 kg on nine boxes of 1 kg), and rest at 1e-5 m/s, with one sweep too. Corner by corner
in place of together, twenty sway at 2e-3 m/s, and nine under 100 kg by 5 mm (four sweeps) or 0.1 m (two).
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import matrix
from wsim.kernels.rigid.complementarity.drift import holding
from wsim.kernels.rigid.complementarity.manifold_impulse import impulses
from wsim.kernels.rigid.complementarity.mean_velocity import bending
from wsim.kernels.rigid.contact import manifolds, surfaces, whole
from wsim.kernels.rigid.impulse import formulas
from wsim.kernels.rigid.kinds import Kind
from wsim.kernels.rigid.motion import double, double3, free_rotation, kicked, near

ZETA, TURN = 10.0, 1.5707963267948966      # damping ratio; h w
A1 = 2.0 * ZETA + TURN
A2 = TURN * A1
GIVES, RATE = wp.constant(1.0 / A2), wp.constant(TURN / A1)     # rate h
NEAR = wp.constant(0.01)                   # of A_ii: points of which one is needless share what they bear as they did
BACK = wp.constant(0.005)                  # of the drift in a substep


@cache
def goals(real):
    """(goal, fastest). goal: function of a point's gap and impulse: (1 where it acts, bias, part of A_ii that its impulse gives
    way by). fastest(m, rig): speed at which the shapes of manifold m are pushed apart, at most [m/s]."""
    t, Rig = types(real), whole(real)

    @wp.func
    def fastest(m: int, rig: Rig):
        L = rig.s.ball[rig.c.a[m]]
        b = rig.s.ball[rig.c.b[m]]
        if L < real(0.0) or (b >= real(0.0) and b < L):
            L = b
        return wp.sqrt(real(2.0) * rig.work.g * L)

    @wp.func
    def goal(gap: real, push: real, h: real, most: real, biased: int):
        wants = t.vec3(real(1.0), real(0.0), real(0.0))
        if gap > real(0.0):
            wants[1] = gap / h
            if biased == 0 and push <= real(0.0):
                wants[0] = real(0.0)                  # what is not yet touched keeps its speed
        elif biased == 1:
            wants[1] = wp.max(real(RATE) * gap / h, -most)
            wants[2] = real(GIVES)
        return wants

    return goal, fastest


@cache
def sweeps(real, exact: bool = False):
    """(warm, solve): functions of a manifold m. exact: of the converged mode, whose adjoint has points go straight."""
    t, Rig, friction_of = types(real), whole(real), surfaces(real)[0]
    Two, _, begun, shoved, pushed, ended, slip, rubbed = formulas(real)
    together, (goal, fastest), (bends, bend), hold = impulses(real), goals(real), bending(real), holding(real)

    @wp.func
    def meets(two: Two, m: int, j: int, h: real, arcs: bool, rig: Rig):
        """u of point j of manifold m; arcs: in the mean of the substep."""
        u = slip(two, j, rig)
        if wp.static(not exact):
            if arcs:
                u += bend(two, m, j, h, rig)
        return u

    @wp.func(inline=False)
    def warm(m: int, k: int, h: real, rig: Rig):
        if rig.c.count[m] > 0:
            two = begun(m, k, rig)
            n = rig.c.n[m]
            s = real(0.5) * h * wp.dot(n, two.o_a + two.o_b)             # what turns about n takes its friction with it
            c = real(1.0) - real(0.5) * s * s
            P = t.vec3()
            T_a = t.vec3()
            T_b = t.vec3()
            for i in range(rig.c.count[m]):
                j = 4 * m + i
                rub = rig.c.rub[j] - wp.dot(n, rig.c.rub[j]) * n
                rub = c * rub + s * wp.cross(n, rub)
                rig.c.rub[j] = rub
                one = rig.c.push[j] * n + rub
                P += one
                T_a += wp.cross(rig.work.r_a[j], one)
                T_b += wp.cross(rig.work.r_b[j], one)
            ended(shoved(two, P, T_a, T_b), rig)

    @wp.func(inline=False)
    def along(two: Two, m: int, count: int, h: real, biased: int, arcs: bool, rig: Rig):
        """After the impulses along the normal, of all points together."""
        n = rig.c.n[m]
        before = t.vec4()
        wanted = t.vec4()              # of the velocity along n: its change
        soft = t.vec4()                # part of A_ii that an impulse gives way by
        close = t.vec4()               # the same, of its change
        acts = wp.vec4i()
        most = fastest(m, rig)
        for i in range(4):
            if i < count:
                before[i] = rig.c.push[4 * m + i]
                wants = goal(rig.work.now[4 * m + i], before[i], h, most, biased)
                soft[i] = wants[2]
                if wants[2] == real(0.0):
                    close[i] = real(NEAR)
                if wants[0] > real(0.0):
                    acts[i] = 1
                    wanted[i] = -(wp.dot(n, meets(two, m, 4 * m + i, h, arcs, rig)) + wants[1])
        more = together(rig.work.A[m], before, wanted, soft, close, acts)
        T_a = t.vec3()
        T_b = t.vec3()
        P = t.vec3()
        for i in range(4):
            if i < count:
                rig.c.push[4 * m + i] = before[i] + more[i]
                P += more[i] * n
                T_a += wp.cross(rig.work.r_a[4 * m + i], more[i] * n)
                T_b += wp.cross(rig.work.r_b[4 * m + i], more[i] * n)
        return shoved(two, P, T_a, T_b)

    @wp.func(inline=False)
    def solve(m: int, k: int, h: real, biased: int, rig: Rig):
        count = rig.c.count[m]
        if count > 0:
            two = begun(m, k, rig)
            arcs = biased == 1 and bends(two, h)
            two = along(two, m, count, h, biased, arcs, rig)
            n = rig.c.n[m]
            mu = friction_of(m, rig)
            for i in range(count):
                j = 4 * m + i
                was = rig.c.rub[j]
                u = meets(two, m, j, h, arcs, rig)
                if wp.static(not exact):
                    if biased == 1:
                        u += (real(BACK) / h) * rig.c.drift[j]
                rub = rubbed(was, u, n, rig.work.K[j], rig.c.push[j], mu)
                rig.c.rub[j] = rub
                two = pushed(two, j, rub - was, rig)
            if wp.static(not exact):
                if biased == 1:
                    hold(m, count, mu, rig)
            ended(two, rig)

    return warm, solve


@cache
def body_steps(real):
    """(oriented, turned, forces, place): functions of a body or a collider, f behind the bodies."""
    Rig = whole(real)

    @wp.func
    def oriented(i: int, rig: Rig):
        R = matrix(rig.now.q[i])
        rig.work.turn[i] = R
        rig.work.spread[i] = R * wp.diag(rig.b.inverse[i]) * wp.transpose(R)

    @wp.func
    def turned(f: int, k: int, rig: Rig):
        rig.work.turn[f] = matrix(rig.still.q[k * rig.still.moving, f - rig.b.w.shape[0]])

    @wp.func(inline=False)
    def forces(i: int, h: real, rig: Rig):
        rig.work.touched[i] = 0
        if rig.work.asleep[i] == 0:
            rig.work.p0[i] = rig.now.p[i]
            rig.work.L0[i] = rig.now.L[i]
            rig.now.p[i] = kicked(rig.now.p[i], rig.b.push[i], rig.b.drag[i], h)
            rig.now.L[i] = kicked(rig.now.L[i], rig.b.torque[i], rig.b.spin_drag[i], h)

    @wp.func(inline=False)
    def place(i: int, h: real, rig: Rig):
        if rig.work.asleep[i] == 0:
            p = rig.now.p[i]
            L = rig.now.L[i]
            if rig.work.touched[i] == 0:
                p = kicked(rig.work.p0[i], rig.b.push[i], rig.b.drag[i], real(0.5) * h)
                L = kicked(rig.work.L0[i], rig.b.torque[i], rig.b.spin_drag[i], real(0.5) * h)
            step = rig.now.e[i] + h * rig.b.w[i] * p
            x = rig.now.x[i] + step
            rig.now.e[i] = step - (x - rig.now.x[i])
            rig.now.x[i] = x
            q = free_rotation(double(rig.now.q[i], rig.now.o[i]), double3(L), double3(rig.b.inverse[i]), wp.float64(h))
            rig.now.q[i] = near(q, rig.now.q[i])
            rig.now.o[i] = near(q - double(rig.now.q[i], wp.quatd()), rig.now.q[i])

    return oriented, turned, forces, place


@cache
def contact_kind(real, coloured: bool, exact: bool = False) -> Kind:
    """Manifolds as a kind of constraints; not coloured: all in turn, as they are listed, by one thread; exact: see `sweeps`."""
    Rig, prepare, (warm, solve) = whole(real), formulas(real, not exact)[1], sweeps(real, exact)
    count = manifolds(real)
    if coloured:
        @wp.func
        def colours(rig: Rig):
            return rig.work.colours[0]

        @wp.func
        def start(colour: int, rig: Rig):
            return rig.work.starts[colour]

        @wp.func
        def item(slot: int, rig: Rig):
            return rig.work.order[slot]
    else:
        @wp.func
        def colours(rig: Rig):
            return 1

        @wp.func
        def start(colour: int, rig: Rig):
            return colour * count(rig)

        @wp.func
        def item(slot: int, rig: Rig):
            return slot

    return Kind("contacts", prepare, warm, solve, colours, start, item)
