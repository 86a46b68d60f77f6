"""Conjugate gradients on a grid, with a preconditioner M between the launches (Hestenes, Stiefel 1952):

    z = M r,  beta = r.z / (r.z)',  p = z + beta p,  w = A p,  alpha = r.z / p.w,  x += alpha p,  r -= alpha w

until |r| <= tolerance |b|. All numbers stay on the device: S below. A sum is taken by as many threads as there are, each over
cells that stand a stride apart, then by block, then of the blocks: in float64, in one order, without atomics.

In a sealed region A p sums to nothing; what rounding leaves of that sum would stay in r for good. So w less its mean is taken
from r (S[CELLS] cells, 0: not sealed), where w is not 0: it is in cells that no face opens. |r| is that of r less its mean.

Where M is A^-1 but for rounding, steps need no length: x += z, r -= A z (`refinement_kernel`), until |r| is as small.
"""

# ruff: noqa: UP018

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import grid_functions
from wsim.kernels.fluid.pressure import poisson_stencil, pressure_levels
from wsim.kernels.math.real import types
from wsim.kernels.solver.pcg import block_sum

RZ, ALPHA, BETA, GOAL, COUNT, SIZE, MEAN, CELLS, NUMBERS = range(9)        # numbers of S
START, TURN, STEP, CHECK = range(4)                               # what `grid_scalars_kernel` makes of a sum


@cache
def grid_dot_kernel(real, module):
    """Kernels over blocks of threads: dot (a, b) -> parts; less (numbers, which, x) -> x less a number."""

    def grid_dot_parts(a: wp.array(dtype=real), b: wp.array(dtype=real), part_out: wp.array(dtype=wp.vec2d)):
        sum = wp.float64(0.0)
        for c in range(wp.tid(), a.shape[0], part_out.shape[0] * wp.block_dim()):
            sum += wp.float64(a[c]) * wp.float64(b[c])
        sum = block_sum(sum)
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = wp.vec2d(sum, wp.float64(0.0))

    return wp.kernel(grid_dot_parts, name=f"grid_dot_{types(real).name}", module=module, enable_backward=False,
                     grid_stride=False)


@cache
def pressure_product_kernel(dim: int, fractions: bool | int, real, module):
    """Kernel over blocks of threads: w_out = A p, parts of p.w and of the sum of w."""
    Level, s, f = pressure_levels(real), poisson_stencil(dim, fractions, real), grid_functions(dim, real)

    def multiply_pressure_matrix(level: Level, p: wp.array(dtype=real), w_out: wp.array(dtype=real),
                                 part_out: wp.array(dtype=wp.vec2d)):
        sum = wp.float64(0.0)
        whole = wp.float64(0.0)
        for c in range(wp.tid(), p.shape[0], part_out.shape[0] * wp.block_dim()):
            w = s.product(level, p, f.place(c, level.n))
            w_out[c] = w
            sum += wp.float64(p[c]) * wp.float64(w)
            whole += wp.float64(w)
        sum = block_sum(sum)
        whole = block_sum(whole)
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = wp.vec2d(sum, whole)

    return wp.kernel(multiply_pressure_matrix, name=f"grid_multiply_{s.name}", module=module, enable_backward=False,
                     grid_stride=False)


@cache
def grid_cg_kernel(real, module):
    """Kernel over blocks of threads: x and r a step on, parts of r.r."""

    def advance_grid_cg(S: wp.array(dtype=wp.float64), p: wp.array(dtype=real), w: wp.array(dtype=real),
                        x_out: wp.array(dtype=real), r_out: wp.array(dtype=real), part_out: wp.array(dtype=wp.vec2d)):
        sum = wp.float64(0.0)
        whole = wp.float64(0.0)
        alpha = real(S[ALPHA])
        mean = real(S[MEAN])
        for c in range(wp.tid(), p.shape[0], part_out.shape[0] * wp.block_dim()):
            x_out[c] = x_out[c] + alpha * p[c]
            r = r_out[c]
            if w[c] != real(0.0):
                r -= alpha * (w[c] - mean)
            r_out[c] = r
            sum += wp.float64(r) * wp.float64(r)
            whole += wp.float64(r)
        sum = block_sum(sum)
        whole = block_sum(whole)
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = wp.vec2d(sum, whole)

    return wp.kernel(advance_grid_cg, name=f"grid_advance_{types(real).name}", module=module, enable_backward=False,
                     grid_stride=False)


@cache
def refinement_kernel(dim: int, fractions: bool, real, module):
    """Kernel over blocks of threads: x += z (the first time x = z), r -= A z, parts of r.r: a step that needs no other
    length."""
    Level, s, f = pressure_levels(real), poisson_stencil(dim, fractions, real), grid_functions(dim, real)

    def refine_pressure(level: Level, z: wp.array(dtype=real), S: wp.array(dtype=wp.float64), x_out: wp.array(dtype=real),
                        r_out: wp.array(dtype=real), part_out: wp.array(dtype=wp.vec2d)):
        sum = wp.float64(0.0)
        whole = wp.float64(0.0)
        first = S[COUNT] == wp.float64(0.0)
        for c in range(wp.tid(), z.shape[0], part_out.shape[0] * wp.block_dim()):
            x = z[c]
            if not first:
                x += x_out[c]
            x_out[c] = x
            r = r_out[c] - s.product(level, z, f.place(c, level.n))
            r_out[c] = r
            sum += wp.float64(r) * wp.float64(r)
            whole += wp.float64(r)
        sum = block_sum(sum)
        whole = block_sum(whole)
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = wp.vec2d(sum, whole)

    return wp.kernel(refine_pressure, name=f"grid_refine_{s.name}", module=module, enable_backward=False, grid_stride=False)


@cache
def grid_direction_kernel(real, module):
    """Kernel over cells: p = z + beta p; the first time p is not read."""

    def update_grid_direction(S: wp.array(dtype=wp.float64), z: wp.array(dtype=real), p_out: wp.array(dtype=real)):
        c = wp.tid()
        value = z[c]
        if S[BETA] != wp.float64(0.0):
            value += real(S[BETA]) * p_out[c]
        p_out[c] = value

    return wp.kernel(update_grid_direction, name=f"grid_turn_{types(real).name}", module=module, enable_backward=False)


@cache
def grid_scalars_kernel(module):
    """Kernel over one block of threads: the sum of the parts, and what follows from it: see `what`."""

    def update_grid_scalars(part: wp.array(dtype=wp.vec2d), what: int, tolerance: wp.float64, cap: int,
                            S_out: wp.array(dtype=wp.float64),
                            going_out: wp.array(dtype=int), count_out: wp.array(dtype=int), missed_out: wp.array(dtype=int)):
        sum = wp.float64(0.0)
        zero = wp.float64(0.0)
        whole = wp.float64(0.0)
        for k in range(wp.tid(), part.shape[0], wp.block_dim()):
            both = part[k]
            sum += both[0]
            whole += both[1]
        sum = block_sum(sum)
        whole = block_sum(whole)
        if wp.tid() == 0:
            if what == START:                                  # sum is b.b
                S_out[SIZE] = sum
                S_out[GOAL] = tolerance * tolerance * sum
                S_out[RZ] = zero
                S_out[COUNT] = zero
                S_out[ALPHA] = wp.float64(1.0)
                going_out[0] = int(sum > zero)
            elif what == TURN:                                 # r.z
                S_out[BETA] = zero
                if S_out[RZ] > zero:
                    S_out[BETA] = sum / S_out[RZ]
                S_out[RZ] = sum
            elif what == STEP:                                 # p.w
                S_out[ALPHA] = zero
                S_out[MEAN] = zero
                if S_out[CELLS] > zero:
                    S_out[MEAN] = whole / S_out[CELLS]
                if sum > zero:
                    S_out[ALPHA] = S_out[RZ] / sum
            else:                                              # r.r
                if S_out[CELLS] > zero:
                    sum -= whole * whole / S_out[CELLS]
                count = S_out[COUNT] + wp.float64(1.0)
                S_out[COUNT] = count
                wp.atomic_add(count_out, 0, 1)
                stuck = S_out[ALPHA] == zero or not sum >= zero
                goes = sum > S_out[GOAL] and count < wp.float64(cap) and not stuck
                going_out[0] = int(goes)
                if not goes:
                    wp.atomic_max(count_out, 1, int(count))
                    if not sum <= S_out[GOAL]:
                        wp.atomic_add(missed_out, 0, 1)

    return wp.kernel(update_grid_scalars, name="grid_conclude", module=module, enable_backward=False, grid_stride=False)
