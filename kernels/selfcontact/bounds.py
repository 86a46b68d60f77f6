"""Bounds of rounding of pairs, and the gaps that they keep for it.

    c = 8 u (|r| + |m_i| + |m_j| + |shift_i - shift_j|),   sums of absolute coordinates, m the motions, u = 2^-24 (2^-53)

A proof asks for s + 2 c at the end, s the gap that a file needs; projections and cuts leave s + 2 SPARE c.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion.points import states
from wsim.kernels.selfcontact import closest, pairs

SPARE = 2.0            # of what a proof asks for beyond s: what projections and cuts leave of a gap is proven


@cache
def bounds(real):
    """Functions: least gap that a file needs of a pair; c, see above, of one whose points are at p1 .. p3 from its first; the
    least coefficient in the middle."""
    t = types(real)
    Surfaces, State = pairs.surfaces(real), states(real)
    _, slack = pairs.reading(real)

    @wp.func
    def written(s: Surfaces, at: State, kind: int, ids: wp.vec4i):
        first = slack(s, at.x, ids[0])
        other = wp.max(slack(s, at.x, ids[2]), slack(s, at.x, ids[3]))
        if kind == closest.POINT:
            return first + wp.max(other, slack(s, at.x, ids[1]))
        return wp.max(first, slack(s, at.x, ids[1])) + other

    @wp.func
    def one(a: t.vec3):
        return wp.abs(a[0]) + wp.abs(a[1]) + wp.abs(a[2])

    @wp.func
    def rounding(s: Surfaces, at: State, ids: wp.vec4i, p1: t.vec3, p2: t.vec3, p3: t.vec3):
        o = ids[0]
        own = one(at.d[o] - at.e[o]) + one(at.e[o])
        most = real(0.0)
        for k in range(1, 4):
            q = ids[k]
            most = wp.max(most, one(at.d[q] - at.e[q]) + one(at.e[q]) + one(s.shift[q] - s.shift[o]))
        return real(8.0) * s.ulp * (most + own + wp.max(one(p1), wp.max(one(p2), one(p3))))

    @wp.func
    def still(s: Surfaces, ids: wp.vec4i, p1: t.vec3, p2: t.vec3, p3: t.vec3):
        """The same where nothing moves: more is left of the gap of what was proven, by c of the substep before."""
        o = ids[0]
        most = real(0.0)
        for k in range(1, 4):
            most = wp.max(most, one(s.shift[ids[k]] - s.shift[o]))
        return real(8.0) * s.ulp * (most + wp.max(one(p1), wp.max(one(p2), one(p3))))

    @wp.func
    def between(kind: int, a1: real, a2: real, a3: real):
        """Least coefficient in the middle; a: n . R + m . r of points, the first point's being 0."""
        other = wp.max(a2, a3)
        if kind == closest.POINT:
            return -wp.max(other, a1)
        return wp.min(-other, a1 - other)

    return written, rounding, still, between


@cache
def ends(real):
    """Function: what a pair of points must keep beyond s, that it is proven."""
    Surfaces, State = pairs.surfaces(real), states(real)
    place, _ = pairs.reading(real)
    rounding = bounds(real)[1]

    @wp.func
    def room(s: Surfaces, at: State, ids: wp.vec4i):
        o = ids[0]
        return real(2.0 * SPARE) * rounding(s, at, ids, place(s, at.x, at.e, ids[1], o), place(s, at.x, at.e, ids[2], o),
                                            place(s, at.x, at.e, ids[3], o))

    return room
