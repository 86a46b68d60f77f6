"""Manifold of two faces: the one, clipped by the sides of the other (Sutherland, Hodgman 1974), or one point where no face
touches. All in one frame.

The nearest places and the normal n are known. A face whose outward normal f is nearly -n (of A) or n (of B), and along which
the two are as far apart as along n, to a part BIAS of their size, is the reference. The longer one is preferred, or of equal
ones A's, unless the other is better by that much, so that it does not change from frame to frame. The other face is cut by the
planes through the reference's edges,

    d = (p - q_s).(e_s x f) <= 0,        gap = (p - q_0).f - radii

A corner counts as inside up to SLACK of the size, so that equal boxes on one another keep their corners, and with them their
keys. Two segments that are parallel touch at the ends of what they share.

    key   side of the reference (1 bit), its face (9), the other's (9), edge or corner of that (6), side that cut it (6)
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.marks import scratch, standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.lists.manifold import manifold_makers, manifold_reduction_func, manifold_type

BIAS = wp.constant(1.0e-3)              # of the size: nearer, a face touches rather than an edge
SLACK = wp.constant(1.0e-4)             # of the size: so far beyond a side a corner still is inside
ALIGNED = wp.constant(0.99)             # cosine: faces further from the normal do not touch flat
LONGER = wp.constant(1.1)               # times as long as the other's a face must be to be preferred
PARALLEL = wp.constant(0.01)            # sine between segments that touch all along
WHOLE = wp.constant(63)                 # in place of a side: a corner that none has cut
SIDES = wp.constant(32)                 # edges from here on are sides of the reference


@cache
def clip_types(real) -> SimpleNamespace:
    """Side: a face of one of the two. Nearest: the nearest places of both."""
    t = types(real)

    @wp.struct
    class ContactFace:
        count: int                      # corners
        number: int
        f: t.vec3                       # outward unit normal; 0: none
        r: real                         # radius all around [m]

    @wp.struct
    class NearestPlaces:
        n: t.vec3
        gap: real
        x: t.vec3                       # midpoint
        key: int                        # of the one point; -1: places unknown, faces only

    return SimpleNamespace(Side=ContactFace, Nearest=NearestPlaces)


@cache
def face_clipping_funcs(real):
    """(side, polygon, segment): functions that clip P, with the labels of its corners, by a reference Q of `count` corners."""
    t = types(real)
    vec3, vec3s, ints = t.vec3, wp.array(dtype=t.vec3), wp.array(dtype=int)

    @wp.func
    def side_plane_normal(Q: vec3s, count: int, f: vec3, s: int):
        """Outward unit normal of side s; of a segment its two ends."""
        e = Q[(s + 1) % count] - Q[s]
        n = wp.normalize(wp.cross(e, f))
        if count == 2:
            n = -wp.normalize(e)
        return n

    @wp.func(inline=False)
    def clip_by_half_space(P: vec3s, key: ints, edge: ints, room: wp.vec4i, q: vec3, n: vec3, slack: real):
        """One cut. room: (first corner read, first written, corners, side) -> corners left."""
        left = int(0)
        for i in range(room[2]):
            a = room[0] + i
            b = room[0] + (i + 1) % room[2]
            da = wp.dot(P[a] - q, n)
            db = wp.dot(P[b] - q, n)
            if da <= slack:
                P[room[1] + left] = P[a]
                key[room[1] + left] = key[a]
                edge[room[1] + left] = edge[a]
                left += 1
            if (da < real(0.0) and db > slack) or (da > slack and db < real(0.0)):
                P[room[1] + left] = P[a] + (da / (da - db)) * (P[b] - P[a])
                key[room[1] + left] = edge[a] * 64 + room[3]
                edge[room[1] + left] = wp.where(da < real(0.0), int(SIDES) + room[3], edge[a])
                left += 1
        return left

    @wp.func
    def clip_polygon(Q: vec3s, count: int, f: vec3, P: vec3s, key: ints, edge: ints, corners: wp.vec2i, slack: real):
        """corners: (of P, most of it) -> (first corner, corners left)."""
        first = int(0)
        left = int(corners[0])
        for i in range(left):
            key[i] = i * 64 + WHOLE
            edge[i] = i
        for s in range(count):
            if left > 0:
                other = corners[1] - first
                left = clip_by_half_space(P, key, edge, wp.vec4i(first, other, left, s), Q[s],
                                          side_plane_normal(Q, count, f, s), slack)
                first = other
        return first, left

    @wp.func(inline=False)
    def clip_segment(Q: vec3s, count: int, f: vec3, P: vec3s, key: ints, slack: real):
        low = real(0.0)
        high = real(1.0)
        key[0] = WHOLE
        key[1] = 64 + WHOLE
        e = P[1] - P[0]
        for s in range(count):
            n = side_plane_normal(Q, count, f, s)
            da = wp.dot(P[0] - Q[s], n)
            db = wp.dot(P[1] - Q[s], n)
            if da > slack and db > slack:
                low = real(2.0)
            elif da > slack:
                if da / (da - db) > low:
                    low = da / (da - db)
                    key[0] = s
            elif db > slack:
                if da / (da - db) < high:
                    high = wp.max(da / (da - db), real(0.0))
                    key[1] = 64 + s
        start = P[0]
        P[1] = start + high * e
        P[0] = start + low * e                     # += of an array is an atomic addition, which a GPU has not on local memory
        return wp.where(low <= high, 2, 0)

    return side_plane_normal, clip_polygon, clip_segment


@cache
def clipped_gap_func(real):
    """Function (Q, count, f, P, key, first, points, radii) -> points whose gap is within the margin, at the start of P."""
    t = types(real)

    @wp.func
    def least_height_over_face(P: wp.array(dtype=t.vec3), count: int, q: t.vec3, f: t.vec3):
        """Least height of the corners P over the plane through q."""
        least = wp.dot(P[0] - q, f)
        for i in range(1, count):
            least = wp.min(least, wp.dot(P[i] - q, f))
        return least

    @wp.func
    def gaps_over_reference(q: t.vec3, f: t.vec3, P: wp.array(dtype=t.vec3), gap: wp.array(dtype=real),
                            key: wp.array(dtype=int), room: wp.vec3i, radii: t.vec3):
        """room: (first, points, what is above the features' number); radii: (reference, other, margin). P becomes midpoints."""
        kept = int(0)
        for i in range(room[1]):
            p = P[room[0] + i]
            g = wp.dot(p - q, f)
            free = g - radii[0] - radii[1]
            if free <= radii[2]:
                P[kept] = p + (real(0.5) * (radii[0] - radii[1] - g)) * f
                gap[kept] = free
                key[kept] = room[2] + key[room[0] + i]
                kept += 1
        return kept

    return least_height_over_face, gaps_over_reference


@cache
def face_manifold_func(real, corners: int, outer: bool = False):
    """Function (PA, a, PB, b, near, margin, size) -> Manifold; faces of at most `corners` corners, which are overwritten.
    outer: see `manifold_reduction_func`."""
    t, Manifold, of = types(real), manifold_type(real), clip_types(real)
    Side, Nearest, vec3s = of.Side, of.Nearest, wp.array(dtype=t.vec3)
    _side, polygon, segment = face_clipping_funcs(real)
    apart, heights = clipped_gap_func(real)
    single, _flipped, _turned = manifold_makers(real)
    reduce, most = manifold_reduction_func(real, outer), 2 * corners

    @wp.func(inline=False)
    def manifold_of_clipped_face(Q: vec3s, ref: Side, P: vec3s, other: Side, flip: int, margin: real, size: real):
        key = scratch(shape=(wp.static(2 * most),), dtype=int)
        edge = scratch(shape=(wp.static(2 * most),), dtype=int)
        gap = scratch(shape=(wp.static(2 * most),), dtype=real)
        first = int(0)
        key[0] = 0                                              # of a corner alone
        left = int(other.count)
        if other.count == 2:
            left = segment(Q, ref.count, ref.f, P, key, real(SLACK) * size)
        elif other.count > 2:
            first, left = polygon(Q, ref.count, ref.f, P, key, edge, wp.vec2i(other.count, most), real(SLACK) * size)
        above = flip * 1073741824 + (ref.number % 512) * 2097152 + (other.number % 512) * 4096
        left = heights(Q[0], ref.f, P, gap, key, wp.vec3i(first, left, above), t.vec3(ref.r, other.r, margin))
        n = ref.f
        if flip == 0:
            n = -n
        return reduce(n, P, gap, key, left, size)

    @wp.func
    def segments_are_parallel(PA: vec3s, a: Side, PB: vec3s, b: Side, n: t.vec3):
        """Whether two segments lie along one another."""
        u = wp.normalize(PA[1] - PA[0])
        v = wp.normalize(PB[1] - PB[0])
        return (wp.length(wp.cross(u, v)) < real(PARALLEL) and wp.abs(wp.dot(u, n)) < real(PARALLEL)
                and a.count == 2 and b.count == 2)

    @wp.func(inline=False)
    def choose_reference_face(PA: vec3s, a: Side, PB: vec3s, b: Side, near: Nearest, size: real):
        """0: the face or the segment of A, 1: the face of B, -1: none touches flat."""
        low = near.gap - real(BIAS) * size
        by_a = low - size
        by_b = low - size
        if b.count > 1 and wp.dot(a.f, near.n) < -real(ALIGNED):
            by_a = apart(PB, b.count, PA[0], a.f) - a.r - b.r
        if a.count > 1 and wp.dot(b.f, near.n) > real(ALIGNED):
            by_b = apart(PA, a.count, PB[0], b.f) - a.r - b.r
        longer = real(0.0)
        for i in range(b.count):
            longer = wp.max(longer, wp.length(PB[i] - PB[0]))
        for i in range(a.count):
            if real(LONGER) * wp.length(PA[i] - PA[0]) >= longer:
                longer = real(0.0)
        bias = real(BIAS) * size
        which = int(-1)
        if longer > real(0.0) and by_b >= low and by_a <= by_b + bias:
            which = 1
        elif by_a >= low and by_b <= by_a + bias:
            which = 0
        elif by_b >= low:
            which = 1
        elif segments_are_parallel(PA, a, PB, b, near.n):
            which = 0
        return which

    @standalone_function
    @wp.func
    def face_contact_manifold(PA: vec3s, a: Side, PB: vec3s, b: Side, near: Nearest, margin: real, size: real):
        m = Manifold()
        which = choose_reference_face(PA, a, PB, b, near, size)
        ref = a
        other = b
        if which == 1:                                          # one call: inlined thrice, a GPU compiles for long
            ref = b
            other = a
            for i in range(wp.max(a.count, b.count)):
                p = PA[i]
                q = PB[i]
                PA[i] = q
                PB[i] = p
        if ref.count == 2:
            ref.f = -near.n
        if which >= 0:
            m = manifold_of_clipped_face(PA, ref, PB, other, which, margin, size)
        if near.key >= 0 and near.gap <= margin:
            deepest = near.gap + real(2.0) * real(BIAS) * size
            for i in range(4):
                if i < m.count:
                    deepest = wp.min(deepest, m.gap[i])
            if m.count == 0 or deepest > near.gap + real(BIAS) * size:
                m = single(near.n, near.x, near.gap, near.key)
        return m

    return face_contact_manifold
