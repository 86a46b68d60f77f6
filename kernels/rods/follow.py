"""Points that edges of strands carry along.

    y = sum_j w_j (c_j + F_j o_j),  v = sum_j w_j (c'_j + omega_j x F_j o_j),  omega = t x (v1 - v0) / |e| + spin t

c: middle of an edge; F: its frame (tangent t, director, their cross product); o: place in it at the start; sum w_j = 1. What
moves all edges rigidly moves y so.
"""

from functools import cache

import warp as wp

from wsim.kernels.rods.tables import RodMotion, RodTable


@wp.struct
class BoundPoints:
    """Edges that carry points, (points, edges)."""

    edge: wp.array2d(dtype=int)                     # rows of the flat tables of strands
    weight: wp.array2d(dtype=wp.float64)
    place: wp.array2d(dtype=wp.vec3d)               # in the edge's frame [m]
    rest: wp.array(dtype=wp.vec3d)                  # what rounding took from a point at the start [m], (points,)


@cache
def carried_point_kernel(module: str):
    """Kernel over points: places [m] and velocities [m/s], world."""
    @wp.kernel(enable_backward=False, module=module)
    def carry_points(S: RodTable, Q: RodMotion, B: BoundPoints, x_out: wp.array(dtype=wp.vec3d),
                     v_out: wp.array(dtype=wp.vec3d)):
        p = wp.tid()
        half = wp.float64(0.5)
        strands = S.points.shape[0]
        x = wp.vec3d()
        v = wp.vec3d()
        for j in range(B.edge.shape[1]):
            i = B.edge[p, j] / strands
            k = B.edge[p, j] % strands
            w = B.weight[p, j]
            e = Q.x[i + 1, k] - Q.x[i, k]
            length = wp.length(e)
            t = e / length
            d = Q.d[i, k]
            o = B.place[p, j]
            r = t * o[0] + d * o[1] + wp.cross(t, d) * o[2]
            omega = wp.cross(t, Q.v[i + 1, k] - Q.v[i, k]) / length + t * Q.w[i, k][0]
            x = x + (S.origin[k] + (Q.x[i, k] + Q.x[i + 1, k]) * half + r) * w
            v = v + ((Q.v[i, k] + Q.v[i + 1, k]) * half + wp.cross(omega, r)) * w
        x_out[p] = x + B.rest[p]
        v_out[p] = v

    return carry_points
