"""Capsules: two of them, and one against a box. Segments are p + t d with t from -1 to 1; cores first, radii after.

Two segments (Eberly 2001; Ericson 2005, section 5.1.9): (s, t) minimises |p_a + s a - p_b - t b|^2, clamped to its bounds.

A segment and a box: half the squared distance is convex in t, its derivative sum_i d_i e_i(t) grows by linear pieces, with e
the part of the place beyond the box. The pieces end where the segment crosses the planes of the faces: of those, the last with
a derivative below 0 and the first above are found, and between them the zero is exact. A segment that enters the box leaves it
by the least of six axes, three faces and three products of an edge with the segment.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.eigen import machine_epsilon
from wsim.kernels.math.real import types
from wsim.kernels.rigid.narrow.clip import clip_types


@cache
def nearest_point_funcs(real):
    """(aside, nearest): a unit vector across d; Nearest of two places of the cores a and b."""
    t, Nearest = types(real), clip_types(real).Nearest
    vec3 = t.vec3

    @wp.func
    def unit_vector_across(d: vec3):
        k = int(wp.argmin(wp.abs(d)))
        e = vec3()
        e[k] = real(1.0)
        return wp.normalize(wp.cross(d, e))

    @wp.func
    def nearest_from_cores(a: vec3, b: vec3, n: vec3, apart: real, radii: t.vec2, key: int):
        near = Nearest()
        near.n = n
        near.gap = apart - radii[0] - radii[1]
        near.x = real(0.5) * (a + b + (radii[1] - radii[0]) * n)
        near.key = key
        return near

    return unit_vector_across, nearest_from_cores


@cache
def capsule_pair_func(real):
    """Function (size_a, size_b, R, p) -> Nearest of two capsules, B in the pose (R, p) in A's frame."""
    t = types(real)
    vec3 = t.vec3
    aside, nearest = nearest_point_funcs(real)

    @wp.func(inline=False)
    def closest_segment_places(a: vec3, b: vec3, r: vec3):
        """(s, t) of the nearest places of s a and r + t b, |a|, |b| > 0."""
        one = real(1.0)
        aa = wp.dot(a, a)
        bb = wp.dot(b, b)
        ab = wp.dot(a, b)
        ar = wp.dot(a, r)
        br = wp.dot(b, r)
        cross = wp.cross(a, b)
        D = wp.dot(cross, cross)
        s = wp.clamp(ar / aa, -one, one)
        if D > machine_epsilon(one) * aa * bb:
            s = wp.clamp((ar * bb - ab * br) / D, -one, one)
        u = (s * ab - br) / bb
        if u > one or u < -one:
            u = wp.clamp(u, -one, one)
        s = wp.clamp((ar + u * ab) / aa, -one, one)
        return s, wp.clamp((s * ab - br) / bb, -one, one)

    @wp.func(inline=False)
    def nearest_of_capsules(size_a: vec3, size_b: vec3, R: t.mat33, p: vec3):
        a = vec3(real(0.0), real(0.0), wp.max(size_a[1], real(1.0e-6) * size_a[0]))
        b = wp.max(size_b[1], real(1.0e-6) * size_b[0]) * vec3(R[0, 2], R[1, 2], R[2, 2])
        s, u = closest_segment_places(a, b, p)
        pa = s * a
        pb = p + u * b
        v = pa - pb
        apart = wp.length(v)
        n = wp.cross(a, b)                       # where they cross
        if wp.length(n) <= real(1.0e-3) * wp.length(a) * wp.length(b):
            n = aside(a)
        n = wp.normalize(n)
        if apart > real(8.0) * machine_epsilon(apart) * (wp.length(p) + a[2]):
            n = v / apart
        elif wp.dot(n, p) > real(0.0):
            n = -n
        return nearest(pa, pb, n, apart, t.vec2(size_a[0], size_b[0]), 0)

    return nearest_of_capsules


@cache
def box_capsule_func(real):
    """Function (half, size, R, p) -> Nearest of a box A of half edges `half` and a capsule B in the pose (R, p) there."""
    t, Nearest = types(real), clip_types(real).Nearest
    vec3 = t.vec3
    _aside, nearest = nearest_point_funcs(real)

    @wp.func
    def excess_beyond_box(half: vec3, q: vec3):
        return vec3(q[0] - wp.clamp(q[0], -half[0], half[0]), q[1] - wp.clamp(q[1], -half[1], half[1]),
                    q[2] - wp.clamp(q[2], -half[2], half[2]))

    @wp.func(inline=False)
    def segment_place_near_box(half: vec3, p: vec3, d: vec3):
        """t of the place of the segment nearest to the box."""
        one = real(1.0)
        low = -one
        high = one
        at_low = wp.dot(d, excess_beyond_box(half, p - d))
        at_high = wp.dot(d, excess_beyond_box(half, p + d))
        found = low
        if at_high <= real(0.0) and at_low < real(0.0):
            found = high
        elif at_low < real(0.0):
            planes = int(6)                                # a variable: unrolled, a GPU compiles for long
            for k in range(planes):
                i = k % 3
                side = wp.where(k < 3, half[i], -half[i])
                if wp.abs(d[i]) > real(0.0):
                    u = (side - p[i]) / d[i]
                    if u > low and u < high:
                        slope = wp.dot(d, excess_beyond_box(half, p + u * d))
                        if slope < real(0.0):
                            low = u
                            at_low = slope
                        else:
                            high = u
                            at_high = slope
            found = low + (high - low) * (-at_low / (at_high - at_low))
        return found

    @wp.func(inline=False)
    def segment_box_penetration(half: vec3, p: vec3, d: vec3):
        """(depth, outward axis) of the least way out of the box; a face, unless an edge is less by 1e-4 of the size."""
        best = vec3()
        least = real(1.0e30)
        bias = real(1.0e-4) * wp.length(half)
        axes = int(6)
        for k in range(axes):
            i = k % 3
            L = vec3()
            L[i] = real(1.0)
            if k > 2:
                L = wp.cross(L, d)
            length = wp.length(L)
            if k < 3 or length > real(1.0e-3) * wp.length(d):
                L = L / length
                if wp.dot(L, p) < real(0.0):
                    L = -L
                depth = wp.dot(wp.abs(L), half) + wp.abs(wp.dot(L, d)) - wp.dot(L, p)
                if depth < least - bias:
                    least = depth
                    best = L
        return least, best

    @wp.func(inline=False)
    def segment_middle_in_box(half: vec3, p: vec3, d: vec3):
        """Middle of what of the segment is in the box."""
        low = real(-1.0)
        high = real(1.0)
        for i in range(3):
            if wp.abs(d[i]) > real(0.0):
                u = (-half[i] - p[i]) / d[i]
                v = (half[i] - p[i]) / d[i]
                low = wp.max(low, wp.min(u, v))
                high = wp.min(high, wp.max(u, v))
        return p + (real(0.5) * (low + high)) * d

    @wp.func(inline=False)
    def nearest_box_capsule(half: vec3, size: vec3, R: t.mat33, p: vec3):
        d = size[1] * vec3(R[0, 2], R[1, 2], R[2, 2])
        u = segment_place_near_box(half, p, d)
        q = p + u * d
        e = excess_beyond_box(half, q)
        apart = wp.length(e)
        near = Nearest()
        if apart > real(8.0) * machine_epsilon(apart) * (wp.length(half) + wp.length(p)):
            near = nearest(q - e, q, -e / apart, apart, t.vec2(real(0.0), size[0]), 0)
        else:
            depth, L = segment_box_penetration(half, p, d)
            q = segment_middle_in_box(half, p, d)
            if wp.abs(wp.dot(L, d)) > real(1.0e-3) * size[1]:           # an end is deepest
                q = p - wp.sign(wp.dot(L, d)) * d
            near = nearest(q + depth * L, q, -L, -depth, t.vec2(real(0.0), size[0]), 0)
        return near

    return nearest_box_capsule
