"""Adjoint of implicit viscosity, kernels/fluid/viscosity.py. On the faces that are not fixed (f) of a component

    (I - a L_ff) u'_f = u_f + a (L_fx u_x + walls):    (I - a L_ff) y = u'_f,    u_f = y,  u_x = u'_x + a L_xf y

with a bar over each but y; the matrix is symmetric, and the same solver finds y. a gets y . (L u' + walls), a wall 2 a y of the
faces beside it.
"""

# ruff: noqa: UP018

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs
from wsim.kernels.fluid.viscosity import viscosity_functions
from wsim.kernels.math.real import types
from wsim.kernels.solver.pcg import block_sum


@cache
def fixed_faces_kernel(dim: int, axis: int, fractions: bool, slip: bool, real, module):
    """Kernel over faces: by of fixed ones into fixed_out, and 0 in their place."""
    t, S, f, s = (types(real), grid_structs(real), grid_functions(dim, real),
                  viscosity_functions(dim, axis, fractions, slip, real))

    def separate_fixed_faces(g: S.Grid, low: t.vec3, high: t.vec3, o: wp.array(dtype=real), by_out: wp.array(dtype=real),
                             fixed_out: wp.array(dtype=real)):
        c = wp.tid()
        own = real(0.0)
        if s.fixed(g, low, high, o, f.place(c, f.faces(g, wp.static(axis)))):
            own = by_out[c]
            by_out[c] = real(0.0)
        fixed_out[c] = own

    return wp.kernel(separate_fixed_faces, name=f"viscosity_apart_{s.name}", module=module, enable_backward=False)


@cache
def fixed_faces_adjoint_kernel(dim: int, axis: int, fractions: bool, slip: bool, real, module):
    """Kernel over faces: by_out is y of those that are not fixed; of others what was apart, and a L_xf y."""
    t, S, f, s = (types(real), grid_structs(real), grid_functions(dim, real),
                  viscosity_functions(dim, axis, fractions, slip, real))

    def restore_fixed_faces(g: S.Grid, low: t.vec3, high: t.vec3, o: wp.array(dtype=real), y: wp.array(dtype=real),
                            scale: wp.array(dtype=real), fixed: wp.array(dtype=real), by_out: wp.array(dtype=real)):
        c = wp.tid()
        shape = f.faces(g, wp.static(axis))
        i = f.place(c, shape)
        value = y[c]
        if s.fixed(g, low, high, o, i):
            sum = real(0.0)
            for b in range(wp.static(dim)):
                for side in range(2):
                    j = wp.vec3i(i[0], i[1], i[2])
                    j[b] = i[b] + 2 * side - 1
                    inside = j[b] >= 0 and j[b] < shape[b]
                    if g.periodic[b] != 0:
                        j[b] = (j[b] + shape[b]) % shape[b]
                        inside = True
                    if inside:
                        if not s.fixed(g, low, high, o, j):
                            sum += y[flat_cell_index(j, shape)]
            if wp.static(fractions and slip):
                if o[c] == real(0.0):
                    sum = real(0.0)
            value = fixed[c] + scale[0] * sum
        by_out[c] = value

    return wp.kernel(restore_fixed_faces, name=f"viscosity_beside_{s.name}", module=module, enable_backward=False)


@cache
def viscosity_gradient_kernel(dim: int, axis: int, fractions: bool, slip: bool, real, module):
    """Kernel over blocks of threads: parts of y . (L u' + walls)."""
    t, S, f, s = (types(real), grid_structs(real), grid_functions(dim, real),
                  viscosity_functions(dim, axis, fractions, slip, real))

    def viscosity_gradient_parts(g: S.Grid, low: t.vec3, high: t.vec3, o: wp.array(dtype=real), u: wp.array(dtype=real),
                                 y: wp.array(dtype=real), part_out: wp.array(dtype=wp.vec2d)):
        sum = wp.float64(0.0)
        for c in range(wp.tid(), u.shape[0], part_out.shape[0] * wp.block_dim()):
            i = f.place(c, f.faces(g, wp.static(axis)))
            if not s.fixed(g, low, high, o, i):
                sum += wp.float64(y[c] * s.spread(g, low, high, o, u, i, real(1.0)))
        sum = block_sum(sum)
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = wp.vec2d(sum, wp.float64(0.0))

    return wp.kernel(viscosity_gradient_parts, name=f"viscosity_known_{s.name}", module=module, enable_backward=False,
                     grid_stride=False)


@cache
def wall_shear_kernel(dim: int, axis: int, fractions: bool, real, module):
    """Kernel over blocks of threads: parts of the sums of 2 a y beside the low and the high side of axis b, where those are
    closed; walls that are not slippery."""
    t, S, f, s = (types(real), grid_structs(real), grid_functions(dim, real),
                  viscosity_functions(dim, axis, fractions, False, real))

    def wall_shear_parts(g: S.Grid, low: t.vec3, high: t.vec3, o: wp.array(dtype=real), y: wp.array(dtype=real),
                         scale: wp.array(dtype=real), b: int, part_out: wp.array(dtype=wp.vec2d)):
        first = wp.float64(0.0)
        second = wp.float64(0.0)
        for c in range(wp.tid(), y.shape[0], part_out.shape[0] * wp.block_dim()):
            i = f.place(c, f.faces(g, wp.static(axis)))
            if not s.fixed(g, low, high, o, i):
                by = wp.float64(real(2.0) * scale[0] * y[c])
                if i[b] == 0 and low[b] == real(0.0):
                    first += by
                if i[b] + 1 == g.n[b] and high[b] == real(0.0):
                    second += by
        first = block_sum(first)
        second = block_sum(second)
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = wp.vec2d(first, second)

    return wp.kernel(wall_shear_parts, name=f"viscosity_walls_{s.name}", module=module, enable_backward=False,
                     grid_stride=False)
