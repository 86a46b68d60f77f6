"""Soft Step: the passes of a substep of bodies in contact, manifold by manifold (Gauss-Seidel), see kernels/rigid/passes.py.

    impacts            what would touch in this substep faster than a rest is thrown back, see kernels/rigid/impact.py
    forces             p, L by a whole substep
    warm start         the impulses of the substep before
    solve              sweeps: u_n' = u_n + soft (bias - u_n), friction clamped to the cone
    places             free bodies by the mean of the velocities before and behind the forces, others by the solved one
    relax              sweeps without bias: what pushed bodies apart leaves no velocity

Soft contact (Catto 2011, Soft constraints; Solver2D, Soft Step) of damping ratio zeta and angular frequency w:

    a_1 = 2 zeta + h w,  a_2 = h w a_1,  soft = a_2 / (1 + a_2),  give = 1 / (1 + a_2),  rate = w / a_1
    dP = -K_nn^-1 soft (u_n + rate max(gap, -most)) - give P,    P + dP >= 0;   gap > 0: bias = gap / h, soft = 1, give = 0

with h w = pi / 2, a frequency of 0.25 / h. Sweeps are the scene's iterations. A column of ten boxes of 1 m at 480 Hz sinks
1.73 mm and rests; one sweep never rests; of 100 kg on nine boxes of 1 kg, two sweeps sway by 0.1 m, four by 5 mm (both sink by
32 mm).
"""

from functools import cache

import warp as wp

from wsim.kernels.math.rotation import matrix
from wsim.kernels.rigid.contact import manifolds, whole
from wsim.kernels.rigid.impulse import formulas
from wsim.kernels.rigid.kinds import Kind
from wsim.kernels.rigid.motion import double, double3, free_rotation, kicked, near

ZETA, TURN = 10.0, 1.5707963267948966      # damping ratio; h w
A1 = 2.0 * ZETA + TURN
A2 = TURN * A1
SOFT, GIVE, RATE = wp.constant(A2 / (1.0 + A2)), wp.constant(1.0 / (1.0 + A2)), wp.constant(TURN / A1)     # rate h
MOST = wp.constant(4.0)                    # [m/s] at which what overlaps is pushed apart, at most


@cache
def sweeps(real):
    """(warm, solve): functions of a manifold m."""
    Rig = whole(real)
    _, _, begun, pushed, ended, slip, rubbed = formulas(real)

    @wp.func
    def warm(m: int, k: int, rig: Rig):
        two = begun(m, k, rig)
        n = rig.c.n[m]
        for i in range(rig.c.count[m]):
            j = 4 * m + i
            rig.c.rub[j] = rig.c.rub[j] - wp.dot(n, rig.c.rub[j]) * n
            two = pushed(two, m, j, rig.c.push[j] * n + rig.c.rub[j], rig)
        ended(two, m, rig)

    @wp.func
    def solve(m: int, k: int, h: real, biased: int, rig: Rig):
        two = begun(m, k, rig)
        n = rig.c.n[m]
        mu = real(0.5) * (rig.s.friction[rig.c.a[m]] + rig.s.friction[rig.c.b[m]])
        for i in range(rig.c.count[m]):
            j = 4 * m + i
            gap = rig.work.now[j]
            before = rig.c.push[j]
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
                u = wp.dot(n, slip(two, j, rig))
                push = wp.max(before - soft * (u + bias) / wp.dot(n, rig.work.K[j] * n) - give * before, real(0.0))
                rig.c.push[j] = push
                two = pushed(two, m, j, (push - before) * n, rig)
        for i in range(rig.c.count[m]):
            j = 4 * m + i
            was = rig.c.rub[j]
            rub = rubbed(was, slip(two, j, rig), n, rig.work.K[j], rig.c.push[j], mu)
            rig.c.rub[j] = rub
            two = pushed(two, m, j, rub - was, rig)
        ended(two, m, rig)

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

    @wp.func
    def forces(i: int, h: real, rig: Rig):
        rig.work.p0[i] = rig.now.p[i]
        rig.work.L0[i] = rig.now.L[i]
        rig.now.p[i] = kicked(rig.now.p[i], rig.b.push[i], rig.b.drag[i], h)
        rig.now.L[i] = kicked(rig.now.L[i], rig.b.torque[i], rig.b.spin_drag[i], h)
        rig.work.touched[i] = 0

    @wp.func
    def place(i: int, h: real, rig: Rig):
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
def contact_kind(real, coloured: bool) -> Kind:
    """Manifolds as a kind of constraints; not coloured: all in turn, as they are listed, by one thread."""
    Rig, prepare, (warm, solve) = whole(real), formulas(real)[1], sweeps(real)
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
