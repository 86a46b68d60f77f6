"""Adjoint of the velocities of obstacles, `cover_adjoint_kernel` of kernels/fluid/fractions.py: v = V + W x r at a face across
the axis e, so

    V += v e,    W += v r x e

with a bar over each: of the obstacle that is nearest to the face. Openings are taken as they are.
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid import shapes as moved
from wsim.kernels.fluid.adjoint.covering import Numbers
from wsim.kernels.fluid.grid import grid_functions, grid_structs
from wsim.kernels.math.real import types
from wsim.kernels.solver.pcg import block_sum


@cache
def cover_adjoint_kernel(dim: int, axis: int, kinds: tuple[str, ...], real, module):
    """Kernel over blocks of threads: parts of what V (first three) and W (next three) of obstacle k get, of the faces of an
    axis."""
    t, G, S, f = types(real), grid_structs(real), moved.fluid_shape_structs(real), grid_functions(dim, real)
    s = moved.shape_queries(dim, kinds, real)

    @wp.func
    def nearest_obstacle(shapes: S.Shapes, y: t.vec3, time: real):
        found = int(0)  # noqa: UP018
        least = real(1.0e9)
        for k in range(shapes.of.kind.shape[0]):
            phi = s.signed(shapes.of, k, y, time)
            if phi < least:
                least = phi
                found = k
        return found

    def obstacle_velocity_parts(g: G.Grid, shapes: S.Shapes, k: int, clock: wp.array(dtype=real), by: wp.array(dtype=real),
                                part_out: wp.array(dtype=Numbers)):
        sum = Numbers()
        e = t.vec3()
        e[shapes.axes[wp.static(axis)]] = real(1.0)
        time = clock[0] + clock[1]
        for c in range(wp.tid(), by.shape[0], part_out.shape[0] * wp.block_dim()):
            if by[c] != real(0.0):
                i = f.place(c, f.faces(g, wp.static(axis)))
                y = s.spot(shapes, t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(wp.static(axis)))
                if nearest_obstacle(shapes, y, time) == k:
                    turn = wp.cross(y - s.center(shapes.of, k, time), e)
                    for a in range(3):
                        sum[a] = sum[a] + wp.float64(by[c] * e[a])
                        sum[3 + a] = sum[3 + a] + wp.float64(by[c] * turn[a])
        for j in range(6):
            sum[j] = block_sum(sum[j])
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = sum

    return wp.kernel(obstacle_velocity_parts, name=f"covers_adjoint_{'xyz'[axis]}_{s.name}", module=module,
                     enable_backward=False, grid_stride=False)
