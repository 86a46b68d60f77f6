"""First hit of a moving point on a collider's shape, and whether a shape stands between two places. All in the frame of the
shape: of a collider that moves, the point's way is told from the collider's pose at its start to that at its end.

    s       part of the way p -> q that the point may go: 1 where it meets nothing
    n       unit normal of what it meets, towards the side that the point is on; 0 where it meets nothing
    skin    distance that it keeps [m]; what starts nearer may leave, slide, and come no nearer

A convex shape's distance phi is convex along the way, so that its tangent is a bound from below: Newton's steps

    s += (phi(s) - skin) / -(n . (q - p))

come from the outside, never pass the root, and end at once at a plane. Only the signed distance of the shape is asked for
(kernels/contact/collider/shape.py), so that a shape of another place needs no more. A way that leaves a convex shape meets
nothing.

A mesh is met by a ray, of Woop's watertight test, and by its nearest point at the way's end. An open mesh is met on both
sides. A closed one only from outside: a point that is found inside may leave. Meshes are in float32, so a point keeps
a rounding from one even where it is to keep nothing: one that was put on a face may be behind it.
"""

# Device code: int(0) makes a variable of what would be a constant, and an outer `if` on a Python bool drops its branch
# before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.nearest import convex_kinds
from wsim.kernels.contact.collider.shape import convex_distance_func
from wsim.kernels.contact.mesh import SHEET, SOLID
from wsim.kernels.math.real import types

STEPS = 24               # Newton's, of a convex shape: they double the digits, but at a way that grazes they halve the rest
NEAR = 0.01              # of the skin: so near is met
ROUNDING = 2.0 ** -20    # least skin of a mesh, over the size of what is rounded to float32: eight times what is lost there
AGAIN = 4                # faces of a closed mesh that a way may leave by before it enters one


@cache
def segment_queries(kinds: tuple[str, ...], real) -> SimpleNamespace:
    """first_hit(kind, size, mesh, p, q, skin) -> (s, n); between(kind, size, mesh, p, q, slack) -> whether a shape is in
    the way from p to q, by more than slack [m] (below 0: or nearly, at both ends). Thickness does not count. kinds: of shapes,
    "solid" and "sheet" of meshes."""
    t = types(real)
    apart = convex_distance_func(convex_kinds(kinds))
    has_convex = convex_kinds(kinds)[0] in kinds
    has_mesh = "solid" in kinds or "sheet" in kinds

    @wp.func
    def widened_normal(n: wp.vec3f):
        return t.vec3(real(n[0]), real(n[1]), real(n[2]))

    @wp.func(inline=False)
    def convex_hit(kind: int, size: t.vec3, p: t.vec3, q: t.vec3, skin: real, near: real):
        way = q - p
        s = real(0.0)
        n = t.vec3()
        for _ in range(STEPS):
            phi, normal = apart(kind, size, p + s * way)
            n = normal
            rate = -wp.dot(n, way)
            gap = phi - skin
            if rate <= real(0.0):
                return real(1.0), t.vec3()
            if gap <= near:
                return s, n
            s += gap / rate
            if s >= real(1.0):
                return real(1.0), t.vec3()
        return s, n

    @wp.func
    def ray_hit(kind: int, mesh: wp.uint64, p: t.vec3, way: t.vec3):
        """(part of the way, normal towards p) of the face that is met first; 2 where none is."""
        at = wp.vec3f(p)
        dir = wp.vec3f(way)
        done = float(0.0)
        faces = int(AGAIN)                                     # a variable: the loop is compiled once
        for _ in range(faces):
            hit = wp.mesh_query_ray(mesh, at + done * dir, dir, float(1.0) - done)
            if not hit.result:
                return real(2.0), t.vec3()
            along = wp.dot(hit.normal, dir)
            if kind == SHEET or along <= float(0.0):
                n = hit.normal
                if along > float(0.0):
                    n = -hit.normal
                return real(done + hit.t), widened_normal(n)
            done += hit.t + float(1.0e-4)
            if done >= float(1.0):
                return real(2.0), t.vec3()
        return real(2.0), t.vec3()

    @wp.func(inline=False)
    def mesh_hit(kind: int, mesh: wp.uint64, p: t.vec3, q: t.vec3, least: real):
        way = q - p
        skin = wp.max(least, real(ROUNDING) * (wp.length(p) + wp.length(way)))
        if kind == SOLID:                                      # what is a rounding inside comes no further
            start = wp.mesh_query_point_no_sign(mesh, wp.vec3f(p), float(skin))
            if start.result:
                m = wp.mesh_eval_face_normal(mesh, start.face)
                off = wp.vec3f(p) - wp.mesh_eval_position(mesh, start.face, start.u, start.v)
                if wp.dot(off, m) < float(0.0) and wp.dot(wp.vec3f(way), m) < float(0.0):
                    return real(0.0), widened_normal(m)
        s, n = ray_hit(kind, mesh, p, way)
        rate = -wp.dot(n, way)
        if s <= real(1.0):
            if rate > real(0.0):
                s = wp.max(s - skin / rate, real(0.0))
            return s, n
        end = wp.vec3f(q)
        near = wp.mesh_query_point_no_sign(mesh, end, float(skin))
        if near.result:
            c = wp.mesh_eval_position(mesh, near.face, near.u, near.v)
            normal = wp.mesh_eval_face_normal(mesh, near.face)
            off = end - c
            far = wp.length(off)
            if kind == SHEET or wp.dot(off, normal) >= float(0.0):
                if far > float(0.01) * float(skin):
                    n = widened_normal(off / far)
                else:
                    n = widened_normal(normal)
                    if wp.dot(wp.vec3f(p) - c, normal) < float(0.0):
                        n = -n
                rate = -wp.dot(n, way)
                if rate > real(0.0):
                    return wp.max(real(1.0) - (skin - real(far)) / rate, real(0.0)), n
        return real(1.0), t.vec3()

    @wp.func
    def first_shape_hit(kind: int, size: t.vec3, mesh: wp.uint64, p: t.vec3, q: t.vec3, skin: real):
        s = real(1.0)
        n = t.vec3()
        if wp.static(has_mesh):
            if kind >= SOLID:
                s, n = mesh_hit(kind, mesh, p, q, skin)
        if wp.static(has_convex):
            if kind < SOLID:
                s, n = convex_hit(kind, size, p, q, skin, real(NEAR) * skin)
        return s, n

    @wp.func(inline=False)
    def shape_stands_between(kind: int, size: t.vec3, mesh: wp.uint64, p: t.vec3, q: t.vec3, slack: real):
        found = bool(False)
        if wp.static(has_mesh):
            if kind >= SOLID:
                along = slack * wp.normalize(q - p)
                start = p + wp.min(slack, real(0.0)) * wp.normalize(q - p)
                found = wp.mesh_query_ray_anyhit(mesh, wp.vec3f(start), wp.vec3f(q - along - start), float(1.0))
                if slack < real(0.0) and not found:            # a ray along a face misses it
                    found = wp.mesh_query_point_no_sign(mesh, wp.vec3f(p), -float(slack)).result
                    if not found:
                        found = wp.mesh_query_point_no_sign(mesh, wp.vec3f(q), -float(slack)).result
        if wp.static(has_convex):
            if kind < SOLID:
                phi, n = apart(kind, size, p)
                found = phi < -slack
                if not found and phi + wp.dot(n, q - p) < -slack:      # else the plane at p has q on its side
                    s, m = convex_hit(kind, size, p, q, -slack, real(0.0))
                    found = s < real(1.0)
        return found

    return SimpleNamespace(first_hit=first_shape_hit, between=shape_stands_between)
