"""Closest points of a point and a triangle, and of two edges; a normal that separates them, and the gap along it.

A pair has four points p0 .. p3 and a kind: POINT, p0 against the triangle p1 p2 p3, or EDGES, p0 p1 against p2 p3. Its weights
b are those of the closest points, positive on the first side and negative on the second, so that

    sum_k b_k p_k = y - z,   y, z the closest points,   n = (y - z) / |y - z|,   gap = min_ij n . (p_i - p_j)

over the points i of the first side and j of the second. Where y and z are exact, gap = |y - z| (separating plane of convex
sets); any other n, by rounding or of parallel edges, gives a lower gap, and a proof that uses it stays one. Of points 6 um
apart on edges of 16 mm the difference y - z is turned by rounding so much that nothing is left of the gap: n is rather made
normal to the features that y and z are on, by their directions, and the best of what rounding leaves is taken.

Ericson, Real-Time Collision Detection, 2005, 5.1.5 and 5.1.9. Degenerate triangles and edges give finite results.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types

POINT, EDGES = 0, 1


@cache
def closest_weights(real):
    """Function (kind, p0, p1, p2, p3) -> b, as above."""
    t = types(real)
    vec3, vec4 = t.vec3, t.vec4

    @wp.func
    def clamped_share(a: real, b: real):
        """a / (a + b) in 0 .. 1, 0 where both are 0."""
        whole = a + b
        if whole <= real(0.0):
            return real(0.0)
        return wp.clamp(a / whole, real(0.0), real(1.0))

    @wp.func
    def on_triangle(p: vec3, a: vec3, b: vec3, c: vec3):
        """Weights of the point of a triangle that is closest to p."""
        ab, ac, ap, bp, cp = b - a, c - a, p - a, p - b, p - c
        d1, d2, d3 = wp.dot(ab, ap), wp.dot(ac, ap), wp.dot(ab, bp)
        d4, d5, d6 = wp.dot(ac, bp), wp.dot(ab, cp), wp.dot(ac, cp)
        zero, one = real(0.0), real(1.0)
        if d1 <= zero and d2 <= zero:
            return vec3(one, zero, zero)
        if d3 >= zero and d4 <= d3:
            return vec3(zero, one, zero)
        if d6 >= zero and d5 <= d6:
            return vec3(zero, zero, one)
        vc = d1 * d4 - d3 * d2
        if vc <= zero and d1 >= zero and d3 <= zero:
            s = clamped_share(d1, -d3)
            return vec3(one - s, s, zero)
        vb = d5 * d2 - d1 * d6
        if vb <= zero and d2 >= zero and d6 <= zero:
            s = clamped_share(d2, -d6)
            return vec3(one - s, zero, s)
        va = d3 * d6 - d5 * d4
        if va <= zero and d4 - d3 >= zero and d5 - d6 >= zero:
            s = clamped_share(d4 - d3, d5 - d6)
            return vec3(zero, one - s, s)
        whole = va + vb + vc
        if whole <= zero:
            return vec3(one, zero, zero)
        return vec3(va, vb, vc) / whole

    @wp.func
    def on_edges(p: vec3, q: vec3, u: vec3, v: vec3):
        """Places of the closest points along two edges, 0 .. 1 each."""
        d, e, r = q - p, v - u, p - u
        a, f, c = wp.dot(d, d), wp.dot(e, r), wp.dot(d, r)
        b, g = wp.dot(d, e), wp.dot(e, e)
        area = a * g - b * b
        s = real(0.0)
        if area > real(0.0):
            s = wp.clamp((b * f - c * g) / area, real(0.0), real(1.0))
        w = real(-1.0)                                    # a point: its place along the other edge is found below
        if g > real(0.0):
            w = (b * s + f) / g
        if w < real(0.0):
            w = real(0.0)
            s = real(0.0)
            if a > real(0.0):
                s = wp.clamp(-c / a, real(0.0), real(1.0))
        elif w > real(1.0):
            w = real(1.0)
            s = real(0.0)
            if a > real(0.0):
                s = wp.clamp((b - c) / a, real(0.0), real(1.0))
        return s, w

    @wp.func
    def closest_point_weights(kind: int, p0: vec3, p1: vec3, p2: vec3, p3: vec3):
        if kind == POINT:
            b = on_triangle(p0, p1, p2, p3)
            return vec4(real(1.0), -b[0], -b[1], -b[2])
        s, w = on_edges(p0, p1, p2, p3)
        return vec4(real(1.0) - s, s, w - real(1.0), -w)

    return closest_point_weights


@cache
def pair_gap_func(real):
    """Function (kind, n, p0, p1, p2, p3) -> min_ij n . (p_i - p_j)."""
    vec3 = types(real).vec3

    @wp.func
    def gap_along_normal(kind: int, n: vec3, p0: vec3, p1: vec3, p2: vec3, p3: vec3):
        a = wp.dot(n, p0 - p2)
        b = wp.dot(n, p0 - p3)
        if kind == POINT:
            return wp.min(wp.min(a, b), wp.dot(n, p0 - p1))
        return wp.min(wp.min(a, b), wp.min(wp.dot(n, p1 - p2), wp.dot(n, p1 - p3)))

    return gap_along_normal


@cache
def pair_normal_func(real):
    """Function (kind, b, p0, p1, p2, p3) -> (n, gap), see above; b from `closest_weights`. Nothing to go by: n = 0, gap = 0."""
    t = types(real)
    vec3, vec4 = t.vec3, t.vec4
    least = pair_gap_func(real)

    @wp.func
    def part_across_edge(way: vec3, e: vec3):
        """The part of a way that is across an edge."""
        size = wp.dot(e, e)
        if size <= real(0.0):
            return way
        return way - (wp.dot(way, e) / size) * e

    @wp.func
    def separating_normal(kind: int, b: vec4, p0: vec3, p1: vec3, p2: vec3, p3: vec3):
        way = b[0] * p0 + b[1] * p1 + b[2] * p2 + b[3] * p3
        zero = real(0.0)
        e, g = p1 - p0, p3 - p2                           # directions of the features; 0 where one is a point
        if kind == POINT:
            e = vec3()
            if b[1] != zero and b[2] != zero:
                e = p2 - p1
            if b[1] != zero and b[3] != zero:
                g = p3 - p1
            elif b[2] == zero or b[3] == zero:
                g = vec3()
        else:
            if b[0] == zero or b[1] == zero:
                e = vec3()
            if b[2] == zero or b[3] == zero:
                g = vec3()
        n = wp.normalize(part_across_edge(part_across_edge(way, e), g))
        best = least(kind, n, p0, p1, p2, p3)
        m = wp.normalize(part_across_edge(part_across_edge(way, g), e))
        other = least(kind, m, p0, p1, p2, p3)
        if other > best:
            n = m
            best = other
        m = wp.normalize(wp.cross(e, g))
        if wp.dot(m, way) < zero:
            m = -m
        other = wp.max(least(kind, m, p0, p1, p2, p3), least(kind, -m, p0, p1, p2, p3))
        if other > best:
            if least(kind, m, p0, p1, p2, p3) < other:
                m = -m
            n = m
            best = other
        return n, best

    return separating_normal
