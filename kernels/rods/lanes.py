"""Elimination of strands on a GPU, LANES threads each: a lane has a column of every block, and what all of them need whole they
hand each other in shared memory. The system and the order are those of kernels/rods/system.py and eliminate.py.

A thread a strand kept nine blocks in local memory: 8 us a point of a few strands, 18 of 10k (H200)."""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102

from functools import cache

import warp as wp

from wsim.kernels.rods.element import bend
from wsim.kernels.rods.tables import Strands, Trial

LANES, THREADS = 4, 32           # of a strand, of a block (one warp: shared memory is that of a warp)
SYMMETRIC, LAST, RIGHT, EDGE, BENT, GUST, DAMP = 0, 6, 7, 11, 15, 42, 45
CALM, AIRY = 42, 51              # numbers of a point without air and with it
Bend = bend().Bend


@wp.struct
class Parts:
    """Table of what points leave for their strands, and the state of Newton's method, (strands,).

    part (CALM or AIRY, points, strands): upper triangle of the point's own block (rows of three, then the angle's), right-hand
    side from RIGHT on, the edge's tangent and length [m], Bend of the point in its order, half the force of the air on the edge
    [N] and the upper triangle of its stiffness [N/m]"""

    part: wp.array3d(dtype=wp.float64)
    near: wp.array3d(dtype=wp.float64)              # factor towards the next point, (16, points, strands)
    far: wp.array3d(dtype=wp.float64)               # and the one behind it
    least: wp.array(dtype=wp.float64)               # shortest edge [m]
    before: wp.array(dtype=wp.float64)              # greatest correction of the iteration before [m]
    share: wp.array(dtype=wp.float64)               # of a correction that is taken
    count: wp.array(dtype=int)                      # iterations
    on: wp.array(dtype=int)                         # 1: it goes on
    moved: wp.array(dtype=int)                      # 1: it has moved in this iteration


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


@wp.struct
class Factors:
    """L D L^T of a block: L below the diagonal by rows, and one over D."""

    a: wp.vec3d                                     # L10, L20, L30
    b: wp.vec3d                                     # L21, L31, L32
    d: wp.vec4d


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __shared__ double room[4 * 32];
    const int t = threadIdx.x, first = t & ~3;
    const unsigned group = 0xfu << first;
    __syncwarp(group);
    for (int r = 0; r < 4; ++r) room[32 * r + t] = own[r];
    __syncwarp(group);
    wp::mat_t<4, 4, double> m;
    for (int r = 0; r < 4; ++r)
        for (int c = 0; c < 4; ++c) m.data[r][c] = room[32 * r + first + c];
    return m;
#else
    return wp::mat_t<4, 4, double>();
#endif
""")
def whole(own: wp.vec4d) -> wp.mat44d:
    """Block whose columns the lanes of a strand have."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const unsigned group = 0xfu << (threadIdx.x & 28);
    return wp::vec_t<4, double>(__shfl_sync(group, own, 0, 4), __shfl_sync(group, own, 1, 4), __shfl_sync(group, own, 2, 4),
                                __shfl_sync(group, own, 3, 4));
#else
    return wp::vec_t<4, double>();
#endif
""")
def together(own: wp.float64) -> wp.vec4d:
    """Vector whose numbers the lanes of a strand have."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncwarp(0xfu << (threadIdx.x & 28));
#endif
""")
def meet():
    """The lanes of a strand wait for each other; what each wrote is seen by all."""
    ...


@wp.func
def pick(v: wp.vec4d, lane: int):
    return wp.where(lane < 2, wp.where(lane == 0, v[0], v[1]), wp.where(lane == 2, v[2], v[3]))


@wp.func
def symmetric(part: wp.array3d(dtype=wp.float64), first: int, i: int, k: int, lane: int):
    """Column `lane` < 3 of a 3 x 3 block whose upper triangle stands from `first` on; 0 in lane 3."""
    zero = wp.float64(0.0)
    v = wp.vec4d()
    if lane < 3:
        v = wp.vec4d(part[first + lane, i, k], part[first + wp.where(lane == 0, 1, 2 + lane), i, k],
                     part[first + wp.where(lane == 2, 5, 2 + 2 * lane), i, k], zero)
    return v


@wp.func
def own_block(A: Parts, i: int, n: int, k: int, lane: int):
    """Column of a point's own block, and its right-hand side."""
    zero = wp.float64(0.0)
    r = wp.vec4d()
    D = wp.vec4d(wp.float64(wp.where(lane == 0, 1, 0)), wp.float64(wp.where(lane == 1, 1, 0)),
                 wp.float64(wp.where(lane == 2, 1, 0)), wp.float64(wp.where(lane == 3, 1, 0)))
    if i < n:
        D = symmetric(A.part, wp.static(SYMMETRIC), i, k, lane)
        if lane == 3:
            D = wp.vec4d(zero, zero, zero, A.part[wp.static(LAST), i, k])
        r = wp.vec4d(A.part[wp.static(RIGHT), i, k], A.part[wp.static(RIGHT + 1), i, k],
                     A.part[wp.static(RIGHT + 2), i, k], A.part[wp.static(RIGHT + 3), i, k])
    return D, r


@wp.func
def factors(D: wp.mat44d):
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
    y1 = y[1] - f.a[0] * y[0]
    y2 = y[2] - f.a[1] * y[0] - f.b[0] * y1
    z3 = (y[3] - f.a[2] * y[0] - f.b[1] * y1 - f.b[2] * y2) * f.d[3]
    z2 = y2 * f.d[2] - f.b[2] * z3
    z1 = y1 * f.d[1] - f.b[0] * z2 - f.b[1] * z3
    return wp.vec4d(y[0] * f.d[0] - f.a[0] * z1 - f.a[1] * z2 - f.a[2] * z3, z1, z2, z3)


@wp.func
def read3(part: wp.array3d(dtype=wp.float64), first: int, i: int, k: int):
    return wp.vec3d(part[first, i, k], part[first + 1, i, k], part[first + 2, i, k])


@wp.func
def keep(part: wp.array3d(dtype=wp.float64), first: int, i: int, k: int, v: wp.vec3d):
    """Stores three numbers of a point."""
    part[first, i, k] = v[0]
    part[first + 1, i, k] = v[1]
    part[first + 2, i, k] = v[2]


@wp.func
def keep_bend(A: Parts, i: int, k: int, f: Bend):
    keep(A.part, wp.static(BENT), i, k, f.s)
    for c in range(wp.static(3)):
        keep(A.part, wp.static(BENT + 3) + 3 * c, i, k, f.a[c])
        keep(A.part, wp.static(BENT + 12) + 3 * c, i, k, f.b[c])
    keep(A.part, wp.static(BENT + 21), i, k, f.u)
    keep(A.part, wp.static(BENT + 24), i, k, f.w)


@wp.func
def keep_symmetric(part: wp.array3d(dtype=wp.float64), first: int, i: int, k: int, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Stores the upper triangle of a block's rows."""
    keep(part, first, i, k, a)
    part[first + 3, i, k] = b[1]
    part[first + 4, i, k] = b[2]
    part[first + 5, i, k] = c[2]


@cache
def eliminating(airy: bool):
    """Function (S, T, A, lane, k) -> greatest correction of a strand's points [m], of which T.z has all."""

    @wp.func
    def stretch(S: Strands, A: Parts, w: Window, i: int, k: int, lane: int):
        zero = wp.float64(0.0)
        free0 = wp.where(S.hold[i, k] < 0, wp.float64(1.0), zero)
        free1 = wp.where(S.hold[i + 1, k] < 0, wp.float64(1.0), zero)
        e = read3(A.part, wp.static(EDGE), i, k)
        t = wp.vec4d(e[0], e[1], e[2], zero)
        length = A.part[wp.static(EDGE + 3), i, k]
        tension = S.A[i, k] * (length - S.length[i, k])
        across = wp.max(tension / wp.max(length, wp.float64(1e-30)), zero)
        H = t * (pick(t, lane) * (S.A[i, k] - across))
        H = H + wp.vec4d(wp.where(lane == 0, across, zero), wp.where(lane == 1, across, zero),
                         wp.where(lane == 2, across, zero), zero)
        w.P = w.P - H * (free0 * free1)
        r = t * tension
        if wp.static(airy):
            K = symmetric(A.part, wp.static(DAMP), i, k, lane)
            w.P = w.P + K * (free0 * free1)
            H = H + K
            f = read3(A.part, wp.static(GUST), i, k)
            gust = wp.vec4d(f[0], f[1], f[2], zero)
            w.r0 = w.r0 + gust * free0
            w.r1 = w.r1 + gust * free1
        w.D0 = w.D0 + H * free0
        w.D1 = w.D1 + H * free1
        w.r0 = w.r0 + r * free0
        w.r1 = w.r1 - r * free1
        return w

    @wp.func
    def strain(A: Parts, w: Window, c: int, q: wp.float64, off: wp.float64, i: int, k: int, lane: int, held: wp.vec3d,
               spin: wp.vec2d):
        """The window with a strain of a point. q: its stiffness, off: how far from rest."""
        a = read3(A.part, wp.static(BENT + 3) + 3 * c, i, k)
        b = read3(A.part, wp.static(BENT + 12) + 3 * c, i, k)
        d = (a - b) * held[1]
        a = a * -held[0]
        b = b * held[2]
        g0 = wp.vec4d(a[0], a[1], a[2], A.part[wp.static(BENT + 21) + c, i, k] * spin[0])
        g1 = wp.vec4d(d[0], d[1], d[2], A.part[wp.static(BENT + 24) + c, i, k] * spin[1])
        g2 = wp.vec4d(b[0], b[1], b[2], wp.float64(0.0))
        p0 = q * pick(g0, lane)
        p1 = q * pick(g1, lane)
        p2 = q * pick(g2, lane)
        s = off * q
        w.r0 = w.r0 - g0 * s
        w.r1 = w.r1 - g1 * s
        w.r2 = w.r2 - g2 * s
        w.D0 = w.D0 + g0 * p0
        w.D1 = w.D1 + g1 * p1
        w.D2 = w.D2 + g2 * p2
        w.P = w.P + g0 * p1
        w.N = w.N + g1 * p2
        w.F = w.F + g0 * p2
        return w

    @wp.func
    def flex(S: Strands, A: Parts, w: Window, i: int, k: int, lane: int):
        zero = wp.float64(0.0)
        one = wp.float64(1.0)
        held = wp.vec3d(wp.where(S.hold[i - 1, k] < 0, one, zero), wp.where(S.hold[i, k] < 0, one, zero),
                        wp.where(S.hold[i + 1, k] < 0, one, zero))
        spin = wp.vec2d(wp.where(S.clamped[i - 1, k] == 0, one, zero), wp.where(S.clamped[i, k] == 0, one, zero))
        off = read3(A.part, wp.static(BENT), i, k) - S.rest[i, k]
        B = S.B[i, k]
        w = strain(A, w, 0, B, off[0], i, k, lane, held, spin)
        w = strain(A, w, 1, B, off[1], i, k, lane, held, spin)
        w = strain(A, w, 2, S.C[i, k], off[2], i, k, lane, held, spin)
        if lane == 3:
            u = read3(A.part, wp.static(BENT + 21), i, k)
            v = read3(A.part, wp.static(BENT + 24), i, k)
            p = B * off[0]
            q = B * off[1]
            w.D0 = w.D0 + wp.vec4d(zero, zero, zero, wp.max(p * u[1] - q * u[0], zero) * spin[0])
            w.D1 = w.D1 + wp.vec4d(zero, zero, zero, wp.max(p * v[1] - q * v[0], zero) * spin[1])
        return w

    @wp.func
    def backward(T: Trial, A: Parts, n: int, lane: int, k: int):
        z1 = wp.vec4d()
        z2 = wp.vec4d()
        most = wp.float64(0.0)
        for j in range(n):
            i = n - 1 - j
            z = pick(T.z[i, k], lane)
            row = 4 * lane
            for c in range(wp.static(LANES)):
                z -= A.near[row + c, i, k] * z1[c] + A.far[row + c, i, k] * z2[c]
            all = together(z)
            if lane == 0:
                T.z[i, k] = all
            most = wp.max(most, wp.length(wp.vec3d(all[0], all[1], all[2])))
            z2 = z1
            z1 = all
        return most

    @wp.func
    def eliminate(S: Strands, T: Trial, A: Parts, n: int, lane: int, k: int):
        w = Window()
        D, r = own_block(A, 0, n, k, lane)
        w.D0 = D
        w.r0 = r
        D, r = own_block(A, 1, n, k, lane)
        w.D1 = D
        w.r1 = r
        for i in range(n):
            D, r = own_block(A, i + 2, n, k, lane)
            w.D2 = D
            w.r2 = r
            w.N = wp.vec4d()
            w.F = wp.vec4d()
            if i + 1 < n:
                w = stretch(S, A, w, i, k, lane)
            if i + 2 < n:
                if S.clamped[i, k] + S.clamped[i + 1, k] < 2:
                    w = flex(S, A, w, i + 1, k, lane)
            f = factors(whole(w.D0))
            P = wp.transpose(whole(w.P))
            F = wp.transpose(whole(w.F))
            L1 = solved(f, w.P)
            L2 = solved(f, w.F)
            y = solved(f, w.r0)
            for c in range(wp.static(LANES)):
                A.near[wp.static(LANES) * c + lane, i, k] = L1[c]
                A.far[wp.static(LANES) * c + lane, i, k] = L2[c]
            if lane == 0:
                T.z[i, k] = y
            w.D0 = w.D1 - P * L1
            w.P = w.N - P * L2
            w.D1 = w.D2 - F * L2
            w.r0 = w.r1 - P * y
            w.r1 = w.r2 - F * y
        meet()
        return backward(T, A, n, lane, k)

    return eliminate
