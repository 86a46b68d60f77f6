"""Signed distance of a place to a collider's shape, in the shape's own frame: of a convex one by its formula
(kernels/contact/shape.py), of a mesh by Warp's query.

    phi    distance [m], below 0 within; an open mesh has no inside
    n      unit normal, out of the solid, of an open mesh towards the place; phi n leads from the nearest place to this one
    face, u, v   where that is on a mesh; -1: on none

Warp's queries are float32; distances from the place that they name are of the precision that is asked for.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.contact.mesh import SHEET, SOLID
from wsim.kernels.contact.shape import distance
from wsim.kernels.math.real import types

FAR = 1.0e9              # [m] further than anything


@cache
def convex_kinds(kinds: tuple[str, ...]) -> tuple[str, ...]:
    """Those that are no meshes; one at least, so that there is something to compile."""
    return tuple(k for k in kinds if k not in ("solid", "sheet", "forming")) or ("sphere",)


@cache
def nearest(kinds: tuple[str, ...], real):
    """Function (kind, size, mesh, q) -> (phi, n, face, u, v)."""
    t, convex = types(real), distance(convex_kinds(kinds))
    solid, sheet = "solid" in kinds, "sheet" in kinds

    @wp.func
    def nearest(kind: int, size: t.vec3, mesh: wp.uint64, q: t.vec3):
        phi = real(FAR)
        n = t.vec3(real(0.0), real(0.0), real(1.0))
        face = int(-1)
        u = float(0.0)
        v = float(0.0)
        sign = float(1.0)
        if wp.static(solid):
            if kind == SOLID:
                near = wp.mesh_query_point_sign_normal(mesh, wp.vec3f(q), float(FAR))
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
        if kind < SOLID:
            found, normal = convex(kind, size, q)
            phi = found
            n = normal
        return phi, n, face, u, v

    return nearest
