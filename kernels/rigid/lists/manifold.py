"""Contact manifold of two bodies: where they touch or nearly touch, at most four points with one normal.

    n     unit normal, from B to A                     gap   n.(a - b) of two places that face each other [m], below 0: overlap
    x     midpoint of a and b, from A's origin [m]     a = x + gap n / 2,  b = x - gap n / 2
    key   number of the features that touch; it holds no place, so that it stays as long as they do

All points are kept whose gap is below a margin: what is not yet touched may be before the frame ends. Of more than four the
deepest stays, the farthest from it, and those that span the largest area with them: what is left out lies within or near the
area, so that the bodies rest as they did. Ties go to the first in order, to a part TIE, so that small motions choose alike.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types

TIE = wp.constant(1.0e-3)              # part of a size by which a later point must be better: smaller, the choice flickers


@cache
def manifold_type(real):
    """Struct of a manifold; all of it in one frame, that of A or one of A's origin and the world's axes."""
    t = types(real)

    @wp.struct
    class ContactManifold:
        n: t.vec3
        count: int                           # points, 0 to 4
        x: wp.types.matrix((4, 3), real)     # rows [m]
        gap: t.vec4                          # [m]
        key: wp.vec4i

    return ContactManifold


@cache
def manifold_makers(real):
    """(single, flipped, turned): a manifold of one point; seen from B; with its vectors turned into another frame."""
    t, Manifold = types(real), manifold_type(real)

    @wp.func
    def one_point_manifold(n: t.vec3, x: t.vec3, gap: real, key: int):
        m = Manifold()
        m.n = n
        m.count = 1
        m.x[0] = x
        m.gap[0] = gap
        m.key[0] = key
        return m

    @wp.func
    def flip_manifold(m: Manifold, origin: t.vec3):
        """Of (B, A), as (A, B) has it: the normal turned over, places from an origin that lies at `origin`."""
        f = Manifold()
        f.n = -m.n
        f.count = m.count
        f.gap = m.gap
        f.key = m.key
        for i in range(4):
            if i < m.count:
                f.x[i] = m.x[i] - origin
        return f

    @wp.func
    def turn_manifold(m: Manifold, R: t.mat33):
        f = Manifold()
        f.n = R * m.n
        f.count = m.count
        f.gap = m.gap
        f.key = m.key
        for i in range(4):
            if i < m.count:
                f.x[i] = R * m.x[i]
        return f

    return one_point_manifold, flip_manifold, turn_manifold


@cache
def manifold_reduction_func(real, outer: bool = False):
    """Function (n, x, gap, key, count, size) -> Manifold: at most four of `count` points.

    x, gap, key: arrays of the thread; size [m]: of the smaller body, by which ties are told. outer: of equally deep points the
    one farthest from the axis along n through the origin is the first, a corner of their outline whatever the order."""
    t, Manifold = types(real), manifold_type(real)

    @wp.func
    def doubled_triangle_area(n: t.vec3, o: t.vec3, a: t.vec3, p: t.vec3):
        """Twice the signed area of the triangle o a p, seen against n."""
        return wp.dot(n, wp.cross(a - o, p - o))

    @wp.func
    def outermost_point(n: t.vec3, x: wp.array(dtype=t.vec3), count: int):
        best = int(0)
        most = real(0.0)
        for i in range(count):
            far = wp.length(x[i] - wp.dot(n, x[i]) * n)
            if far > most * (real(1.0) + real(TIE)):
                most = far
                best = i
        return best

    @wp.func
    def deepest_manifold_point(gap: wp.array(dtype=real), count: int, o: int, tie: real):
        best = int(o)
        for i in range(count):
            if gap[i] < gap[best] - tie:
                best = i
        return best

    @wp.func
    def farthest_manifold_point(n: t.vec3, x: wp.array(dtype=t.vec3), count: int, o: int):
        best = int(o)
        most = real(0.0)
        for i in range(count):
            d = x[i] - x[o]
            d -= wp.dot(n, d) * n
            far = wp.length(d)
            if far > most * (real(1.0) + real(TIE)):
                most = far
                best = i
        return best

    @wp.func
    def widest_manifold_point(n: t.vec3, x: wp.array(dtype=t.vec3), count: int, o: int, a: int, side: real):
        """The point that is farthest to one side of the line o a."""
        best = int(-1)
        most = real(0.0)
        for i in range(count):
            wide = side * doubled_triangle_area(n, x[o], x[a], x[i])
            if i != o and i != a and wide > most * (real(1.0) + real(TIE)):
                most = wide
                best = i
        return best, most

    @wp.func
    def fourth_manifold_point(n: t.vec3, x: wp.array(dtype=t.vec3), count: int, chosen: wp.vec4i, turn: real):
        """The point that adds most to the triangle of the three chosen, of orientation `turn`."""
        best = int(-1)
        most = real(0.0)
        for i in range(count):
            if i != chosen[0] and i != chosen[1] and i != chosen[2]:
                p = x[i]
                more = wp.max(-turn * doubled_triangle_area(n, x[chosen[0]], x[chosen[1]], p),
                              wp.max(-turn * doubled_triangle_area(n, x[chosen[1]], x[chosen[2]], p),
                                     -turn * doubled_triangle_area(n, x[chosen[2]], x[chosen[0]], p)))
                if more > most * (real(1.0) + real(TIE)):
                    most = more
                    best = i
        return best

    @wp.func(inline=False)
    def reduce_to_four_points(n: t.vec3, x: wp.array(dtype=t.vec3), gap: wp.array(dtype=real), key: wp.array(dtype=int),
                              count: int, size: real):
        chosen = wp.vec4i(0, 1, 2, 3)
        m = Manifold()
        m.n = n
        m.count = wp.min(count, 4)
        if count > 4:
            first = int(0)
            if outer:
                first = outermost_point(n, x, count)
            chosen[0] = deepest_manifold_point(gap, count, first, real(TIE) * size)
            chosen[1] = farthest_manifold_point(n, x, count, chosen[0])
            left, more = widest_manifold_point(n, x, count, chosen[0], chosen[1], real(1.0))
            right, less = widest_manifold_point(n, x, count, chosen[0], chosen[1], real(-1.0))
            turn = real(1.0)
            if less > more * (real(1.0) + real(TIE)):
                left = right
                turn = real(-1.0)
            chosen[2] = left
            chosen[3] = -1
            m.count = 2
            if left >= 0:
                chosen[3] = fourth_manifold_point(n, x, count, chosen, turn)
                m.count = 3
                if chosen[3] >= 0:
                    m.count = 4
        for i in range(4):
            if i < m.count:
                m.x[i] = x[chosen[i]]
                m.gap[i] = gap[chosen[i]]
                m.key[i] = key[chosen[i]]
        return m

    return reduce_to_four_points
