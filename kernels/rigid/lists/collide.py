"""Manifolds of a list of pairs, with the impulses that the same features had before.

A thread has a pair. Its manifold is computed from the poses of both shapes, from the place of A's body; points become cores in
the frames of the bodies, and are given what they had before (rows.py beside this). All are made when the list is new; later
those that need it, for the poses at the time of impact where bodies are fast (renewal.py). Pairs with a mesh are left to
collide_mesh.py.
"""

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import whole
from wsim.kernels.rigid.impulse import formulas
from wsim.kernels.rigid.lists.manifold import manifold
from wsim.kernels.rigid.lists.renewal import LATER, STEPS, TOUCHES, meeting, needing
from wsim.kernels.rigid.lists.rows import keep_row, lasts, posing, writing
from wsim.kernels.rigid.narrow.pair import narrow
from wsim.kernels.rigid.narrow.shape import MESH, hulls


def collide(pairs, real, module):
    """Kernel over the pairs of a list; pairs: of kinds of shapes (`wsim.kernels.rigid.narrow.pair.every`). h [s]: of a
    substep, 0: manifolds are those of now, whatever the speed."""
    t = types(real)
    Rig, Manifold = whole(real), manifold(real)
    Last, Hulls = lasts(real), hulls(real)
    found, write, (Posed, posed) = narrow(pairs, real), writing(real), posing(real)
    known, point, poses, keep = write.known, write.point, write.poses, keep_row(real)
    needed, of, prepare = needing(real), meeting(real), formulas(real)[1]
    Twist, twist, advanced, hurried, closing = of.Twist, of.twist, of.advanced, of.hurried, of.closing
    margin, size = of.margin, of.size

    @wp.func
    def until(mm: Manifold, p: Posed, both: Twist):
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
    def least(mm: Manifold):
        gap = mm.gap[0]
        for i in range(1, 4):
            if i < mm.count:
                gap = wp.min(gap, mm.gap[i])
        return gap

    @wp.func(inline=False)
    def written(m: int, k: int, row: int, mm: Manifold, p: Posed, last: Last, rig: Rig):
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

    def rigid_collide(rig: Rig, H: Hulls, k: int, h: real, last: Last):
        m = wp.tid()
        a = rig.c.a[m]
        whole_list = rig.work.strayed[0]
        rig.work.renewed[m] = 0
        if a < 0:
            rig.c.count[m] = 0
        elif rig.s.kind[rig.c.b[m]] != MESH:
            make = whole_list == 1
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
                q = p
                fast = hurried(both, h, m, rig)
                near = real(TOUCHES) * size(m, rig)
                mm = Manifold()
                time = real(0.0)
                steps = int(STEPS)
                for step in range(steps):
                    then = advanced(p, both, time, m, rig)
                    at = found(p.a, p.b, H, then.pose_a, then.pose_b, p.margin)
                    if step == 0 or at.count > 0:
                        mm = at
                        q = then
                    if not fast or at.count == 0 or least(at) <= near:
                        break
                    more = until(at, then, both)
                    if more < real(0.0) or time + more > real(LATER) * h:
                        break
                    time += more
                written(m, k, row, mm, q, last, rig)

    return wp.kernel(rigid_collide, name="rigid_collide", module=module, enable_backward=False)
