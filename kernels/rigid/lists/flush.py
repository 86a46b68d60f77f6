"""Contacts at the seams of colliders that lie flush, so that a body slides from tile to tile as over one floor.

A body that rests on one tile meets the edge of the next before it is above it, and sunk by a little it meets the side. Let a
body touch collider I with a normal n_i at p_i, and J at points p_j. What of J lies below the plane of the first contact,

    n_i . (p_j - p_i) <= FLUSH L,     max over y of J of n_i . (y - p_i) <= FLUSH L + SLOPE size of J,     L: of the body

can touch a convex body, which is above that plane, in the plane alone, and from there up. A contact with another normal n_j is
left out: it is that of an edge or a side that the body never meets. What the body covers of J has a contact of its own along
n_i. Where I lies below the plane of J too (two slopes of a ridge), both stay. A mesh counts as the box of its bounds.

Rows are made at different times, and some for a time of impact. So what a row knows goes with its collider to where that is
when the substep begins: tiles that rise together are as flush as tiles that stand.
"""

import warp as wp

from wsim.kernels.contact.collider.shape import BOX, PLANE
from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.narrow.shape import MESH, hull_type, shape_extent_funcs, shape_type, support_map_func

FLUSH = wp.constant(1.0e-3)            # of the size: steps lower than that are none
SLOPE = wp.constant(5.0e-3)            # by which the plane, often that of a face of the body, may lean against J
SAME = wp.constant(2.0e-5)             # sine of the angle up to which two normals are equal: more would push a ball off a seam


def flush_seam_kernels(kinds: frozenset[str], real, module):
    """Kernel over the rows of a list, behind those that make manifolds; kinds: of colliders."""
    t, Rig, Shape, Hulls = types(real), rig_type(real), shape_type(real), hull_type(real)
    farthest, radius = support_map_func(kinds, real), shape_extent_funcs(real)[0]

    @wp.func
    def collider_pose(i: int, k: int, rig: Rig):
        """Of the frame of row i's collider, where substep k begins."""
        f = rig.s.frame[rig.c.b[i]] - rig.b.w.shape[0]
        row = k * rig.still.moving
        return t.transform(rig.still.x[row, f], rig.still.q[row, f])

    @wp.func
    def turn_change(v: t.vec3, i: int, k: int, rig: Rig):
        """Change of a vector that turns with row i's collider, since the row was made."""
        then = rig.c.turn_b[i]
        d = wp.transform_get_rotation(collider_pose(i, k, rig)) * wp.quat_inverse(then)
        u = t.vec3(d[0], d[1], d[2])
        return real(2.0) * (d[3] * wp.cross(u, v) + wp.cross(u, wp.cross(u, v)))

    @wp.func
    def flush_row_normal(i: int, k: int, rig: Rig):
        n = rig.c.n[i]
        if rig.still.moving == 1:
            n += turn_change(n, i, k, rig)
        return n

    @wp.func
    def point_on_collider(i: int, j: int, k: int, rig: Rig):
        """Point j of row i on the collider, from the origin of the body."""
        x = rig.c.from_a[i] + rig.c.first_a[j] - (rig.c.gap[j] + rig.c.skin[i][0]) * rig.c.n[i]
        if rig.still.moving == 1:
            b = rig.s.frame[rig.c.b[i]]
            away = rig.s.origin[b] - rig.s.origin[rig.s.frame[rig.c.a[i]]]
            arm = x - t.vec3(real(away[0]), real(away[1]), real(away[2])) - rig.c.from_b[i]
            x += wp.transform_get_translation(collider_pose(i, k, rig)) - rig.c.from_b[i] + turn_change(arm, i, k, rig)
        return x

    @wp.func
    def height_above_row(i: int, e: int, k: int, H: Hulls, rig: Rig):
        """How far the collider of row e reaches above the plane of row i, both of one shape of a body."""
        n = flush_row_normal(i, k, rig)
        b = rig.c.b[e]
        pose = collider_pose(e, k, rig) * rig.s.place[b]
        away = rig.s.origin[rig.s.frame[b]] - rig.s.origin[rig.s.frame[rig.c.a[i]]]
        center = t.vec3(real(away[0]), real(away[1]), real(away[2])) + wp.transform_get_translation(pose)
        d = wp.quat_rotate_inv(wp.transform_get_rotation(pose), n)
        top = real(0.0)
        if rig.s.kind[b] == MESH or rig.s.kind[b] == BOX:
            top = wp.dot(wp.abs(d), rig.s.size[b])
        else:
            s = Shape()
            s.kind = rig.s.kind[b]
            s.row = rig.s.row[b]
            s.size = rig.s.size[b]
            top = wp.dot(farthest(s, H, d), d) + radius(s)
        return wp.dot(n, center - point_on_collider(i, 4 * i, k, rig)) + top

    @wp.func
    def row_lies_below(i: int, m: int, k: int, low: real, rig: Rig):
        """Whether the points of row m lie below the plane of row i."""
        n = flush_row_normal(i, k, rig)
        found = bool(True)
        for e in range(rig.c.count[m]):
            found = found and wp.dot(n, point_on_collider(m, 4 * m + e, k, rig) - point_on_collider(i, 4 * i, k, rig)) <= low
        return found

    @wp.func(inline=False)
    def collider_is_hidden(m: int, k: int, H: Hulls, rig: Rig):
        """Whether the collider of row m lies below the plane of another row of the same shape."""
        a = rig.c.a[m]
        found = bool(False)
        low = real(FLUSH) * rig.s.ball[a]
        lean = real(SLOPE) * rig.s.ball[rig.c.b[m]]
        i = int(m)
        while i > 0 and rig.c.a[wp.max(i - 1, 0)] == a:
            i -= 1
        more = bool(True)
        while more:
            if rig.c.b[i] != rig.c.b[m] and rig.c.count[i] > 0 and rig.s.frame[rig.c.b[i]] >= rig.b.w.shape[0]:
                n = flush_row_normal(i, k, rig)
                v = flush_row_normal(m, k, rig)
                other = wp.dot(n, v) < real(0.0) or wp.length(wp.cross(n, v)) > real(SAME)
                if other and row_lies_below(i, m, k, low, rig):
                    if height_above_row(i, m, k, H, rig) <= low + lean and height_above_row(m, i, k, H, rig) > low:
                        found = True
            i += 1
            more = i < rig.c.a.shape[0] and not found
            if more:
                more = rig.c.a[i] == a
        return found

    def rigid_flush(rig: Rig, H: Hulls, k: int):
        m = wp.tid()
        if rig.c.a[m] >= 0 and rig.work.renewed[m] == 1 and rig.c.count[m] > 0:
            b = rig.c.b[m]
            if rig.s.kind[b] != PLANE and rig.s.frame[b] >= rig.b.w.shape[0] and rig.s.kind[rig.c.a[m]] != MESH:
                if collider_is_hidden(m, k, H, rig):
                    rig.work.renewed[m] = 2

    def rigid_drop(rig: Rig):
        m = wp.tid()
        if rig.work.renewed[m] == 2:
            rig.c.count[m] = 0

    return [wp.kernel(f, name=f.__name__, module=module, enable_backward=False) for f in (rigid_flush, rigid_drop)]
