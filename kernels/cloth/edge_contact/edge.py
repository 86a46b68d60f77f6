"""Where an edge of a sheet is nearest to a collider.

phi, the signed distance of a convex collider, is convex along an edge. Its least value lies where the tangents of both ends
meet, or above (Kelley 1960, The cutting-plane method for solving convex programs). The search ends where phi is that low. Both
tangents have normals n0, n1 with slopes a0 < 0 < a1 along the edge, and m = (a1 n0 - a0 n1) / (a1 - a0) is across the edge and
across the collider's edge: the normal of the contact is m / |m|, and inside the collider its gap is phi / |m|.

Assumes convex shapes; of meshes, that what is near an edge is convex.
"""

# Device code: int(0) makes a variable of what would be a constant, and an outer `if` on a Python bool drops its branch
# before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.contact.collide import split_convex_and_meshes
from wsim.kernels.contact.collider.shape import convex_distance_func
from wsim.kernels.contact.mesh import (
    INSIDE,
    SOLID,
    corner_readers,
    feature_distance,
    nearest_face_func,
    nearest_feature,
    triangle_normal,
)
from wsim.kernels.math.real import types

AWAY = 1.0e30          # [m] of what is too far to touch
ROUNDS = 8             # of the search along an edge; 1 to 3 do on flat faces
EXACT = 1.0e-3         # of an edge's length: how near the least phi is known


@cache
def edge_distance_function(kinds: tuple[str, ...], real):
    """Function (kind, size, mesh, q, most) -> (phi, n, slip): signed distance [m], its gradient and the motion of the surface
    in its own frame in this substep [m]; AWAY where a mesh is farther than `most`."""
    t, (convex, meshes) = types(real), split_convex_and_meshes(kinds)
    shaped, meshed, formula = bool(convex), "solid" in meshes, convex_distance_func(convex)
    search, (corners, steps) = nearest_face_func(("solid",)), corner_readers(real)

    @wp.func
    def collider_phi_and_slip(kind: int, size: t.vec3, mesh: wp.uint64, q: t.vec3, most: real):
        phi = real(AWAY)
        n = t.vec3()
        slip = t.vec3()
        if shaped:
            if kind < SOLID:
                phi, n = formula(kind, size, q)
        if meshed:
            if kind == SOLID:
                face, sign = search(kind, mesh, wp.vec3f(q), float(most), 0, 0.0)
                if face >= 0:
                    what, first = nearest_feature(corners(mesh, face, 0), q)
                    X = corners(mesh, face, first)
                    side = real(1.0)
                    if what == INSIDE and wp.dot(triangle_normal(X), q - X[0]) < real(0.0):
                        side = -side
                    if sign < float(0.0):
                        side = -side
                    phi, n, slip = feature_distance(X, steps(mesh, face, first), what, side, q)
        return phi, n, slip

    return collider_phi_and_slip


@cache
def nearest_edge_function(kinds: tuple[str, ...], real):
    """Function (kind, size, mesh, ends: rows q, limit, felt0, felt1) -> (u, phi, m, slip) where an edge is nearest; phi is AWAY
    where that is an end, or farther than `limit` [m]."""
    t, shape = types(real), edge_distance_function(kinds, real)
    two = wp.types.matrix((2, 3), real)

    @wp.func
    def nearest_edge_place(kind: int, size: t.vec3, mesh: wp.uint64, ends: two, limit: real, felt0: t.vec4, felt1: t.vec4):
        e = ends[1] - ends[0]
        length = wp.length(e)
        n0 = t.vec3(felt0[0], felt0[1], felt0[2])
        n1 = t.vec3(felt1[0], felt1[1], felt1[2])
        phi0 = felt0[3]
        phi1 = felt1[3]
        a0 = wp.dot(n0, e)
        a1 = wp.dot(n1, e)
        lo = real(0.0)
        hi = real(1.0)
        u = real(0.0)
        phi = real(AWAY)
        m = t.vec3()
        slip = t.vec3()
        rounds = int(0)
        while rounds < ROUNDS and a0 < real(0.0) and a1 > real(0.0):
            u = (phi1 - phi0 + a0 * lo - a1 * hi) / (a0 - a1)
            least = phi0 + a0 * (u - lo)
            m = (a1 * n0 - a0 * n1) / (a1 - a0)
            if least > limit and (kind < SOLID or rounds > 0):
                phi = real(AWAY)
                break
            u = wp.clamp(u, lo + real(0.02) * (hi - lo), hi - real(0.02) * (hi - lo))
            phi, n, slip = shape(kind, size, mesh, ends[0] + u * e, wp.abs(least) + length)
            rounds += 1
            if phi - least < real(EXACT) * length:
                break
            a = wp.dot(n, e)
            if a < real(0.0):
                lo = u
                phi0 = phi
                a0 = a
                n0 = n
            else:
                hi = u
                phi1 = phi
                a1 = wp.max(a, real(EXACT) * real(EXACT) * length)
                n1 = n
        return u, phi, m, slip

    return nearest_edge_place
