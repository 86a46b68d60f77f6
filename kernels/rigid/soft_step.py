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
from wsim.kernels.math.rotation import rotation_to_matrix
from wsim.kernels.rigid.complementarity.drift import drift_holding_func
from wsim.kernels.rigid.complementarity.manifold_impulse import manifold_impulse_func
from wsim.kernels.rigid.complementarity.mean_velocity import mean_velocity_funcs
from wsim.kernels.rigid.contact import manifold_count_func, rig_type, surface_law_functions
from wsim.kernels.rigid.impulse import impulse_formulas
from wsim.kernels.rigid.kinds import ConstraintKind
from wsim.kernels.rigid.motion import double_quat, double_vec3, free_rotor_step, kick_momentum, rounded_quaternion

ZETA, TURN = 10.0, 1.5707963267948966      # damping ratio; h w
A1 = 2.0 * ZETA + TURN
A2 = TURN * A1
GIVES, RATE = wp.constant(1.0 / A2), wp.constant(TURN / A1)     # rate h
NEAR = wp.constant(0.01)                   # of A_ii: points of which one is needless share what they bear as they did
BACK = wp.constant(0.005)                  # of the drift in a substep


@cache
def contact_goal_functions(real):
    """(goal, fastest). goal: function of a point's gap and impulse: (1 where it acts, bias, part of A_ii that its impulse gives
    way by). fastest(m, rig): speed at which the shapes of manifold m are pushed apart, at most [m/s]."""
    t, Rig = types(real), rig_type(real)

    @wp.func
    def fastest_separation_speed(m: int, rig: Rig):
        L = rig.s.ball[rig.c.a[m]]
        b = rig.s.ball[rig.c.b[m]]
        if L < real(0.0) or (b >= real(0.0) and b < L):
            L = b
        return wp.sqrt(real(2.0) * rig.work.g[rig.s.world[rig.c.a[m]]] * L)

    @wp.func
    def soft_contact_goal(gap: real, push: real, h: real, most: real, biased: int):
        wants = t.vec3(real(1.0), real(0.0), real(0.0))
        if gap > real(0.0):
            wants[1] = gap / h
            if biased == 0 and push <= real(0.0):
                wants[0] = real(0.0)                  # what is not yet touched keeps its speed
        elif biased == 1:
            wants[1] = wp.max(real(RATE) * gap / h, -most)
            wants[2] = real(GIVES)
        return wants

    return soft_contact_goal, fastest_separation_speed


@cache
def soft_sweep_funcs(real, exact: bool = False):
    """(warm, solve): functions of a manifold m. exact: of the converged mode, whose adjoint has points go straight."""
    t, Rig, friction_of = types(real), rig_type(real), surface_law_functions(real)[0]
    Two, _, begun, shoved, _, ended, _, rubbed = impulse_formulas(real)
    rows = wp.types.matrix((4, 3), real)
    together, (goal, fastest), (bends, bend), hold = (manifold_impulse_func(real), contact_goal_functions(real),
                                                      mean_velocity_funcs(real), drift_holding_func(real))

    @wp.struct
    class ManifoldPoints:
        """The points of a manifold, rows, read before anything is written: reads wait for one another else."""
        r_a: rows
        r_b: rows
        K: rows
        rub: rows
        drift: rows
        push: t.vec4
        now: t.vec4

    @wp.func
    def read_manifold_points(m: int, rig: Rig):
        p = ManifoldPoints()
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
    def point_relative_velocity(two: Two, p: ManifoldPoints, m: int, i: int, h: real, arcs: bool, rig: Rig):
        """u of point i of manifold m; arcs: in the mean of the substep."""
        u = two.v_a + wp.cross(two.o_a, p.r_a[i]) - two.v_b - wp.cross(two.o_b, p.r_b[i])
        if wp.static(not exact):
            if arcs:
                u += bend(two, m, 4 * m + i, h, rig)
        return u

    @wp.func(inline=False)
    def warm_start_manifold(m: int, k: int, h: real, rig: Rig):
        count = rig.c.count[m]
        if count > 0:
            two = begun(m, k, rig)
            p = read_manifold_points(m, rig)
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
    def solve_normal_impulses(two: Two, p: ManifoldPoints, m: int, count: int, h: real, biased: int, arcs: bool, rig: Rig):
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
                    wanted[i] = -(wp.dot(n, point_relative_velocity(two, p, m, i, h, arcs, rig)) + wants[1])
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
    def solve_contact_manifold(m: int, k: int, h: real, biased: int, rig: Rig):
        count = rig.c.count[m]
        if count > 0:
            two = begun(m, k, rig)
            p = read_manifold_points(m, rig)
            n = rig.c.n[m]
            mu = friction_of(m, rig)
            arcs = biased == 1 and bends(two, h)
            two, push = solve_normal_impulses(two, p, m, count, h, biased, arcs, rig)
            drifts = real(0.0)
            for i in range(4):
                if i < count:
                    u = point_relative_velocity(two, p, m, i, h, arcs, rig)
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

    return warm_start_manifold, solve_contact_manifold


@cache
def body_steps(real):
    """(oriented, turned, forces, place): functions of a body or a collider, f behind the bodies."""
    Rig = rig_type(real)

    @wp.func
    def orient_body(i: int, rig: Rig):
        R = rotation_to_matrix(rig.now.q[i])
        rig.work.turn[i] = R
        rig.work.spread[i] = R * wp.diag(rig.b.inverse[i]) * wp.transpose(R)

    @wp.func
    def orient_collider(f: int, k: int, rig: Rig):
        rig.work.turn[f] = rotation_to_matrix(rig.still.q[k * rig.still.moving, f - rig.b.w.shape[0]])

    @wp.func(inline=False)
    def apply_body_forces(i: int, h: real, rig: Rig):
        rig.work.touched[i] = 0
        if rig.work.asleep[i] == 0:
            rig.work.p0[i] = rig.now.p[i]
            rig.work.L0[i] = rig.now.L[i]
            rig.now.p[i] = kick_momentum(rig.now.p[i], rig.b.push[i], rig.b.drag[i], h)
            rig.now.L[i] = kick_momentum(rig.now.L[i], rig.b.torque[i], rig.b.spin_drag[i], h)

    @wp.func(inline=False)
    def place_moved_body(i: int, h: real, rig: Rig):
        if rig.work.asleep[i] == 0:
            p = rig.now.p[i]
            L = rig.now.L[i]
            if rig.work.touched[i] == 0:
                p = kick_momentum(rig.work.p0[i], rig.b.push[i], rig.b.drag[i], real(0.5) * h)
                L = kick_momentum(rig.work.L0[i], rig.b.torque[i], rig.b.spin_drag[i], real(0.5) * h)
            step = rig.now.e[i] + h * rig.b.w[i] * p
            x = rig.now.x[i] + step
            rig.now.e[i] = step - (x - rig.now.x[i])
            rig.now.x[i] = x
            q = free_rotor_step(double_quat(rig.now.q[i], rig.now.o[i]), double_vec3(L), double_vec3(rig.b.inverse[i]),
                                wp.float64(h))
            rig.now.q[i] = rounded_quaternion(q, rig.now.q[i])
            rig.now.o[i] = rounded_quaternion(q - double_quat(rig.now.q[i], wp.quatd()), rig.now.q[i])

    return orient_body, orient_collider, apply_body_forces, place_moved_body


@cache
def contact_kind(real, coloured: bool, exact: bool = False) -> ConstraintKind:
    """Manifolds as a kind of constraints; not coloured: all in turn, as they are listed, by one thread; exact: see
    `soft_sweep_funcs`."""
    Rig, prepare, (warm, solve) = rig_type(real), impulse_formulas(real, not exact)[1], soft_sweep_funcs(real, exact)
    count = manifold_count_func(real)
    if coloured:
        @wp.func
        def colour_count(rig: Rig):
            return rig.work.colours[0]

        @wp.func
        def first_slot_of_colour(colour: int, rig: Rig):
            return rig.work.starts[colour]

        @wp.func
        def manifold_in_order(slot: int, rig: Rig):
            return rig.work.order[slot]
    else:
        @wp.func
        def colour_count(rig: Rig):
            return 1

        @wp.func
        def first_slot_of_colour(colour: int, rig: Rig):
            return colour * count(rig)

        @wp.func
        def manifold_in_order(slot: int, rig: Rig):
            return slot

    return ConstraintKind("contacts", prepare, warm, solve, colour_count, first_slot_of_colour, manifold_in_order)
