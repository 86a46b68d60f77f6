"""Newton's system of one strand: forces, and the stiffness of Gauss and Newton, factored point by point.

    v1 = ((1 + b) d - b s) / h,    M ((1 + b) v1 - (1 + 2 b) v + b u) / h = F(x + d) + M g        BDF2: b = 1/2; b = 0: Euler
    K = M (1 + b)^2 / h^2 + sum over strains of k grad grad^T (and what tension gives across edges)

Strains of a point know three points in a row, so that K has two blocks beside its diagonal; blocks are 4 x 4 (a point, and the
angle of the edge behind it), eliminated from the first to the last without pivoting: K is positive definite. What Gauss and
Newton leave out (strain times its second derivative) changes how fast iterations converge, not where to; of it what turns of
edges about themselves change is taken (`element.spinning`): of rods that are bent, or pulled straight, it is most.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.rods.air import air_force_on_edge, strand_end_velocity
from wsim.kernels.rods.contact import TINY, Colliders, expect_all, strand_touch_functions
from wsim.kernels.rods.edges.edge_contact_law import EdgeForces
from wsim.kernels.rods.edges.inside import inside_edge_functions
from wsim.kernels.rods.element import orthogonal_director, rod_strain_functions, rotated_director, transport_director
from wsim.kernels.rods.eliminate import EliminationWindow, point_elimination_func
from wsim.kernels.rods.forces import (
    damped_strains,
    damping_gain,
    edge_spin_rate,
    edge_tension,
    multistep_memory,
    spin_stiffness_with_gain,
)
from wsim.kernels.rods.tables import RodMotion, RodStep, RodTable, RodTrial, is_own_point

_bend = rod_strain_functions()
Bend, strains = _bend.Bend, _bend.strains


@wp.func
def point_angle_vector(v: wp.vec3d, angle: wp.float64):
    return wp.vec4d(v[0], v[1], v[2], angle)


@wp.func
def inertia_block(S: RodTable, Q: RodMotion, T: RodTrial, p: RodStep, i: int, k: int):
    """Diagonal block and right-hand side of a point and its edge."""
    D = wp.identity(n=4, dtype=wp.float64)
    r = wp.vec4d()
    if i < S.points[k]:
        m = S.m[i, k]
        b = multistep_memory(Q, i, k)
        a = wp.float64(1.0) + b
        if S.hold[i, k] < 0:
            v = ((T.x[i, k] - Q.x[i, k]) * a - Q.s[i, k] * b) / p.h
            f = (S.gravity[k] - (v * a - Q.v[i, k] * (a + b) + Q.u[i, k] * b) / p.h) * m
            if S.load_row:
                if S.load_row[i, k] >= 0:
                    f = f + S.load_force[p.at, S.load_row[i, k]]
            r = point_angle_vector(f, wp.float64(0.0))
        for c in range(3):
            D[c, c] = m * a * a / (p.h * p.h)
        J = S.J[i, k]
        if J > wp.float64(0.0):
            D[3, 3] = J * a * a / (p.h * p.h)
            if S.clamped[i, k] == 0:
                w = Q.w[i, k]
                r[3] = -J * (edge_spin_rate(Q, T, p.h, i, k) * a - w[0] * (a + b) + w[2] * b) / p.h
    return D, r


@wp.func
def push_edge_ends(S: RodTable, w: EliminationWindow, f: wp.vec3d, K: wp.mat33d, i: int, k: int):
    """The window with a force on either end of an edge, its first two points, and the stiffness against their mean."""
    one = wp.float64(1.0)
    free0 = wp.where(S.hold[i, k] < 0, one, one - one)
    free1 = wp.where(S.hold[i + 1, k] < 0, one, one - one)
    m = int(3)
    for a in range(m):
        for b in range(m):
            w.D0[a, b] = w.D0[a, b] + K[a, b] * free0
            w.D1[a, b] = w.D1[a, b] + K[a, b] * free1
            w.P[a, b] = w.P[a, b] + K[a, b] * free0 * free1
    g = point_angle_vector(f, wp.float64(0.0))
    w.r0 = w.r0 + g * free0
    w.r1 = w.r1 + g * free1
    return w


@wp.func
def add_stiffness(D: wp.mat44d, K: wp.mat33d):
    """A block with a stiffness of a point added."""
    m = int(3)
    for a in range(m):
        for b in range(m):
            D[a, b] = D[a, b] + K[a, b]
    return D


@wp.func
def add_edge_contact(S: RodTable, w: EliminationWindow, t: EdgeForces, i: int, k: int):
    """The window with forces of colliders on an edge, its first two points."""
    one = wp.float64(1.0)
    free0 = wp.where(S.hold[i, k] < 0, one, one - one)
    free1 = wp.where(S.hold[i + 1, k] < 0, one, one - one)
    w.D0 = add_stiffness(w.D0, t.K0 * free0)
    w.D1 = add_stiffness(w.D1, t.K1 * free1)
    w.P = add_stiffness(w.P, t.K * (free0 * free1))
    w.r0 = w.r0 + point_angle_vector(t.f0, wp.float64(0.0)) * free0
    w.r1 = w.r1 + point_angle_vector(t.f1, wp.float64(0.0)) * free1
    return w


@wp.func
def add_edge_tension(S: RodTable, T: RodTrial, w: EliminationWindow, t: wp.vec3d, length: wp.float64, pull: wp.vec2d, i: int,
                     k: int):
    """The window with an edge's tension (pull: `edge_tension`) between its first two points, and across what tension gives,
    that of the last correction: edges that turn are too long before the next one, which would hold them fast."""
    one = wp.float64(1.0)
    across = wp.max(T.pull[i, k] / wp.max(length, TINY), wp.float64(0.0))
    H = wp.outer(t, t) * (pull[1] - across) + wp.identity(n=3, dtype=wp.float64) * across
    free0 = wp.where(S.hold[i, k] < 0, one, one - one)
    free1 = wp.where(S.hold[i + 1, k] < 0, one, one - one)
    m = int(3)                                           # of loops that are not written out: they compile ten times faster
    for a in range(m):
        for b in range(m):
            w.D0[a, b] = w.D0[a, b] + H[a, b] * free0
            w.D1[a, b] = w.D1[a, b] + H[a, b] * free1
            w.P[a, b] = w.P[a, b] - H[a, b] * free0 * free1
    f = point_angle_vector(t * pull[0], wp.float64(0.0))
    w.r0 = w.r0 + f * free0
    w.r1 = w.r1 - f * free1
    return w


@wp.func
def add_bending(S: RodTable, w: EliminationWindow, f: Bend, off: wp.vec3d, more: wp.float64, i: int, k: int):
    """The window with bending and twisting at point i, its middle one. off: `damped_strains`; more: `damping_gain`."""
    zero = wp.float64(0.0)
    free0 = wp.where(S.hold[i - 1, k] < 0, wp.float64(1.0), zero)
    free1 = wp.where(S.hold[i, k] < 0, wp.float64(1.0), zero)
    free2 = wp.where(S.hold[i + 1, k] < 0, wp.float64(1.0), zero)
    spin0 = wp.where(S.clamped[i - 1, k] == 0, wp.float64(1.0), zero)
    spin1 = wp.where(S.clamped[i, k] == 0, wp.float64(1.0), zero)
    turn = spin_stiffness_with_gain(S, f, more, i, k)
    m = int(3)
    for c in range(m):
        q = wp.where(c < 2, S.B[i, k], S.C[i, k])
        K = q * (wp.float64(1.0) + more)
        u = wp.where(c < 2, turn[c], wp.float64(1.0))
        g0 = point_angle_vector(f.a[c] * -free0, wp.where(c < 2, u, -u) * spin0)
        g1 = point_angle_vector((f.a[c] - f.b[c]) * free1, u * spin1)
        g2 = point_angle_vector(f.b[c] * free2, zero)
        s = off[c] * q
        w.r0 = w.r0 - point_angle_vector(f.a[c] * -free0, f.u[c] * spin0) * s
        w.r1 = w.r1 - point_angle_vector((f.a[c] - f.b[c]) * free1, f.w[c] * spin1) * s
        w.r2 = w.r2 - g2 * s
        w.D0 = w.D0 + wp.outer(g0, g0) * K
        w.D1 = w.D1 + wp.outer(g1, g1) * K
        w.D2 = w.D2 + wp.outer(g2, g2) * K
        w.P = w.P + wp.outer(g0, g1) * K
        w.N = w.N + wp.outer(g1, g2) * K
        w.F = w.F + wp.outer(g0, g2) * K
    w.D0[3, 3] = w.D0[3, 3] + S.B[i, k] * turn[2] * spin0
    w.D1[3, 3] = w.D1[3, 3] + S.B[i, k] * turn[2] * spin1
    return w


@cache
def point_block_func(kinds: tuple[str, ...], airy: bool, pressed: bool):
    """Function (S, C, Q, T, p, i, k) -> diagonal block and right-hand side of a point: all but what edges and bends give."""
    meets, touch = bool(kinds), strand_touch_functions(kinds).touch if kinds else None

    @wp.func
    def assemble_point_block(S: RodTable, C: Colliders, Q: RodMotion, T: RodTrial, p: RodStep, i: int, k: int):
        D, r = inertia_block(S, Q, T, p, i, k)
        if wp.static(airy):
            if i < S.points[k]:
                if S.hold[i, k] < 0:
                    rate = S.m[i, k] * S.decay[k]
                    r = r - point_angle_vector(strand_end_velocity(Q, T, p.h, i, k) * rate, wp.float64(0.0))
                    D = add_stiffness(D, wp.identity(n=3, dtype=wp.float64)
                                      * (rate * (wp.float64(1.0) + multistep_memory(Q, i, k)) / p.h))
        if wp.static(meets):
            if i < S.points[k]:
                if S.hold[i, k] < 0 and is_own_point(S, i, k):
                    t = touch(C, S, Q, T, p.h * p.h, p.at, i, k)
                    r = r + point_angle_vector(t.f, wp.float64(0.0))
                    D = add_stiffness(D, t.K)
        if wp.static(pressed):
            if i < S.points[k]:
                r = r + point_angle_vector(T.press[i, k], wp.float64(0.0))
                D = add_stiffness(D, T.stiff[i, k])
                if T.given and S.hold[i, k] < 0:
                    r = r + point_angle_vector(T.given[i, k], wp.float64(0.0))
                if T.lift and S.hold[i, k] < 0:
                    r = r + point_angle_vector(T.lift[i, k], wp.float64(0.0))
                    D = add_stiffness(D, T.firm[i, k])
        return D, r

    return assemble_point_block


@cache
def strand_assembly_func(kinds: tuple[str, ...], airy: bool, pressed: bool = False, closed: bool = False):
    """Function (S, C, Q, T, p, k): assembles and eliminates, from the first point to the last. kinds: of colliders. airy: there
    is air (S.wind and below). pressed: other edges press (T.press, T.stiff, T.along), and T.pivot and T.b (eliminated on) are
    left for more right-hand sides, as where strands are closed."""
    eliminate, point = point_elimination_func(pressed or closed), point_block_func(kinds, airy, pressed)
    meets = bool(kinds)
    clear, touch = (inside_edge_functions(kinds).clear, inside_edge_functions(kinds).touch) if meets else (None, None)

    @wp.func
    def assemble_strand_forward(S: RodTable, C: Colliders, Q: RodMotion, T: RodTrial, p: RodStep, k: int):
        n = S.points[k]
        w = EliminationWindow()
        e = T.x[1, k] - T.x[0, k]
        l0 = wp.length(e)
        t0 = e / wp.max(l0, TINY)
        for j in range(n + 2):
            i = j - 2                                    # the first of the window's points; it is filled before it has one
            D, r = point(S, C, Q, T, p, j, k)
            w.D2 = D
            w.r2 = r
            if i >= 0 and i + 1 < n:
                w = add_edge_tension(S, T, w, t0, l0, edge_tension(S, Q, T, p, t0, l0, i, k), i, k)
                if wp.static(meets):
                    held = S.hold[i, k] >= 0 and S.hold[i + 1, k] >= 0
                    if not held and is_own_point(S, i, k) and not clear(C, S, T, p.at, i, k):
                        w = add_edge_contact(S, w, touch(C, S, Q, T, p.h * p.h, p.at, i, k), i, k)
                if wp.static(airy):
                    f, K = air_force_on_edge(S, Q, T, p, i, k)
                    w = push_edge_ends(S, w, f, K, i, k)
                if wp.static(pressed):
                    w.P = add_stiffness(w.P, T.along[i, k])
                    if T.bridge:
                        w.P = add_stiffness(w.P, T.bridge[i, k])
            if i >= 0 and i + 2 < n:
                e = T.x[j, k] - T.x[i + 1, k]
                l1 = wp.length(e)
                t1 = e / wp.max(l1, TINY)
                if S.clamped[i, k] + S.clamped[i + 1, k] < 2:
                    s = strains(t0, t1, wp.max(l0, TINY), wp.max(l1, TINY), T.d[i, k], T.d[i + 1, k], T.phi[i + 1, k])
                    T.phi[i + 1, k] = s.s[2]
                    w = add_bending(S, w, s, damped_strains(S, Q, T, p, s, i + 1, k), damping_gain(S, Q, p.h, i, i + 2, k),
                                    i + 1, k)
                l0 = l1
                t0 = t1
            w = eliminate(T, w, i, k)

    return assemble_strand_forward


@wp.func
def corrected_edge_tension(S: RodTable, e: wp.vec3d, z: wp.vec4d, i: int, k: int):
    """Tension [N] that a correction gives an edge e, whose ends it moves apart by z."""
    length = wp.length(e)
    return S.A[i, k] * (length - S.length[i, k] + (e[0] * z[0] + e[1] * z[1] + e[2] * z[2]) / wp.max(length, TINY))


@wp.func
def turn_edge(S: RodTable, T: RodTrial, e: wp.vec3d, now: wp.vec3d, z: wp.vec4d, angle: wp.float64, i: int, k: int):
    """Tension and director of the edge behind point i, which went from e to `now` [m]. z: correction of its second point less
    that of its first; angle: that it is turned by about itself [rad]."""
    T.pull[i, k] = corrected_edge_tension(S, e, z, i, k)
    if S.clamped[i, k] == 0:
        t = wp.normalize(now)
        T.d[i, k] = rotated_director(t, orthogonal_director(t, transport_director(wp.normalize(e), t, T.d[i, k])), angle)
        T.turn[i, k] = T.turn[i, k] + angle


@wp.func
def apply_strand_corrections(S: RodTable, T: RodTrial, part: wp.float64, k: int):
    """Moves by a part of the corrections; directors go along with their edges."""
    n = S.points[k]
    if T.hit:
        for i in range(n):
            expect_all(T, T.z[i, k], T.z[wp.min(i + 1, n - 1), k], i, k)
    x0 = T.x[0, k]
    z = T.z[0, k]
    y0 = x0 + wp.vec3d(z[0], z[1], z[2]) * part
    T.x[0, k] = y0
    for i in range(n - 1):
        x1 = T.x[i + 1, k]
        z1 = T.z[i + 1, k]
        y1 = x1 + wp.vec3d(z1[0], z1[1], z1[2]) * part
        T.x[i + 1, k] = y1
        turn_edge(S, T, x1 - x0, y1 - y0, z1 - z, z[3] * part, i, k)
        x0 = x1
        y0 = y1
        z = z1
