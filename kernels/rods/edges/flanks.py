"""Places of a strand's edge where a shape is met between the edge's points.

    s(u) = n . t at x_u = (1 - u) a + u b        n: normal of the shape nearest to there, t: direction of the edge
    u0, u1: s = -TURN, s = TURN                  beside where the shape is nearest, s = 0 (phi is convex in u: s grows)

A face that lies on an edge is met at both of its ends, as bodies are by their corners: nearest is one or the other, as it is
tilted. A shape that turns by less than 2 TURN along an edge has no such places: strands are curves, which their points hold,
and chords sink by L^2 / (8 R), less than L / 40 then. There are none where the shape is nearest at an end; of a mesh with
several bumps under one edge those are found that the middle leads to.

As an edge turns a place moves along it, to where s is TURN again, and phi changes as at y = u + TURN / s', towards the other
place: the corner itself where that is sharp, and on what is round the nearest place, for both. Forces are those at y, and
across the edge: a place does not follow as the edge moves along itself.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.mesh import SHEET, SOLID
from wsim.kernels.rods.contact import FAR, Colliders, touching

TURN = wp.constant(wp.float64(0.1))          # more, and places on a ball are shallow; less, and thin faces have but one
ROUNDS = wp.constant(48)                     # of a search, every other one halves what is left; 3 to 6 do on smooth shapes
NEAR = wp.constant(wp.float64(1e-9))         # u is known to this
STRAIGHT = wp.constant(wp.float64(1e-3))     # or s to this, and u then by its slope, to second order
ASIDE = wp.constant(wp.float64(1e-3))        # of an edge, by which its slope is known
PIERCED = wp.constant(wp.float64(1e-3))      # of what is kept, within which an edge goes through a sheet: it has no side there


@wp.struct
class Flank:
    """A place: u, 0 where there is none; distance there [m], its normal made one across the edge, the slope of s, the same
    place of the collider where the substep began, and y."""

    u: wp.float64
    phi: wp.float64
    n: wp.vec3d
    slope: wp.float64
    before: wp.vec3d
    y: wp.float64


@wp.struct
class Flanks:
    """Both places of an edge, and the least distance of its ends [m]."""

    a: Flank
    b: Flank
    ends: wp.float64


@cache
def flanking(kinds: tuple[str, ...]) -> SimpleNamespace:
    """Functions (C, c, at, a, b, reach) of the edge from a to b in the frame of a collider where a substep ends: flanks, its
    `Flanks` that are nearer than reach [m]; turns, whether one may be nearer than
    its ends. kinds: of colliders."""
    signed = touching(kinds).signed

    @wp.func
    def flank(C: Colliders, c: int, at: int, a: wp.vec3d, d: wp.vec3d, reach: wp.float64, cut: wp.vec4d, turn: wp.float64):
        """The place where s is turn. cut: u below, s there, u above, s there."""
        found = Flank()
        length = wp.length(d)
        t = d / length
        half = wp.float64(0.5)
        lo = cut[0]
        hi = cut[2]
        g0 = cut[1] - turn
        g1 = cut[3] - turn
        u = hi
        g = g1
        phi = FAR
        n = wp.vec3d()
        before = wp.vec3d()
        count = int(0)
        while count < ROUNDS and hi - lo > NEAR and (count == 0 or wp.abs(g) > STRAIGHT):
            u = half * (lo + hi)
            if count % 2 == 0:
                edge = (hi - lo) * wp.float64(0.02)
                u = wp.clamp(lo - g0 * (hi - lo) / (g1 - g0), lo + edge, hi - edge)
            phi, n, before = signed(C, c, at, a + d * u)
            g = wp.dot(n, t) - turn
            if g >= wp.float64(0.0):
                hi = u
                g1 = g
            else:
                lo = u
                g0 = g
            count += 1
        if wp.static("sheet" in kinds):
            if C.kind[c] == SHEET and phi < PIERCED * reach:
                phi = FAR
        if phi < reach:
            beside = u + wp.sign(turn) * ASIDE
            _, m, _0 = signed(C, c, at, a + d * beside)
            slope = wp.max((wp.dot(m, t) - turn - g) / (beside - u), wp.float64(2.0) * TURN)
            more = wp.clamp(-g / slope, lo - u, hi - u)
            found.u = u + more
            found.phi = phi + turn * length * more
            found.n = wp.normalize(n - t * wp.dot(n, t))
            found.slope = slope
            found.before = before + d * more
            found.y = found.u - turn / slope
        return found

    @wp.func
    def turns(C: Colliders, c: int, at: int, a: wp.vec3d, b: wp.vec3d, reach: wp.float64):
        d = b - a
        length = wp.length(d)
        t = d / length
        phi0, n, _ = signed(C, c, at, a)
        s0 = wp.dot(n, t)
        mesh = C.kind[c] >= SOLID
        if (s0 >= wp.float64(0.0) and not mesh) or phi0 - length >= reach:
            return False
        phi1, m, _1 = signed(C, c, at, b)
        s1 = wp.dot(m, t)
        if s1 <= TURN and (s0 >= -TURN or s1 < -TURN):
            return False
        least = wp.float64(0.5) * (phi0 + phi1 - length)
        if not mesh:                                             # phi is convex: above its tangents
            if s1 <= wp.float64(0.0):
                return False
            least = phi0 + s0 * (phi0 - phi1 + s1 * length) / (s1 - s0)
        return least < wp.min(reach, wp.min(phi0, phi1))

    @wp.func
    def flanks(C: Colliders, c: int, at: int, a: wp.vec3d, b: wp.vec3d, reach: wp.float64):
        found = Flanks()
        zero = wp.float64(0.0)
        one = wp.float64(1.0)
        half = wp.float64(0.5)
        d = b - a
        length = wp.length(d)
        t = d / length
        phi, n, _ = signed(C, c, at, a + d * half)
        s = wp.dot(n, t)
        fall = half * wp.where(C.kind[c] >= SOLID, one, wp.abs(s))
        if phi - fall * length >= reach:
            return found
        phi0, n0, _0 = signed(C, c, at, a)
        phi1, n1, _1 = signed(C, c, at, b)
        s0 = wp.dot(n0, t)
        s1 = wp.dot(n1, t)
        found.ends = wp.min(phi0, phi1)
        if s0 < -TURN and s1 >= -TURN:
            low = wp.vec4d(zero, s0, half, s)
            if s < -TURN:
                low = wp.vec4d(half, s, one, s1)
            found.a = flank(C, c, at, a, d, reach, low, -TURN)
        if s0 <= TURN and s1 > TURN:
            high = wp.vec4d(half, s, one, s1)
            if s > TURN:
                high = wp.vec4d(zero, s0, half, s)
            found.b = flank(C, c, at, a, d, reach, high, TURN)
        if found.a.u > zero and found.b.u > zero:
            middle = half * (found.a.u + found.b.u)
            found.a.y = wp.min(found.a.y, middle)
            found.b.y = wp.max(found.b.y, middle)
        found.a.y = wp.min(found.a.y, one)
        found.b.y = wp.max(found.b.y, zero)
        return found

    return SimpleNamespace(flanks=flanks, turns=turns)
