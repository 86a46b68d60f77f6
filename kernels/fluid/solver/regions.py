"""Sealed regions, in which the pressure is known but for a constant: the right-hand side must sum to nothing in each, or no
velocity has that divergence. What it sums to is spread over the region's cells and taken off.
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.conjugate import CELLS, MEAN
from wsim.kernels.fluid.grid import grid_functions
from wsim.kernels.fluid.pressure import poisson_stencil, pressure_levels
from wsim.kernels.math.real import types
from wsim.kernels.solver.pcg import block_sum


@cache
def open_region_kernel(dim: int, real, module):
    """Kernel over cells: region_out is 0 where a cell has an open face, else -1."""
    Level, s, f = pressure_levels(real), poisson_stencil(dim, True, real), grid_functions(dim, real)

    def mark_open_cells(level: Level, region_out: wp.array(dtype=int)):
        c = wp.tid()
        region_out[c] = wp.where(s.diagonal(level, f.place(c, level.n)) > real(0.0), 0, -1)

    return wp.kernel(mark_open_cells, name=f"region_inside_{f.name}", module=module, enable_backward=False)


@cache
def region_sum_kernel(labelled: bool, real, module):
    """Kernel over blocks of threads: parts (sum of b, cells) of a region; without labels of all cells."""

    def region_sum_parts(region: wp.array(dtype=int), which: int, b: wp.array(dtype=real), part_out: wp.array(dtype=wp.vec2d)):
        sum = wp.float64(0.0)
        count = wp.float64(0.0)
        for c in range(wp.tid(), b.shape[0], part_out.shape[0] * wp.block_dim()):
            if wp.static(labelled):
                if region[c] == which:
                    sum += wp.float64(b[c])
                    count += wp.float64(1.0)
            else:
                sum += wp.float64(b[c])
                count += wp.float64(1.0)
        sum = block_sum(sum)
        count = block_sum(count)
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = wp.vec2d(sum, count)

    name = f"region_gather{'_labelled' * labelled}_{types(real).name}"
    return wp.kernel(region_sum_parts, name=name, module=module, enable_backward=False, grid_stride=False)


@cache
def region_mean_kernel(module):
    """Kernel over one block of threads: the mean of a region, and its cells if it is the `only` one."""

    def compute_region_mean(part: wp.array(dtype=wp.vec2d), only: int, S_out: wp.array(dtype=wp.float64)):
        sum = wp.float64(0.0)
        count = wp.float64(0.0)
        for k in range(wp.tid(), part.shape[0], wp.block_dim()):
            p = part[k]
            sum += p[0]
            count += p[1]
        sum = block_sum(sum)
        count = block_sum(count)
        if wp.tid() == 0:
            S_out[MEAN] = sum / wp.max(count, wp.float64(1.0))
            S_out[CELLS] = count * wp.float64(only)

    return wp.kernel(compute_region_mean, name="region_mean", module=module, enable_backward=False, grid_stride=False)


@cache
def region_level_kernel(labelled: bool, real, module):
    """Kernel over cells: the mean of a region taken off."""

    def subtract_region_mean(region: wp.array(dtype=int), which: int, S: wp.array(dtype=wp.float64),
                             b_out: wp.array(dtype=real)):
        c = wp.tid()
        if wp.static(labelled):
            if region[c] == which:
                b_out[c] = real(wp.float64(b_out[c]) - S[MEAN])
        else:
            b_out[c] = real(wp.float64(b_out[c]) - S[MEAN])

    name = f"region_level{'_labelled' * labelled}_{types(real).name}"
    return wp.kernel(subtract_region_mean, name=name, module=module, enable_backward=False)
