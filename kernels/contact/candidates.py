"""Candidates: the faces of mesh colliders that a point may come near in many substeps, listed once.

    q   place of a point in a mesh's own frame [m]         near   within which a substep looks for faces about q1 [m]

Where a list is made, at q, it holds every face within R of q, with what the mesh moves in its own frame until the list ends
taken off (`stride`). A later substep looks within `near` of q1 alone: as long as |q1 - q| + near <= R every face that it could
find is in the list, and it looks no further than there. Lists end after `every` substeps, and are made where one is asked for,
or by a point that went further than was thought. Where a list has no room for all of its faces, half of the way to spare is
tried, a fourth, an eighth; where there are too many even so it is none: the tree is asked, and the host makes room.

Faces stand by their distances D from q, ascending, and are read as long as D - |q1 - q| is within what is looked for.

List and tree give the same faces to the same rule, so the bits do not depend on where lists were made: the nearest face, of
equal ones the first; the side by the angle-weighted normals (Baerentzen, Aanaes 2005) of all faces as near as it, as Warp's
mesh_query_point_sign_normal weighs them; the first face of a ray. A face alone under a point's inside needs no weighing.
"""

# Device code: int(0) makes a variable of what would be a constant, and an outer `if` on a Python bool drops its branch
# before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.contact import mesh as meshes
from wsim.kernels.contact.project import contact_tables
from wsim.kernels.math import face as faces
from wsim.kernels.math.real import types

MOST = 128             # faces of a list: one with more is no faster than the tree
AHEAD = 2.0            # of the motion that a point would have until its list ends, at the speed that it has when it is made
HALVES = 3             # tries with less to spare
AWAY = 24.0            # substeps like this one that a distance is to hold for
HOLD = 8               # substeps behind one that was near in which no distance is measured


@wp.func
def insert_face_by_distance(L: Any, first: int, count: int, dist: float, face: int):
    """Puts a face into a list of `count` that begins at `first`, by its distance."""
    n = L.w.shape[0]
    j = int(count)
    while j > 0 and L.far[first + (j - 1) * n] > dist:
        L.far[first + j * n] = L.far[first + (j - 1) * n]
        L.face[first + j * n] = L.face[first + (j - 1) * n]
        j -= 1
    L.far[first + j * n] = dist
    L.face[first + j * n] = face


@wp.func
def make_face_list(mesh: wp.uint64, L: Any, s: int, i: int, q: wp.vec3f, radius: float, moved: float):
    """Makes the list of slot s and point i: the faces within `radius` of q; moved: what the mesh may move meanwhile [m].
    Returns their number."""
    face = int(0)
    count = int(0)
    low, high = faces.query_box(q, radius)
    query = wp.mesh_query_aabb(mesh, low, high)
    while wp.mesh_query_aabb_next(query, face):
        dist, _p = faces.face_distance(mesh, face, q)
        if dist <= radius:
            if count < L.room:
                insert_face_by_distance(L, s * L.room * L.w.shape[0] + i, count, dist - moved, face)
            count += 1
    at = s * L.w.shape[0] + i
    L.count[at] = count
    L.place[at] = q
    L.radius[at] = radius - moved
    return count


@wp.func
def expire_lists(L: Any, i: int, k: int):
    """Ends the lists of a point that others follow."""
    if k % L.every == 0:
        for s in range(L.count.shape[0] // L.w.shape[0]):
            L.radius[s * L.w.shape[0] + i] = float(-1.0)


@wp.func
def list_reach_bound(L: Any, at: int, q: wp.vec3f, reach: float):
    """Distance from where a list was made that no face goes beyond which is within `reach` of q."""
    gone = wp.length(q - L.place[at])
    return reach + gone + faces.SLACK * (gone + wp.max(wp.abs(q)))


@cache
def list_refresh_func(real):
    """Function (c, L, row, i, k, ends, near): makes the list of a row and point i where it ends, or would not do."""
    Rows = contact_tables(real)[0]

    @wp.func
    def refresh_face_list(c: Rows, L: Any, row: int, i: int, k: int, ends: wp.types.matrix((2, 3), real), near: real):
        s = L.slot[row]
        at = s * L.w.shape[0] + i
        q = wp.vec3f(ends[1])
        if not wp.length(q - L.place[at]) + float(near) <= L.radius[at]:
            end = wp.min(k - k % L.every + L.every, c.stride.shape[0])
            moved = float(0.0)
            for later in range(k + 1, end):
                moved += float(c.stride[later, row])
            spare = AHEAD * float(end - k) * float(wp.length(ends[1] - ends[0])) + float(0.5) * float(c.skin) + moved
            tries = int(0)
            while make_face_list(c.of.mesh[row], L, s, i, q, float(near) + moved + spare, moved) > L.room and tries < HALVES:
                spare *= float(0.5)
                tries += 1
            if L.count[at] > L.room:
                wp.atomic_max(L.wanted, 0, wp.min(L.count[at], MOST))

    return refresh_face_list


@wp.func
def deduct_mesh_deformation(c: Any, L: Any, o: int, i: int, k: int):
    """Takes off from what a point i of object o is known to be far by what meshes move in their own frames in substep k."""
    for row in range(c.first[o], c.first[o + 1]):
        s = L.slot[row]
        if s >= 0:
            L.radius[s * L.w.shape[0] + i] -= float(c.stride[k, row])


@cache
def mesh_clearance_func(real):
    """Function (c, L, row, i, k, ends, near): True if no face of a mesh is within `near` of point i where it ends; False: it is
    not known. A distance D from q holds as long as |q1 - q| + near <= D; it is measured anew where it does not, but for the
    next HOLD substeps where the mesh was near. L: place q, radius D less what the mesh has moved, count: substeps to wait."""
    Rows = contact_tables(real)[0]

    @wp.func
    def is_clear_of_mesh(c: Rows, L: Any, row: int, i: int, k: int, ends: wp.types.matrix((2, 3), real), near: real):
        at = L.slot[row] * L.w.shape[0] + i
        q = wp.vec3f(ends[1])
        rounded = faces.SLACK * wp.max(wp.abs(q))
        if L.count[at] > 0:
            L.count[at] -= 1
            return False
        if wp.length(q - L.place[at]) + float(near) + rounded <= L.radius[at]:
            return True
        most = float(near) + AWAY * (float(wp.length(ends[1] - ends[0])) + float(c.stride[k, row])) + float(c.skin)
        dist = float(most)
        found = wp.mesh_query_point_no_sign(c.of.mesh[row], q, most)
        if found.result:
            dist = wp.length(q - wp.mesh_eval_position(c.of.mesh[row], found.face, found.u, found.v))
        L.place[at] = q
        L.radius[at] = dist - faces.SLACK * dist - rounded
        if float(near) + rounded <= L.radius[at]:
            return True
        L.count[at] = HOLD
        return False

    return is_clear_of_mesh


@wp.func
def nearest_listed_face(mesh: wp.uint64, L: Any, s: int, i: int, q: wp.vec3f, near: float):
    """(face nearer than `near` or -1, its distance [m])."""
    count = L.count[s * L.w.shape[0] + i]
    gone = list_reach_bound(L, s * L.w.shape[0] + i, q, 0.0)
    dist = float(faces.FAR)
    first = int(-1)
    face = int(0)
    if count <= L.room:
        for j in range(count):
            at = (s * L.room + j) * L.w.shape[0] + i
            if L.far[at] - gone > wp.min(dist, near):
                break
            dist, first = faces.nearer_face(mesh, L.face[at], q, dist, first)
    else:
        low, high = faces.query_box(q, near)
        query = wp.mesh_query_aabb(mesh, low, high)
        while wp.mesh_query_aabb_next(query, face):
            dist, first = faces.nearer_face(mesh, face, q, dist, first)
    if not dist < near:
        first = -1
    return first, dist


@wp.func
def side_of_listed_faces(mesh: wp.uint64, L: Any, s: int, i: int, q: wp.vec3f, nearest: int, dist: float):
    """1, or -1 where q is behind the surface: by the faces no further than the nearest one, but for rounding."""
    eps = faces.equal_distance(mesh, q) * faces.edge_length(mesh)
    count = L.count[s * L.w.shape[0] + i]
    n = wp.vec3f()
    face = int(0)
    if count <= L.room:
        last = list_reach_bound(L, s * L.w.shape[0] + i, q, dist + eps)
        for j in range(count):
            at = (s * L.room + j) * L.w.shape[0] + i
            if L.far[at] > last:
                break
            n += faces.angle_weighted_normal(mesh, L.face[at], q, dist + eps, eps)
    else:
        low, high = faces.query_box(q, dist + eps)
        query = wp.mesh_query_aabb(mesh, low, high)
        while wp.mesh_query_aabb_next(query, face):
            n += faces.angle_weighted_normal(mesh, face, q, dist + eps, eps)
    _dist, p = faces.face_distance(mesh, nearest, q)
    return wp.where(wp.dot(n, q - p) > float(0.0), float(1.0), float(-1.0))


@wp.func
def first_listed_face_hit(mesh: wp.uint64, L: Any, s: int, i: int, start: wp.vec3f, way: wp.vec3f, length: float):
    """The first face on a ray of that length, -1: none. Its end is q1, so that all it may meet is near there."""
    count = L.count[s * L.w.shape[0] + i]
    t = length
    first = int(-1)
    face = int(0)
    if count <= L.room:
        last = list_reach_bound(L, s * L.w.shape[0] + i, start + length * way, length)
        for j in range(count):
            at = (s * L.room + j) * L.w.shape[0] + i
            if L.far[at] > last:
                break
            t, first = faces.sooner_face_hit(mesh, L.face[at], start, way, t, first)
    else:
        low, high = faces.query_box(start + float(0.5) * length * way, float(0.5) * length)
        query = wp.mesh_query_aabb(mesh, low, high)
        while wp.mesh_query_aabb_next(query, face):
            t, first = faces.sooner_face_hit(mesh, face, start, way, t, first)
    return first


@cache
def listed_touch_func(kinds: tuple[str, ...], real):
    """Function (c, L, row, i, deep, ends, reach: r and margin) -> (C, n, p, s0, slip) of a point that goes from ends[0] to
    ends[1], as `mesh.touch_mesh`, by its list. deep: it may be inside."""
    t, Rows, (corners, steps), formula = (types(real), contact_tables(real)[0], meshes.corner_readers(real),
                                          meshes.mesh_plane_func(real))
    cross, enter = meshes.crossing_func(real), meshes.entered_face(real)
    has_solid = "solid" in kinds

    @wp.func
    def through(kind: int, L: Any, at: wp.vec3i, mesh: wp.uint64, way: t.mat33):
        """(Y, front) of the face that is crossed. at: row, point, and face that the point is over in the end; way: from where,
        to where, and signed distance there with how far faces are looked for."""
        s, i = L.slot[at[0]], at[1]
        start = way[0]
        q1 = way[1]
        length = wp.length(q1 - start)
        Y = t.mat33()
        front = real(0.0)
        if wp.abs(way[2][0]) < length:
            crossed = first_listed_face_hit(mesh, L, s, i, wp.vec3f(start), wp.vec3f((q1 - start) / length), float(length))
            if crossed >= 0:
                Y, front = cross(kind, mesh, crossed, q1 - start)
            if has_solid:
                if kind == meshes.SOLID and front == real(0.0) and (crossed >= 0 or way[2][0] < real(0.0)):
                    began, _far = nearest_listed_face(mesh, L, s, i, wp.vec3f(start), float(way[2][1] - length))
                    if began >= 0 and began != at[2]:
                        Y, front = enter(mesh, began, start, q1)
        return Y, front

    @wp.func
    def touch_listed_mesh(c: Rows, L: Any, row: int, i: int, deep: int, ends: wp.types.matrix((2, 3), real), reach: t.vec2):
        kind, mesh, s = c.of.kind[row], c.of.mesh[row], L.slot[row]
        q1 = ends[1]
        most = float(reach[0] + reach[1])
        C = real(1.0e30)
        s0 = C
        n = q1
        p = q1
        slip = t.vec3()
        q = wp.vec3f(q1)
        sign = float(1.0)
        face = int(-1)
        near = float(faces.FAR)
        if kind != meshes.SOLID or deep == 0:
            face, near = nearest_listed_face(mesh, L, s, i, q, most)
        if has_solid:
            if kind == meshes.SOLID and deep != 0:
                wound = wp.mesh_query_point_sign_winding_number(mesh, q, wp.max(most, float(c.of.size[row][0])))
                if wound.result:
                    face = wound.face
                    sign = wound.sign
        if face >= 0:
            what, first = meshes.nearest_feature(corners(mesh, face, 0), q1)
            X = corners(mesh, face, first)
            V = steps(mesh, face, first)
            behind = what == meshes.INSIDE and wp.dot(meshes.triangle_normal(X), q1 - X[0]) < real(0.0)
            if has_solid:
                if kind == meshes.SOLID and deep == 0:
                    sign = wp.where(behind, float(-1.0), float(1.0))
                    if what != meshes.INSIDE:
                        sign = side_of_listed_faces(mesh, L, s, i, q, face, near)
            gap = real(sign)
            if behind:
                gap = -gap
            dist, _n, slip = meshes.feature_distance(X, V, what, gap, q1)
            Y, front = through(kind, L, wp.vec3i(row, i, wp.where(what == meshes.INSIDE, face, -1)), mesh,
                               wp.matrix_from_rows(ends[0] + slip, q1, t.vec3(dist, real(most), real(0.0))))
            C, n, p, s0, slip = formula(X, V, Y, what, t.vec2(gap, front), ends, reach[0])
        return C, n, p, s0, slip

    return touch_listed_mesh
