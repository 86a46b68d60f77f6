"""Candidates: the faces of mesh colliders that a point may come near in many substeps, listed once.

    q   place of a point in a mesh's own frame [m]         near   within which a substep looks for faces about q1 [m]

Where a list is made, at q, it holds every face within R of q, with what the mesh moves in its own frame until the list ends
taken off (`stride`). A later substep looks within `near` of q1 alone: as long as |q1 - q| + near <= R every face that it could
find is in the list, and it looks no further than there. Lists are made anew each `every` substeps, and in between by a point
that went further than was thought. A list that has no room for all of its faces is none: the tree is asked in every substep.

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

from wsim.kernels.contact.mesh import INSIDE, SOLID, crossing, normal, part, reading, settled, toward
from wsim.kernels.contact.project import tables
from wsim.kernels.math.real import types

ROOM = 16              # faces of a list
AHEAD = 2.0            # of the motion that a point would have until its list ends, at the speed that it has when it is made
SLACK = 1.0e-6         # of places, that boxes about them are larger by
FAR = 1.0e30           # distance of a face that has no area


@wp.func_native("return wp::closest_point_to_triangle(a, b, c, q);")
def weights(a: wp.vec3f, b: wp.vec3f, c: wp.vec3f, q: wp.vec3f) -> wp.vec2f: ...


@wp.func_native("""
    float t, u, v, sign;
    return wp::intersect_ray_tri_woop(q, way, a, b, c, t, u, v, sign, nullptr) && t >= 0.0f ? t : -1.0f;
""")
def struck(q: wp.vec3f, way: wp.vec3f, a: wp.vec3f, b: wp.vec3f, c: wp.vec3f) -> float: ...


@wp.func_native("return wp::mesh_get(mesh).average_edge_length;")
def edge_length(mesh: wp.uint64) -> float: ...


@wp.func
def corners_of(mesh: wp.uint64, face: int):
    return wp.matrix_from_rows(wp.mesh_get_point(mesh, 3 * face), wp.mesh_get_point(mesh, 3 * face + 1),
                               wp.mesh_get_point(mesh, 3 * face + 2))


@wp.func
def away(mesh: wp.uint64, face: int, q: wp.vec3f):
    """(distance [m] of a face, FAR for a sliver, as Warp's queries leave it out; its place nearest to q)."""
    X = corners_of(mesh, face)
    e0 = X[1] - X[0]
    e1 = X[2] - X[0]
    e2 = X[2] - X[1]
    size = wp.dot(e0, e0) + wp.dot(e1, e1) + wp.dot(e2, e2)
    dist = float(FAR)
    p = q
    if wp.length(wp.cross(e0, e1)) >= float(1.0e-6) * size:
        uv = weights(X[0], X[1], X[2], q)
        p = uv[0] * X[0] + uv[1] * X[1] + (float(1.0) - uv[0] - uv[1]) * X[2]
        dist = wp.length(p - q)
    return dist, p


@wp.func
def angle(a: wp.vec3f, b: wp.vec3f):
    return wp.acos(wp.clamp(wp.dot(wp.normalize(a), wp.normalize(b)), float(-1.0), float(1.0)))


@wp.func
def off(p: wp.vec3f, a: wp.vec3f, b: wp.vec3f):
    """Square of the distance of p from the line through a and b."""
    e = b - a
    t = wp.dot(p - a, e) / wp.dot(e, e)
    return wp.length_sq(p - a - t * e)


@wp.func
def weighted(mesh: wp.uint64, face: int, q: wp.vec3f, most: float, eps: float):
    """Normal of a face by the angle that it has about its place nearest to q, where that is no further than `most` [m]."""
    n = wp.vec3f()
    dist, p = away(mesh, face, q)
    if dist <= most:
        X = corners_of(mesh, face)
        square = eps * eps
        weight = float(2.0) * wp.pi
        if wp.min(wp.min(off(p, X[0], X[1]), off(p, X[1], X[2])), off(p, X[2], X[0])) < square:
            weight = wp.pi
        if wp.length_sq(p - X[0]) < square:
            weight = angle(X[1] - X[0], X[2] - X[0])
        elif wp.length_sq(p - X[1]) < square:
            weight = angle(X[2] - X[1], X[0] - X[1])
        elif wp.length_sq(p - X[2]) < square:
            weight = angle(X[0] - X[2], X[1] - X[2])
        n = weight * wp.normalize(wp.cross(X[1] - X[0], X[2] - X[0]))
    return n


@wp.func
def box(q: wp.vec3f, r: float):
    more = r + SLACK * (r + wp.max(wp.abs(q)))
    half = wp.vec3f(more, more, more)
    return q - half, q + half


@wp.func
def nearer(mesh: wp.uint64, face: int, q: wp.vec3f, dist: float, first: int):
    """(distance, face): the nearer one of two, of equal ones the first."""
    found, _p = away(mesh, face, q)
    if found < dist or (found == dist and face < first):
        return found, face
    return dist, first


@wp.func
def make(mesh: wp.uint64, L: Any, s: int, i: int, q: wp.vec3f, radius: float, moved: float):
    """Makes the list of slot s and point i: the faces within `radius` of q; moved: what the mesh may move meanwhile [m]."""
    face = int(0)
    count = int(0)
    low, high = box(q, radius)
    query = wp.mesh_query_aabb(mesh, low, high)
    while wp.mesh_query_aabb_next(query, face):
        dist, _p = away(mesh, face, q)
        if dist <= radius:
            if count < ROOM:
                L.face[(s * ROOM + count) * L.w.shape[0] + i] = face
            count += 1
    at = s * L.w.shape[0] + i
    L.count[at] = count
    L.place[at] = q
    L.radius[at] = radius - moved


@wp.func
def forget(L: Any, row: int, i: int, k: int):
    """Leaves no list where lists end."""
    s = L.slot[row]
    if s >= 0 and k % L.every == 0:
        L.radius[s * L.w.shape[0] + i] = float(-1.0)


@cache
def refresh(real):
    """Function (c, L, row, i, k, ends, near): makes the list of a row and point i where it ends, or would not do."""
    Rows = tables(real)[0]

    @wp.func
    def refresh(c: Rows, L: Any, row: int, i: int, k: int, ends: wp.types.matrix((2, 3), real), near: real):
        s = L.slot[row]
        at = s * L.w.shape[0] + i
        q = wp.vec3f(ends[1])
        begin = k % L.every
        if not wp.length(q - L.place[at]) + float(near) <= L.radius[at]:
            end = wp.min(k - begin + L.every, c.stride.shape[0])
            moved = float(0.0)
            for later in range(k + 1, end):
                moved += float(c.stride[later, row])
            more = AHEAD * float(end - k) * float(wp.length(ends[1] - ends[0])) + float(0.5) * float(c.skin)
            make(c.mesh[row], L, s, i, q, float(near) + more + float(2.0) * moved, moved)

    return refresh


@wp.func
def nearest(mesh: wp.uint64, L: Any, s: int, i: int, q: wp.vec3f, near: float):
    """(face nearer than `near` or -1, its distance [m])."""
    count = L.count[s * L.w.shape[0] + i]
    dist = float(FAR)
    first = int(-1)
    face = int(0)
    if count <= ROOM:
        for j in range(count):
            dist, first = nearer(mesh, L.face[(s * ROOM + j) * L.w.shape[0] + i], q, dist, first)
    else:
        low, high = box(q, near)
        query = wp.mesh_query_aabb(mesh, low, high)
        while wp.mesh_query_aabb_next(query, face):
            dist, first = nearer(mesh, face, q, dist, first)
    if not dist < near:
        first = -1
    return first, dist


@wp.func
def side(mesh: wp.uint64, L: Any, s: int, i: int, q: wp.vec3f, nearest: int, dist: float):
    """1, or -1 where q is behind the surface: by the faces no further than the nearest one, but for rounding."""
    eps = float(1.0e-3) * edge_length(mesh)
    count = L.count[s * L.w.shape[0] + i]
    n = wp.vec3f()
    face = int(0)
    if count <= ROOM:
        for j in range(count):
            n += weighted(mesh, L.face[(s * ROOM + j) * L.w.shape[0] + i], q, dist + eps, eps)
    else:
        low, high = box(q, dist + eps)
        query = wp.mesh_query_aabb(mesh, low, high)
        while wp.mesh_query_aabb_next(query, face):
            n += weighted(mesh, face, q, dist + eps, eps)
    _dist, p = away(mesh, nearest, q)
    return wp.where(wp.dot(n, q - p) > float(0.0), float(1.0), float(-1.0))


@wp.func
def sooner(mesh: wp.uint64, face: int, start: wp.vec3f, way: wp.vec3f, t: float, first: int):
    """(length of a ray, face): the sooner one of two, of equal ones the first."""
    X = corners_of(mesh, face)
    found = struck(start, way, X[0], X[1], X[2])
    if found >= float(0.0) and (found < t or (found == t and face < first)):
        return found, face
    return t, first


@wp.func
def hit(mesh: wp.uint64, L: Any, s: int, i: int, start: wp.vec3f, way: wp.vec3f, length: float):
    """The first face on a ray of that length, -1: none. Its end is q1, so that all it may meet is near there."""
    count = L.count[s * L.w.shape[0] + i]
    t = length
    first = int(-1)
    face = int(0)
    if count <= ROOM:
        for j in range(count):
            t, first = sooner(mesh, L.face[(s * ROOM + j) * L.w.shape[0] + i], start, way, t, first)
    else:
        low, high = box(start + float(0.5) * length * way, float(0.5) * length)
        query = wp.mesh_query_aabb(mesh, low, high)
        while wp.mesh_query_aabb_next(query, face):
            t, first = sooner(mesh, face, start, way, t, first)
    return first


@cache
def touch_listed(kinds: tuple[str, ...], real):
    """Function (c, L, row, i, deep, ends, reach: r and margin) -> (C, n, p, s0, slip) of a point that goes from ends[0] to
    ends[1], as `mesh.touch_mesh`, by its list; points that may have started inside (`deep`) ask the tree."""
    t, Rows, (corners, steps), cross, formula = types(real), tables(real)[0], reading(real), crossing(real), settled(real)
    has_solid = "solid" in kinds

    @wp.func
    def touch_listed(c: Rows, L: Any, row: int, i: int, deep: int, ends: wp.types.matrix((2, 3), real), reach: t.vec2):
        kind, mesh, s = c.kind[row], c.mesh[row], L.slot[row]
        q1 = ends[1]
        most = float(reach[0] + reach[1])
        C = real(1.0e30)
        s0 = C
        n = q1
        p = q1
        slip = t.vec3()
        q = wp.vec3f(q1)
        sign = float(1.0)
        face, near = nearest(mesh, L, s, i, q, most)
        if has_solid:
            if kind == SOLID and deep != 0:
                face = -1
                wound = wp.mesh_query_point_sign_winding_number(mesh, q, wp.max(most, float(c.size[row][0])))
                if wound.result:
                    face = wound.face
                    sign = wound.sign
        if face >= 0:
            what, first = part(corners(mesh, face, 0), q1)
            X = corners(mesh, face, first)
            V = steps(mesh, face, first)
            behind = what == INSIDE and wp.dot(normal(X), q1 - X[0]) < real(0.0)
            if has_solid:
                if kind == SOLID and deep == 0:
                    sign = wp.where(behind, float(-1.0), float(1.0))
                    if what != INSIDE:
                        sign = side(mesh, L, s, i, q, face, near)
            gap = real(sign)
            if behind:
                gap = -gap
            dist, _n, slip = toward(X, V, what, gap, q1)
            start = ends[0] + slip
            length = wp.length(q1 - start)
            Y = t.mat33()
            front = real(0.0)
            if wp.abs(dist) < length:
                through = hit(mesh, L, s, i, wp.vec3f(start), wp.vec3f((q1 - start) / length), float(length))
                if through >= 0:
                    Y, front = cross(kind, mesh, through, q1 - start)
            C, n, p, s0, slip = formula(X, V, Y, what, t.vec2(gap, front), ends, reach[0])
        return C, n, p, s0, slip

    return touch_listed
