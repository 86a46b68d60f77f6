"""Manifolds of a list of pairs, with the impulses that the same features had before.

A thread has a pair. Its manifold is computed from the poses of both shapes, from the place of A's body; points become cores in
the frames of the bodies, and are given what they had before (rows.py beside this). All of a world are made when its list is
new, while those of other worlds move (worlds.py). Later those are made that need it, for the poses at the time of impact where
bodies are fast (renewal.py). Pairs with a mesh are left to collide_mesh.py.
"""

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type, rigid_contact_structs
from wsim.kernels.rigid.impulse import impulse_formulas
from wsim.kernels.rigid.lists.core import HIT, core_stop_funcs
from wsim.kernels.rigid.lists.manifold import manifold_type
from wsim.kernels.rigid.lists.renewal import LATER, STEPS, TOUCHES, manifold_need_func, twist_functions
from wsim.kernels.rigid.lists.rows import keep_row_func, last_list_type, posed_pair_type, row_writing_funcs
from wsim.kernels.rigid.lists.worlds import listed_anew_func, row_move_func
from wsim.kernels.rigid.narrow.pair import narrow_phase_func
from wsim.kernels.rigid.narrow.shape import MESH, hull_type


def pair_manifold_kernel(pairs, real, module):
    """Kernel over the pairs of a list; pairs: of kinds of shapes (`wsim.kernels.rigid.narrow.pair.pairs_of_kinds`). h [s]: of a
    substep, 0: manifolds are those of now, whatever the speed. aside: the list before, where only some worlds are listed."""
    t = types(real)
    Rig, Manifold = rig_type(real), manifold_type(real)
    Last, Hulls = last_list_type(real), hull_type(real)
    found, write, (Posed, posed) = narrow_phase_func(pairs, real), row_writing_funcs(real), posed_pair_type(real)
    known, point, poses, keep = write.known, write.point, write.poses, keep_row_func(real)
    needed, of, prepare = manifold_need_func(real), twist_functions(real), impulse_formulas(real)[1]
    Twist, twist, advanced, hurried, closing = of.Twist, of.twist, of.advanced, of.hurried, of.closing
    margin, size, (anew, move) = of.margin, of.size, (listed_anew_func(real), row_move_func(real))
    Table = rigid_contact_structs(real)[2]
    reached, alone, stopped = core_stop_funcs(real)

    @wp.func
    def time_until_touch(mm: Manifold, p: Posed, both: Twist):
        """Time until the first point of a manifold would touch; < 0 where none comes nearer, or one touches."""
        soonest = real(-1.0)
        for i in range(4):
            if i < mm.count:
                rate = closing(mm.n, mm.x[i] + wp.transform_get_translation(p.pose_a), both, p)
                if rate < real(0.0):
                    after = -mm.gap[i] / rate
                    if soonest < real(0.0) or after < soonest:
                        soonest = after
        return soonest

    @wp.func
    def least_manifold_gap(mm: Manifold):
        gap = mm.gap[0]
        for i in range(1, 4):
            if i < mm.count:
                gap = wp.min(gap, mm.gap[i])
        return gap

    @wp.func
    def hold_core_contact(mm: Manifold, ahead: Manifold, q: Posed, core: int, m: int, near: real, rig: Rig):
        """A manifold with the core as a point, if that touches in the substep; ahead: of the core alone."""
        out = mm
        r = rig.s.core[wp.where(core > 0, rig.c.a[m], rig.c.b[m])][3]
        if ahead.count > 0 and mm.count > 0:
            if ahead.gap[0] <= real(HIT) * r + near:
                own = alone(q, core, m, rig)
                c = wp.where(core > 0, wp.transform_get_translation(own.pose_a), wp.transform_get_translation(own.pose_b))
                out = stopped(mm, ahead.n, c - wp.transform_get_translation(q.pose_a), real(core) * r)
        return out

    @wp.func
    def manifold_at_impact(p: Posed, both: Twist, h: real, m: int, H: Hulls, rig: Rig):
        """A manifold, and the poses that it is of: those of now, or of the time of impact."""
        mm = Manifold()
        ahead = Manifold()
        q = p
        fast = hurried(both, h, m, rig)
        near = real(TOUCHES) * size(m, rig)
        core = int(0)
        steps = int(STEPS)
        parts = int(2)
        for part in range(parts):                      # the shapes, then the core of one alone
            time = real(0.0)
            if part == 1:
                if fast and mm.count > 0:
                    core = reached(least_manifold_gap(mm), h * wp.length(both.v_a - both.v_b), m, rig)
                if core == 0:
                    break
            for step in range(steps):
                then = advanced(p, both, time, m, rig)
                if part == 1:
                    then = alone(then, core, m, rig)
                at = found(then.a, then.b, H, then.pose_a, then.pose_b, p.margin)
                if part == 1:
                    ahead = at
                elif step == 0 or at.count > 0:
                    mm = at
                    q = then
                if not fast or at.count == 0 or least_manifold_gap(at) <= near:
                    break
                more = time_until_touch(at, then, both)
                if more < real(0.0) or time + more > real(LATER) * h:
                    break
                time += more
        if core != 0:
            mm = hold_core_contact(mm, ahead, q, core, m, near, rig)
        return mm, q

    @wp.func(inline=False)
    def write_pair_manifold(m: int, k: int, row: int, mm: Manifold, p: Posed, last: Last, rig: Rig):
        """Puts a manifold into row m; row: where its impulses are."""
        rig.c.colour[m] = -1
        if row >= 0:
            rig.c.colour[m] = last.colour[row]
        rig.c.count[m] = mm.count
        rig.c.n[m] = mm.n
        rig.work.renewed[m] = 1
        rig.c.skin[m] = t.vec2(rig.s.skin[rig.c.a[m]], rig.s.skin[rig.c.b[m]])
        poses(m, p, rig)
        for i in range(mm.count):
            rig.c.key[4 * m + i] = mm.key[i]
            point(m, i, mm.x[i] + wp.transform_get_translation(p.pose_a), mm.gap[i], row, p, last, rig)
        prepare(m, k, rig)

    def rigid_collide(rig: Rig, H: Hulls, k: int, h: real, last: Last, aside: Table):
        m = wp.tid()
        a = rig.c.a[m]
        whole_list = rig.work.strayed[0]
        rig.work.renewed[m] = 0
        if a < 0:
            rig.c.count[m] = 0
        elif rig.s.kind[rig.c.b[m]] != MESH and rig.s.kind[a] != MESH:
            make = bool(False)
            if whole_list == 1:
                make = anew(a, rig)
                if not make:
                    move(m, known(m, last, rig), aside, k, rig)
            if not make and rig.c.count[m] >= 0:
                make = needed(m, k, rig)
            if make:
                row = int(m)
                if whole_list == 1:
                    row = known(m, last, rig)
                else:
                    keep(m, rig.c, last)
                p = posed(m, k, rig)
                both = twist(m, k, h, rig)
                p.margin = margin(both, h, m, p, rig)
                mm, q = manifold_at_impact(p, both, h, m, H, rig)
                write_pair_manifold(m, k, row, mm, q, last, rig)

    return wp.kernel(rigid_collide, name="rigid_collide", module=module, enable_backward=False)
