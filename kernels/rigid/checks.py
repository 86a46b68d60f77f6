"""Checks of rigid bodies at the end of a frame: energy and work, springs of drives, gaps of joints, overlap.

    K = 1/2 (p . p / m + M I^-1 M),  M = q* L q          W = F . (x - x0) + sum of work of moving colliders

    gap of a joint      largest |g - goal| of a locked row over GAP of the size of its smaller body [m], over ANGLE [rad]
    overlap             largest depth of a point of a manifold over OVERLAP of the least width of the bodies that meet there and
                        what they go in a substep: an impact is not a stack that sinks

What is over 1 is told, in thousandths, by the largest of a world: of whole numbers that does not depend on the order.

F: weight and force [N]. A drive of stiffness k and force at most f holds U = 1/2 k y^2 where |k y| <= f, y = g - target, else
f |y| - f^2 / 2 k: its damping, and the force left out beyond f, only take energy.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.point_energy import bounded, motions
from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import conjugate, normalized, rotate
from wsim.kernels.rigid.contact import whole
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.steps import functions
from wsim.kernels.rigid.joint.tables import LOCKED, NONE
from wsim.kernels.rigid.motion import double, structs

GAP = wp.constant(wp.float64(0.01))            # of the size of the smaller body: seen at a glance; loops leave 1e-4 at most
ANGLE = wp.constant(wp.float64(0.02))          # [rad]
OVERLAP = wp.constant(0.05)                    # of the least width: a stack that has sunk by so much is no stack any more


@cache
def balance_bodies(real):
    """Kernel over (worlds x threads): a row of the ledger each. p_more, L_more: momenta of half a step more, or none."""
    t, (Motions, moved) = types(real), motions(real)
    Bodies, Moving = structs(real)
    vec3 = wp.array(dtype=t.vec3)

    def balance_bodies(b: Bodies, now: Moving, p_more: vec3, L_more: vec3, worlds: int, at: Motions,
                       rows: wp.array(dtype=wp.vec4d)):
        threads = rows.shape[0] // worlds
        world = wp.tid() // threads
        each = b.w.shape[0] // worlds
        K = wp.float64(0.0)
        W = wp.float64(0.0)
        for i in range(world * each + wp.tid() % threads, (world + 1) * each, threads):
            p = wp.vec3d(now.p[i])
            L = wp.vec3d(now.L[i])
            if p_more:
                p += wp.vec3d(p_more[i])
                L += wp.vec3d(L_more[i])
            M = rotate(conjugate(normalized(double(now.q[i], now.o[i]))), L)
            K += wp.float64(0.5) * (wp.float64(b.w[i]) * wp.dot(p, p) + wp.dot(M, wp.cw_mul(wp.vec3d(b.inverse[i]), M)))
            W += wp.dot(wp.vec3d(b.push[i]), moved(at, i))
            if at.given:
                W += bounded(at.given[i])
                at.given[i] = wp.float64(0.0)
        rows[wp.tid()] = wp.vec4d(K, wp.float64(0.0), wp.float64(0.0), W)

    return wp.kernel(balance_bodies, name=f"balance_bodies_{t.name}", module=f"wsim_balance_bodies_{t.name}",
                     enable_backward=False)


@cache
def place_joints(real):
    """Kernel over islands: coordinates of joints where a frame begins."""
    (Bodies, Moving), placed = structs(real), functions(real).placed

    def place_joints(b: Bodies, now: Moving, J: Linked):
        placed(wp.tid(), 0, b, now, J)

    return wp.kernel(place_joints, name="place_joints", module=f"wsim_place_joints_{types(real).name}", enable_backward=False)


@wp.kernel(module="wsim_balance_drives", enable_backward=False)
def balance_drives(J: Linked, worlds: int, begins: int, rows: wp.array(dtype=wp.vec4d)):
    """Over (worlds x threads): the energy of the springs of drives, and the work of those that ask for a speed. begins: 1 with
    the targets of where a frame begins, else of where it ends."""
    threads = rows.shape[0] // worlds
    world = wp.tid() // threads
    each = J.broken.shape[0] // worlds
    U = wp.float64(0.0)
    W = wp.float64(0.0)
    six = int(6)
    for j in range(world * each + wp.tid() % threads, (world + 1) * each, threads):
        W += bounded(J.given[j])
        J.given[j] = wp.float64(0.0)
        if J.broken[j] == 0:
            for r in range(six):
                k = J.t.stiffness[j, r]
                if J.t.drive[j, r] > NONE and k > wp.float64(0.0):
                    target = J.t.target[j, r]
                    if J.t.aiming == 1:
                        target = J.t.aim[(1 - begins) * (J.t.aim.shape[0] - 1), j, r]
                    y = wp.abs(J.now[j, r] - target)
                    f = J.t.most[j, r]
                    if k * y <= f:
                        U += wp.float64(0.5) * k * y * y
                    else:
                        U += f * y - wp.float64(0.5) * f * f / k
    rows[wp.tid()] = wp.vec4d(wp.float64(0.0), U, U, W)


@wp.kernel(module="wsim_balance_drives", enable_backward=False)
def check_joints(J: Linked, size: wp.array(dtype=wp.float64), worlds: int, word: wp.array(dtype=int)):
    """Over joints: gap of each over what it may be. size: of the smaller body [m]."""
    j = wp.tid()
    if J.broken[j] == 0:
        worst = wp.float64(0.0)
        six = int(6)
        for r in range(six):
            if J.t.kind[j, r] == LOCKED:
                may = ANGLE
                if r < 3:
                    may = GAP * size[j]
                worst = wp.max(worst, wp.abs(J.now[j, r] - J.t.low[j, r]) / may)
        if worst > wp.float64(1.0):
            wp.atomic_max(word, j // (J.broken.shape[0] // worlds), int(wp.float64(1000.0) * wp.min(worst, wp.float64(1.0e6))))


@cache
def check_overlap(real):
    """Kernel over manifolds: overlap of each over what it may be. width: least width of each shape of a body [m]; inf: none."""
    Rig, t = whole(real), types(real)

    @wp.func
    def speed(f: int, rig: Rig):
        v = real(0.0)
        if f < rig.b.w.shape[0]:
            v = rig.b.w[f] * wp.length(rig.now.p[f])
        return float(v)

    def check_overlap(rig: Rig, h: float, width: wp.array(dtype=float), word: wp.array(dtype=int)):
        m = wp.tid()
        deep = float(0.0)
        for i in range(rig.c.count[m]):
            deep = wp.max(deep, -float(rig.work.now[4 * m + i]))
        if deep > 0.0:
            a = rig.c.a[m]
            b = rig.c.b[m]
            way = h * (speed(rig.s.frame[a], rig) + speed(rig.s.frame[b], rig))
            worst = deep / (OVERLAP * wp.min(width[a], width[b]) + way)
            if worst > 1.0:
                wp.atomic_max(word, wp.max(rig.s.world[a], rig.s.world[b]), int(1000.0 * wp.min(worst, 1.0e6)))

    return wp.kernel(check_overlap, name=f"check_overlap_{t.name}", module=f"wsim_balance_bodies_{t.name}",
                     enable_backward=False)
