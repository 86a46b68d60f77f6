"""The small levels of a V-cycle (kernels/fluid/solver/multigrid.py) in one launch: one block of threads goes down and up
through all of them, and its threads meet where launches would end. On the CPU one thread does.

A launch in a graph takes an H200 1.9 us, whatever it does; these levels would have a hundred of them a cycle.
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import flat, functions
from wsim.kernels.fluid.pressure import levels
from wsim.kernels.fluid.solver.multigrid import passes
from wsim.kernels.math.block import meet
from wsim.kernels.solver.pcg import total

BLOCK = 512              # threads


@cache
def rungs(real):
    """Struct of a level: its equation, the factors by which its axes are halved to the next coarser one, x and b."""
    Level = levels(real)

    @wp.struct
    class Rung:
        level: Level
        halved: wp.vec3i
        x: wp.array(dtype=real)
        b: wp.array(dtype=real)

    return Rung


@cache
def coarse(dim: int, fractions: bool | int, sweeps: int, coarsest: int, real, module):
    """Kernel of one block: x of the first of the rungs, of its b. sweeps, coarsest: of both colours, before and behind.
    sealed: the mean of the coarsest b is taken off, or no x has that residual."""
    Rung, p, f = rungs(real), passes(dim, fractions, real), functions(dim, real)

    @wp.func(inline=False)
    def sweep(t: int, r: Rung, color: int, fresh: bool):
        last = r.level.n[wp.static(dim - 1)]
        half = r.x.shape[0] // last * ((last + 1) // 2)
        for m in range(t, half, wp.block_dim()):
            i = p.coloured(m, color, r.level.n)
            if i[wp.static(dim - 1)] < last:
                if fresh:
                    r.x[flat(i, r.level.n)] = p.fresh(r.level, r.b, i)
                else:
                    r.x[flat(i, r.level.n)] = p.swept(r.level, r.b, r.x, i)
        meet()

    @wp.func(inline=False)
    def even(t: int, r: Rung):
        sum = wp.float64(0.0)
        count = wp.float64(0.0)
        for c in range(t, r.b.shape[0], wp.block_dim()):
            if p.diagonal(r.level, f.place(c, r.level.n)) > real(0.0):
                sum += wp.float64(r.b[c])
                count += wp.float64(1.0)
        sum = total(sum)
        count = total(count)
        for c in range(t, r.b.shape[0], wp.block_dim()):
            if p.diagonal(r.level, f.place(c, r.level.n)) > real(0.0):
                r.b[c] = r.b[c] - real(sum / count)
        meet()

    def coarse(table: wp.array(dtype=Rung), sealed: int):
        t = wp.tid()
        deepest = table.shape[0] - 1
        for k in range(deepest):
            r = table[k]
            below = table[k + 1]
            for m in range(wp.static(2 * sweeps)):
                sweep(t, r, m & 1, m == 0)
            for c in range(t, below.b.shape[0], wp.block_dim()):
                below.b[c] = p.residual(r.level, f.place(c, below.level.n), r.halved, r.b, r.x)
            meet()
        r = table[deepest]
        if sealed != 0:
            even(t, r)
        often = wp.static(2 * coarsest)
        if r.x.shape[0] == 1:
            often = 2
        for m in range(often):
            sweep(t, r, m & 1, m == 0)
        for m in range(often):
            sweep(t, r, 1 - (m & 1), False)
        for step in range(deepest):
            r = table[deepest - 1 - step]
            below = table[deepest - step]
            last = r.level.n[wp.static(dim - 1)]
            half = r.x.shape[0] // last * ((last + 1) // 2)
            for m in range(t, half, wp.block_dim()):
                i = p.coloured(m, 1, r.level.n)
                if i[wp.static(dim - 1)] < last:
                    r.x[flat(i, r.level.n)] = p.risen(r.level, below.level.n, r.halved, r.b, below.x, r.x, i)
            meet()
            for m in range(1, wp.static(2 * sweeps)):
                sweep(t, r, 1 - (m & 1), False)

    return wp.kernel(coarse, name=f"coarse_{p.name}", module=module, enable_backward=False, grid_stride=False,
                     launch_bounds=BLOCK)
