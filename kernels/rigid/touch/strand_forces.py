"""Forces of rigid bodies on strands, on their points by the law of kernels/rods/contact.py, and within their edges by that of
kernels/rods/edges/edge_contact_points.py. What bodies then do: kernels/rigid/touch/strands.py.

    k = max(STIFF m / h^2, FIRM A, min(M / h^2, A))      M: of the body, A: E A over the edge's length; what lies on a rope
                                                         sinks by g h^2 / n on n points, or by its strain, in edges

A force f at x_u = (1 - u) x_i + u x_i+1 is (1 - u) f and u f on the points of the edge, and -f on the body at the arm of x_u;
its stiffness b b^T K, b = (1 - u, u). A point has u = 0, and a row that it shares with the edge behind it: three sites, the
point and two places within the edge. The friction of each is with the body that it is deepest in, or, where two press an edge,
of the first site with the one farther down it, of the second with the other, by all that each presses with.

The load that friction goes by, at most twice the present normal force, is a force that Newton's system knows nothing of (it has
no potential): iterations may go round for good. Behind LATE of them it stays as it is for AGAIN, which then settle.
"""

from functools import cache

import warp as wp

from wsim.kernels.rigid.touch.strand_contacts import SITES, RodSpot, strand_shape_funcs, strand_spot
from wsim.kernels.rigid.touch.strand_ties import add_body_tie
from wsim.kernels.rigid.touch.strands import RodBodies
from wsim.kernels.rods.contact import (
    FIRM,
    SOFT,
    STIFF,
    Colliders,
    RodTouch,
    add_bristle_friction,
    friction_load_bound,
    strand_collider_friction,
)
from wsim.kernels.rods.contact import soft_normal_force as pressing
from wsim.kernels.rods.edges.edge_contact_law import depth_beneath_ends
from wsim.kernels.rods.edges.edge_contact_points import EdgePlace
from wsim.kernels.rods.tables import RodContacts, RodMotion, RodTable, RodTrial, is_own_point

LATE = wp.constant(30)                   # iterations behind which the load of friction is a new one in each of AGAIN alone
AGAIN = wp.constant(20)


@wp.struct
class DeepestContact:
    """The contact of a site that is deepest: shape, number in its row, normal, u, normal force [N], how deep [m]. 0 N: none."""

    shape: int
    number: int
    n: wp.vec3d
    u: wp.float64
    N: wp.float64
    deep: wp.float64


@wp.func
def deeper_contact(to: DeepestContact, other: DeepestContact):
    if other.N > to.N:
        return other
    return to


@wp.func
def body_contact_stiffness(W: RodBodies, j: int, s: RodSpot):
    """k, see above, of a place in body j [N/m]."""
    hh = W.h * W.h
    return wp.max(wp.max(STIFF * s.m / hh, FIRM * s.A), wp.min(W.m[j] / hh, s.A))


@wp.func
def add_body_contact(W: RodBodies, B: RodContacts, s: RodSpot, n: wp.vec3d, deep: wp.float64, c: int):
    """A contact more, of a place so deep in shape c."""
    j = W.body[c]
    p = s.i * W.strand.shape[0] + s.k
    N, slope = pressing(body_contact_stiffness(W, j, s), SOFT * s.radius, deep)
    number = B.many[p]
    B.many[p] = number + 1
    if number < B.body.shape[1]:
        B.body[p, number] = j
        B.u[p, number] = s.u
        B.f[p, number] = n * N
        B.K[p, number] = wp.outer(n, n) * slope
        B.arm[p, number] = s.x - (W.c1[j] + W.xi[j, 0])
    to = DeepestContact()
    to.n = n
    to.shape = c
    to.number = number
    to.u = s.u
    to.N = N
    to.deep = deep
    return to


@wp.func
def add_body_friction(C: Colliders, S: RodTable, W: RodBodies, B: RodContacts, to: DeepestContact, s: RodSpot):
    """Friction of a site with a shape, in a contact of its own if there is one."""
    p = s.i * W.strand.shape[0] + s.k
    B.N[p, s.site] = to.N
    B.deep[p, s.site] = to.deep
    if to.N == wp.float64(0.0) or B.many[p] > B.body.shape[1]:
        return
    c = to.shape
    j = W.body[c]
    q = wp.transform_point(wp.transform_inverse(W.pose1[c]), s.x)
    slid = s.way - (s.x - wp.transform_point(W.pose0[c], q))
    stick = W.stick[s.i, s.k]
    load = W.load[s.i, s.k]
    if s.site == 1:
        stick = W.stick1[s.i, s.k]
        load = W.load1[s.i, s.k]
    elif s.site == 2:
        stick = W.stick2[s.i, s.k]
        load = W.load2[s.i, s.k]
    load = friction_load_bound(load, s.m, s.v - (W.c1[j] - W.c0[j]) / W.h, S.gravity[s.k], to.n, B.N[p, s.site], W.h * W.h)
    if B.load[p, s.site] > wp.float64(0.0):
        load = B.load[p, s.site]
    B.load[p, s.site] = load
    t = RodTouch()
    t.f = B.f[p, to.number]
    t.K = B.K[p, to.number]
    slip = stick + slid
    lean = wp.normalize(slip - to.n * wp.dot(to.n, slip)) * wp.float64(1 - wp.min(B.rough[W.strand[s.k]], 1))
    t = add_bristle_friction(t, to.n, slip, load, body_contact_stiffness(W, j, s), strand_collider_friction(C, S, c, s.k), lean)
    B.f[p, to.number] = t.f
    B.K[p, to.number] = t.K
    B.s[p, s.site] = t.s


@cache
def body_contact_kernels(kinds: tuple[str, ...], module: str):
    """Kernels over points, and the edges behind them: contacts with bodies in the trial; what they come to on points. full[0]:
    most contacts of a point and its edge, where there is no room for them. kinds: of shapes, which C has as colliders without
    frames."""
    depth, span = strand_shape_funcs(kinds)

    @wp.func
    def meet_point(C: Colliders, S: RodTable, Q: RodMotion, T: RodTrial, W: RodBodies, B: RodContacts, i: int, k: int):
        to = DeepestContact()
        s = strand_spot(S, Q, T, i, k, 0, wp.float64(0.0))
        w = SOFT * s.radius
        for c in range(W.body.shape[0]):
            deep, n = depth(C, W, s, w, c)
            if deep > -w:
                to = deeper_contact(to, add_body_contact(W, B, s, n, deep, c))
        add_body_friction(C, S, W, B, to, s)

    @wp.func
    def meet_place(C: Colliders, W: RodBodies, B: RodContacts, s: RodSpot, at: EdgePlace, ends: wp.float64, c: int):
        w = SOFT * s.radius
        deep = depth_beneath_ends(at.phi, ends, s.radius + C.thick[c], w)
        to = DeepestContact()
        if at.u > wp.float64(0.0) and deep > -w:
            to = add_body_contact(W, B, s, at.n, deep, c)
        return to

    @wp.func
    def meet_edge(C: Colliders, S: RodTable, Q: RodMotion, T: RodTrial, W: RodBodies, B: RodContacts, i: int, k: int):
        a = DeepestContact()
        b = DeepestContact()
        most = DeepestContact()
        less = DeepestContact()
        thick = wp.max(S.radius[i, k], S.radius[i + 1, k])
        for c in range(W.body.shape[0]):
            to = span(C, S, T, W, SOFT * thick, c, i, k)
            x = meet_place(C, W, B, strand_spot(S, Q, T, i, k, 1, to.a.u), to.a, to.ends, c)
            y = meet_place(C, W, B, strand_spot(S, Q, T, i, k, 2, to.b.u), to.b, to.ends, c)
            a = deeper_contact(a, x)
            b = deeper_contact(b, y)
            both = deeper_contact(x, y)
            both.N = x.N + y.N
            less = deeper_contact(less, both)
            if both.N > most.N:
                less = most
                most = both
        if less.N > wp.float64(0.0):
            a = most
            b = less
            if less.u < most.u:
                a = less
                b = most
        add_body_friction(C, S, W, B, a, strand_spot(S, Q, T, i, k, 1, a.u))
        add_body_friction(C, S, W, B, b, strand_spot(S, Q, T, i, k, 2, b.u))

    @wp.kernel(module=module, enable_backward=False)
    def meet_bodies(C: Colliders, S: RodTable, Q: RodMotion, T: RodTrial, W: RodBodies, B: RodContacts,
                    full: wp.array(dtype=int)):
        p = wp.tid()
        i = p / S.points.shape[0]
        k = p - i * S.points.shape[0]
        count = B.count[W.strand[k]]
        B.many[p] = 0
        for site in range(SITES):
            B.N[p, site] = wp.float64(0.0)
            B.s[p, site] = wp.vec3d()
            B.deep[p, site] = wp.float64(0.0)
            if count <= LATE or count % AGAIN == 0:
                B.load[p, site] = wp.float64(0.0)
        if i < S.points[k] and B.near[W.strand[k]] == 1 and is_own_point(S, i, k):
            if W.tied:
                add_body_tie(S, T, W, B, i, k)
            meet_point(C, S, Q, T, W, B, i, k)
            if i + 1 < S.points[k]:
                meet_edge(C, S, Q, T, W, B, i, k)
            if B.many[p] > B.body.shape[1]:
                wp.atomic_max(full, 0, B.many[p])

    @wp.kernel(module=module, enable_backward=False)
    def gather_bodies(S: RodTable, W: RodBodies, B: RodContacts, T: RodTrial):
        p = wp.tid()
        m = S.points.shape[0]
        i = p / m
        k = p - i * m
        one = wp.float64(1.0)
        f = wp.vec3d()
        K = wp.mat33d()
        X = wp.mat33d()
        if i < S.points[k] and B.near[W.strand[k]] == 1:
            for j in range(wp.min(B.many[p], B.body.shape[1])):
                u = B.u[p, j]
                f += B.f[p, j] * (one - u)
                K += B.K[p, j] * ((one - u) * (one - u))
                if u > wp.float64(0.0):
                    if S.hold[i, k] < 0 and S.hold[i + 1, k] < 0:
                        X += B.K[p, j] * (u * (one - u))
            if i > 0:
                for j in range(wp.min(B.many[p - m], B.body.shape[1])):
                    u = B.u[p - m, j]
                    f += B.f[p - m, j] * u
                    K += B.K[p - m, j] * (u * u)
        T.lift[i, k] = f
        T.firm[i, k] = K
        T.bridge[i, k] = X

    return meet_bodies, gather_bodies
