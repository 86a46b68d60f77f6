"""Where a moving point meets a triangle mesh, in the mesh's own frame. Symbols: kernels/contact/collide.py.

First what is found and then stays (`feature_search_func`): the nearest face at q1 and what of it is nearest (its inside, an
edge or a corner); on which side the point is; and, where the nearest point is nearer than |dq|, since only then can a crossing
be, the face that a ray q0 -> q1 goes through. A way that starts inside a solid (by rounding, of a point that a contact left on
its surface) has the face nearest to q0, where it goes deeper: else it would leave a thin wall by its other side. Sides are
those of the angle-weighted pseudo normal (Baerentzen, Aanaes 2005), exact for closed meshes and as cheap as none; or, where
`deep` is set, of the winding number (Barill et al. 2018), which survives self-intersection but costs ten times as much: the
host asks for it when points may start inside.

Then smooth functions of q0 and q1 (`mesh_plane_func`), in the precision of the run, with corners X_0, X_1, X_2 and their
motions V in this substep, so that q0 + slip is where the point was as the touched part of the surface sees it:

    inside    n the face's normal m,  p = q1 - h m,  h = m.(q1 - X_0)                    slip: by the areas of p
    edge      p = X_0 + t (X_1 - X_0),  n = (q1 - p) / |q1 - p|                          slip = (1 - t) V_0 + t V_1
    corner    p = X_0                                                                    slip = V_0
    crossing  n the normal of the face Y that is crossed, p where the ray meets it       slip as without

Warp's mesh queries are float32 in both precisions: near an edge they may name the other face.
"""

# Device code: int(0) makes a variable of what would be a constant, and an outer `if` on a Python bool drops its branch
# before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.contact.collider.shape import CONVEX
from wsim.kernels.math.real import types

SOLID, SHEET, BALLS = len(CONVEX), len(CONVEX) + 1, len(CONVEX) + 2       # closed mesh; open mesh, two-sided; points' balls
INSIDE, RIM, CORNER = 0, 1, 2                        # what of a face is nearest
EDGE = 1e-6            # of an edge's length: so far beyond it a point still counts as over the face, whose normal is exact,
                       # where the direction to the edge is rounding near it


@cache
def nearest_face_func(kinds: tuple[str, ...]):
    """Function (kind, mesh, q, most, deep, depth) -> (face or -1, sign): nearest face within `most` [m]."""
    has_solid, has_sheet = "solid" in kinds, "sheet" in kinds
    if has_solid:
        from wsim.kernels.math.face import equal_distance

    @wp.func
    def nearest_face_and_sign(kind: int, mesh: wp.uint64, q: wp.vec3f, most: float, deep: int, depth: float):
        face = int(-1)
        sign = float(1.0)
        if has_sheet:
            if kind == SHEET:
                found = wp.mesh_query_point_no_sign(mesh, q, most)
                if found.result:
                    face = found.face
        if has_solid:
            if kind == SOLID:
                if deep != 0:
                    wound = wp.mesh_query_point_sign_winding_number(mesh, q, wp.max(most, depth))
                    if wound.result:
                        face = wound.face
                        sign = wound.sign
                else:
                    near = wp.mesh_query_point_sign_normal(mesh, q, most, equal_distance(mesh, q))
                    if near.result:
                        face = near.face
                        sign = near.sign
        return face, sign

    return nearest_face_and_sign


@wp.func
def triangle_normal(X: Any):
    """Unit normal of a triangle with its corners in rows; 0 where it has no area."""
    return wp.normalize(wp.cross(X[1] - X[0], X[2] - X[0]))


@wp.func
def nearest_feature(X: Any, q: Any):
    """(what of a triangle is nearest to q, first of its corners)."""
    m = triangle_normal(X)
    what = int(INSIDE)
    first = int(0)
    on = int(RIM)
    least = type(q[0])(-1.0)
    if wp.dot(m, m) < type(q[0])(0.5):
        what = RIM
    for k in range(3):
        a = X[k]
        e = X[(k + 1) % 3] - a
        away = q - a
        square = wp.dot(e, e)
        if wp.dot(wp.cross(m, e), away) < -type(q[0])(EDGE) * square:
            what = RIM
        t = wp.dot(away, e)
        if square > type(q[0])(0.0):
            t = wp.clamp(t / square, type(q[0])(0.0), type(q[0])(1.0))
        off = away - t * e
        if least < type(q[0])(0.0) or wp.dot(off, off) < least:
            least = wp.dot(off, off)
            first = k
            on = RIM
            if t <= type(q[0])(0.0):
                on = CORNER
            if t >= type(q[0])(1.0):
                on = CORNER
                first = (k + 1) % 3
    if what == INSIDE:
        first = 0
    else:
        what = on
    return what, first


@cache
def corner_readers(real):
    """(corners, steps): functions (mesh, face, first) -> corners [m] of a face in rows, and their motions in this substep,
    counted from its corner `first`."""
    t = types(real)

    @wp.func
    def widen_mesh_vector(p: wp.vec3f):
        return t.vec3(real(p[0]), real(p[1]), real(p[2]))

    @wp.func
    def mesh_face_corners(mesh: wp.uint64, face: int, first: int):
        return wp.matrix_from_rows(widen_mesh_vector(wp.mesh_get_point(mesh, 3 * face + first)),
                                   widen_mesh_vector(wp.mesh_get_point(mesh, 3 * face + (first + 1) % 3)),
                                   widen_mesh_vector(wp.mesh_get_point(mesh, 3 * face + (first + 2) % 3)))

    @wp.func
    def mesh_face_motions(mesh: wp.uint64, face: int, first: int):
        return wp.matrix_from_rows(widen_mesh_vector(wp.mesh_get_velocity(mesh, 3 * face + first)),
                                   widen_mesh_vector(wp.mesh_get_velocity(mesh, 3 * face + (first + 1) % 3)),
                                   widen_mesh_vector(wp.mesh_get_velocity(mesh, 3 * face + (first + 2) % 3)))

    return mesh_face_corners, mesh_face_motions


@wp.func
def feature_distance(X: Any, V: Any, what: int, side: Any, q: Any):
    """(dist, n, slip): signed distance [m] of q to that part of a triangle, its gradient, motion of the surface there."""
    one = type(side)(1.0)
    e = X[1] - X[0]
    away = q - X[0]
    dist = type(side)(0.0)
    n = side * triangle_normal(X)
    slip = V[0]
    if what == INSIDE:
        dist = wp.dot(n, away)
        c = wp.cross(e, X[2] - X[0])
        over = one / wp.dot(c, c)
        u = over * wp.dot(c, wp.cross(away, X[2] - X[0]))
        v = over * wp.dot(c, wp.cross(e, away))
        slip = (one - u - v) * V[0] + u * V[1] + v * V[2]
    else:
        if what == RIM:
            t = wp.dot(away, e) / wp.dot(e, e)
            away = away - t * e
            slip = (one - t) * V[0] + t * V[1]
        far = wp.length(away)
        if far > type(side)(0.0):
            dist = side * far
            n = (side / far) * away
    return dist, n, slip


@cache
def mesh_plane_func(real):
    """Function (X, V, Y, what, sides, ends, r) -> (C, n, p, s0, slip), of what `feature_search_func` has found; ends: rows q0
    and q1."""
    t = types(real)

    @wp.func
    def mesh_contact_plane(X: t.mat33, V: t.mat33, Y: t.mat33, what: int, sides: t.vec2, ends: wp.types.matrix((2, 3), real),
                           r: real):
        q1 = ends[1]
        front = sides[1]
        dist, n, slip = feature_distance(X, V, what, sides[0], q1)
        p = q1 - dist * n
        start = ends[0] + slip
        dq = q1 - start
        C = dist - r
        if front != real(0.0):
            n = front * triangle_normal(Y)
            C = wp.dot(n, q1 - Y[0]) - r
            p = start + (wp.dot(n, Y[0] - start) / wp.dot(n, dq)) * dq
        return C, n, p, C - wp.dot(n, dq), slip

    return mesh_contact_plane


@cache
def crossing_func(real):
    """Function (kind, mesh, face, way) -> (Y, front): corners of a face that a way goes through; 1, or -1 where that is from
    behind, 0 where a solid is left."""
    t, (corners, _) = types(real), corner_readers(real)

    @wp.func
    def crossed_face_and_side(kind: int, mesh: wp.uint64, face: int, way: t.vec3):
        Y = corners(mesh, face, 0)
        front = real(0.0)
        fall = wp.dot(triangle_normal(Y), way)
        if fall < real(0.0):                                  # a solid is entered through the front of a face
            front = real(1.0)
        if fall > real(0.0) and kind == SHEET:
            front = real(-1.0)
        return Y, front

    return crossed_face_and_side


@cache
def entered_face(real):
    """Function (mesh, face, start, q1) -> (Y, front): as `crossing_func`, of a way that starts inside a solid, or on it, over
    the inside of that face, and goes deeper: as if it came through there."""
    t, (corners, _) = types(real), corner_readers(real)

    @wp.func
    def entered_face(mesh: wp.uint64, face: int, start: t.vec3, q1: t.vec3):
        Y = corners(mesh, face, 0)
        front = real(0.0)
        what, _first = nearest_feature(Y, start)
        if what == INSIDE and wp.dot(triangle_normal(Y), q1 - start) < real(0.0):
            front = real(1.0)
        return Y, front

    return entered_face


@cache
def feature_search_func(kinds: tuple[str, ...], real):
    """Function (kind, mesh, deep, depth, q0, q1, most) -> (X, V, Y, what, sides, faces), see above; what < 0: no face within
    `most` [m] of q1. sides: 1, or -1 where the point is behind the face, or on the inner side of a closed mesh; 0, or the side
    of the face that is crossed. faces: the nearest one, which of its corners is X_0, and the one that is crossed."""
    t, search, (corners, steps) = types(real), nearest_face_func(kinds), corner_readers(real)
    cross, enter = crossing_func(real), entered_face(real)

    @wp.func
    def find_mesh_features(kind: int, mesh: wp.uint64, deep: int, depth: real, q0: t.vec3, q1: t.vec3, most: real):
        X = t.mat33()
        V = t.mat33()
        Y = t.mat33()
        what = int(-1)
        side = real(1.0)
        front = real(0.0)
        faces = wp.vec3i(-1, 0, -1)
        face, sign = search(kind, mesh, wp.vec3f(q1), float(most), deep, float(depth))
        if face >= 0:
            what, first = nearest_feature(corners(mesh, face, 0), q1)
            X = corners(mesh, face, first)
            V = steps(mesh, face, first)
            faces[0] = face
            faces[1] = first
            if what == INSIDE and wp.dot(triangle_normal(X), q1 - X[0]) < real(0.0):
                side = -side
            if sign < float(0.0):
                side = -side
            dist, n, slip = feature_distance(X, V, what, side, q1)
            start = q0 + slip
            length = wp.length(q1 - start)
            if wp.abs(dist) < length:
                ray = wp.mesh_query_ray(mesh, wp.vec3f(start), wp.vec3f((q1 - start) / length), float(length))
                if ray.result:
                    faces[2] = ray.face
                    Y, front = cross(kind, mesh, ray.face, q1 - start)
                if front == real(0.0) and kind == SOLID and (ray.result or dist < real(0.0)):
                    began = wp.mesh_query_point_no_sign(mesh, wp.vec3f(start), float(most - length))
                    if began.result and not (what == INSIDE and began.face == face):
                        faces[2] = began.face
                        Y, front = enter(mesh, began.face, start, q1)
        return X, V, Y, what, t.vec2(side, front), faces

    return find_mesh_features


@cache
def mesh_touch_func(kinds: tuple[str, ...], real):
    """Function (kind, mesh, deep, depth, q0, q1, r, margin) -> (C, n, p, s0, slip), as `collide.touch_convex`.

    depth   no inside point is further from the surface [m]       slip   motion of the surface in its own frame [m]"""
    t, find, formula = types(real), feature_search_func(kinds, real), mesh_plane_func(real)

    @wp.func
    def touch_moving_mesh(kind: int, mesh: wp.uint64, deep: int, depth: real, q0: t.vec3, q1: t.vec3, r: real, margin: real):
        C = real(1.0e30)
        n = q1
        p = q1
        s0 = C
        slip = t.vec3()
        X, V, Y, what, sides, _faces = find(kind, mesh, deep, depth, q0, q1, margin + r)
        if what >= 0:
            C, n, p, s0, slip = formula(X, V, Y, what, sides, wp.matrix_from_rows(q0, q1), r)
        return C, n, p, s0, slip

    return touch_moving_mesh
