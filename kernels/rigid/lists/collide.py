"""Manifolds of a list of pairs, with the impulses that the same features had before.

A thread has a pair. Its manifold is computed from the poses of both shapes, from the place of A's body; points become cores in
the frames of the bodies, and are given what they had in the last list (rows.py beside this). Pairs with a mesh are left to
collide_mesh.py.
"""

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import whole
from wsim.kernels.rigid.lists.rows import lasts, posing, writing
from wsim.kernels.rigid.narrow.pair import narrow
from wsim.kernels.rigid.narrow.shape import MESH, hulls


def collide(pairs, real, module):
    """Kernel over the pairs of a list; pairs: of kinds of shapes (`wsim.kernels.rigid.narrow.pair.every`)."""
    t = types(real)
    Rig = whole(real)
    Last, Hulls = lasts(real), hulls(real)
    found, write, posed = narrow(pairs, real), writing(real), posing(real)[1]
    known, point = write.known, write.point

    def rigid_collide(rig: Rig, H: Hulls, k: int, last: Last):
        m = wp.tid()
        a = rig.c.a[m]
        rig.c.count[m] = 0
        if a >= 0:
            b = rig.c.b[m]
            if rig.s.kind[b] != MESH:
                p = posed(m, k, rig)
                found_m = found(p.a, p.b, H, p.pose_a, p.pose_b, p.margin)
                row = known(m, last, rig)
                rig.c.colour[m] = -1
                if row >= 0:
                    rig.c.colour[m] = last.colour[row]
                rig.c.count[m] = found_m.count
                rig.c.n[m] = found_m.n
                rig.c.skin[m] = t.vec2(rig.s.skin[a], rig.s.skin[b])
                for i in range(found_m.count):
                    rig.c.key[4 * m + i] = found_m.key[i]
                    point(m, i, found_m.x[i] + wp.transform_get_translation(p.pose_a), found_m.gap[i], row, p, last, rig)

    return wp.kernel(rigid_collide, name="rigid_collide", module=module, enable_backward=False)
