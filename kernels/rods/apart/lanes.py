"""Elimination of strands on a GPU, LANES threads each: a lane has a column of every block, and what all of them need whole they
hand each other in shared memory. The system and the order are those of kernels/rods/system.py and eliminate.py.

A thread a strand kept nine blocks in local memory: 8 us a point of a few strands, 18 of 10k (H200)."""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102

from functools import cache

import warp as wp

from wsim.kernels.rods.apart.desk import arrive, desk, fetch, got, got3, meet, sent, together, whole
from wsim.kernels.rods.apart.parts import (
    EDGE,
    FREE,
    LANES,
    LAST,
    MORE,
    OFF,
    OWN,
    RIGHT,
    SLOPES,
    SPINS,
    STEPS,
    SYMMETRIC,
    TORQUES,
    Parts,
    numbers,
)
from wsim.kernels.rods.tables import Trial


@wp.struct
class Window:
    """Columns of blocks of three points in a row, as `wsim.kernels.rods.eliminate.Window` has them."""

    D0: wp.vec4d
    D1: wp.vec4d
    D2: wp.vec4d
    P: wp.vec4d
    N: wp.vec4d
    F: wp.vec4d
    r0: wp.vec4d
    r1: wp.vec4d
    r2: wp.vec4d
    m0: wp.vec2d                                    # 1: a point is free, its edge spins
    m1: wp.vec2d
    m2: wp.vec2d


@wp.struct
class Factors:
    """L D L^T of a block: L below the diagonal by rows, and one over D."""

    a: wp.vec3d                                     # L10, L20, L30
    b: wp.vec3d                                     # L21, L31, L32
    d: wp.vec4d


@wp.func
def pick(v: wp.vec4d, lane: int):
    """Number of a vector that a lane has."""
    return wp.where(lane < 2, wp.where(lane == 0, v[0], v[1]), wp.where(lane == 2, v[2], v[3]))


@wp.func
def symmetric(at: int, first: int, lane: int):
    """Column `lane` < 3 of a 3 x 3 block whose upper triangle stands from `first` on; 0 in lane 3."""
    zero = wp.float64(0.0)
    x = got(at, first + wp.min(lane, 2))
    y = got(at, first + wp.where(lane == 0, 1, 2 + wp.min(lane, 2)))
    z = got(at, first + wp.where(lane >= 2, 5, 2 + 2 * lane))
    return wp.vec4d(wp.where(lane < 3, x, zero), wp.where(lane < 3, y, zero), wp.where(lane < 3, z, zero), zero)


@wp.func
def own_block(at: int, lane: int, w: Window):
    """The window with a third point."""
    zero = wp.float64(0.0)
    last = got(at, wp.static(LAST))
    w.D2 = symmetric(at, wp.static(SYMMETRIC), lane) + wp.vec4d(zero, zero, zero, wp.where(lane == 3, last, zero))
    w.r2 = wp.vec4d(got(at, wp.static(RIGHT)), got(at, wp.static(RIGHT + 1)), got(at, wp.static(RIGHT + 2)),
                    got(at, wp.static(RIGHT + 3)))
    w.m2 = wp.vec2d(got(at, wp.static(FREE)), got(at, wp.static(FREE + 1)))
    return w


@wp.func
def factors(D: wp.mat44d):
    """Factors of the symmetric part of a block; rounding makes others of it, see kernels/rods/eliminate.py."""
    f = Factors()
    one = wp.float64(1.0)
    half = wp.float64(0.5)
    u0 = half * (D[0, 1] + D[1, 0])
    u1 = half * (D[0, 2] + D[2, 0])
    u2 = half * (D[0, 3] + D[3, 0])
    p = one / D[0, 0]
    f.a = wp.vec3d(u0 * p, u1 * p, u2 * p)
    q = one / (D[1, 1] - f.a[0] * u0)
    v1 = half * (D[1, 2] + D[2, 1]) - f.a[1] * u0
    v2 = half * (D[1, 3] + D[3, 1]) - f.a[2] * u0
    b0 = v1 * q
    b1 = v2 * q
    s = one / (D[2, 2] - f.a[1] * u1 - b0 * v1)
    w2 = half * (D[2, 3] + D[3, 2]) - f.a[2] * u1 - b1 * v1
    b2 = w2 * s
    f.b = wp.vec3d(b0, b1, b2)
    f.d = wp.vec4d(p, q, s, one / (D[3, 3] - f.a[2] * u2 - b1 * v2 - b2 * w2))
    return f


@wp.func
def solved(f: Factors, y: wp.vec4d):
    """Solution of L D L^T x = y."""
    y1 = y[1] - f.a[0] * y[0]
    y2 = y[2] - f.a[1] * y[0] - f.b[0] * y1
    z3 = (y[3] - f.a[2] * y[0] - f.b[1] * y1 - f.b[2] * y2) * f.d[3]
    z2 = y2 * f.d[2] - f.b[2] * z3
    z1 = y1 * f.d[1] - f.b[0] * z2 - f.b[1] * z3
    return wp.vec4d(y[0] * f.d[0] - f.a[0] * z1 - f.a[1] * z2 - f.a[2] * z3, z1, z2, z3)


@wp.func
def strain(at: int, c: int, w: Window, lane: int):
    """The window with strain c at its middle point."""
    a = got3(at, wp.static(SLOPES) + 3 * c)
    b = got3(at, wp.static(SLOPES + 9) + 3 * c)
    d = (a - b) * w.m1[0]
    a = a * -w.m0[0]
    b = b * w.m2[0]
    spin = got(at, wp.static(SPINS) + c)
    f0 = wp.vec4d(a[0], a[1], a[2], wp.float64(0.0))
    f1 = wp.vec4d(d[0], d[1], d[2], wp.float64(0.0))
    g0 = f0 + wp.vec4d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.where(c < 2, spin, -spin) * w.m0[1])
    g1 = f1 + wp.vec4d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), spin * w.m1[1])
    g2 = wp.vec4d(b[0], b[1], b[2], wp.float64(0.0))
    p0 = pick(g0, lane)
    p1 = pick(g1, lane)
    p2 = pick(g2, lane)
    s = got(at, wp.static(OFF) + c)
    w.r0 = w.r0 - f0 * s
    w.r1 = w.r1 - f1 * s
    w.r2 = w.r2 - g2 * s
    w.D0 = w.D0 + g0 * p0
    w.D1 = w.D1 + g1 * p1
    w.D2 = w.D2 + g2 * p2
    w.P = w.P + g0 * p1
    w.N = w.N + g1 * p2
    w.F = w.F + g0 * p2
    return w


@wp.func
def eliminated(A: Parts, w: Window, at: int, i: int, k: int, lane: int):
    """The window with the strains of its points, moved on by one, whose factors are stored."""
    zero = wp.float64(0.0)
    for c in range(wp.static(3)):
        w = strain(at, c, w, lane)
    own = wp.vec4d(zero, zero, zero, wp.where(lane == 3, got(at, wp.static(OWN)), zero))
    w.D0 = w.D0 + own * w.m0[1]
    w.D1 = w.D1 + own * w.m1[1]
    w.r0 = w.r0 + wp.vec4d(zero, zero, zero, got(at, wp.static(TORQUES)) * w.m0[1])
    w.r1 = w.r1 + wp.vec4d(zero, zero, zero, got(at, wp.static(TORQUES + 1)) * w.m1[1])
    f = factors(whole(w.D0))
    L1 = solved(f, w.P)
    L2 = solved(f, w.F)
    y = solved(f, w.r0)
    for c in range(wp.static(LANES)):
        A.factor[wp.static(LANES) * c + lane, i, k] = L1[c]
        A.factor[wp.static(LANES) * c + lane + wp.static(LANES * LANES), i, k] = L2[c]
    A.factor[wp.static(2 * LANES * LANES) + lane, i, k] = pick(y, lane)
    P = wp.transpose(whole(w.P))
    w.D0 = w.D1 - P * L1
    w.P = w.N - P * L2
    w.r0 = w.r1 - P * y
    F = wp.transpose(whole(w.F))
    w.D1 = w.D2 - F * L2
    w.r1 = w.r2 - F * y
    return w


@cache
def eliminating(meets: bool, airy: bool):
    """Function (T, A, n, lane, k) -> greatest correction of a strand's n points [m], of which T.z has all."""
    count = numbers(airy)

    @wp.func
    def stretch(A: Parts, at: int, w: Window, edges: int, i: int, k: int, lane: int):
        zero = wp.float64(0.0)
        e = got3(at, wp.static(EDGE))
        stiff = got3(at, wp.static(EDGE + 3))
        t = wp.vec4d(e[0], e[1], e[2], zero)
        H = t * (pick(t, lane) * stiff[0]) + wp.vec4d(wp.where(lane == 0, stiff[1], zero), wp.where(lane == 1, stiff[1], zero),
                                                  wp.where(lane == 2, stiff[1], zero), zero)
        w.P = w.P - H * (w.m0[0] * w.m1[0])
        r = t * stiff[2]
        w.r0 = w.r0 + r * w.m0[0]
        w.r1 = w.r1 - r * w.m1[0]
        if wp.static(meets):
            K1 = wp.vec4d()
            K01 = wp.vec4d()
            f1 = wp.vec4d()
            if edges == 1:
                c = wp.static(count) + wp.min(lane, 2)
                K1 = wp.vec4d(A.part[c, i, k], A.part[wp.where(lane == 0, wp.static(count + 1), c + 2), i, k],
                              A.part[wp.static(count) + wp.where(lane >= 2, 5, 2 + 2 * lane), i, k], zero)
                K01 = wp.vec4d(A.part[c + 6, i, k], A.part[c + 9, i, k], A.part[c + 12, i, k], zero)
                f1 = wp.vec4d(A.part[wp.static(count + 15), i, k], A.part[wp.static(count + 16), i, k],
                              A.part[wp.static(count + 17), i, k], zero)
            on = w.m1[0] * wp.where(lane < 3, wp.float64(1.0), zero)
            w.D1 = w.D1 + K1 * on
            w.P = w.P + K01 * (w.m0[0] * on)
            w.r1 = w.r1 + f1 * w.m1[0]
        if wp.static(airy):
            K = symmetric(at, wp.static(MORE + 3), lane)
            w.P = w.P + K * (w.m0[0] * w.m1[0])
            H = H + K
            f = got3(at, wp.static(MORE))
            gust = wp.vec4d(f[0], f[1], f[2], zero)
            w.r0 = w.r0 + gust * w.m0[0]
            w.r1 = w.r1 + gust * w.m1[0]
        w.D0 = w.D0 + H * w.m0[0]
        w.D1 = w.D1 + H * w.m1[0]
        return w

    @wp.func
    def forward(A: Parts, desk: int, n: int, lane: int, k: int):
        w = Window()
        edges = int(0)
        if wp.static(meets):
            edges = A.edges[k]
        for j in range(wp.static(STEPS)):
            if j < n + 2:
                fetch(A.part, wp.static(count), j - 2, k, desk + wp.static(64 * count) * j, True)
            sent()
        slot = int(0)
        for j in range(n + 2):
            i = j - 2
            at = desk + wp.static(64 * count) * slot
            arrive()
            w = own_block(at, lane, w)
            w.N = wp.vec4d()
            w.F = wp.vec4d()
            if i >= 0:
                w = stretch(A, at, w, edges, i, k, lane)
                w = eliminated(A, w, at, i, k, lane)
            else:
                w.D0 = w.D1
                w.r0 = w.r1
                w.D1 = w.D2
                w.r1 = w.r2
            meet()
            if j + wp.static(STEPS) < n + 2:
                fetch(A.part, wp.static(count), i + wp.static(STEPS), k, at, True)
            sent()
            slot = wp.where(slot + 1 == wp.static(STEPS), 0, slot + 1)
            w.m0 = w.m1
            w.m1 = w.m2

    @wp.func
    def backward(T: Trial, A: Parts, desk: int, n: int, lane: int, k: int):
        z1 = wp.vec4d()
        z2 = wp.vec4d()
        most = wp.float64(0.0)
        for j in range(wp.static(STEPS)):
            if j < n:
                fetch(A.factor, wp.static(2 * LANES * LANES + LANES), n - 1 - j, k, desk + wp.static(64 * count) * j, False)
            sent()
        slot = int(0)
        for j in range(n):
            i = n - 1 - j
            at = desk + wp.static(64 * count) * slot
            arrive()
            z = got(at, wp.static(2 * LANES * LANES) + lane)
            row = wp.static(LANES) * lane
            for c in range(wp.static(LANES)):
                z -= got(at, row + c) * z1[c] + got(at, row + c + wp.static(LANES * LANES)) * z2[c]
            all = together(z)
            if j + wp.static(STEPS) < n:
                fetch(A.factor, wp.static(2 * LANES * LANES + LANES), i - wp.static(STEPS), k, at, False)
            sent()
            slot = wp.where(slot + 1 == wp.static(STEPS), 0, slot + 1)
            if lane == 0:
                T.z[i, k] = all
            most = wp.max(most, wp.length(wp.vec3d(all[0], all[1], all[2])))
            z2 = z1
            z1 = all
        return most

    @wp.func
    def eliminate(T: Trial, A: Parts, n: int, lane: int, k: int):
        place = desk(wp.static(count))
        forward(A, place, n, lane, k)
        meet()
        return backward(T, A, place, n, lane, k)

    return eliminate
