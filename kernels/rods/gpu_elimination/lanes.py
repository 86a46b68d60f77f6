"""Elimination of strands on a GPU, LANES threads each: a lane has a column of every block, and what all of them need whole they
hand each other in shared memory. The system and the order are those of kernels/rods/system.py and eliminate.py.

A thread a strand kept nine blocks in local memory: 8 us a point of a few strands, 18 of 10k (H200)."""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102

from functools import cache

import warp as wp

from wsim.kernels.rods.gpu_elimination import parts
from wsim.kernels.rods.gpu_elimination.desk import (
    commit_fetch_group,
    fetch_point_numbers,
    shared_memory_address,
    shared_number,
    shared_vector,
    strand_lane_barrier,
    wait_fetch_group,
    whole_lane_block,
    whole_lane_vector,
)
from wsim.kernels.rods.tables import RodTrial


@wp.struct
class LaneWindow:
    """Columns of blocks of three points in a row, as `wsim.kernels.rods.eliminate.EliminationWindow` has them."""

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
class LdlFactors:
    """L D L^T of a block: L below the diagonal by rows, and one over D."""

    a: wp.vec3d                                     # L10, L20, L30
    b: wp.vec3d                                     # L21, L31, L32
    d: wp.vec4d


@wp.func
def component_of_lane(v: wp.vec4d, lane: int):
    """Number of a vector that a lane has."""
    return wp.where(lane < 2, wp.where(lane == 0, v[0], v[1]), wp.where(lane == 2, v[2], v[3]))


@wp.func
def symmetric_lane_column(at: int, first: int, lane: int):
    """Column `lane` < 3 of a 3 x 3 block whose upper triangle stands from `first` on; 0 in lane 3."""
    zero = wp.float64(0.0)
    x = shared_number(at, first + wp.min(lane, 2))
    y = shared_number(at, first + wp.where(lane == 0, 1, 2 + wp.min(lane, 2)))
    z = shared_number(at, first + wp.where(lane >= 2, 5, 2 + 2 * lane))
    return wp.vec4d(wp.where(lane < 3, x, zero), wp.where(lane < 3, y, zero), wp.where(lane < 3, z, zero), zero)


@wp.func
def own_block(at: int, lane: int, w: LaneWindow):
    """The window with a third point."""
    zero = wp.float64(0.0)
    last = shared_number(at, wp.static(parts.LAST))
    w.D2 = symmetric_lane_column(at, wp.static(parts.SYMMETRIC), lane) + wp.vec4d(zero, zero, zero,
                                                                                  wp.where(lane == 3, last, zero))
    w.r2 = wp.vec4d(shared_number(at, wp.static(parts.RIGHT)), shared_number(at, wp.static(parts.RIGHT + 1)),
                    shared_number(at, wp.static(parts.RIGHT + 2)), shared_number(at, wp.static(parts.RIGHT + 3)))
    w.m2 = wp.vec2d(shared_number(at, wp.static(parts.FREE)), shared_number(at, wp.static(parts.FREE + 1)))
    return w


@wp.func
def symmetric_ldl_factors(D: wp.mat44d):
    """Factors of the symmetric part of a block; rounding makes others of it, see kernels/rods/eliminate.py."""
    f = LdlFactors()
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
def solve_ldl_factors(f: LdlFactors, y: wp.vec4d):
    """Solution of L D L^T x = y."""
    y1 = y[1] - f.a[0] * y[0]
    y2 = y[2] - f.a[1] * y[0] - f.b[0] * y1
    z3 = (y[3] - f.a[2] * y[0] - f.b[1] * y1 - f.b[2] * y2) * f.d[3]
    z2 = y2 * f.d[2] - f.b[2] * z3
    z1 = y1 * f.d[1] - f.b[0] * z2 - f.b[1] * z3
    return wp.vec4d(y[0] * f.d[0] - f.a[0] * z1 - f.a[1] * z2 - f.a[2] * z3, z1, z2, z3)


@wp.func
def add_strain_to_window(at: int, c: int, w: LaneWindow, lane: int):
    """The window with strain c at its middle point."""
    a = shared_vector(at, wp.static(parts.SLOPES) + 3 * c)
    b = shared_vector(at, wp.static(parts.SLOPES + 9) + 3 * c)
    d = (a - b) * w.m1[0]
    a = a * -w.m0[0]
    b = b * w.m2[0]
    spin = shared_number(at, wp.static(parts.SPINS) + c)
    f0 = wp.vec4d(a[0], a[1], a[2], wp.float64(0.0))
    f1 = wp.vec4d(d[0], d[1], d[2], wp.float64(0.0))
    g0 = f0 + wp.vec4d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.where(c < 2, spin, -spin) * w.m0[1])
    g1 = f1 + wp.vec4d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), spin * w.m1[1])
    g2 = wp.vec4d(b[0], b[1], b[2], wp.float64(0.0))
    p0 = component_of_lane(g0, lane)
    p1 = component_of_lane(g1, lane)
    p2 = component_of_lane(g2, lane)
    s = shared_number(at, wp.static(parts.OFF) + c)
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
def eliminate_lane_point(A: parts.RodParts, w: LaneWindow, at: int, i: int, k: int, lane: int):
    """The window with the strains of its points, moved on by one, whose factors are stored."""
    zero = wp.float64(0.0)
    for c in range(wp.static(3)):
        w = add_strain_to_window(at, c, w, lane)
    own = wp.vec4d(zero, zero, zero, wp.where(lane == 3, shared_number(at, wp.static(parts.OWN)), zero))
    w.D0 = w.D0 + own * w.m0[1]
    w.D1 = w.D1 + own * w.m1[1]
    w.r0 = w.r0 + wp.vec4d(zero, zero, zero, shared_number(at, wp.static(parts.TORQUES)) * w.m0[1])
    w.r1 = w.r1 + wp.vec4d(zero, zero, zero, shared_number(at, wp.static(parts.TORQUES + 1)) * w.m1[1])
    f = symmetric_ldl_factors(whole_lane_block(w.D0))
    L1 = solve_ldl_factors(f, w.P)
    L2 = solve_ldl_factors(f, w.F)
    y = solve_ldl_factors(f, w.r0)
    for c in range(wp.static(parts.LANES)):
        A.factor[wp.static(parts.LANES) * c + lane, i, k] = L1[c]
        A.factor[wp.static(parts.LANES) * c + lane + wp.static(parts.LANES * parts.LANES), i, k] = L2[c]
    A.factor[wp.static(2 * parts.LANES * parts.LANES) + lane, i, k] = component_of_lane(y, lane)
    P = wp.transpose(whole_lane_block(w.P))
    w.D0 = w.D1 - P * L1
    w.P = w.N - P * L2
    w.r0 = w.r1 - P * y
    F = wp.transpose(whole_lane_block(w.F))
    w.D1 = w.D2 - F * L2
    w.r1 = w.r2 - F * y
    return w


@cache
def lane_elimination_func(meets: bool, airy: bool):
    """Function (T, A, n, lane, k) -> greatest correction of a strand's n points [m], of which T.z has all."""
    count = parts.numbers_per_point(airy)

    @wp.func
    def stretch_lane_window(A: parts.RodParts, at: int, w: LaneWindow, edges: int, i: int, k: int, lane: int):
        zero = wp.float64(0.0)
        e = shared_vector(at, wp.static(parts.EDGE))
        stiff = shared_vector(at, wp.static(parts.EDGE + 3))
        t = wp.vec4d(e[0], e[1], e[2], zero)
        H = t * (component_of_lane(t, lane) * stiff[0]) + wp.vec4d(wp.where(lane == 0, stiff[1], zero),
                                                                   wp.where(lane == 1, stiff[1], zero),
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
            K = symmetric_lane_column(at, wp.static(parts.MORE + 3), lane)
            w.P = w.P + K * (w.m0[0] * w.m1[0])
            H = H + K
            f = shared_vector(at, wp.static(parts.MORE))
            gust = wp.vec4d(f[0], f[1], f[2], zero)
            w.r0 = w.r0 + gust * w.m0[0]
            w.r1 = w.r1 + gust * w.m1[0]
        w.D0 = w.D0 + H * w.m0[0]
        w.D1 = w.D1 + H * w.m1[0]
        return w

    @wp.func
    def eliminate_lanes_forward(A: parts.RodParts, desk: int, n: int, lane: int, k: int):
        w = LaneWindow()
        edges = int(0)
        if wp.static(meets):
            edges = A.edges[k]
        for j in range(wp.static(parts.STEPS)):
            if j < n + 2:
                fetch_point_numbers(A.part, wp.static(count), j - 2, k, desk + wp.static(64 * count) * j, True)
            commit_fetch_group()
        slot = int(0)
        for j in range(n + 2):
            i = j - 2
            at = desk + wp.static(64 * count) * slot
            wait_fetch_group()
            w = own_block(at, lane, w)
            w.N = wp.vec4d()
            w.F = wp.vec4d()
            if i >= 0:
                w = stretch_lane_window(A, at, w, edges, i, k, lane)
                w = eliminate_lane_point(A, w, at, i, k, lane)
            else:
                w.D0 = w.D1
                w.r0 = w.r1
                w.D1 = w.D2
                w.r1 = w.r2
            strand_lane_barrier()
            if j + wp.static(parts.STEPS) < n + 2:
                fetch_point_numbers(A.part, wp.static(count), i + wp.static(parts.STEPS), k, at, True)
            commit_fetch_group()
            slot = wp.where(slot + 1 == wp.static(parts.STEPS), 0, slot + 1)
            w.m0 = w.m1
            w.m1 = w.m2

    @wp.func
    def substitute_lanes_backward(T: RodTrial, A: parts.RodParts, desk: int, n: int, lane: int, k: int):
        z1 = wp.vec4d()
        z2 = wp.vec4d()
        most = wp.float64(0.0)
        for j in range(wp.static(parts.STEPS)):
            if j < n:
                fetch_point_numbers(A.factor, wp.static(2 * parts.LANES * parts.LANES + parts.LANES), n - 1 - j, k,
                                    desk + wp.static(64 * count) * j, False)
            commit_fetch_group()
        slot = int(0)
        for j in range(n):
            i = n - 1 - j
            at = desk + wp.static(64 * count) * slot
            wait_fetch_group()
            z = shared_number(at, wp.static(2 * parts.LANES * parts.LANES) + lane)
            row = wp.static(parts.LANES) * lane
            for c in range(wp.static(parts.LANES)):
                z -= shared_number(at, row + c) * z1[c] + shared_number(at,
                                                                        row + c + wp.static(parts.LANES * parts.LANES)) * z2[c]
            all = whole_lane_vector(z)
            if j + wp.static(parts.STEPS) < n:
                fetch_point_numbers(A.factor, wp.static(2 * parts.LANES * parts.LANES + parts.LANES),
                                    i - wp.static(parts.STEPS), k, at, False)
            commit_fetch_group()
            slot = wp.where(slot + 1 == wp.static(parts.STEPS), 0, slot + 1)
            if lane == 0:
                T.z[i, k] = all
            most = wp.max(most, wp.length(wp.vec3d(all[0], all[1], all[2])))
            z2 = z1
            z1 = all
        return most

    @wp.func
    def eliminate_by_lanes(T: RodTrial, A: parts.RodParts, n: int, lane: int, k: int):
        place = shared_memory_address(wp.static(count))
        eliminate_lanes_forward(A, place, n, lane, k)
        strand_lane_barrier()
        return substitute_lanes_backward(T, A, place, n, lane, k)

    return eliminate_by_lanes
