"""Key of the one point where two polyhedra touch and no face of either does: the vertices that bear it on both.

A feature is the set of vertices that lie within NEAR of the size of the farthest along the normal: a vertex, the two of an
edge, those of a face. Their numbers, in ascending order, make f = 31 f + i + 1 modulo a prime, and both features the key

    key = -2^31 + f_a 2^15 + f_b          below 0, as no key of a clipped corner is (clip.py)

Two edges that cross keep it while their bodies turn and slide on each other, and another pair of edges takes no impulse of
theirs. What is round has no such features: its point moves over it, and keeps the key 0.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.collider.shape import BOX
from wsim.kernels.math.real import types
from wsim.kernels.rigid.narrow.shape import HULL, hull_type, shape_extent_funcs, shape_type

NEAR = wp.constant(1.0e-3)               # of the size: as `wsim.kernels.rigid.narrow.clip.BIAS`, below which a face touches
PRIME = wp.constant(32749)               # the greatest below 2^15


@cache
def feature_key_func(real):
    """Function (a, b, hulls, R, n) -> key of two shapes, b turned by R in A's frame, n from B to A; 0 unless each is a box or a
    hull, and one a hull (boxes number their edges themselves)."""
    t, Shape, Hulls = types(real), shape_type(real), hull_type(real)
    _radius, size = shape_extent_funcs(real)

    @wp.func
    def polyhedron_vertex(s: Shape, H: Hulls, i: int):
        p = t.vec3()
        if s.kind == BOX:
            p = t.vec3(wp.where((i & 1) == 0, -s.size[0], s.size[0]), wp.where((i & 2) == 0, -s.size[1], s.size[1]),
                       wp.where((i & 4) == 0, -s.size[2], s.size[2]))
        else:
            p = H.vertex[H.first[s.row] + i]
        return p

    @wp.func
    def support_feature_number(s: Shape, H: Hulls, d: t.vec3):
        count = int(8)
        if s.kind == HULL:
            count = H.first[s.row + 1] - H.first[s.row]
        most = wp.dot(polyhedron_vertex(s, H, 0), d)
        for i in range(1, count):
            most = wp.max(most, wp.dot(polyhedron_vertex(s, H, i), d))
        least = most - real(NEAR) * size(s, H)
        found = int(0)
        for i in range(count):
            if wp.dot(polyhedron_vertex(s, H, i), d) >= least:
                found = (31 * found + i + 1) % PRIME
        return found

    @wp.func(inline=False)
    def feature_pair_key(a: Shape, b: Shape, H: Hulls, R: t.mat33, n: t.vec3):
        key = int(0)
        corners = (a.kind == BOX or a.kind == HULL) and (b.kind == BOX or b.kind == HULL)
        if corners and (a.kind == HULL or b.kind == HULL):
            code = support_feature_number(a, H, -n) * 32768 + support_feature_number(b, H, wp.transpose(R) * n)
            key = code - 1073741824 - 1073741824
        return key

    return feature_pair_key
