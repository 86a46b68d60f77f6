"""The small levels of a V-cycle (kernels/fluid/solver/multigrid.py) in one launch: one block of threads goes down and up
through all of them, and its threads meet where launches would end. On the CPU one thread does.

A launch in a graph takes an H200 1.9 us, whatever it does; these levels would have a hundred of them a cycle.
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions
from wsim.kernels.fluid.pressure import pressure_levels
from wsim.kernels.fluid.solver.multigrid import vcycle_functions
from wsim.kernels.math.block import block_barrier
from wsim.kernels.solver.pcg import block_sum

BLOCK = 512              # threads


@cache
def coarse_rungs(real):
    """Struct of a level: its equation, the factors by which its axes are halved to the next coarser one, x and b."""
    Level = pressure_levels(real)

    @wp.struct
    class Rung:
        level: Level
        halved: wp.vec3i
        x: wp.array(dtype=real)
        b: wp.array(dtype=real)

    return Rung


@cache
def small_levels_kernel(dim: int, fractions: bool | int, sweeps: int, coarsest: int, real, module):
    """Kernel of one block: x of the first of the rungs, of its b. sweeps, coarsest: of both colours, before and behind.
    sealed: the mean of the coarsest b is taken off, or no x has that residual."""
    Rung, p, f = coarse_rungs(real), vcycle_functions(dim, fractions, real), grid_functions(dim, real)

    @wp.func(inline=False)
    def sweep_rung(t: int, r: Rung, color: int, fresh: bool):
        last = r.level.n[wp.static(dim - 1)]
        half = r.x.shape[0] // last * ((last + 1) // 2)
        for m in range(t, half, wp.block_dim()):
            i = p.coloured(m, color, r.level.n)
            if i[wp.static(dim - 1)] < last:
                if fresh:
                    r.x[flat_cell_index(i, r.level.n)] = p.fresh(r.level, r.b, i)
                else:
                    r.x[flat_cell_index(i, r.level.n)] = p.swept(r.level, r.b, r.x, i)
        block_barrier()

    @wp.func(inline=False)
    def remove_rung_mean(t: int, r: Rung):
        sum = wp.float64(0.0)
        count = wp.float64(0.0)
        for c in range(t, r.b.shape[0], wp.block_dim()):
            if p.diagonal(r.level, f.place(c, r.level.n)) > real(0.0):
                sum += wp.float64(r.b[c])
                count += wp.float64(1.0)
        sum = block_sum(sum)
        count = block_sum(count)
        for c in range(t, r.b.shape[0], wp.block_dim()):
            if p.diagonal(r.level, f.place(c, r.level.n)) > real(0.0):
                r.b[c] = r.b[c] - real(sum / count)
        block_barrier()

    def small_levels_cycle(table: wp.array(dtype=Rung), sealed: int):
        t = wp.tid()
        deepest = table.shape[0] - 1
        for k in range(deepest):
            r = table[k]
            below = table[k + 1]
            for m in range(wp.static(2 * sweeps)):
                sweep_rung(t, r, m & 1, m == 0)
            for c in range(t, below.b.shape[0], wp.block_dim()):
                below.b[c] = p.residual(r.level, f.place(c, below.level.n), r.halved, r.b, r.x)
            block_barrier()
        r = table[deepest]
        if sealed != 0:
            remove_rung_mean(t, r)
        often = wp.static(2 * coarsest)
        if r.x.shape[0] == 1:
            often = 2
        for m in range(often):
            sweep_rung(t, r, m & 1, m == 0)
        for m in range(often):
            sweep_rung(t, r, 1 - (m & 1), False)
        for step in range(deepest):
            r = table[deepest - 1 - step]
            below = table[deepest - step]
            last = r.level.n[wp.static(dim - 1)]
            half = r.x.shape[0] // last * ((last + 1) // 2)
            for m in range(t, half, wp.block_dim()):
                i = p.coloured(m, 1, r.level.n)
                if i[wp.static(dim - 1)] < last:
                    r.x[flat_cell_index(i, r.level.n)] = p.risen(r.level, below.level.n, r.halved, r.b, below.x, r.x, i)
            block_barrier()
            for m in range(1, wp.static(2 * sweeps)):
                sweep_rung(t, r, 1 - (m & 1), False)

    return wp.kernel(small_levels_cycle, name=f"coarse_{p.name}", module=module, enable_backward=False, grid_stride=False,
                     launch_bounds=BLOCK)
