"""Convex shapes of bodies, each in its own frame: an inner core and a radius all around it.

    point    sphere (R)                   segment  capsule (R, H)             box, cylinder, cone, hull, triangle: R = 0
    h(d)     the place of the core farthest along d (support)
    face     the polygon of the surface farthest along d, counterclockwise as seen from outside; a segment where the surface
             bends, a point where it bends both ways

Sizes are those of kernels/contact/collider/shape.py, axis z: box (half edges), (R, H, -) of the others with H half the height
of a cylinder and a cone and of the segment of a capsule. Two cores of round shapes seldom meet, which is the hard case of GJK.
A cap of a cylinder or the base of a cone is a polygon of eight corners in its rim: in the body's frame while it lies flat, else
beginning with the lowest.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.collider.shape import BOX, CAPSULE, CONE, CYLINDER, PLANE, SPHERE
from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.real import types

HULL, TRIANGLE, MESH = 8, 9, 10          # further kinds; 6 and 7 are meshes of points (kernels/contact/mesh.py)
KINDS = {"plane": PLANE, "sphere": SPHERE, "box": BOX, "capsule": CAPSULE, "cylinder": CYLINDER, "cone": CONE, "hull": HULL,
         "triangle": TRIANGLE, "mesh": MESH}
CORNERS = 32                             # of a face, at most: hulls thin theirs
FLAT = wp.constant(1.0e-2)               # sine of a tilt below which a round face lies flat


@cache
def shape_type(real):
    """Struct of one shape."""
    t = types(real)

    @wp.struct
    class ConvexShape:
        kind: int
        row: int                             # of a hull in the tables
        size: t.vec3                         # [m]
        corners: t.mat33                     # of a triangle, rows [m]

    return ConvexShape


@cache
def hull_type(real):
    """Struct of the tables of convex hulls; faces and corners of all hulls stand one after another."""
    t = types(real)

    @wp.struct
    class ConvexHulls:
        first: wp.array(dtype=int)           # vertex of each hull, (hulls + 1,)
        vertex: wp.array(dtype=t.vec3)       # [m]
        first_face: wp.array(dtype=int)      # of each hull, (hulls + 1,)
        normal: wp.array(dtype=t.vec3)       # of each face, outward, unit
        offset: wp.array(dtype=real)         # normal.x of its plane [m]
        first_corner: wp.array(dtype=int)    # of each face, (faces + 1,)
        corner: wp.array(dtype=int)          # vertices around a face, from the hull's first
        size: wp.array(dtype=real)           # radius about the origin of the hull's frame [m], (hulls,)

    return ConvexHulls


@cache
def support_map_func(kinds: frozenset[str], real):
    """Function (shape, hulls, d) -> the place of the core farthest along d, d not 0."""
    t, Shape, Hulls = types(real), shape_type(real), hull_type(real)
    has = {name: name in kinds for name in KINDS}
    box, capsule, cylinder, cone = has["box"], has["capsule"], has["cylinder"], has["cone"]
    hull, triangle = has["hull"], has["triangle"]

    @wp.func
    def signed_half_extent(x: real, a: real):
        """a with the sign of x."""
        return wp.where(x < real(0.0), -a, a)

    @wp.func
    def support_on_rim(d: t.vec3, R: real):
        rho = wp.sqrt(d[0] * d[0] + d[1] * d[1])
        p = t.vec3(R, real(0.0), real(0.0))
        if rho > real(0.0):
            p = t.vec3(R * (d[0] / rho), R * (d[1] / rho), real(0.0))
        return p, rho

    @wp.func
    def support_on_hull(H: Hulls, row: int, d: t.vec3):
        best = H.first[row]
        most = wp.dot(H.vertex[best], d)
        for i in range(best + 1, H.first[row + 1]):
            far = wp.dot(H.vertex[i], d)
            if far > most:
                most = far
                best = i
        return H.vertex[best]

    @wp.func
    def support_on_triangle(X: t.mat33, d: t.vec3):
        far = X * d
        i = int(wp.argmax(far))
        return X[i]

    @standalone_function
    @wp.func
    def support_place(s: Shape, H: Hulls, d: t.vec3):
        p = t.vec3()
        if box:
            if s.kind == BOX:
                p = t.vec3(signed_half_extent(d[0], s.size[0]), signed_half_extent(d[1], s.size[1]),
                           signed_half_extent(d[2], s.size[2]))
        if capsule:
            if s.kind == CAPSULE:
                p[2] = signed_half_extent(d[2], s.size[1])
        if cylinder:
            if s.kind == CYLINDER:
                p, _rho = support_on_rim(d, s.size[0])
                p[2] = signed_half_extent(d[2], s.size[1])
        if cone:
            if s.kind == CONE:
                p, rho = support_on_rim(d, s.size[0])
                p[2] = -s.size[1]
                if real(2.0) * s.size[1] * d[2] > s.size[0] * rho:
                    p = t.vec3(real(0.0), real(0.0), s.size[1])
        if hull:
            if s.kind == HULL:
                p = support_on_hull(H, s.row, d)
        if triangle:
            if s.kind == TRIANGLE:
                p = support_on_triangle(s.corners, d)
        return p

    return support_place


@cache
def shape_extent_funcs(real):
    """(radius, size) of a shape [m]: all around the core; of a ball about its origin, not of a plane."""
    Shape, Hulls = shape_type(real), hull_type(real)

    @wp.func
    def core_radius(s: Shape):
        r = real(0.0)
        if s.kind == SPHERE or s.kind == CAPSULE:
            r = s.size[0]
        return r

    @standalone_function
    @wp.func(inline=False)
    def bounding_size(s: Shape, H: Hulls):
        r = s.size[0]
        if s.kind == BOX:
            r = wp.length(s.size)
        elif s.kind == CAPSULE:
            r = s.size[0] + s.size[1]
        elif s.kind == CYLINDER or s.kind == CONE:
            r = wp.sqrt(s.size[0] * s.size[0] + s.size[1] * s.size[1])
        elif s.kind == HULL:
            r = H.size[s.row]
        elif s.kind == TRIANGLE:
            r = wp.max(wp.length(s.corners[1] - s.corners[0]), wp.length(s.corners[2] - s.corners[0]))
        return r

    return core_radius, bounding_size
