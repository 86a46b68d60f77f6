"""Checks of rigid bodies at the end of a frame: energy and work, springs of drives, gaps of joints, overlap.

    K = 1/2 (p . p / m + M I^-1 M),  M = q* L q          W = F . (x - x0) + sum of work of moving colliders

    gap of a joint      largest |g - goal| of a locked row over GAP of the size of its smaller body [m], over ANGLE [rad]
    pressed contacts    hold U = 1/2 F d of the force F and depth d of their points: they are soft (kernels/rigid/soft_step.py)
    overlap             largest depth of a point of a manifold over OVERLAP of the least width of the bodies that meet there and
                        what they go in a substep: an impact is not a stack that sinks
    rolling             facets or radians that pass below a body in a substep (kernels/rigid/narrow/rolling.py). It counts once
                        LASTED of them have passed in successive frames at more than MANY a substep: a body that lands or
                        tumbles once is left out

What is over 1 is told, in thousandths, by the largest of a world: of whole numbers that does not depend on the order.

F: weight and force [N]. A drive of stiffness k and force at most f holds U = 1/2 k y^2 where |k y| <= f, y = g - target, else
f |y| - f^2 / 2 k: its damping, and the force left out beyond f, only take energy.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.point_energy import bounded_work, point_motion_type
from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import conjugate_rotation, rotate_vector, unit_quaternion
from wsim.kernels.rigid.contact import first_manifold_func, rig_type
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.steps import joint_step_functions
from wsim.kernels.rigid.joint.tables import LOCKED, NONE
from wsim.kernels.rigid.lists.renewal import twist_functions
from wsim.kernels.rigid.lists.rows import posed_pair_type
from wsim.kernels.rigid.motion import body_structs, double_quat
from wsim.kernels.rigid.narrow.rolling import rolling_passage_func
from wsim.kernels.rigid.narrow.shape import hull_type

GAP = wp.constant(wp.float64(0.01))            # of the size of the smaller body: seen at a glance; loops leave 1e-4 at most
ANGLE = wp.constant(wp.float64(0.02))          # [rad]
MANY = 0.35                                    # facets or [rad] in a substep
SLOW = wp.constant(0.003)                      # [rad] in a substep; below it nothing is checked: half of what 128 corners need
LASTED = wp.constant(wp.float64(24.0))         # facets or [rad]
OVERLAP = wp.constant(0.05)                    # of the least width: a stack that has sunk by so much is no stack any more


@cache
def body_balance_kernel(real):
    """Kernel over (worlds x threads): a row of the ledger each. p_more, L_more: momenta of half a step more, or none."""
    t, (Motions, moved) = types(real), point_motion_type(real)
    Bodies, Moving = body_structs(real)
    vec3 = wp.array(dtype=t.vec3)

    def sum_body_balance(b: Bodies, now: Moving, p_more: vec3, L_more: vec3, worlds: int, at: Motions,
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
            M = rotate_vector(conjugate_rotation(unit_quaternion(double_quat(now.q[i], now.o[i]))), L)
            K += wp.float64(0.5) * (wp.float64(b.w[i]) * wp.dot(p, p) + wp.dot(M, wp.cw_mul(wp.vec3d(b.inverse[i]), M)))
            W += wp.dot(wp.vec3d(b.push[i]), moved(at, i))
            if at.given:
                W += bounded_work(at.given[i])
                at.given[i] = wp.float64(0.0)
        rows[wp.tid()] = wp.vec4d(K, wp.float64(0.0), wp.float64(0.0), W)

    return wp.kernel(sum_body_balance, name=f"balance_bodies_{t.name}", module=f"wsim_balance_bodies_{t.name}",
                     enable_backward=False)


@cache
def joint_place_kernel(real):
    """Kernel over islands: coordinates of joints where a frame begins."""
    (Bodies, Moving), placed = body_structs(real), joint_step_functions(real).placed

    def place_all_joints(b: Bodies, now: Moving, J: Linked):
        placed(wp.tid(), 0, b, now, J)

    return wp.kernel(place_all_joints, name="place_joints", module=f"wsim_place_joints_{types(real).name}",
                     enable_backward=False)


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
        W += bounded_work(J.given[j])
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
def contact_energy_kernel(real):
    """Kernel over (worlds x threads): a row of the ledger each, with the energy that contacts may give back. h: of the last
    substep [s]."""
    Rig, t, first_manifold = rig_type(real), types(real), first_manifold_func(real)

    def sum_contact_energy(rig: Rig, h: wp.float64, worlds: int, rows: wp.array(dtype=wp.vec4d)):
        threads = rows.shape[0] // worlds
        world = wp.tid() // threads
        held = wp.float64(0.0)
        for m in range(first_manifold(world, rig) + wp.tid() % threads, first_manifold(world + 1, rig), threads):
            for i in range(rig.c.count[m]):
                depth = wp.max(-wp.float64(rig.work.now[4 * m + i]), wp.float64(0.0))
                held += wp.float64(0.5) / h * wp.float64(rig.c.push[4 * m + i]) * depth
        rows[wp.tid()] = wp.vec4d(wp.float64(0.0), wp.float64(0.0), held, wp.float64(0.0))

    return wp.kernel(sum_contact_energy, name=f"balance_contacts_{t.name}", module=f"wsim_balance_bodies_{t.name}",
                     enable_backward=False)


@cache
def overlap_check_kernel(real):
    """Kernel over manifolds: overlap of each over what it may be. width: least width of each shape of a body [m]; inf: none."""
    Rig, t = rig_type(real), types(real)

    @wp.func
    def body_frame_speed(f: int, rig: Rig):
        v = real(0.0)
        if f < rig.b.w.shape[0]:
            v = rig.b.w[f] * wp.length(rig.now.p[f])
        return float(v)

    def measure_body_overlap(rig: Rig, h: float, width: wp.array(dtype=float), word: wp.array(dtype=int)):
        m = wp.tid()
        deep = float(0.0)
        for i in range(rig.c.count[m]):
            deep = wp.max(deep, -float(rig.work.now[4 * m + i]))
        if deep > 0.0:
            a = rig.c.a[m]
            b = rig.c.b[m]
            way = h * (body_frame_speed(rig.s.frame[a], rig) + body_frame_speed(rig.s.frame[b], rig))
            worst = deep / (OVERLAP * wp.min(width[a], width[b]) + way)
            if worst > 1.0:
                wp.atomic_max(word, wp.max(rig.s.world[a], rig.s.world[b]), int(1000.0 * wp.min(worst, 1.0e6)))

    return wp.kernel(measure_body_overlap, name=f"check_overlap_{t.name}", module=f"wsim_balance_bodies_{t.name}",
                     enable_backward=False)


@cache
def rolling_check_kernel(real):
    """Kernel over manifolds: facets or radians that pass in the last substep k, of h [s]. found: the largest of each world, in
    thousandths times 2^32, plus the index of its shape."""
    Rig, t, Hulls = rig_type(real), types(real), hull_type(real)
    posed, twist, pass_by = posed_pair_type(real)[1], twist_functions(real).twist, rolling_passage_func(real, MANY)

    @wp.func
    def record_rolling_passage(shape: int, other: int, passed: real, rig: Rig, found: wp.array(dtype=wp.int64)):
        if passed > real(MANY):
            world = wp.max(rig.s.world[shape], rig.s.world[other])
            thousandths = wp.int64(wp.min(real(1000.0) * passed, real(1.0e6)))
            wp.atomic_max(found, world, (thousandths << wp.int64(32)) + wp.int64(shape))

    def measure_body_rolling(rig: Rig, H: Hulls, k: int, h: real, found: wp.array(dtype=wp.int64)):
        m = wp.tid()
        if rig.c.a[m] >= 0 and rig.c.count[m] > 0:
            both = twist(m, k, h, rig)
            o = both.o_a - both.o_b
            least = real(0.5) * wp.length(o)                  # of what turns itself: a crate on rollers does not
            if h * least > real(SLOW):
                a = rig.c.a[m]
                b = rig.c.b[m]
                p = posed(m, k, rig)
                n = rig.c.n[m]
                if rig.s.frame[a] < rig.b.w.shape[0] and wp.length(both.o_a) >= least:
                    record_rolling_passage(a, b, pass_by(p.a, H, wp.transform_get_rotation(p.pose_a), o, -n, h), rig, found)
                if rig.s.frame[b] < rig.b.w.shape[0] and wp.length(both.o_b) >= least:
                    record_rolling_passage(b, a, pass_by(p.b, H, wp.transform_get_rotation(p.pose_b), -o, n, h), rig, found)

    return wp.kernel(measure_body_rolling, name=f"check_rolling_{t.name}", module=f"wsim_check_rolling_{t.name}",
                     enable_backward=False)


@wp.kernel(module="wsim_balance_drives", enable_backward=False)
def close_rolling(found: wp.array(dtype=wp.int64), substeps: int, lasted: wp.array(dtype=wp.float64),
                  last: wp.array(dtype=wp.int64), word: wp.array(dtype=int)):
    """Kernel over worlds. lasted: facets or [rad] in successive frames so far; last: copy of found, which is then cleared."""
    w = wp.tid()
    thousandths = int(found[w] >> wp.int64(32))
    lasted[w] = wp.where(thousandths > 0, lasted[w], wp.float64(0.0)) + wp.float64(0.001 * float(thousandths * substeps))
    if lasted[w] > LASTED:
        word[w] = thousandths
    last[w] = found[w]
    found[w] = wp.int64(0)
