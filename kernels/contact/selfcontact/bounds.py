"""Bounds of rounding of pairs, and the gaps that they keep for it.

    c = 8 u (|r| + |m_i| + |m_j| + |shift_i - shift_j|),   sums of absolute coordinates, m the motions, u = 2^-24 (2^-53)

A proof asks for s + 2 c at the end, s the gap that a file needs; projections and cuts leave s + 2 SPARE c.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.selfcontact import closest, pairs
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states

SPARE = 2.0            # of what a proof asks for beyond s: what projections and cuts leave of a gap is proven


@cache
def pair_rounding_bounds(real):
    """Functions: least gap that a file needs of a pair; c, see above, of one whose points are at p1 .. p3 from its first; the
    least coefficient in the middle."""
    t = types(real)
    Surfaces, State = pairs.surface_type(real), point_states(real)
    _, slack = pairs.pair_geometry_funcs(real)

    @wp.func
    def least_written_gap(s: Surfaces, at: State, kind: int, ids: wp.vec4i):
        first = slack(s, at.x, ids[0])
        other = wp.max(slack(s, at.x, ids[2]), slack(s, at.x, ids[3]))
        if kind == closest.POINT:
            return first + wp.max(other, slack(s, at.x, ids[1]))
        return wp.max(first, slack(s, at.x, ids[1])) + other

    @wp.func
    def taxicab_norm(a: t.vec3):
        return wp.abs(a[0]) + wp.abs(a[1]) + wp.abs(a[2])

    @wp.func
    def moving_rounding_bound(s: Surfaces, at: State, ids: wp.vec4i, p1: t.vec3, p2: t.vec3, p3: t.vec3):
        o = ids[0]
        own = taxicab_norm(at.d[o] - at.e[o]) + taxicab_norm(at.e[o])
        most = real(0.0)
        for k in range(1, 4):
            q = ids[k]
            most = wp.max(most, taxicab_norm(at.d[q] - at.e[q]) + taxicab_norm(at.e[q]) + taxicab_norm(s.shift[q] - s.shift[o]))
        return real(8.0) * s.ulp * (most + own + wp.max(taxicab_norm(p1), wp.max(taxicab_norm(p2), taxicab_norm(p3))))

    @wp.func
    def resting_rounding_bound(s: Surfaces, ids: wp.vec4i, p1: t.vec3, p2: t.vec3, p3: t.vec3):
        """The same where nothing moves: more is left of the gap of what was proven, by c of the substep before."""
        o = ids[0]
        most = real(0.0)
        for k in range(1, 4):
            most = wp.max(most, taxicab_norm(s.shift[ids[k]] - s.shift[o]))
        return real(8.0) * s.ulp * (most + wp.max(taxicab_norm(p1), wp.max(taxicab_norm(p2), taxicab_norm(p3))))

    @wp.func
    def least_middle_coefficient(kind: int, a1: real, a2: real, a3: real):
        """Least coefficient in the middle; a: n . R + m . r of points, the first point's being 0."""
        other = wp.max(a2, a3)
        if kind == closest.POINT:
            return -wp.max(other, a1)
        return wp.min(-other, a1 - other)

    return least_written_gap, moving_rounding_bound, resting_rounding_bound, least_middle_coefficient


@cache
def proof_margin_func(real):
    """Function: what a pair of points must keep beyond s, that it is proven."""
    Surfaces, State = pairs.surface_type(real), point_states(real)
    place, _ = pairs.pair_geometry_funcs(real)
    rounding = pair_rounding_bounds(real)[1]

    @wp.func
    def pair_proof_margin(s: Surfaces, at: State, ids: wp.vec4i):
        o = ids[0]
        return real(2.0 * SPARE) * rounding(s, at, ids, place(s, at.x, at.e, ids[1], o), place(s, at.x, at.e, ids[2], o),
                                            place(s, at.x, at.e, ids[3], o))

    return pair_proof_margin
