"""Contact of a strand's edges with colliders, between their points: the law of kernels/rods/contact.py at two places of an edge
(kernels/rods/edges/flanks.py), with forces b f on its points and stiffness b b^T K, b = (1 - y, y).

    e = deep_u - w - max(-w, deep_i, deep_i+1)         deep = r - phi: what the points of an edge do not meet by themselves

A strand that lies on a plane has no contact inside its edges; one whose points are clear has e = deep_u; and where a contact
moves on from an edge to a point, forces do not jump. As an edge turns its places move, and forces with them:

    K = N'(e) b b^T n n^T + N a a^T / phi'',   a = grad phi' = (-n + (1 - y) t phi'' / L, n + y t phi'' / L),   phi'' = L s'

of which hairs that land on a ball with points as far apart as a fifth of its radius had five times as much as of inertia. What
is left out of the stiffness (of e what the maximum changes by moves, of N grad grad phi what is below 0) leaves it symmetric
and positive.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from wsim.kernels.rods.contact import (
    CLEAR,
    FAR,
    FIRM,
    MET,
    SOFT,
    STIFF,
    Colliders,
    Side,
    Touch,
    bound,
    forget,
    press,
    pressed,
    rub,
)
from wsim.kernels.rods.edges.flanks import Flank, flanking
from wsim.kernels.rods.tables import Motion, Strands, Trial

DRAWN = wp.constant(wp.float64(0.25))        # of its length: how far outside an edge that is pressed still is


@wp.struct
class Inside:
    """Forces of colliders on both points of an edge, and their stiffness: of each, and between them."""

    f0: wp.vec3d
    f1: wp.vec3d
    K0: wp.mat33d
    K1: wp.mat33d
    K: wp.mat33d


@wp.func
def spread(to: Inside, f: wp.vec3d, K: wp.mat33d, u: wp.float64):
    """`to` with a force at a place of the edge, and its stiffness."""
    v = wp.float64(1.0) - u
    to.f0 = to.f0 + f * v
    to.f1 = to.f1 + f * u
    to.K0 = to.K0 + K * (v * v)
    to.K1 = to.K1 + K * (u * u)
    to.K = to.K + K * (u * v)
    return to


@wp.func
def roll(to: Inside, n: wp.vec3d, d: wp.vec3d, y: wp.float64, N: wp.float64, slope: wp.float64):
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
def between(u: wp.float64, a: Any, b: Any):
    """What is a at a point and b at the next, numbers or vectors, at the part u of the edge."""
    return a + (b - a) * u


@wp.func
def beneath(phi: wp.float64, ends: wp.float64, r: wp.float64, w: wp.float64):
    """e of a place of an edge [m]. ends: least distance of its points; r: what is kept from the collider [m]."""
    return r - phi - w - wp.max(-w, r - ends)


@wp.struct
class Site:
    """One of both places of an edge in all colliders: the deepest one, its normal force [N], y and the slope of s."""

    side: Side
    N: wp.float64
    y: wp.float64
    slope: wp.float64


@wp.struct
class Edge:
    """The edge behind point i of strand k in the substep at, hh: h^2 [s^2]; ends: least distance of its points [m]."""

    i: int
    k: int
    at: int
    hh: wp.float64
    ends: wp.float64


@cache
def inside(kinds: tuple[str, ...]) -> SimpleNamespace:
    """Functions of the edge behind a point in the substep at: clear(C, S, T, at, i, k) -> True where it touches nothing, as its
    ends say, which T.edge remembers; else touch(C, S, Q, T, hh, at, i, k) -> Inside, hh: h^2, of which T.inside and T.bristle
    remember what lasts. kinds: of colliders.

    Rows of T that edges have of their first places stand behind those of points, of their second behind these."""
    flanks, turns = flanking(kinds).flanks, flanking(kinds).turns

    @wp.func
    def stiffness(S: Strands, hh: wp.float64, y: wp.float64, i: int, k: int):
        return wp.max(STIFF * between(y, S.m[i, k], S.m[i + 1, k]) / hh, FIRM * S.A[i, k])

    @wp.func
    def meet(C: Colliders, S: Strands, Q: Motion, T: Trial, to: Site, at: Flank, E: Edge, c: int):
        """The site with a place in a collider."""
        i = E.i
        k = E.k
        now = E.at
        zero = wp.float64(0.0)
        y = at.y
        r = between(y, S.radius[i, k], S.radius[i + 1, k])
        deep = beneath(at.phi, E.ends, r + C.thick[c], SOFT * r)
        N, slope = press(stiffness(S, E.hh, y, i, k), SOFT * r, deep)
        if N > to.N or (to.N == zero and deep > to.side.deep):
            x = between(y, T.x[i, k], T.x[i + 1, k])
            q = at.before + wp.transform_vector(C.back[now + 1, c], T.x[i + 1, k] - T.x[i, k]) * (y - at.u)
            n = wp.transform_vector(C.frame[now + 1, c], at.n)
            to.y = y
            to.slope = at.slope
            to.side.c = c
            to.side.n = n
            to.side.deep = deep
            to.side.slid = (x - between(y, Q.x[i, k], Q.x[i + 1, k])) - (
                x + S.origin[k] - wp.transform_point(C.frame[now, c], q))
            to.side.hit = wp.vec4d(n[0] * slope, n[1] * slope, n[2] * slope, N)
            to.N = N
        return to, N, slope

    @wp.func
    def end(C: Colliders, S: Strands, Q: Motion, T: Trial, found: Inside, to: Site, E: Edge, which: int):
        """The edge with what lasts of a site, and friction with the collider that it is deepest in."""
        i = E.i
        k = E.k
        zero = wp.float64(0.0)
        row = T.x.shape[0] * (1 + which) + i
        N = to.N
        t = Touch()
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
        stiff = stiffness(S, E.hh, y, i, k)
        if T.hit:
            if to.slope == zero:
                forget(T, row, k)
            t, N = pressed(T, t, to.side, stiff, SOFT * between(y, S.radius[i, k], S.radius[i + 1, k]), row, k)
            lean = T.lean[row, k]
            T.slip[row, k] = (s - n * wp.dot(n, s)) * wp.where(N > zero, wp.float64(1.0), zero)
        if N > zero:
            found = roll(found, n, T.x[i + 1, k] - T.x[i, k], y, N, to.slope)
            m = between(y, S.m[i, k], S.m[i + 1, k])
            N = bound(before, m, between(y, Q.v[i, k], Q.v[i + 1, k]), S.gravity[k], n, N, E.hh)
            t = rub(t, n, s, N, stiff, C.friction[to.side.c, k], lean)
        T.bristle[row, k] = t.s
        T.inside[row, k] = wp.vec3d(y, wp.max(to.N, zero), wp.where(to.N > zero, to.side.deep, zero))
        return spread(found, t.f, t.K, y)

    @wp.func
    def clear(C: Colliders, S: Strands, T: Trial, at: int, i: int, k: int):
        had = T.edge[i, k]
        if had == MET:
            if not T.hit:
                return False
            row = T.x.shape[0] + i
            if wp.abs(T.load[row, k]) + wp.abs(T.load[row + T.x.shape[0], k]) > wp.float64(0.0):
                return False
        x0 = T.x[i, k] + S.origin[k]
        x1 = T.x[i + 1, k] + S.origin[k]
        reach = (SOFT + wp.float64(1.0)) * wp.max(S.radius[i, k], S.radius[i + 1, k])
        for c in range(C.kind.shape[0]):
            back = C.back[at + 1, c]
            if turns(C, c, at, wp.transform_point(back, x0), wp.transform_point(back, x1), reach + C.thick[c]):
                return False
        if had != CLEAR:
            T.edge[i, k] = CLEAR
        return True

    @wp.func
    def fill(T: Trial, had: int, i: int, k: int):
        """Rows of an edge that has none yet: as `forget` leaves them, or as an iteration that found nothing."""
        if T.hit:
            for which in range(1, 3):
                row = T.x.shape[0] * which + i
                forget(T, row, k)
                if had == CLEAR:
                    T.slip[row, k] = wp.vec3d()

    @wp.func
    def touch(C: Colliders, S: Strands, Q: Motion, T: Trial, hh: wp.float64, at: int, i: int, k: int):
        found = Inside()
        E = Edge()
        E.i = i
        E.k = k
        E.at = at
        E.hh = hh
        first = Site()
        second = Site()
        first.side.deep = -FAR
        second.side.deep = -FAR
        zero = wp.float64(0.0)
        x0 = T.x[i, k] + S.origin[k]
        x1 = T.x[i + 1, k] + S.origin[k]
        had = T.edge[i, k]
        now = CLEAR
        reach = (SOFT + wp.float64(1.0)) * wp.max(S.radius[i, k], S.radius[i + 1, k])
        if T.hit and had == MET:
            row = T.x.shape[0] + i
            if T.load[row, k] > zero or T.load[row + T.x.shape[0], k] > zero:    # it is drawn back as points are
                reach = reach + DRAWN * wp.length(x1 - x0)
        for c in range(C.kind.shape[0]):
            back = C.back[at + 1, c]
            both = flanks(C, c, at, wp.transform_point(back, x0), wp.transform_point(back, x1), reach + C.thick[c])
            E.ends = both.ends
            if both.a.u + both.b.u > zero and now == CLEAR:
                now = MET
                if had != MET:
                    fill(T, had, i, k)
            if both.a.u > zero:
                first, N, slope = meet(C, S, Q, T, first, both.a, E, c)
                n = wp.transform_vector(C.frame[at + 1, c], both.a.n)
                found = spread(found, n * N, wp.outer(n, n) * slope, both.a.y)
            if both.b.u > zero:
                second, N2, slope2 = meet(C, S, Q, T, second, both.b, E, c)
                n2 = wp.transform_vector(C.frame[at + 1, c], both.b.n)
                found = spread(found, n2 * N2, wp.outer(n2, n2) * slope2, both.b.y)
        if now != had:
            T.edge[i, k] = now
        if now == MET or had == MET:
            found = end(C, S, Q, T, found, first, E, 0)
            found = end(C, S, Q, T, found, second, E, 1)
        return found

    return SimpleNamespace(clear=clear, touch=touch, name="_".join(kinds))
