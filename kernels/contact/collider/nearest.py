"""Signed distance of a place to a collider's shape, in the shape's own frame: of a convex one by its formula
(kernels/contact/collider/shape.py), of a mesh by Warp's query, of a cloud of balls by that for centres.

    phi    distance [m], below 0 within; an open mesh has no inside
    n      unit normal, out of the solid, of an open mesh towards the place; phi n leads from the nearest place to this one
    face, u, v   where that is on a mesh; -1: on none

Warp's queries are float32; distances from the place that they name are of the precision that is asked for.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.contact.collider.shape import convex_distance_func
from wsim.kernels.contact.mesh import BALLS, SHEET, SOLID
from wsim.kernels.math.real import types

FAR = 1.0e9              # [m] further than anything
BEYOND = 4.0             # largest radii from a cloud: further away the ball of the nearest centre stands for the nearest ball


@cache
def convex_kinds(kinds: tuple[str, ...]) -> tuple[str, ...]:
    """Those that are no meshes; one at least, so that there is something to compile."""
    return tuple(k for k in kinds if k not in ("solid", "sheet", "balls", "forming")) or ("sphere",)


@cache
def ball_cloud_func(real):
    """Function (size, mesh, q) -> (phi, n, ball or -1) of a cloud: the ball of which q is least outside. The mesh
    has the radii behind its centres; size has the largest and the smallest of them."""
    t = types(real)

    @wp.func
    def ball_distance(mesh: wp.uint64, k: int, q: wp.vec3f):
        balls = wp.mesh_get(mesh)
        center = balls.points[k]
        return wp.length(q - center) - balls.points[balls.indices.shape[0] // 3 + k][0], center

    @wp.func
    def nearest_ball_of_cloud(size: t.vec3, mesh: wp.uint64, place: t.vec3):
        q = wp.vec3f(place)
        found = int(-1)
        least = float(FAR)
        center = wp.vec3f()
        first = wp.mesh_query_point_no_sign(mesh, q, float(FAR))
        if first.result:
            found = first.face
            least, center = ball_distance(mesh, found, q)
            largest = float(size[0])
            if size[1] < size[0] and least < float(BEYOND) * largest:
                out = wp.vec3f(least + largest)
                query = wp.mesh_query_aabb(mesh, q - out, q + out)
                k = int(0)
                while wp.mesh_query_aabb_next(query, k):
                    phi, other = ball_distance(mesh, k, q)
                    if phi < least or (phi == least and k < found):
                        least = phi
                        center = other
                        found = k
        off = place - t.vec3(real(center[0]), real(center[1]), real(center[2]))
        n = t.vec3(real(0.0), real(0.0), real(1.0))
        if wp.length(off) > real(0.0):
            n = wp.normalize(off)
        return real(least), n, found

    return nearest_ball_of_cloud


@cache
def nearest_shape_func(kinds: tuple[str, ...], real):
    """Function (kind, size, mesh, q) -> (phi, n, face, u, v)."""
    t, convex = types(real), convex_distance_func(convex_kinds(kinds))
    solid, sheet, cloud, balls = "solid" in kinds, "sheet" in kinds, "balls" in kinds, ball_cloud_func(real)
    if solid:
        from wsim.kernels.math.face import equal_distance

    @wp.func
    def nearest_on_shape(kind: int, size: t.vec3, mesh: wp.uint64, q: t.vec3):
        phi = real(FAR)
        n = t.vec3(real(0.0), real(0.0), real(1.0))
        face = int(-1)
        u = float(0.0)
        v = float(0.0)
        sign = float(1.0)
        if wp.static(solid):
            if kind == SOLID:
                near = wp.mesh_query_point_sign_normal(mesh, wp.vec3f(q), float(FAR), equal_distance(mesh, wp.vec3f(q)))
                if near.result:
                    face = near.face
                    u = near.u
                    v = near.v
                    sign = near.sign
        if wp.static(sheet):
            if kind == SHEET:
                open = wp.mesh_query_point_no_sign(mesh, wp.vec3f(q), float(FAR))
                if open.result:
                    face = open.face
                    u = open.u
                    v = open.v
        if wp.static(solid or sheet):
            if face >= 0:
                p = wp.mesh_eval_position(mesh, face, u, v)
                off = q - t.vec3(real(p[0]), real(p[1]), real(p[2]))
                far = wp.length(off)
                phi = real(sign) * far
                if far > real(0.0):
                    n = real(sign) * wp.normalize(off)
                else:
                    m = wp.mesh_eval_face_normal(mesh, face)
                    n = t.vec3(real(m[0]), real(m[1]), real(m[2]))
        if wp.static(cloud):
            if kind == BALLS:
                phi, n, face = balls(size, mesh, q)
        if kind < SOLID:
            found, normal = convex(kind, size, q)
            phi = found
            n = normal
        return phi, n, face, u, v

    return nearest_on_shape
