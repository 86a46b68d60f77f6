"""Places of an edge in all colliders, as forces on its two points: the law and its stiffness are those of
kernels/rods/edges/inside.py."""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: UP018

from typing import Any

import warp as wp

from wsim.kernels.rods.contact import (
    CLEAR,
    FIRM,
    SOFT,
    STIFF,
    Colliders,
    DeepestCollider,
    RodTouch,
    add_bristle_friction,
    correct_normal_force,
    forget_contact_force,
    friction_load_bound,
    soft_normal_force,
    strand_collider_friction,
)
from wsim.kernels.rods.edges.edge_contact_points import EdgePlace
from wsim.kernels.rods.tables import RodMotion, RodTable, RodTrial, contact_mass


@wp.struct
class EdgeForces:
    """Forces of colliders on both points of an edge, and their stiffness: of each, and between them."""

    f0: wp.vec3d
    f1: wp.vec3d
    K0: wp.mat33d
    K1: wp.mat33d
    K: wp.mat33d


@wp.func
def add_force_on_edge(to: EdgeForces, f: wp.vec3d, K: wp.mat33d, u: wp.float64):
    """`to` with a force at a place of the edge, and its stiffness."""
    v = wp.float64(1.0) - u
    to.f0 = to.f0 + f * v
    to.f1 = to.f1 + f * u
    to.K0 = to.K0 + K * (v * v)
    to.K1 = to.K1 + K * (u * u)
    to.K = to.K + K * (u * v)
    return to


@wp.func
def add_rolling_stiffness(to: EdgeForces, n: wp.vec3d, d: wp.vec3d, y: wp.float64, N: wp.float64, slope: wp.float64):
    """`to` with what a normal force N gives as its place moves along the edge d."""
    length = wp.length(d)
    t = d * (slope / length)
    a0 = t * (wp.float64(1.0) - y) - n
    a1 = t * y + n
    k = N / (slope * length)
    to.K0 = to.K0 + wp.outer(a0, a0) * k
    to.K1 = to.K1 + wp.outer(a1, a1) * k
    to.K = to.K + wp.outer(a0, a1) * k
    return to


@wp.func
def interpolate_on_edge(u: wp.float64, a: Any, b: Any):
    """What is a at a point and b at the next, numbers or vectors, at the part u of the edge."""
    return a + (b - a) * u


@wp.func
def depth_beneath_ends(phi: wp.float64, ends: wp.float64, r: wp.float64, w: wp.float64):
    """e of a place of an edge [m]. ends: least distance of its points; r: what is kept from the collider [m]."""
    return r - phi - w - wp.max(-w, r - ends)


@wp.struct
class EdgeSite:
    """One of both places of an edge in all colliders: the deepest one, its normal force [N], y and the slope of s. more: what
    its friction goes by besides N [N], that of the other place in its collider where two colliders have a site each."""

    side: DeepestCollider
    N: wp.float64
    more: wp.float64
    y: wp.float64
    slope: wp.float64


@wp.struct
class ColliderPair:
    """The two colliders that press an edge most, with what [N], and where on it."""

    first: int
    second: int
    most: wp.float64
    less: wp.float64
    y: wp.float64
    z: wp.float64


@wp.func
def add_pressing_collider(to: ColliderPair, c: int, N: wp.float64, y: wp.float64):
    """The pair behind one collider more."""
    if N > to.most:
        to.second = to.first
        to.less = to.most
        to.z = to.y
        to.first = c
        to.most = N
        to.y = y
    elif N > to.less:
        to.second = c
        to.less = N
        to.z = y
    return to


@wp.struct
class RodEdge:
    """The edge behind point i of strand k in the substep at, hh: h^2 [s^2], from x0 to x1 in the world [m]; reach: within which
    it meets anything [m]; had: T.edge; ends: least distance of its points [m]."""

    i: int
    k: int
    at: int
    hh: wp.float64
    x0: wp.vec3d
    x1: wp.vec3d
    reach: wp.float64
    had: int
    ends: wp.float64


@wp.struct
class FacedEdge:
    """An edge in all colliders: forces, both sites, the two colliders that press it most, and what T.edge will be."""

    to: EdgeForces
    first: EdgeSite
    second: EdgeSite
    pair: ColliderPair
    now: int


@wp.func
def edge_contact_stiffness(S: RodTable, hh: wp.float64, y: wp.float64, i: int, k: int):
    """k of kernels/rods/contact.py at a place of an edge [N/m]."""
    return wp.max(STIFF * interpolate_on_edge(y, S.m[i, k], contact_mass(S, i + 1, k)) / hh, FIRM * S.A[i, k])


@wp.func
def press_edge_site(C: Colliders, S: RodTable, Q: RodMotion, T: RodTrial, to: EdgeSite, at: EdgePlace, E: RodEdge, c: int):
    """The site with a place in a collider."""
    i = E.i
    k = E.k
    now = E.at
    zero = wp.float64(0.0)
    y = at.y
    r = interpolate_on_edge(y, S.radius[i, k], S.radius[i + 1, k])
    deep = depth_beneath_ends(at.phi, E.ends, r + C.thick[c], SOFT * r)
    N, slope = soft_normal_force(edge_contact_stiffness(S, E.hh, y, i, k), SOFT * r, deep)
    if N > to.N or (to.N == zero and deep > to.side.deep):
        x = interpolate_on_edge(y, T.x[i, k], T.x[i + 1, k])
        way = wp.quat_rotate_inv(wp.transform_get_rotation(C.pose[now + 1, c]), T.x[i + 1, k] - T.x[i, k])
        q = at.before + way * (y - at.u)
        n = wp.transform_vector(C.pose[now + 1, c], at.n)
        to.y = y
        to.slope = at.slope
        to.side.c = c
        to.side.n = n
        to.side.deep = deep
        to.side.slid = (x - interpolate_on_edge(y, Q.x[i, k], Q.x[i + 1, k])) - (
            x + S.origin[k] - wp.transform_point(C.pose[now, c], q))
        to.side.hit = wp.vec4d(n[0] * slope, n[1] * slope, n[2] * slope, N)
        to.N = N
    return to, N, slope


@wp.func
def end_edge_site(C: Colliders, S: RodTable, Q: RodMotion, T: RodTrial, found: EdgeForces, to: EdgeSite, E: RodEdge,
                  which: int):
    """The edge with what lasts of a site, and friction with the collider that it is deepest in."""
    i = E.i
    k = E.k
    zero = wp.float64(0.0)
    row = T.x.shape[0] * (1 + which) + i
    N = to.N
    t = RodTouch()
    t.N = N
    y = to.y
    n = to.side.n
    stick = Q.stick1[i, k]
    before = Q.load1[i, k]
    if which == 1:
        stick = Q.stick2[i, k]
        before = Q.load2[i, k]
    s = stick + to.side.slid
    lean = wp.vec3d()
    stiff = edge_contact_stiffness(S, E.hh, y, i, k)
    if T.hit:
        if to.slope == zero:
            forget_contact_force(T, row, k)
        t, N = correct_normal_force(T, t, to.side, stiff, SOFT * interpolate_on_edge(y, S.radius[i, k], S.radius[i + 1, k]),
                                    row, k)
        lean = T.lean[row, k]
        T.slip[row, k] = (s - n * wp.dot(n, s)) * wp.where(N > zero, wp.float64(1.0), zero)
    if N > zero:
        found = add_rolling_stiffness(found, n, T.x[i + 1, k] - T.x[i, k], y, N, to.slope)
        v = interpolate_on_edge(y, Q.v[i, k], Q.v[i + 1, k])
        m = interpolate_on_edge(y, S.m[i, k], contact_mass(S, i + 1, k))
        N = friction_load_bound(before, m, v, S.gravity[k], n, N + to.more, E.hh)
        t = add_bristle_friction(t, n, s, N, stiff, strand_collider_friction(C, S, to.side.c, k), lean)
    T.bristle[row, k] = t.s
    T.inside[row, k] = wp.vec3d(y, wp.max(to.N, zero) + to.more, wp.where(to.N > zero, to.side.deep, zero))
    return add_force_on_edge(found, t.f, t.K, y)


@wp.func
def fill_edge_rows(T: RodTrial, had: int, i: int, k: int):
    """Rows of an edge that has none yet: as `forget_contact_force` leaves them, or as an iteration that found nothing."""
    if T.hit:
        for which in range(1, 3):
            row = T.x.shape[0] * which + i
            forget_contact_force(T, row, k)
            if had == CLEAR:
                T.slip[row, k] = wp.vec3d()
