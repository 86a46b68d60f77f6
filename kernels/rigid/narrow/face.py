"""The face of a convex shape that lies farthest along a direction, as corners for clipping. See kernels/rigid/narrow/shape.py.

    box       of three that contain the lowest corner the one that faces d most         cylinder   cap, or a line of the side
    hull      likewise of those that contain the lowest vertex                           cone       base, or a line of the flank
    capsule   its segment          triangle  itself, seen from the side of d             sphere     its centre
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.collider.shape import BOX, CAPSULE, CONE, CYLINDER
from wsim.kernels.math.eigen import machine_epsilon
from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.narrow.shape import FLAT, HULL, TRIANGLE, hull_type, shape_type

ROUND = 8                                   # corners in a rim


@cache
def flat_faces(real):
    """(box, hull, triangle): functions (shape, hulls, d, P_out) -> (count, number, outward unit normal)."""
    t, Shape, Hulls = types(real), shape_type(real), hull_type(real)

    @wp.func(inline=False)
    def lowest_box_face(s: Shape, d: t.vec3, P: wp.array(dtype=t.vec3)):
        k = int(wp.argmax(wp.abs(d)))
        i = (k + 1) % 3
        j = (k + 2) % 3
        side = wp.where(d[k] < real(0.0), real(-1.0), real(1.0))
        n = t.vec3()
        n[k] = side
        for c in range(4):
            p = t.vec3()
            p[k] = side * s.size[k]
            p[i] = wp.where(c == 0 or c == 3, -s.size[i], s.size[i])
            p[j] = side * wp.where(c < 2, -s.size[j], s.size[j])
            P[c] = p
        return 4, 2 * k + wp.where(side < real(0.0), 1, 0), n

    @wp.func(inline=False)
    def lowest_hull_face(s: Shape, H: Hulls, d: t.vec3, P: wp.array(dtype=t.vec3)):
        low = H.first[s.row]
        for i in range(low + 1, H.first[s.row + 1]):
            if wp.dot(H.vertex[i], d) > wp.dot(H.vertex[low], d):
                low = i
        best = int(-1)
        most = real(-2.0)
        near = real(32.0) * machine_epsilon(real(1.0)) * H.size[s.row]
        for f in range(H.first_face[s.row], H.first_face[s.row + 1]):
            if H.offset[f] - wp.dot(H.normal[f], H.vertex[low]) <= near and wp.dot(H.normal[f], d) > most:
                most = wp.dot(H.normal[f], d)
                best = f
        count = int(1)
        n = t.vec3()
        P[0] = H.vertex[low]
        if best >= 0:
            count = H.first_corner[best + 1] - H.first_corner[best]
            n = H.normal[best]
            for c in range(count):
                P[c] = H.vertex[H.first[s.row] + H.corner[H.first_corner[best] + c]]
            best -= H.first_face[s.row]
        return count, best, n

    @wp.func
    def facing_triangle(s: Shape, d: t.vec3, P: wp.array(dtype=t.vec3)):
        X = s.corners
        n = wp.normalize(wp.cross(X[1] - X[0], X[2] - X[0]))
        P[0] = X[0]
        P[1] = X[1]
        P[2] = X[2]
        side = int(0)
        if wp.dot(n, d) < real(0.0):
            P[1] = X[2]
            P[2] = X[1]
            n = -n
            side = 1
        return 3, side, n

    return lowest_box_face, lowest_hull_face, facing_triangle


@cache
def round_faces(real):
    """(cylinder, cone): functions (shape, d, P_out) -> (count, number, normal), the normal 0 of a line."""
    t, Shape = types(real), shape_type(real)

    @wp.func
    def rim_polygon(d: t.vec3, rho: real, R: real, z: real, side: real, P: wp.array(dtype=t.vec3)):
        """Corners of a rim at the height z, turning about z as `side` says."""
        c = real(1.0)
        s = real(0.0)
        if rho > real(FLAT):
            c = d[0] / rho
            s = d[1] / rho
        for k in range(int(ROUND)):
            a = side * real(k) * real(wp.static(6.283185307179586 / ROUND))
            ca = wp.cos(a)
            sa = wp.sin(a)
            P[k] = t.vec3(R * (c * ca - s * sa), R * (s * ca + c * sa), z)

    @wp.func
    def outward_radial_unit(d: t.vec3, rho: real):
        u = t.vec3(real(1.0), real(0.0), real(0.0))
        if rho > real(0.0):
            u = t.vec3(d[0] / rho, d[1] / rho, real(0.0))
        return u

    @wp.func(inline=False)
    def lowest_cylinder_face(s: Shape, d: t.vec3, P: wp.array(dtype=t.vec3)):
        rho = wp.sqrt(d[0] * d[0] + d[1] * d[1])
        n = t.vec3()
        count = int(2)
        number = int(2)
        if wp.abs(d[2]) > rho:
            side = wp.where(d[2] < real(0.0), real(-1.0), real(1.0))
            n[2] = side
            count = ROUND
            number = wp.where(d[2] < real(0.0), 1, 0)
            rim_polygon(d, rho, s.size[0], side * s.size[1], side, P)
        else:
            u = s.size[0] * outward_radial_unit(d, rho)
            P[0] = t.vec3(u[0], u[1], -s.size[1])
            P[1] = t.vec3(u[0], u[1], s.size[1])
        return count, number, n

    @wp.func(inline=False)
    def lowest_cone_face(s: Shape, d: t.vec3, P: wp.array(dtype=t.vec3)):
        rho = wp.sqrt(d[0] * d[0] + d[1] * d[1])
        R = s.size[0]
        H = s.size[1]
        L = wp.sqrt(R * R + real(4.0) * H * H)
        n = t.vec3()
        count = int(2)
        number = int(2)
        if -d[2] > (real(2.0) * H * rho + R * d[2]) / L:                  # the base rather than the flank
            n[2] = real(-1.0)
            count = ROUND
            number = 1
            rim_polygon(d, rho, R, -H, real(-1.0), P)
        else:
            u = R * outward_radial_unit(d, rho)
            P[0] = t.vec3(u[0], u[1], -H)
            P[1] = t.vec3(real(0.0), real(0.0), H)
        return count, number, n

    return lowest_cylinder_face, lowest_cone_face


@cache
def support_face_func(kinds: frozenset[str], real):
    """Function (shape, hulls, d, P_out) -> (corners, number of the face, outward unit normal; 0 of a line or a point)."""
    t, Shape, Hulls = types(real), shape_type(real), hull_type(real)
    box, hull, triangle = flat_faces(real)
    cylinder, cone = round_faces(real)
    has_box, has_capsule, has_cylinder, has_cone, has_hull, has_triangle = (
        name in kinds for name in ("box", "capsule", "cylinder", "cone", "hull", "triangle"))

    @standalone_function
    @wp.func
    def support_face(s: Shape, H: Hulls, d: t.vec3, P: wp.array(dtype=t.vec3)):
        count = int(1)
        number = int(0)
        n = t.vec3()
        P[0] = t.vec3()
        if has_box:
            if s.kind == BOX:
                count, number, n = box(s, d, P)
        if has_capsule:
            if s.kind == CAPSULE:
                count = 2
                P[0] = t.vec3(real(0.0), real(0.0), -s.size[1])
                P[1] = t.vec3(real(0.0), real(0.0), s.size[1])
        if has_cylinder:
            if s.kind == CYLINDER:
                count, number, n = cylinder(s, d, P)
        if has_cone:
            if s.kind == CONE:
                count, number, n = cone(s, d, P)
        if has_hull:
            if s.kind == HULL:
                count, number, n = hull(s, H, d, P)
        if has_triangle:
            if s.kind == TRIANGLE:
                count, number, n = triangle(s, d, P)
        return count, number, n

    return support_face
