"""Places of a strand's edge where a shape that moves freely is met between its ends.

    s(u) = n . t at x_u = (1 - u) a + u b        n: normal of the shape there, t: direction of the edge
    u0, u1: s = -TURN, s = TURN                  beside where the shape is nearest, s = 0 (phi is convex in u: s grows)

A face that lies on an edge is met at both of its ends, as bodies are by the corners of theirs: nearest is one or the other, as
it is tilted, and a body that rests on the one place would tip to and fro. On what is round both are TURN R apart from the
nearest place, and TURN^2 R / 2 farther. As the edge moves along itself the places stay on the shape: forces are across it, of
n - s t. There are none where the shape is nearest at an end; of a mesh with several bumps under one edge those are found that
the middle leads to.

    e = deep_u - w - max(-w, deep_a, deep_b)     deep = r - phi: what the points of an edge do not meet by themselves

A strand that lies flat has no contact within its edges; one whose points are clear has e = deep_u; and where a contact moves on
from an edge to a point, forces do not jump. What the maximum changes by moves is left out of the stiffness, which stays
symmetric and positive.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.contact.mesh import SHEET, SOLID
from wsim.kernels.rods.contact import FAR, Colliders, touching

TURN = wp.constant(wp.float64(0.1))          # more, and places on a ball are shallow; less, and thin faces have but one
ROUNDS = wp.constant(48)                     # of a search, every other one halves what is left; 5 to 8 do on smooth shapes
NEAR = wp.constant(wp.float64(1e-8))         # u is known to this, or s to ten times this
PIERCED = wp.constant(wp.float64(1e-3))      # of what is kept, within which an edge goes through a sheet: it has no side there


@wp.struct
class Flank:
    """A place: u, 0 where there is none; distance there [m], normal across the edge."""

    u: wp.float64
    phi: wp.float64
    n: wp.vec3d


@wp.struct
class Flanks:
    """Both places of an edge, and the least distance of its ends [m]."""

    a: Flank
    b: Flank
    ends: wp.float64


@wp.func
def mean(u: wp.float64, a: wp.float64, b: wp.float64):
    return a + (b - a) * u


@wp.func
def beneath(phi: wp.float64, ends: wp.float64, r: wp.float64, w: wp.float64):
    """e of a place [m]. r: what is kept from the shape [m]."""
    return r - phi - w - wp.max(-w, r - ends)


@cache
def flanking(kinds: tuple[str, ...]):
    """Function (C, c, a, b, reach) -> `Flanks` of the edge from a to b in the frame of a shape, those that are nearer than
    reach [m]. kinds: of shapes, which C has as colliders without frames."""
    signed = touching(kinds).signed
    meshes = "solid" in kinds or "sheet" in kinds

    @wp.func
    def flank(C: Colliders, c: int, a: wp.vec3d, d: wp.vec3d, reach: wp.float64, cut: wp.vec4d, turn: wp.float64):
        """The place where s is turn. cut: u below, s there, u above, s there."""
        found = Flank()
        t = wp.normalize(d)
        half = wp.float64(0.5)
        u = half
        phi = FAR
        n = wp.vec3d()
        lo = cut[0]
        hi = cut[2]
        g0 = cut[1] - turn
        g1 = cut[3] - turn
        g = g1
        count = int(0)
        while count < ROUNDS and hi - lo > NEAR and wp.abs(g) > wp.float64(10.0) * NEAR:
            u = half * (lo + hi)
            if count % 2 == 0:
                edge = (hi - lo) * wp.float64(0.05)
                u = wp.clamp(lo - g0 * (hi - lo) / (g1 - g0), lo + edge, hi - edge)
            phi, n, _ = signed(C, c, 0, a + d * u)
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
            found.u = u
            found.phi = phi
            found.n = wp.normalize(n - t * wp.dot(n, t))
        return found

    @wp.func
    def flanks(C: Colliders, c: int, a: wp.vec3d, b: wp.vec3d, reach: wp.float64):
        found = Flanks()
        zero = wp.float64(0.0)
        one = wp.float64(1.0)
        half = wp.float64(0.5)
        d = b - a
        t = wp.normalize(d)
        phi, n, _ = signed(C, c, 0, a + d * half)
        s = wp.dot(n, t)
        fall = half * wp.abs(s)                                  # phi is convex in u
        if wp.static(meshes):
            if C.kind[c] >= SOLID:
                fall = half
        if phi - fall * wp.length(d) < reach:
            phi0, n0, _0 = signed(C, c, 0, a)
            phi1, n1, _1 = signed(C, c, 0, b)
            s0 = wp.dot(n0, t)
            s1 = wp.dot(n1, t)
            found.ends = wp.min(phi0, phi1)
            if s0 < -TURN and s1 >= -TURN:
                if s >= -TURN:
                    found.a = flank(C, c, a, d, reach, wp.vec4d(zero, s0, half, s), -TURN)
                else:
                    found.a = flank(C, c, a, d, reach, wp.vec4d(half, s, one, s1), -TURN)
            if s0 <= TURN and s1 > TURN:
                if s > TURN:
                    found.b = flank(C, c, a, d, reach, wp.vec4d(zero, s0, half, s), TURN)
                else:
                    found.b = flank(C, c, a, d, reach, wp.vec4d(half, s, one, s1), TURN)
        return found

    return flanks
