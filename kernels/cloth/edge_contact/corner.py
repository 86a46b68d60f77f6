"""Corners of a collider that poke through the inside of a triangle of a sheet: those of a box, the apex of a cone, the rims of
cones and cylinders where they reach highest, and the corners of a mesh's nearest face. The normal m is the triangle's own.

A corner counts where no other place of the collider reaches higher along m (of a mesh: of its face, which faces m). Else an
edge is nearer, which has contacts of its own: where a fold hung across a box's edge, the corner was 5 mm deep in a triangle
that leaned over the edge, and carrying the triangle out gave 8 % of the largest kinetic energy.
"""

# Device code: int(0) makes a variable of what would be a constant, and an outer `if` on a Python bool drops its branch
# before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.cloth.edge_contact.edge import AWAY, EXACT
from wsim.kernels.contact.collider.shape import BOX, CONE, CYLINDER
from wsim.kernels.contact.mesh import SOLID, corner_readers, nearest_face_func, triangle_normal
from wsim.kernels.math.real import types

LEANS = 0.1            # slope of m by which another place may reach higher: what is nearly flat moves to and fro
INNER = 1.0e-3         # least weight of a site inside of a triangle or an edge; nearer to an end, that has the contact
HIGH = 0.5             # of a triangle's longest edge: what pokes higher through it has come another way


@cache
def poking_corner_function(kinds: tuple[str, ...], real):
    """Function (kind, size, mesh, X: rows q of a triangle, m: its unit normal, j) -> (P, there): corner j of a collider that
    may poke through the triangle, in the collider's frame; there: it does not where another reaches higher along m."""
    t, find, (corners, _) = types(real), nearest_face_func(("solid",)), corner_readers(real)
    boxes, cylinders, cones, meshes = ("box" in kinds, "cylinder" in kinds, "cone" in kinds, "solid" in kinds)

    @wp.func
    def highest_rim_point(R: real, H: real, m: t.vec3):
        """Where the rim at z = H reaches highest along m; the middle of its disc where it is flat below m."""
        across = wp.sqrt(m[0] * m[0] + m[1] * m[1])
        P = t.vec3(real(0.0), real(0.0), H)
        if across > real(EXACT):
            P = P + (R / across) * t.vec3(m[0], m[1], real(0.0))
        return P

    @wp.func
    def find_poking_corner(kind: int, size: t.vec3, mesh: wp.uint64, X: t.mat33, m: t.vec3, j: int):
        P = t.vec3()
        there = bool(False)
        if boxes:
            if kind == BOX:
                P = t.vec3(wp.where(j % 2 == 0, -size[0], size[0]), wp.where((j / 2) % 2 == 0, -size[1], size[1]),
                           wp.where(j / 4 == 0, -size[2], size[2]))
                there = wp.min(wp.min(P[0] * m[0] / size[0], P[1] * m[1] / size[1]), P[2] * m[2] / size[2]) > -real(LEANS)
        if cylinders:
            if kind == CYLINDER and j < 2:
                P = highest_rim_point(size[0], wp.where(j == 0, -size[1], size[1]), m)
                there = P[2] * m[2] > -real(LEANS) * size[1]
        if cones:
            if kind == CONE and j < 2:
                P = t.vec3(real(0.0), real(0.0), size[1])
                if j == 0:
                    P = highest_rim_point(size[0], -size[1], m)
                apex = real(2.0) * size[1] * m[2] - size[0] * wp.sqrt(m[0] * m[0] + m[1] * m[1])    # above the rim, along m
                there = wp.where(j == 0, -apex, apex) > -real(LEANS) * wp.max(size[0], size[1])
        if meshes:
            if kind == SOLID and j < 3:
                middle = (X[0] + X[1] + X[2]) / real(3.0)
                most = real(2.0) * wp.length(X[0] - middle) + real(2.0) * wp.length(X[1] - middle)
                face, sign = find(kind, mesh, wp.vec3f(middle), float(most), 0, 0.0)
                if face >= 0:
                    Y = corners(mesh, face, j)
                    P = Y[0]
                    higher = wp.max(wp.dot(m, wp.normalize(Y[1] - P)), wp.dot(m, wp.normalize(Y[2] - P)))
                    out = triangle_normal(Y)
                    if (wp.dot(out, middle - P) < real(0.0)) != (sign < float(0.0)):
                        out = -out
                    there = wp.max(higher, -wp.dot(m, out)) < real(LEANS)
        return P, there

    return find_poking_corner


@cache
def corner_height_function(kinds: tuple[str, ...], real):
    """Function (kind, size, mesh, X: rows q, out: outward there, bound) -> (C, beta, m): the highest corner of a collider in a
    triangle, C the height of the triangle above it, below `bound` [m]; C is AWAY where there is none."""
    t, corner = types(real), poking_corner_function(kinds, real)

    @wp.func
    def highest_corner_through(kind: int, size: t.vec3, mesh: wp.uint64, X: t.mat33, out: t.vec3, bound: real):
        e0 = X[1] - X[0]
        e1 = X[2] - X[0]
        c = wp.cross(e0, e1)
        twice = wp.dot(c, c)
        C = real(AWAY)
        beta = t.vec3()
        m = wp.normalize(c)
        if wp.dot(m, out) < real(0.0):
            m = -m
        high = real(HIGH) * wp.sqrt(wp.max(wp.dot(e0, e0), wp.dot(e1, e1)))
        if twice > real(0.0):
            for j in range(8):
                P, there = corner(kind, size, mesh, X, m, j)
                if there:
                    r = P - X[0]
                    v = wp.dot(c, wp.cross(r, e1)) / twice
                    w = wp.dot(c, wp.cross(e0, r)) / twice
                    u = real(1.0) - v - w
                    height = -wp.dot(m, r)
                    inner = wp.min(u, wp.min(v, w)) > real(INNER)
                    if inner and height < bound and height > -high and height < C:
                        C = height
                        beta = t.vec3(u, v, w)
        return C, beta, m

    return highest_corner_through
