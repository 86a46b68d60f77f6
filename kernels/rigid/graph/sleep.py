"""Sleep of bodies at rest, by islands: a body that has been slow for CALM seconds sleeps when all that it touches has.

    speed^2 = |v|^2 + omega . L / m            twice the kinetic energy over the mass

An island is a set of bodies that joints, and manifolds with points, join, colliders and the world aside. It wakes as one: by a
body that is not calm (it comes near, in any substep, or was set, or pushed by another force), by a collider that moves, and by
a joint that stirs: what it hangs on moves, or its drive has a speed. A broken joint still joins, as it does where joints are
eliminated. Islands are labelled by their first body: labels of two bodies that are joined become the lesser, and paths are
shortened, until nothing changes (Shiloach and Vishkin 1982), so that they depend on the lists alone. Bodies that sleep have no
momentum; their manifolds have their number of points negative meanwhile, which no pass takes up, and keep their impulses for
when they wake.
Passes of joints leave out islands of joints that sleep (kernels/rigid/joint/passes.py).
"""

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import manifold_count_func, rig_type

CALM = wp.constant(0.5)                # [s]
ROUNDS = wp.constant(64)               # of joining labels: the number of bodies in a row doubles in each


def island_edge_functions(real):
    """(joined, bonded): functions, whether manifold m joins two labels, and joint j of so many bodies `bond`, -1 for none."""
    Rig = rig_type(real)

    @wp.func
    def unite_island_labels(f: int, g: int, rig: Rig):
        """Whether bodies f and g had two labels, of which the greater becomes the lesser."""
        a = rig.work.label[f]
        b = rig.work.label[g]
        if a != b:
            wp.atomic_min(rig.work.label, wp.max(a, b), wp.min(a, b))
        return a != b

    @wp.func
    def manifold_joins_islands(m: int, rig: Rig):
        n = rig.b.w.shape[0]
        joins = bool(False)
        if rig.c.count[m] > 0:
            f = rig.s.frame[rig.c.a[m]]
            g = rig.s.frame[rig.c.b[m]]
            if f < n and g < n:
                joins = unite_island_labels(f, g, rig)
        return joins

    @wp.func
    def joint_joins_islands(j: int, bond: wp.array(dtype=wp.vec2i), rig: Rig):
        joins = bool(False)
        pair = bond[j]
        if pair[0] >= 0 and pair[1] >= 0:
            joins = unite_island_labels(pair[0], pair[1], rig)
        return joins

    return manifold_joins_islands, joint_joins_islands


def island_label_func(real, meet):
    """Function: `label` of every body, the first of its island; bond: bodies of joints (joints,), -1 for none."""
    Rig, manifolds_of, (joined, bonded) = rig_type(real), manifold_count_func(real), island_edge_functions(real)

    @wp.func
    def label_body_islands(i: int, threads: int, bond: wp.array(dtype=wp.vec2i), rig: Rig):
        for f in range(i, rig.b.w.shape[0], threads):
            rig.work.label[f] = f
        if i == 0:
            rig.work.flags[0] = 0
        meet()
        for r in range(int(ROUNDS)):
            for m in range(i, manifolds_of(rig), threads):
                if joined(m, rig):
                    rig.work.flags[r & 1] = 1
            for j in range(i, bond.shape[0], threads):
                if bonded(j, bond, rig):
                    rig.work.flags[r & 1] = 1
            meet()
            if rig.work.flags[r & 1] == 0:
                break
            for f in range(i, rig.b.w.shape[0], threads):
                label = int(rig.work.label[f])
                while rig.work.label[label] != label:
                    label = rig.work.label[label]
                rig.work.label[f] = label
            if i == 0:
                rig.work.flags[(r + 1) & 1] = 0
            meet()
        meet()
        if i == 0:
            rig.work.flags[0] = 0
            rig.work.flags[1] = 0

    return label_body_islands


def sleep_functions(real):
    """(calmed, roused, settled, idle): functions of a body f, a manifold m, a body f, a manifold m."""
    t, Rig = types(real), rig_type(real)

    @wp.func
    def count_calm_time(f: int, time: real, speed: real, rig: Rig):
        """Counts the seconds for which a body has been slow."""
        v = rig.b.w[f] * rig.now.p[f]
        L = wp.quat_rotate_inv(rig.now.q[f], rig.now.L[f])
        square = wp.dot(v, v) + rig.b.w[f] * wp.dot(L, wp.cw_mul(rig.b.inverse[f], L))
        calm = real(0.0)
        if square <= speed * speed:
            calm = wp.min(rig.work.calm[f] + time, real(CALM))
        rig.work.calm[f] = calm
        rig.work.roused[f] = 0

    @wp.func
    def rouse_by_collider(m: int, k: int, rig: Rig):
        """Whether a collider that moves touches a body, whose island wakes."""
        n = rig.b.w.shape[0]
        f = rig.s.frame[rig.c.a[m]]
        g = rig.s.frame[rig.c.b[m]]
        body = wp.min(f, g)
        still = wp.max(f, g)
        if rig.c.count[m] > 0 and still >= n and rig.still.moving == 1:
            if wp.length(rig.still.v[k, still - n]) + wp.length(rig.still.omega[k, still - n]) > real(0.0):
                rig.work.roused[rig.work.label[body]] = 1

    @wp.func
    def settle_sleeping_body(f: int, rig: Rig):
        asleep = int(0)
        if rig.work.roused[rig.work.label[f]] == 0:
            asleep = 1
            rig.now.p[f] = t.vec3()
            rig.now.L[f] = t.vec3()
        else:
            rig.work.awake[0] = 1
        rig.work.asleep[f] = asleep

    @wp.func
    def idle_sleeping_manifold(m: int, rig: Rig):
        n = rig.b.w.shape[0]
        f = rig.s.frame[rig.c.a[m]]
        g = rig.s.frame[rig.c.b[m]]
        if rig.c.count[m] > 0 and rig.work.asleep[wp.min(f, g)] == 1:
            if f >= n or g >= n or rig.work.asleep[wp.max(f, g)] == 1:
                for i in range(rig.c.count[m]):
                    rig.work.now[4 * m + i] = rig.c.gap[4 * m + i]
                rig.c.count[m] = -rig.c.count[m]

    return count_calm_time, rouse_by_collider, settle_sleeping_body, idle_sleeping_manifold


def body_sleep_kernel(real, module, meet, threads: int = 0, cluster: int = 0):
    """Kernel, behind the making of manifolds for `time` [s] from substep k on: who sleeps until the next. Slow is what is no
    faster than `speed` [m/s]. bond, stir: of joints (joints,), two bodies, -1 for none, and 1 where its island may not sleep.
    threads, cluster: as `wsim.kernels.rigid.passes.body_substep_kernel`."""
    Rig, manifolds_of, label = rig_type(real), manifold_count_func(real), island_label_func(real, meet)
    calmed, roused, settled, idle = sleep_functions(real)

    def rigid_sleep(threads: int, k: int, time: real, speed: real, rig: Rig, bond: wp.array(dtype=wp.vec2i),
                    stir: wp.array(dtype=int)):
        i = wp.tid()
        n = rig.b.w.shape[0]
        count = manifolds_of(rig)
        for f in range(i, n, threads):
            calmed(f, time, speed, rig)
        if i == 0:
            rig.work.awake[0] = 0
        label(i, threads, bond, rig)
        meet()
        for f in range(i, n, threads):
            if rig.work.calm[f] < real(CALM):
                rig.work.roused[rig.work.label[f]] = 1
        for m in range(i, count, threads):
            roused(m, k, rig)
        for j in range(i, bond.shape[0], threads):
            if stir[j] == 1:
                rig.work.roused[rig.work.label[wp.max(bond[j][0], bond[j][1])]] = 1
        meet()
        for f in range(i, n, threads):
            settled(f, rig)
        meet()
        for m in range(i, count, threads):
            idle(m, rig)

    return wp.kernel(rigid_sleep, name="rigid_sleep", module=module, enable_backward=False, grid_stride=False,
                     **({"launch_bounds": threads} if threads else {}), **({"cluster_dim": cluster} if cluster else {}))


def met_sleeper_kernel(real, module):
    """Kernel over manifolds, within a frame: where a body that is awake comes to one that sleeps, pairs are listed anew."""
    Rig, manifolds_of = rig_type(real), manifold_count_func(real)

    def rigid_met_sleeper(rig: Rig):
        m = wp.tid()
        n = rig.b.w.shape[0]
        if m < manifolds_of(rig) and rig.c.count[m] > 0:
            f = rig.s.frame[rig.c.a[m]]
            g = rig.s.frame[rig.c.b[m]]
            if f < n and g < n and rig.work.asleep[f] != rig.work.asleep[g]:
                rig.work.strayed[0] = 1
                rig.work.strayed[1 + rig.s.world[rig.c.a[m]]] = 1

    return wp.kernel(rigid_met_sleeper, name="rigid_met_sleeper", module=module, enable_backward=False)


def restored_count_kernel(real, module):
    """Kernel over manifolds, behind the substeps: all have their number of points again."""
    Rig = rig_type(real)

    def rigid_counted(rig: Rig):
        m = wp.tid()
        rig.c.count[m] = wp.abs(rig.c.count[m])

    return wp.kernel(rigid_counted, name="rigid_counted", module=module, enable_backward=False)
