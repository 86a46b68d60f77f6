"""Contact of a strand's edges with colliders, between their points: the law of kernels/rods/contact.py at the place of an edge
where a collider is nearest, x_u = (1 - u) x_i + u x_i+1, with forces b f and stiffness b b^T K on both points, b = (1 - u, u).

    e = deep_u - w - max(-w, deep_i, deep_i+1) - chord,        deep = r - phi

What the points of an edge meet by themselves is not met twice: a strand that lies on a plane has no contact inside its edges,
and where a contact moves on from an edge to a point, forces do not jump. One whose points are clear has e = deep_u; but where a
shape turns evenly, by less than TURN along an edge, chord is its sagitta (below TURN^2 / 8 = 1/32 of the edge's length) and a
little more: a strand stands for a curve then, which its points hold, as those of hairs on a head.

As an edge turns u moves, to where phi' = n . (x_i+1 - x_i) is 0 again, and the force with it:

    K = N'(e) b b^T n n^T + N a a^T / phi'',   a = grad phi'                        (of an arc phi'' = L^2 / R)

of which hairs that land on a ball have five times as much as of their inertia. What is left out of the stiffness (of e all but
deep_u, of N grad grad phi what is below 0) leaves it symmetric and positive.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.mesh import SHEET, SOLID
from wsim.kernels.rods.contact import (
    FAR,
    FIRM,
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
    touching,
)
from wsim.kernels.rods.tables import Motion, Strands, Trial

ROUNDS = wp.constant(24)                     # of the search; 3 or 4 do on smooth shapes
NEAR = wp.constant(wp.float64(1e-8))         # of an edge's length, to which the least distance is known on smooth shapes
DRAWN = wp.constant(wp.float64(0.25))        # of its length: how far outside an edge that is pressed still is
ROUND = wp.constant(wp.float64(1e-6))
TURN = wp.constant(wp.float64(0.25))         # [rad] of a shape along an edge, from which on chords of it are not let in
FADE = wp.constant(wp.float64(5.0))          # from 1 - 1 / FADE of that on less and less
EVEN = wp.constant(wp.float64(1.125))         # of sagittas, which are those of parabolas
PIERCED = wp.constant(wp.float64(1e-3))      # of what is kept, within which an edge goes through a sheet: it has no side there


@wp.struct
class Lowest:
    """Place of an edge where a collider is nearest: u, 0 where that is an end or farther than asked; distance there [m] with
    its normal, its second derivative by u [m], the same place of the collider where the substep began; distances of both ends
    [m], and how much phi' changes between these [m]."""

    u: wp.float64
    phi: wp.float64
    round: wp.float64
    n: wp.vec3d
    before: wp.vec3d
    ends: wp.vec2d
    turn: wp.float64


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
def roll(to: Inside, n: wp.vec3d, d: wp.vec3d, u: wp.float64, N: wp.float64, bend: wp.float64):
    """`to` with what a normal force N gives as u moves: N a a^T / phi'', a = grad phi' = (-n + (1 - u) t, n + u t),
    t = d phi'' / |d|^2."""
    length = wp.length(d)
    bend = wp.max(bend, ROUND * length)
    t = d * (bend / (length * length))
    a0 = t * (wp.float64(1.0) - u) - n
    a1 = t * u + n
    k = N / bend
    to.K0 = to.K0 + wp.outer(a0, a0) * k
    to.K1 = to.K1 + wp.outer(a1, a1) * k
    to.K = to.K + wp.outer(a0, a1) * k
    return to


@wp.func
def between(u: wp.float64, a: wp.vec3d, b: wp.vec3d):
    return a + (b - a) * u


@wp.func
def mean(u: wp.float64, a: wp.float64, b: wp.float64):
    return a + (b - a) * u


@wp.func
def beneath(low: Lowest, r: wp.float64, w: wp.float64, length: wp.float64):
    """e of a place of an edge [m]. r: what is kept from the collider [m]; length: of the edge [m]."""
    part = wp.clamp(FADE * (wp.float64(1.0) - low.turn / (TURN * length)), wp.float64(0.0), wp.float64(1.0))
    sag = wp.float64(0.5) * low.turn * low.u * (wp.float64(1.0) - low.u)
    chord = part * (EVEN * sag + wp.min(sag, w + w))
    return r - low.phi - w - wp.max(-w, r - wp.min(low.ends[0], low.ends[1])) - chord


@cache
def inside(kinds: tuple[str, ...]) -> SimpleNamespace:
    """Functions lowest(C, c, at, a, b, reach) -> Lowest of the edge from a to b in the frame of a collider where a substep ends,
    which is nearer than reach [m]; touch(C, S, Q, T, hh, at, i, k) -> Inside of the edge behind a point in the substep at, hh: h^2,
    of which T.inside and T.bristle remember what lasts. kinds: of colliders.

    Signs of n . (b - a) lead there, from the middle: of a convex shape to its least distance, of a mesh with several bumps
    under one edge to that which the middle goes down to."""
    signed = touching(kinds).signed
    meshes = "solid" in kinds or "sheet" in kinds

    @wp.func
    def lowest(C: Colliders, c: int, at: int, a: wp.vec3d, b: wp.vec3d, reach: wp.float64):
        found = Lowest()
        one = wp.float64(1.0)
        half = wp.float64(0.5)
        d = b - a
        u = half
        phi, n, before = signed(C, c, at, a + d * u)
        g = wp.dot(n, d)
        fall = half * wp.abs(g)                                  # phi is convex in u
        if wp.static(meshes):
            if C.kind[c] >= SOLID:
                fall = half * wp.length(d)
        if phi - fall < reach:
            phi0, n0, _0 = signed(C, c, at, a)
            phi1, n1, _1 = signed(C, c, at, b)
            lo = wp.float64(0.0)
            hi = one
            g0 = wp.dot(n0, d)
            g1 = wp.dot(n1, d)
            going = g != wp.float64(0.0)
            if (g > wp.float64(0.0) and g0 >= wp.float64(0.0)) or (g < wp.float64(0.0) and g1 <= wp.float64(0.0)):
                going = False
                phi = FAR
            count = int(0)
            slope = g1 - g0
            bend = slope
            while going:
                if g > wp.float64(0.0):
                    hi = u
                    g1 = g
                else:
                    lo = u
                    g0 = g
                slope = (g1 - g0) / (hi - lo)
                edge = (hi - lo) * wp.float64(0.02)
                if count % 4 == 3:                               # a corner: the straight line between signs is none
                    edge = (hi - lo) * half
                u = wp.clamp(lo - g0 / slope, lo + edge, hi - edge)
                phi, n, before = signed(C, c, at, a + d * u)
                g = wp.dot(n, d)
                count += 1
                slope = wp.where(g > wp.float64(0.0), (g - g0) / (u - lo), (g1 - g) / (hi - u))
                going = count < ROUNDS and half * g * g > NEAR * slope * wp.length(d)
            if wp.static("sheet" in kinds):
                if C.kind[c] == SHEET and phi < PIERCED * reach:
                    phi = FAR
            if phi < reach:
                more = wp.float64(0.0)                           # as straight as g is here, b is right to second order
                if slope > wp.float64(0.0):
                    more = wp.clamp(-g / slope, lo - u, hi - u)
                found.u = u + more
                found.phi = phi + half * g * more
                found.n = n
                found.round = slope
                found.before = before + d * more
                found.ends = wp.vec2d(phi0, phi1)
                found.turn = bend
        return found

    @wp.func
    def touch(C: Colliders, S: Strands, Q: Motion, T: Trial, hh: wp.float64, at: int, i: int, k: int):
        """The law of `kernels.rods.contact.touching`, with u of each collider. Rows of edges stand behind those of points."""
        found = Inside()
        t = Touch()
        side = Side()
        side.deep = -FAR
        best = wp.float64(0.0)                                   # u there
        bend = wp.float64(0.0)
        zero = wp.float64(0.0)
        x0 = T.x[i, k] + S.origin[k]
        x1 = T.x[i + 1, k] + S.origin[k]
        thick = wp.max(S.radius[i, k], S.radius[i + 1, k])
        row = T.x.shape[0] + i
        length = wp.length(x1 - x0)
        for c in range(C.kind.shape[0]):
            back = C.back[at + 1, c]
            reach = (SOFT + wp.float64(1.0)) * thick + C.thick[c]
            if T.hit:
                if T.load[row, k] > zero:                        # it is drawn back as points are
                    reach = reach + DRAWN * length
            low = lowest(C, c, at, wp.transform_point(back, x0), wp.transform_point(back, x1), reach)
            u = low.u
            if u > zero:
                r = mean(u, S.radius[i, k], S.radius[i + 1, k])
                stiff = wp.max(STIFF * mean(u, S.m[i, k], S.m[i + 1, k]) / hh, FIRM * S.A[i, k])
                deep = beneath(low, r + C.thick[c], SOFT * r, length)
                N, slope = press(stiff, SOFT * r, deep)
                n = wp.transform_vector(C.frame[at + 1, c], low.n)
                if N > t.N or (t.N == zero and deep > side.deep):
                    best = u
                    bend = low.round
                    side.c = c
                    side.n = n
                    side.deep = deep
                    side.slid = (between(u, T.x[i, k] - Q.x[i, k], T.x[i + 1, k] - Q.x[i + 1, k])
                                 - (between(u, x0, x1) - wp.transform_point(C.frame[at, c], low.before)))
                    side.hit = wp.vec4d(n[0] * slope, n[1] * slope, n[2] * slope, N)
                if N > zero:
                    found = spread(found, n * N, wp.outer(n, n) * slope, u)
                    t.N = wp.max(t.N, N)
        N = t.N
        s = Q.edge_stick[i, k] + side.slid
        lean = wp.vec3d()
        r = mean(best, S.radius[i, k], S.radius[i + 1, k])
        m = mean(best, S.m[i, k], S.m[i + 1, k])
        stiff = wp.max(STIFF * m / hh, FIRM * S.A[i, k])
        if T.hit:
            if best == zero:
                forget(T, row, k)
                side.hit = wp.vec4d()
            t, N = pressed(T, t, side, stiff, SOFT * r, row, k)
            lean = T.lean[row, k]
            T.slip[row, k] = (s - side.n * wp.dot(side.n, s)) * wp.where(N > zero, wp.float64(1.0), zero)
        if N > zero:
            found = roll(found, side.n, x1 - x0, best, N, bend)
            N = bound(Q.edge_load[i, k], m, between(best, Q.v[i, k], Q.v[i + 1, k]), S.gravity[k], side.n, N, hh)
            t = rub(t, side.n, s, N, stiff, C.friction[side.c, k], lean)
        found = spread(found, t.f, t.K, best)
        T.inside[i, k] = wp.vec3d(best, wp.max(t.N, zero), wp.where(t.N > zero, side.deep, zero))
        T.bristle[i, k] = t.s
        return found

    return SimpleNamespace(lowest=lowest, touch=touch, name="_".join(kinds))
