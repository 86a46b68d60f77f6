"""How deep points, triangles and edges are inside of colliders at one time; asked for by reports, never by a step.

    phi   signed distance to a collider [m], negative inside        depth of a triangle: max of -phi over all of it, or 0

Convex shapes. phi is convex, so on a triangle A B C the function G(s) = min over t of phi(A + s (B - A) + t s (C - B)) is
convex in s, 0 <= s, t <= 1 (partial minimum over slices): golden sections in s, bisection of the slope n.e in t. phi has
slope 1, so the depth is right to 5e-4 (GOLDEN^16 + 2^-14) of the longest edge, and never too great. Tangents lie below phi: a
triangle where one at a corner or at the centre stays above what was found before is left out.

Meshes. phi at the places of a lattice of PLACES along each edge, then a compass search (Hooke, Jeeves 1961) from the
deepest of them, in steps halved down to 1e-3 of an edge: a local maximum, never too great. Open meshes have no inside.

Triangles (of springs: A B B) with a pinned corner inside a collider are left out for that collider: they were put there.
"""

# Device code: int(0) makes a variable of what would be a constant, and an outer `if` on a Python bool drops its branch
# before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.contact.collide import collider_touch_func, split_convex_and_meshes
from wsim.kernels.contact.collider.shape import convex_distance_func
from wsim.kernels.contact.mesh import SHEET, SOLID
from wsim.kernels.contact.project import TOUCHED, contact_tables, slot_type
from wsim.kernels.math.marks import owns_points
from wsim.kernels.math.real import types

GOLDEN, LESS = 0.6180339887498949, 0.3819660112501051
SECTIONS, HALVINGS = 16, 14            # of s and of t; loops of so few turns are unrolled
PLACES, PACE = 5, 0.25                 # of the lattice along an edge, and the part of it between them
SHORTER, TRIES = 8, 64                 # how often the compass is halved, and turned at most


@cache
def convex_penetration_func(kinds: tuple[str, ...], real):
    """Function (kind, size, X, most) -> least phi of a triangle (corners in rows), or some value >= most where it is."""
    t, formula = types(real), convex_distance_func(kinds)
    vec3 = t.vec3

    @wp.func
    def tangent_lower_bound(kind: int, size: vec3, X: t.mat33, q: vec3):
        """A bound of phi on the triangle from below, by the tangent at q."""
        phi, n = formula(kind, size, q)
        return phi + wp.min(wp.dot(n, X[0] - q), wp.min(wp.dot(n, X[1] - q), wp.dot(n, X[2] - q)))

    @wp.func(inline=False)
    def least_phi_on_segment(kind: int, size: vec3, a: vec3, e: vec3):
        """Least phi of a + t e."""
        phi, n = formula(kind, size, a)
        least = phi
        if wp.dot(n, e) < real(0.0):
            phi, n = formula(kind, size, a + e)
            least = wp.min(least, phi)
            if wp.dot(n, e) > real(0.0):
                low = real(0.0)
                high = real(1.0)
                for _ in range(HALVINGS):
                    middle = real(0.5) * (low + high)
                    phi, n = formula(kind, size, a + middle * e)
                    least = wp.min(least, phi)
                    if wp.dot(n, e) < real(0.0):
                        low = middle
                    else:
                        high = middle
        return least

    @wp.func
    def least_phi_on_triangle(kind: int, size: vec3, X: t.mat33, most: real):
        bound = tangent_lower_bound(kind, size, X, (X[0] + X[1] + X[2]) / real(3.0))
        for k in range(3):
            bound = wp.max(bound, tangent_lower_bound(kind, size, X, X[k]))
        least = most
        if bound < most:
            b = X[1] - X[0]
            e = X[2] - X[1]
            low = real(0.0)
            high = real(1.0)
            s1 = real(LESS)
            s2 = real(GOLDEN)
            g1 = least_phi_on_segment(kind, size, X[0] + s1 * b, s1 * e)
            g2 = least_phi_on_segment(kind, size, X[0] + s2 * b, s2 * e)
            least = wp.min(least_phi_on_segment(kind, size, X[0], real(0.0) * e), least_phi_on_segment(kind, size, X[1], e))
            for _ in range(SECTIONS):
                least = wp.min(least, wp.min(g1, g2))
                if g1 < g2:
                    high = s2
                    s2 = s1
                    g2 = g1
                    s1 = high - real(GOLDEN) * (high - low)
                    g1 = least_phi_on_segment(kind, size, X[0] + s1 * b, s1 * e)
                else:
                    low = s1
                    s1 = s2
                    g1 = g2
                    s2 = low + real(GOLDEN) * (high - low)
                    g2 = least_phi_on_segment(kind, size, X[0] + s2 * b, s2 * e)
        return least

    return least_phi_on_triangle


@cache
def rest_gap_func(kinds: tuple[str, ...], real):
    """Function (kind, size, mesh, q, r) -> signed distance of a point at rest less r [m]; of a mesh nothing is found farther
    than size[0]. Called and not inlined: queries of meshes take a second each to compile."""
    t, meet = types(real), collider_touch_func(kinds, real)

    @wp.func(inline=False)
    def gap_at_rest(kind: int, size: t.vec3, mesh: wp.uint64, q: t.vec3, r: real):
        C, n, p, s0, slip = meet(kind, size, mesh, 0, q, q, r, t.vec2(size[0], real(0.0)))
        return C

    return gap_at_rest


@cache
def mesh_penetration_func(kinds: tuple[str, ...], real):
    """Function (mesh, depth, X, most) -> least phi found on a triangle, inside of a closed mesh; 1e30 where it is far."""
    t, of_mesh = types(real), rest_gap_func(kinds, real)
    vec3 = t.vec3

    @wp.func
    def mesh_signed_distance(mesh: wp.uint64, q: vec3, far: real):
        return of_mesh(SOLID, vec3(far, real(0.0), real(0.0)), mesh, q, real(0.0))

    @wp.func
    def least_phi_in_mesh(mesh: wp.uint64, depth: real, X: t.mat33, most: real):
        b = X[1] - X[0]
        e = X[2] - X[0]
        edge = wp.max(wp.length(b), wp.max(wp.length(e), wp.length(e - b)))
        far = depth + edge
        least = real(1.0e30)
        u = real(0.0)
        v = real(0.0)
        if mesh_signed_distance(mesh, X[0] + (b + e) / real(3.0), far) < most + edge:  # slope 1: else none of it is below
            for place in range(PLACES * PLACES):
                u1 = real(place // PLACES) * real(PACE)
                v1 = real(place % PLACES) * real(PACE)
                if u1 + v1 < real(1.0) + real(0.5) * real(PACE):
                    found = mesh_signed_distance(mesh, X[0] + u1 * b + v1 * e, far)
                    if found < least:
                        least = found
                        u = u1
                        v = v1
            step = real(0.5) * real(PACE)
            halved = int(0)
            tries = int(0)
            if least > most + real(PACE) * edge:
                halved = SHORTER
            while halved < SHORTER and tries < TRIES:
                tries += 1
                better = int(0)
                for way in range(6):                         # (1, 0) (0, 1) (-1, 1) (-1, 0) (0, -1) (1, -1)
                    u1 = u + step * (real(way == 0 or way == 5) - real(way == 2 or way == 3))
                    v1 = v + step * (real(way == 1 or way == 2) - real(way == 4 or way == 5))
                    if u1 >= real(0.0) and v1 >= real(0.0) and u1 + v1 <= real(1.0):
                        found = mesh_signed_distance(mesh, X[0] + u1 * b + v1 * e, far)
                        if found < least:
                            least = found
                            u = u1
                            v = v1
                            better = 1
                if better == 0:
                    step = real(0.5) * step
                    halved += 1
        return least

    return least_phi_in_mesh


@cache
def point_penetration_kernel(kinds: tuple[str, ...], real, module):
    """Kernel over lanes, each taking every `lanes`-th point: how deep points are at pose k inside of the distance
    kept and of the solid itself [m], and how many are in contact. The host takes the greatest, so no atomics."""
    t, name = types(real), f"gauge_{'_'.join(kinds)}_{types(real).name}"
    Rows, Points = contact_tables(real)
    Slots, away = slot_type(real), rest_gap_func(kinds, real)

    def measure_point_penetration(c: Rows, points: Points, s: Slots, x: wp.array(dtype=t.vec3), k: int, lanes: int,
                                  inside_out: wp.array(dtype=t.vec2), count_out: wp.array(dtype=int)):
        lane = wp.tid()
        kept = real(0.0)
        solid = real(0.0)
        count = int(0)
        for i in range(lane, s.points, lanes):
            if points.w[i] > real(0.0):
                count += s.mark[i] & TOUCHED
                o = points.object[i]
                x0 = x[i]
                for row in range(c.first[o], c.first[o + 1]):
                    T = c.of.pose[k, row]
                    q = wp.quat_rotate_inv(wp.transform_get_rotation(T), x0 - wp.transform_get_translation(T))
                    r = points.reach[i] + c.of.thick[row]
                    kind = c.of.kind[row]
                    size = c.of.size[row]
                    C = away(kind, size, c.of.mesh[row], q, r)
                    kept = wp.max(kept, -C)
                    if kind != SHEET:
                        solid = wp.max(solid, -C - r)
        inside_out[lane] = t.vec2(kept, solid)
        count_out[lane] = count

    return wp.kernel(measure_point_penetration, name=name, module=module, enable_backward=False)


@cache
def face_penetration_kernel(kinds: tuple[str, ...], real, module):
    """Kernel over lanes, each taking every `lanes`-th triangle (corners: places of its points, (t, 3)): the greatest depth at
    pose k [m]."""
    t, name = types(real), f"sink_{'_'.join(kinds)}_{types(real).name}"
    Rows, Points = contact_tables(real)
    shapes = split_convex_and_meshes(kinds)[0]
    convex, meshes = bool(shapes), "solid" in kinds
    of_convex, of_mesh, away = (convex_penetration_func(shapes, real), mesh_penetration_func(kinds, real),
                                rest_gap_func(kinds, real))

    @wp.func
    def triangle_reaches_ball(ball: t.vec4, X: t.mat33):
        centre = (X[0] + X[1] + X[2]) / real(3.0)
        r = wp.max(wp.length(X[0] - centre), wp.max(wp.length(X[1] - centre), wp.length(X[2] - centre)))
        return wp.length(centre - t.vec3(ball[0], ball[1], ball[2])) < ball[3] + r

    def measure_face_penetration(c: Rows, points: Points, corners: wp.array2d(dtype=int), x: wp.array(dtype=t.vec3), k: int,
                                 lanes: int, depth_out: wp.array(dtype=real)):
        lane = wp.tid()
        worst = real(0.0)
        for j in range(lane, corners.shape[0], lanes):
            o = points.object[corners[j, 0]]
            X = wp.matrix_from_rows(x[corners[j, 0]], x[corners[j, 1]], x[corners[j, 2]])
            for row in range(c.first[o], c.first[o + 1]):
                kind = c.of.kind[row]
                if kind == SHEET or not triangle_reaches_ball(c.ball[k - 1, row], X):
                    continue
                T = c.of.pose[k, row]
                size = c.of.size[row]
                Y = t.mat33()
                put = int(0)
                for corner in range(3):
                    q = wp.quat_rotate_inv(wp.transform_get_rotation(T), X[corner] - wp.transform_get_translation(T))
                    Y[corner] = q
                    if points.w[corners[j, corner]] == real(0.0):
                        put |= int(away(kind, size, c.of.mesh[row], q, real(0.0)) < real(0.0))
                if put != 0:
                    continue
                if convex:
                    if kind < SOLID:
                        worst = wp.max(worst, -of_convex(kind, size, Y, -worst))
                if meshes:
                    if kind == SOLID:
                        worst = wp.max(worst, -of_mesh(c.of.mesh[row], size[0], Y, -worst))
        depth_out[lane] = worst

    return wp.kernel(measure_face_penetration, name=name, module=module, enable_backward=False)


@cache
def collider_work_kernel(real, module):
    """Kernel over points: adds to given [J] the work (m P / g) . u of colliders in a substep, of the rows that are outside."""
    t, Slots, (_, Points) = types(real), slot_type(real), contact_tables(real)

    def add_collider_work(points: Points, s: Slots, push: wp.array(dtype=t.vec3), outside: wp.array(dtype=int), g: real,
                          given: wp.array(dtype=wp.float64)):
        i = wp.tid()
        if points.w[i] > real(0.0):
            for slot in range(s.count[i]):
                j = slot * s.points + i
                if outside[s.row[j]] == 1:
                    given[i] = given[i] + wp.float64(wp.dot(push[j], s.u[j]) / (points.w[i] * g))

    return owns_points(wp.kernel(add_collider_work, name=f"push_work_{t.name}", module=module, enable_backward=False))
