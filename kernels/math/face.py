"""Faces of Warp's meshes beside a point, one by one, by the formulas of Warp's own queries, so that they say the same.

Distances are in m; slivers, of a double area under 1e-6 of the sum of squared edges, are far, as the queries leave them out.
"""

# Device code: int(0) makes a variable of what would be a constant.
# ruff: noqa: UP018

import warp as wp

FAR = 1.0e30           # distance of a face that has no area
SLACK = 1.0e-6         # of places, that boxes about them are larger by
ROUNDED = 4.0e-6       # of coordinates, 64 roundings of float32: distances that differ by less are one


@wp.func_native("return wp::closest_point_to_triangle(a, b, c, q);")
def triangle_barycentrics(a: wp.vec3f, b: wp.vec3f, c: wp.vec3f, q: wp.vec3f) -> wp.vec2f: ...


@wp.func_native("""
    float t, u, v, sign;
    return wp::intersect_ray_tri_woop(q, way, a, b, c, t, u, v, sign, nullptr) && t >= 0.0f ? t : -1.0f;
""")
def ray_triangle_length(q: wp.vec3f, way: wp.vec3f, a: wp.vec3f, b: wp.vec3f, c: wp.vec3f) -> float: ...


@wp.func_native("return wp::mesh_get(mesh).average_edge_length;")
def edge_length(mesh: wp.uint64) -> float: ...


@wp.func_native("""
    const wp::Mesh m = wp::mesh_get(mesh);
    const wp::BVHPackedNodeHalf low = wp::bvh_load_node(m.bvh.node_lowers, *m.bvh.root);
    const wp::BVHPackedNodeHalf high = wp::bvh_load_node(m.bvh.node_uppers, *m.bvh.root);
    return wp::max(wp::max(wp::max(-low.x, high.x), wp::max(-low.y, high.y)), wp::max(-low.z, high.z));
""")
def mesh_extent(mesh: wp.uint64) -> float:
    """Largest coordinate of a mesh's points [m]."""
    ...


@wp.func
def equal_distance(mesh: wp.uint64, q: wp.vec3f):
    """Difference up to which distances of q from faces count as one, as part of the mean edge: what rounding leaves between
    faces that share an edge. Warp's own 1e-3 would count both sides of a wall that is thinner as one."""
    return wp.min(ROUNDED * wp.max(wp.max(wp.abs(q)), mesh_extent(mesh)) / edge_length(mesh), float(1.0e-3))


@wp.func
def corners_of(mesh: wp.uint64, face: int):
    return wp.matrix_from_rows(wp.mesh_get_point(mesh, 3 * face), wp.mesh_get_point(mesh, 3 * face + 1),
                               wp.mesh_get_point(mesh, 3 * face + 2))


@wp.func
def face_distance(mesh: wp.uint64, face: int, q: wp.vec3f):
    """(distance [m] of a face, FAR for a sliver, as Warp's queries leave it out; its place nearest to q)."""
    X = corners_of(mesh, face)
    e0 = X[1] - X[0]
    e1 = X[2] - X[0]
    e2 = X[2] - X[1]
    size = wp.dot(e0, e0) + wp.dot(e1, e1) + wp.dot(e2, e2)
    dist = float(FAR)
    p = q
    if wp.length(wp.cross(e0, e1)) >= float(1.0e-6) * size:
        uv = triangle_barycentrics(X[0], X[1], X[2], q)
        p = uv[0] * X[0] + uv[1] * X[1] + (float(1.0) - uv[0] - uv[1]) * X[2]
        dist = wp.length(p - q)
    return dist, p


@wp.func
def angle_between_vectors(a: wp.vec3f, b: wp.vec3f):
    return wp.acos(wp.clamp(wp.dot(wp.normalize(a), wp.normalize(b)), float(-1.0), float(1.0)))


@wp.func
def squared_line_distance(p: wp.vec3f, a: wp.vec3f, b: wp.vec3f):
    """Square of the distance of p from the line through a and b."""
    e = b - a
    t = wp.dot(p - a, e) / wp.dot(e, e)
    return wp.length_sq(p - a - t * e)


@wp.func
def angle_weighted_normal(mesh: wp.uint64, face: int, q: wp.vec3f, most: float, eps: float):
    """Normal of a face by the angle that it has about its place nearest to q, where that is no further than `most` [m]."""
    n = wp.vec3f()
    dist, p = face_distance(mesh, face, q)
    if dist <= most:
        X = corners_of(mesh, face)
        square = eps * eps
        weight = float(2.0) * wp.pi
        if wp.min(wp.min(squared_line_distance(p, X[0], X[1]), squared_line_distance(p, X[1], X[2])),
                  squared_line_distance(p, X[2], X[0])) < square:
            weight = wp.pi
        if wp.length_sq(p - X[0]) < square:
            weight = angle_between_vectors(X[1] - X[0], X[2] - X[0])
        elif wp.length_sq(p - X[1]) < square:
            weight = angle_between_vectors(X[2] - X[1], X[0] - X[1])
        elif wp.length_sq(p - X[2]) < square:
            weight = angle_between_vectors(X[0] - X[2], X[1] - X[2])
        n = weight * wp.normalize(wp.cross(X[1] - X[0], X[2] - X[0]))
    return n


@wp.func
def side_of_face(mesh: wp.uint64, face: int, q: wp.vec3f, p: wp.vec3f, most: float):
    """1 where q is before a face that is no further than `most` [m], by p, the surface's place nearest to q, -1 where it is
    not; 0 for a face further away. Where all faces say one thing, so does the sum of their weighted normals."""
    front = int(0)
    dist, _p = face_distance(mesh, face, q)
    if dist <= most:
        X = corners_of(mesh, face)
        front = wp.where(wp.dot(wp.cross(X[1] - X[0], X[2] - X[0]), q - p) > float(0.0), 1, -1)
    return front


@wp.func
def query_box(q: wp.vec3f, r: float):
    more = r + SLACK * (r + wp.max(wp.abs(q)))
    half = wp.vec3f(more, more, more)
    return q - half, q + half


@wp.func
def nearer_face(mesh: wp.uint64, face: int, q: wp.vec3f, dist: float, first: int):
    """(distance, face): the nearer one of two, of equal ones the first."""
    found, _p = face_distance(mesh, face, q)
    if found < dist or (found == dist and face < first):
        return found, face
    return dist, first


@wp.func
def sooner_face_hit(mesh: wp.uint64, face: int, start: wp.vec3f, way: wp.vec3f, t: float, first: int):
    """(length of a ray, face): the sooner one of two, of equal ones the first."""
    X = corners_of(mesh, face)
    found = ray_triangle_length(start, way, X[0], X[1], X[2])
    if found >= float(0.0) and (found < t or (found == t and face < first)):
        return found, face
    return t, first
