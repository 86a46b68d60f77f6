"""Places of a strand's edge where a shape is met between the edge's points.

    s(u) = n . t at x_u = (1 - u) a + u b        n: normal of the shape nearest to there, t: direction of the edge
    u0: s = -(TURN + GIVE u)                     beside where the shape is nearest, s = 0 (phi is convex in u: s grows)
    u1: s = TURN + GIVE (1 - u)

A face that lies on an edge is met at both of its ends, as bodies are by their corners: nearest is one or the other, as it is
tilted. s is the same all along a face; because what a place asks of s is less farther on, it goes over a face as that is tilted
from one corner to the other, and forces with it. With the same s for all u it jumped there, and no solution was: of 1280 frames
of nets under bodies 20 were left so, by up to 0.16 of an edge.

A round shape that turns by less than 2 TURN along an edge has no such places nearer than the edge's ends, and is met by these
alone: strands are curves, which their points hold, and chords sink by L^2 / (8 R), less than L / 80 then. There are none where
the shape is nearest at an end; of a mesh with several bumps under one edge those are found that the middle leads to.

As an edge turns a place moves along it, to where s is what it asks for again, and phi changes as at y = u - s / (s' + GIVE),
towards the other place: the corner itself where that is sharp, and on what is round the nearest place, for both. Forces are
those at y, and across the edge: a place does not follow as the edge moves along itself.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.mesh import SHEET, SOLID
from wsim.kernels.rods.contact import FAR, Colliders, strand_touch_functions

TURN = wp.constant(wp.float64(0.05))         # more, and places on a ball are shallow; less, and thin faces have but one
GIVE = wp.constant(wp.float64(0.1))          # half of it, and twice as many frames of nets under bodies were left unsolved
ROUNDS = wp.constant(48)                     # of a search, each fourth halves what is left; 3 to 6 do on smooth shapes
NEAR = wp.constant(wp.float64(1e-9))         # u is known to this
STRAIGHT = wp.constant(wp.float64(1e-6))     # or s to this; 1e-3, and normals jump by as much between iterations
EDGE = wp.constant(wp.float64(1e-3))         # part of what is left that a search takes off at least
ASIDE = wp.constant(wp.float64(1e-3))        # of an edge, by which its slope is known
PIERCED = wp.constant(wp.float64(1e-3))      # of what is kept, within which an edge goes through a sheet: it has no side there


@wp.func
def wanted_edge_slope(side: wp.float64, u: wp.float64):
    """s of a place at u. side: -1 of the first, 1 of the second."""
    half = wp.float64(0.5)
    return side * (TURN + half * GIVE) + GIVE * (half - u)


@wp.struct
class EdgePlace:
    """A place: u, 0 where there is none; distance there [m], its normal made one across the edge, the slope of s, the same
    place of the collider where the substep began, and y."""

    u: wp.float64
    phi: wp.float64
    n: wp.vec3d
    slope: wp.float64
    before: wp.vec3d
    y: wp.float64


@wp.struct
class EdgePlaces:
    """Both places of an edge, and the least distance of its ends [m]."""

    a: EdgePlace
    b: EdgePlace
    ends: wp.float64


@cache
def edge_flank_functions(kinds: tuple[str, ...]) -> SimpleNamespace:
    """Functions (C, c, at, a, b, reach) of the edge from a to b in the frame of a collider where a substep ends: flanks, its
    `EdgePlaces` that are nearer than reach [m]; turns, whether one may be nearer than its ends. kinds: of colliders."""
    signed = strand_touch_functions(kinds).signed

    @wp.func
    def search_edge_flank(C: Colliders, c: int, at: int, a: wp.vec3d, d: wp.vec3d, reach: wp.float64, cut: wp.vec4d,
                          side: wp.float64):
        """A place, by regula falsi (Dowell, Jarratt 1971): u, distance, normal, place before; slope: by what s is off there. It
        is given up where no place is nearer than reach. cut: u below, s there, u above, s there."""
        found = EdgePlace()
        length = wp.length(d)
        half = wp.float64(0.5)
        lo = cut[0]
        hi = cut[2]
        g0 = cut[1] - wanted_edge_slope(side, lo)
        g1 = cut[3] - wanted_edge_slope(side, hi)
        found.phi = FAR
        count = int(0)
        last = int(0)
        while count < ROUNDS and hi - lo > NEAR and (count == 0 or wp.abs(found.slope) > STRAIGHT):
            edge = (hi - lo) * EDGE
            u = wp.clamp(lo - g0 * (hi - lo) / (g1 - g0), lo + edge, hi - edge)
            if count % 4 == 3:
                u = half * (lo + hi)
            phi, n, before = signed(C, c, at, a + d * u)
            s = wp.dot(n, d) / length
            g = s - wanted_edge_slope(side, u)
            found.u = u
            found.phi = phi
            found.n = n
            found.before = before
            found.slope = g
            if g >= wp.float64(0.0):
                hi = u
                g1 = g
                g0 = g0 * wp.where(last > 0, half, half + half)
                last = 1
            else:
                lo = u
                g0 = g
                g1 = g1 * wp.where(last < 0, half, half + half)
                last = -1
            count += 1
            fall = wp.where(C.kind[c] >= SOLID, half + half, wp.abs(s))
            if phi - fall * length * (hi - lo) > reach:
                return EdgePlace()
        return found

    @wp.func
    def find_edge_flank(C: Colliders, c: int, at: int, a: wp.vec3d, d: wp.vec3d, reach: wp.float64, cut: wp.vec4d,
                        side: wp.float64):
        found = search_edge_flank(C, c, at, a, d, reach, cut, side)
        pierced = C.kind[c] == SHEET and found.phi < PIERCED * reach
        if found.u == wp.float64(0.0) or found.phi >= reach or pierced:
            return EdgePlace()
        t = wp.normalize(d)
        beside = found.u + side * ASIDE
        _, m, _0 = signed(C, c, at, a + d * beside)
        g = wp.dot(m, t) - wanted_edge_slope(side, beside)
        slope = wp.max((g - found.slope) / (beside - found.u), GIVE)
        found.n = wp.normalize(found.n - t * wp.dot(found.n, t))
        found.slope = slope
        found.y = found.u - wanted_edge_slope(side, found.u) / slope
        return found

    @wp.func
    def edge_turns_inward(C: Colliders, c: int, at: int, a: wp.vec3d, b: wp.vec3d, reach: wp.float64):
        d = b - a
        zero = wp.float64(0.0)
        one = wp.float64(1.0)
        length = wp.length(d)
        t = d / length
        phi0, n, _ = signed(C, c, at, a)
        s0 = wp.dot(n, t)
        mesh = C.kind[c] >= SOLID
        if (s0 >= zero and not mesh) or phi0 - length >= reach:
            return False
        phi1, m, _1 = signed(C, c, at, b)
        s1 = wp.dot(m, t)
        if s1 <= wanted_edge_slope(one, one) and (s0 >= wanted_edge_slope(-one, zero) or s1 < wanted_edge_slope(-one, one)):
            return False
        least = wp.float64(0.5) * (phi0 + phi1 - length)
        if not mesh:                                             # phi is convex: above its tangents
            if s1 <= zero:
                return False
            least = phi0 + s0 * (phi0 - phi1 + s1 * length) / (s1 - s0)
        return least < wp.min(reach, wp.min(phi0, phi1))

    @wp.func
    def find_both_flanks(C: Colliders, c: int, at: int, a: wp.vec3d, b: wp.vec3d, reach: wp.float64):
        found = EdgePlaces()
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
        if s0 < wanted_edge_slope(-one, zero) and s1 >= wanted_edge_slope(-one, one):
            low = wp.vec4d(zero, s0, half, s)
            if s < wanted_edge_slope(-one, half):
                low = wp.vec4d(half, s, one, s1)
            found.a = find_edge_flank(C, c, at, a, d, reach, low, -one)
        if s0 <= wanted_edge_slope(one, zero) and s1 > wanted_edge_slope(one, one):
            high = wp.vec4d(half, s, one, s1)
            if s > wanted_edge_slope(one, half):
                high = wp.vec4d(zero, s0, half, s)
            found.b = find_edge_flank(C, c, at, a, d, reach, high, one)
        if found.a.u > zero and found.b.u > zero:
            middle = half * (found.a.u + found.b.u)
            found.a.y = wp.min(found.a.y, middle)
            found.b.y = wp.max(found.b.y, middle)
        found.a.y = wp.min(found.a.y, one)
        found.b.y = wp.max(found.b.y, zero)
        return found

    return SimpleNamespace(flanks=find_both_flanks, turns=edge_turns_inward)
