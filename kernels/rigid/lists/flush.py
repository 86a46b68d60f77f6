"""Contacts at the seams of colliders that lie flush, so that a body slides from tile to tile as over one floor.

A body that rests on one tile meets the edge of the next before it is above it, and sunk by a little it meets the side. Let a
body touch collider I with a normal n_i at p_i, and J at points p_j. What of J lies below the plane of the first contact,

    n_i . (p_j - p_i) <= FLUSH L,     max over y of J of n_i . (y - p_i) <= FLUSH L + SLOPE size of J,     L: of the body

can touch a convex body, which is above that plane, in the plane alone, and from there up. A contact with another normal n_j is
left out: it is that of an edge or a side that the body never meets. What the body covers of J has a contact of its own along
n_i. Where I lies below the plane of J too (two slopes of a ridge), both stay. A mesh counts as the box of its bounds.
"""

import warp as wp

from wsim.kernels.contact.shape import BOX, PLANE
from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import whole
from wsim.kernels.rigid.narrow.shape import MESH, extent, hulls, shape, support

FLUSH = wp.constant(1.0e-3)            # of the size: steps lower than that are none
SLOPE = wp.constant(5.0e-3)            # by which the plane, often that of a face of the body, may lean against J
SAME = wp.constant(1.0e-6)             # 1 - cosine of two normals that are one


def flush(kinds: frozenset[str], real, module):
    """Kernel over the rows of a list, behind those that make manifolds; kinds: of colliders."""
    t, Rig, Shape, Hulls = types(real), whole(real), shape(real), hulls(real)
    farthest, radius = support(kinds, real), extent(real)[0]

    @wp.func
    def foot(i: int, j: int, rig: Rig):
        """Point j of row i on the collider, from the origin of the body."""
        return rig.c.from_a[i] + rig.c.first_a[j] - (rig.c.gap[j] + rig.c.skin[i][0]) * rig.c.n[i]

    @wp.func
    def height(i: int, e: int, H: Hulls, rig: Rig):
        """How far the collider of row e reaches above the plane of row i, both of one shape of a body."""
        n = rig.c.n[i]
        b = rig.c.b[e]
        pose = t.transform(rig.c.from_b[e], rig.c.turn_b[e]) * rig.s.place[b]
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
        return wp.dot(n, center - foot(i, 4 * i, rig)) + top

    @wp.func
    def below(i: int, m: int, low: real, rig: Rig):
        """Whether the points of row m lie below the plane of row i."""
        found = bool(True)
        for e in range(rig.c.count[m]):
            found = found and wp.dot(rig.c.n[i], foot(m, 4 * m + e, rig) - foot(i, 4 * i, rig)) <= low
        return found

    @wp.func(inline=False)
    def hidden(m: int, H: Hulls, rig: Rig):
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
                if wp.dot(rig.c.n[i], rig.c.n[m]) < real(1.0) - real(SAME) and below(i, m, low, rig):
                    if height(i, m, H, rig) <= low + lean and height(m, i, H, rig) > low:
                        found = True
            i += 1
            more = i < rig.c.a.shape[0] and not found
            if more:
                more = rig.c.a[i] == a
        return found

    def rigid_flush(rig: Rig, H: Hulls):
        m = wp.tid()
        if rig.c.a[m] >= 0 and rig.work.renewed[m] == 1 and rig.c.count[m] > 0:
            b = rig.c.b[m]
            if rig.s.kind[b] != PLANE and rig.s.frame[b] >= rig.b.w.shape[0]:
                if hidden(m, H, rig):
                    rig.work.renewed[m] = 2

    def rigid_drop(rig: Rig):
        m = wp.tid()
        if rig.work.renewed[m] == 2:
            rig.c.count[m] = 0

    return [wp.kernel(f, name=f.__name__, module=module, enable_backward=False) for f in (rigid_flush, rigid_drop)]
