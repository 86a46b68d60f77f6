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
    Two, _, begun, shoved, _, ended, _, rubbed = formulas(real)
    rows = wp.types.matrix((4, 3), real)
    together, (goal, fastest), (bends, bend), hold = impulses(real), goals(real), bending(real), holding(real)

    @wp.struct
    class Four:
        """The points of a manifold, rows, read before anything is written: reads wait for one another else."""
        r_a: rows
        r_b: rows
        K: rows
        rub: rows
        drift: rows
        push: t.vec4
        now: t.vec4

    @wp.func
    def points(m: int, rig: Rig):
        p = Four()
        for i in range(4):
            p.r_a[i] = rig.work.r_a[4 * m + i]
            p.r_b[i] = rig.work.r_b[4 * m + i]
            p.K[i] = rig.work.K[4 * m + i]
            p.rub[i] = rig.c.rub[4 * m + i]
            p.drift[i] = rig.c.drift[4 * m + i]
            p.push[i] = rig.c.push[4 * m + i]
            p.now[i] = rig.work.now[4 * m + i]
        return p

    @wp.func
    def meets(two: Two, p: Four, m: int, i: int, h: real, arcs: bool, rig: Rig):
        """u of point i of manifold m; arcs: in the mean of the substep."""
        u = two.v_a + wp.cross(two.o_a, p.r_a[i]) - two.v_b - wp.cross(two.o_b, p.r_b[i])
        if wp.static(not exact):
            if arcs:
                u += bend(two, m, 4 * m + i, h, rig)
        return u

    @wp.func(inline=False)
    def warm(m: int, k: int, h: real, rig: Rig):
        count = rig.c.count[m]
        if count > 0:
            two = begun(m, k, rig)
            p = points(m, rig)
            n = rig.c.n[m]
            s = real(0.5) * h * wp.dot(n, two.o_a + two.o_b)             # what turns about n takes its friction with it
            c = real(1.0) - real(0.5) * s * s
            P = t.vec3()
            T_a = t.vec3()
            T_b = t.vec3()
            for i in range(4):
                if i < count:
                    rub = p.rub[i] - wp.dot(n, p.rub[i]) * n
                    rub = c * rub + s * wp.cross(n, rub)
                    rig.c.rub[4 * m + i] = rub
                    one = p.push[i] * n + rub
                    P += one
                    T_a += wp.cross(p.r_a[i], one)
                    T_b += wp.cross(p.r_b[i], one)
            ended(shoved(two, P, T_a, T_b), rig)

    @wp.func
    def along(two: Two, p: Four, m: int, count: int, h: real, biased: int, arcs: bool, rig: Rig):
        """(bodies, pushes) after the impulses along the normal, of all points together."""
        n = rig.c.n[m]
        wanted = t.vec4()              # of the velocity along n: its change
        soft = t.vec4()                # part of A_ii that an impulse gives way by
        close = t.vec4()               # the same, of its change
        before = t.vec4()
        acts = wp.vec4i()
        most = fastest(m, rig)
        for i in range(4):
            if i < count:
                before[i] = p.push[i]
                wants = goal(p.now[i], before[i], h, most, biased)
                soft[i] = wants[2]
                if wants[2] == real(0.0):
                    close[i] = real(NEAR)
                if wants[0] > real(0.0):
                    acts[i] = 1
                    wanted[i] = -(wp.dot(n, meets(two, p, m, i, h, arcs, rig)) + wants[1])
        more = together(rig.work.A[m], before, wanted, soft, close, acts)
        T_a = t.vec3()
        T_b = t.vec3()
        P = t.vec3()
        for i in range(4):
            if i < count:
                P += more[i] * n
                T_a += wp.cross(p.r_a[i], more[i] * n)
                T_b += wp.cross(p.r_b[i], more[i] * n)
        return shoved(two, P, T_a, T_b), before + more

    @wp.func(inline=False)
    def solve(m: int, k: int, h: real, biased: int, rig: Rig):
        count = rig.c.count[m]
        if count > 0:
            two = begun(m, k, rig)
            p = points(m, rig)
            n = rig.c.n[m]
            mu = friction_of(m, rig)
            arcs = biased == 1 and bends(two, h)
            two, push = along(two, p, m, count, h, biased, arcs, rig)
            drifts = real(0.0)
            for i in range(4):
                if i < count:
                    u = meets(two, p, m, i, h, arcs, rig)
                    if wp.static(not exact):
                        if biased == 1:
                            u += (real(BACK) / h) * p.drift[i]
                            drifts += wp.length_sq(p.drift[i])
                    rub = rubbed(p.rub[i], u, n, p.K[i], push[i], mu)
                    P = rub - p.rub[i]
                    two = shoved(two, P, wp.cross(p.r_a[i], P), wp.cross(p.r_b[i], P))
                    rig.c.push[4 * m + i] = push[i]
                    rig.c.rub[4 * m + i] = rub
            if wp.static(not exact):
                if drifts > real(0.0):
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
