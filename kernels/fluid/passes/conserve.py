"""Scalars that keep their sum while air carries them: what a limited cubic has lost or made is put back where it differs from
linear interpolation, and towards that (Priestley 1993; Bermejo, Conde 2002).

    q* limited cubic, l linear, both at the end of the way back;   excess  e = sum q* - sum q
    q_out = q* - L (q* - l)  of the cells in which q* - l has the sign of e,   L = e / sum of q* - l over those

L is below 1, and q_out between q* and l, where these cells differ by as much as is to be put back, as they do but for a rest of
rounding. Sums are of float64, in one order.
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.advection import BOUNDS, backtrace_function, carried_value_function
from wsim.kernels.fluid.grid import grid_functions, grid_structs
from wsim.kernels.fluid.passes.tiles import flush_small_function, tile_function
from wsim.kernels.solver.pcg import block_sum


@cache
def conservative_advect_kernel(dim: int, real, module):
    """Kernel over cells, of those that are near: q* and q* - l of a scalar followed back over the step clock[0] [s]."""
    S, f, tile, back = (grid_structs(real), grid_functions(dim, real), tile_function(dim, real),
                        backtrace_function(dim, -1, real, True))
    cubic, linear = carried_value_function(dim, -1, "cubic", True, real), carried_value_function(dim, -1, "linear", True, real)

    def advect_conservative(g: S.Grid, u: S.Faces, q: wp.array(dtype=real), clock: wp.array(dtype=real),
                            near: wp.array(dtype=int), q_out: wp.array(dtype=real), less_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, g.n)
        if near[tile(g, i)] != 0:
            X = back(g, u, i, clock[0])
            value = cubic(g, q, X)
            q_out[c] = value
            less_out[c] = value - linear(g, q, X)

    return wp.kernel(advect_conservative, name=f"conserve_carry_{f.name}", module=module, enable_backward=False,
                     launch_bounds=BOUNDS)


@cache
def conserved_sum_kernel(dim: int, real, module):
    """Kernel over blocks of threads: parts of the sums of q* - q, and of what q* - l is above and below 0."""
    S, f, tile = grid_structs(real), grid_functions(dim, real), tile_function(dim, real)

    def conserved_sum_parts(g: S.Grid, near: wp.array(dtype=int), before: wp.array(dtype=real), q: wp.array(dtype=real),
                            less: wp.array(dtype=real), part_out: wp.array(dtype=wp.vec3d)):
        excess = wp.float64(0.0)
        above = wp.float64(0.0)
        below = wp.float64(0.0)
        for c in range(wp.tid(), q.shape[0], part_out.shape[0] * wp.block_dim()):
            if near[tile(g, f.place(c, g.n))] != 0:
                excess += wp.float64(q[c]) - wp.float64(before[c])
                above += wp.float64(wp.max(less[c], real(0.0)))
                below += wp.float64(wp.min(less[c], real(0.0)))
        excess = block_sum(excess)
        above = block_sum(above)
        below = block_sum(below)
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = wp.vec3d(excess, above, below)

    return wp.kernel(conserved_sum_parts, name=f"conserve_sums_{f.name}", module=module, enable_backward=False,
                     grid_stride=False)


@cache
def correction_share_kernel(module):
    """Kernel over one block of threads: L of the cells above 0 and of those below, share_out (2,); one of them is 0."""

    def correction_share(part: wp.array(dtype=wp.vec3d), share_out: wp.array(dtype=wp.float64)):
        zero = wp.float64(0.0)
        excess = wp.float64(0.0)
        above = wp.float64(0.0)
        below = wp.float64(0.0)
        for k in range(wp.tid(), part.shape[0], wp.block_dim()):
            p = part[k]
            excess += p[0]
            above += p[1]
            below += p[2]
        excess = block_sum(excess)
        above = block_sum(above)
        below = block_sum(below)
        if wp.tid() == 0:
            share_out[0] = zero
            share_out[1] = zero
            if excess > zero and above > zero:
                share_out[0] = excess / above
            if excess < zero and below < zero:
                share_out[1] = excess / below

    return wp.kernel(correction_share, name="conserve_share", module=module, enable_backward=False, grid_stride=False)


@cache
def conserved_scalar_kernel(dim: int, real, module):
    """Kernel over cells: a scalar of those that are near becomes q_out above, and marks its tiles."""
    S, f, tile, seen = grid_structs(real), grid_functions(dim, real), tile_function(dim, real), flush_small_function(real)

    def restore_scalar_sum(g: S.Grid, near: wp.array(dtype=int), q: wp.array(dtype=real), less: wp.array(dtype=real),
                           share: wp.array(dtype=wp.float64), holds_out: wp.array(dtype=int), q_out: wp.array(dtype=real)):
        c = wp.tid()
        m = tile(g, f.place(c, g.n))
        if near[m] != 0:
            by = share[0]
            if less[c] < real(0.0):
                by = share[1]
            value = seen(real(wp.float64(q[c]) - by * wp.float64(less[c])))
            q_out[c] = value
            if value != real(0.0):
                holds_out[m] = 1

    return wp.kernel(restore_scalar_sum, name=f"conserve_keep_{f.name}", module=module, enable_backward=False)
