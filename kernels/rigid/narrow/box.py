"""Two boxes by separating axes (Gottschalk, Lin, Manocha 1996): three normals of A, three of B, nine products of their edges.

    s(L) = (|p.L| - sum_i a_i |A_i.L| - sum_j b_j |B_j.L|) / |L|          p from A's centre to B's, a and b half edges

The greatest s is the gap: below 0 the depth, above 0 at most the distance (they are apart for sure). An axis of two edges must
be better than a face by EDGE of the size: nearly parallel edges make axes that are nearly normals, and faces touch at more than
one point. Edges whose sine is below SINE make none.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.narrow.clip import clip_types

EDGE = wp.constant(1.0e-4)              # of the smaller box's diagonal: twenty times what rounds in float32 at SINE
SINE = wp.constant(3.0e-3)


@cache
def box_pair_func(real):
    """Function (a, b, R, p) -> Nearest, half edges a and b, B in the pose (R, p) in A's frame; key -1 where faces touch."""
    t, Nearest = types(real), clip_types(real).Nearest
    vec3, mat33 = t.vec3, t.mat33

    @wp.func(inline=False)
    def best_face_axis(a: vec3, b: vec3, R: mat33, p: vec3):
        """(greatest s, axis 0 to 2 of A, 3 to 5 of B)."""
        best = int(0)
        most = real(-1.0e30)
        bias = real(EDGE) * wp.min(wp.length(a), wp.length(b))
        q = wp.transpose(R) * p
        axes = int(6)                              # a variable: unrolled, a GPU compiles for long
        for i in range(axes):
            s = real(0.0)
            if i < 3:
                s = wp.abs(p[i]) - a[i] - wp.dot(wp.abs(R[i]), b)
            else:
                s = wp.abs(q[i - 3]) - b[i - 3] - (wp.abs(R[0, i - 3]) * a[0] + wp.abs(R[1, i - 3]) * a[1]
                                                   + wp.abs(R[2, i - 3]) * a[2])
            if s > most + bias:
                best = i
                most = s
        return most, best

    @wp.func(inline=False)
    def best_edge_axis(a: vec3, b: vec3, R: mat33, p: vec3):
        """(greatest s, 3 i + j of the axis A_i x B_j, the axis)."""
        best = int(-1)
        most = real(-1.0e30)
        axis = vec3()
        products = int(9)
        for k in range(products):
            i = k // 3
            j = k % 3
            e = vec3()
            e[i] = real(1.0)
            L = wp.cross(e, vec3(R[0, j], R[1, j], R[2, j]))
            length = wp.length(L)
            if length > real(SINE):
                L = L / length
                s = wp.abs(wp.dot(p, L)) - wp.dot(wp.abs(L), a) - wp.dot(wp.abs(wp.transpose(R) * L), b)
                if s > most:
                    most = s
                    best = k
                    axis = L
        return most, best, axis

    @wp.func
    def farthest_box_edge(half: vec3, d: vec3, free: int):
        """Middle of the edge along axis `free` that is farthest along d, and its number among the four."""
        c = vec3(wp.where(d[0] < real(0.0), -half[0], half[0]), wp.where(d[1] < real(0.0), -half[1], half[1]),
                 wp.where(d[2] < real(0.0), -half[2], half[2]))
        i = (free + 1) % 3
        j = (free + 2) % 3
        number = wp.where(d[i] < real(0.0), 2, 0) + wp.where(d[j] < real(0.0), 1, 0)
        c[free] = real(0.0)
        return c, number

    @wp.func
    def edge_crossing_point(a: vec3, b: vec3, R: mat33, p: vec3, n: vec3, k: int):
        """Midpoint of the two edges where they are nearest, and their number."""
        i = k // 3
        j = k % 3
        A, na = farthest_box_edge(a, -n, i)
        B, nb = farthest_box_edge(b, wp.transpose(R) * n, j)
        e = vec3()
        e[i] = real(1.0)
        v = vec3(R[0, j], R[1, j], R[2, j])
        o = R * B + p
        r = o - A
        c = v[i]
        s = wp.clamp((r[i] - c * wp.dot(r, v)) / (real(1.0) - c * c), -a[i], a[i])
        u = wp.clamp(s * c - wp.dot(r, v), -b[j], b[j])
        return real(0.5) * (A + s * e + o + u * v), 536870912 + (k * 4 + na) * 4 + nb

    @wp.func(inline=False)
    def nearest_of_boxes(a: vec3, b: vec3, R: mat33, p: vec3):
        near = Nearest()
        most, best = best_face_axis(a, b, R, p)
        n = vec3()
        if best < 3:
            n[best] = real(1.0)
        else:
            n = vec3(R[0, best - 3], R[1, best - 3], R[2, best - 3])
        edge, k, axis = best_edge_axis(a, b, R, p)
        near.key = -1
        near.gap = most
        if edge > most + real(EDGE) * wp.min(wp.length(a), wp.length(b)):
            n = axis
            near.gap = edge
        if wp.dot(n, p) > real(0.0):
            n = -n
        near.n = n
        if near.gap > most:
            x, key = edge_crossing_point(a, b, R, p, n, k)
            near.x = x
            near.key = key
        return near

    return nearest_of_boxes
