"""A convex shape A against one triangle of a mesh, so that a body slides over inner edges as over a plane. In A's frame.

Corners X, unit normal f, e_k = X_{k+1} - X_k, g_k the normal of the neighbour across edge k. The normal n of nearest places
that lie on an edge or a corner v belongs to the mesh only within the Voronoi region of that (Ericson 2005, section 5.1.5),

    edge      n.(e_k x f) >= 0,  n.(g_k x e_k) >= 0     of a rim only the first
    corner    n.(q - v) <= 0                            for all neighbours q of v

Between two faces of one plane that leaves n = f; at a hollow edge nothing: faces alone touch there. Where n does not belong, A
can touch the inside of the face alone: n = f, and only what lies over the triangle counts; nothing where the way out along f is
more than DEEPER times the least: another face holds A there (the wall under an edge on which a box stands).

A face of a closed mesh pushes to its front; one of a sheet to the side where the centre of A is. A convex edge is met from both
its faces, a corner from all: equal points, which share what one would bear.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.collider.shape import CAPSULE, CONE, CYLINDER, SPHERE
from wsim.kernels.math.eigen import identity_like
from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.lists.manifold import manifold_type
from wsim.kernels.rigid.narrow.clip import BIAS, clip_types
from wsim.kernels.rigid.narrow.gjk import gjk_nearest_func
from wsim.kernels.rigid.narrow.mesh import mesh_type, surface_face_readers
from wsim.kernels.rigid.narrow.pair import manifold_completion_func
from wsim.kernels.rigid.narrow.shape import TRIANGLE, hull_type, shape_extent_funcs, shape_type, support_map_func

ON = wp.constant(1.0e-4)                  # weight of a corner below which a place lies on the edge across
STRAIGHT = wp.constant(0.99999)           # cosine: n is f
DEEPER = wp.constant(4.0)
OUTSIDE = wp.constant(1.0e-3)             # sine by which n may lie outside a region


@cache
def normal_region_funcs(real):
    """(edge, corner): functions whether a normal n, in A's frame, belongs to an edge of a mesh, (surfaces, R, e, f, across, n),
    or to one of its points, (surfaces, point, R, n). R: from A's axes to the mesh's."""
    t, Surfaces = types(real), mesh_type(real)
    _corners, normal = surface_face_readers(real)

    @wp.func
    def within_edge_region(S: Surfaces, R: t.mat33, e: t.vec3, f: t.vec3, across: int, n: t.vec3):
        found = wp.dot(n, wp.normalize(wp.cross(e, f))) >= -real(OUTSIDE)
        if across >= 0:
            found = found and wp.dot(n, wp.normalize(wp.cross(normal(S, across) * R, e))) >= -real(OUTSIDE)
        return found

    @wp.func
    def at_corner(S: Surfaces, v: int, R: t.mat33, n: t.vec3):
        found = bool(True)
        for k in range(S.first_around[v], S.first_around[v + 1]):
            e = wp.normalize((S.point[S.around[k]] - S.point[v]) * R)
            found = found and wp.dot(n, e) <= real(OUTSIDE)
        return found

    return within_edge_region, at_corner


@cache
def voronoi_membership_func(real):
    """Function (surfaces, face, R, X, n, b) -> whether the normal n at the place b on the rim of a face belongs to the mesh.
    X: its corners in A's frame; R: from A's axes to the mesh's."""
    t, Surfaces, (within_edge_region, at_corner) = types(real), mesh_type(real), normal_region_funcs(real)

    @wp.func
    def normal_in_voronoi_region(S: Surfaces, face: int, R: t.mat33, X: t.mat33, n: t.vec3, b: t.vec3):
        outward = wp.cross(X[1] - X[0], X[2] - X[0])
        twice = wp.length(outward)
        f = outward / twice
        edges = int(0)
        sum = int(0)
        for k in range(3):
            if wp.dot(f, wp.cross(X[(k + 1) % 3] - X[k], b - X[k])) <= real(ON) * twice:       # twice the area over edge k
                edges += 1
                sum += k
        found = bool(False)
        if edges == 1:
            found = within_edge_region(S, R, X[(sum + 1) % 3] - X[sum], f, S.beside[face][sum], n)
        elif edges == 2:
            corner = wp.where(sum == 1, 1, wp.where(sum == 2, 0, 2))
            found = at_corner(S, S.face[face][corner], R, n)
        return found

    return normal_in_voronoi_region


@cache
def triangle_nearest_func(kinds: frozenset[str], real):
    """Function (a, hulls, surfaces, face, R, X, f, margin) -> Nearest as the mesh has it, f to A's side."""
    t, Shape, Hulls, Surfaces, Nearest = (types(real), shape_type(real), hull_type(real), mesh_type(real),
                                          clip_types(real).Nearest)
    near_of, lowest, belongs = gjk_nearest_func(kinds, real), support_map_func(kinds, real), voronoi_membership_func(real)
    radius, size = shape_extent_funcs(real)

    @wp.func
    def nearest_over_face(a: Shape, H: Hulls, X: t.mat33, f: t.vec3):
        """Nearest of the face alone."""
        near = Nearest()
        near.n = f
        near.gap = wp.dot(lowest(a, H, -f) - X[0], f) - radius(a)
        near.key = -1
        return near

    @wp.func
    def nearest_on_triangle(a: Shape, H: Hulls, S: Surfaces, face: int, R: t.mat33, X: t.mat33, f: t.vec3, margin: real):
        b = Shape()
        b.kind = TRIANGLE
        b.corners = X
        near = near_of(a, b, H, identity_like(X), t.vec3(), margin)
        if near.gap <= margin:
            if wp.dot(near.n, f) >= real(STRAIGHT):
                near.n = f
                if a.kind == SPHERE or a.kind == CAPSULE or a.kind == CYLINDER or a.kind == CONE:
                    near = nearest_over_face(a, H, X, f)       # what is nearest on a rim is not what rolls on the face
                    if a.kind == SPHERE:
                        near.x = -(radius(a) + real(0.5) * near.gap) * f
                        near.key = 0
            elif not belongs(S, face, R, X, near.n, near.x - (real(0.5) * near.gap) * near.n):
                alone = nearest_over_face(a, H, X, f)
                if alone.gap < real(DEEPER) * wp.min(near.gap, real(0.0)) - real(BIAS) * size(a, H):
                    alone.gap = real(2.0) * wp.abs(margin) + size(a, H)
                near = alone
        return near

    return nearest_on_triangle


@cache
def triangle_func(kinds: frozenset[str], real):
    """Function (a, hulls, surfaces, where, R, c, margin) -> Manifold in A's frame of a shape, no plane, and a face of a mesh.
    where: (number of the mesh, of the face among those of all); (R, c): pose of A in the mesh's frame."""
    t, Shape, Hulls, Manifold, Surfaces = types(real), shape_type(real), hull_type(real), manifold_type(real), mesh_type(real)
    every = kinds | {"triangle"}
    near_of, completed = triangle_nearest_func(every, real), manifold_completion_func(every, real, True)
    corners, _normal = surface_face_readers(real)

    @standalone_function
    @wp.func
    def triangle_manifold(a: Shape, H: Hulls, S: Surfaces, where: wp.vec2i, R: t.mat33, c: t.vec3, margin: real):
        m = Manifold()
        X = corners(S, where[1], R, c)
        f = wp.normalize(wp.cross(X[1] - X[0], X[2] - X[0]))
        front = wp.dot(f, X[0]) <= real(0.0)                               # the centre of A is at 0
        if S.sided[where[0]] == 0 and not front:
            f = -f                                                         # the other side of a sheet
            front = True
        if front and wp.length_sq(f) > real(0.0):
            b = Shape()
            b.kind = TRIANGLE
            b.corners = X
            near = near_of(a, H, S, where[1], R, X, f, margin)
            m = completed(a, b, H, identity_like(X), t.vec3(), near, margin)
        return m

    return triangle_manifold
