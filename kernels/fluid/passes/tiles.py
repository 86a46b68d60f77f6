"""Scalars by tiles of 8 cells an edge: where a tile and those that air can come from hold nothing, there is nothing to carry.

    holds   1: a cell of the tile has some of a scalar, (tiles,)
    near    1: a tile within  d = |u| h / dx + 3  cells along each axis holds some

A way back ends within |u| h of where it began, |u| the greatest velocity of any face, and rows are read no further than two
from there: what is not near is 0 to the bit whether it is carried or not, and is neither read nor written. A limited cubic
makes nothing of nothing, but puts ever smaller numbers a cell further in each step. What is below LEAST is made 0, so that
tiles stay those that can be seen.
"""

# ruff: noqa: UP018
# int(0) makes a variable of what would be a constant.

from functools import cache

import warp as wp

from wsim.kernels.fluid.advection import BOUNDS, backtrace_function, carried_value_function
from wsim.kernels.fluid.grid import grid_functions, grid_structs
from wsim.kernels.math.real import types

EDGE = 8                                          # cells of a tile along each axis
LEAST = {"f32": 1e-10, "f64": 1e-20}              # [1] or [K]: smaller amounts are none
READ = 3.0                                        # rows beyond the end of a way back, one of them for rounding
FAR = 8                                           # tiles: air that comes from further comes from everywhere


def tile_counts(n: tuple[int, ...]) -> tuple[int, int, int]:
    """Tiles along the axes of n cells."""
    x, y, z = (-(-m // EDGE) for m in n)
    return x, y, z


@cache
def tile_function(dim: int, real):
    """Function (g, i) -> tile of cell i."""
    S = grid_structs(real)

    @wp.func
    def tile_of_cell(g: S.Grid, i: wp.vec3i):
        if wp.static(dim == 2):
            return (i[0] >> 3) * ((g.n[1] + 7) >> 3) + (i[1] >> 3)
        return ((i[0] >> 3) * ((g.n[1] + 7) >> 3) + (i[1] >> 3)) * ((g.n[2] + 7) >> 3) + (i[2] >> 3)

    return tile_of_cell


@cache
def tile_mark_kernel(dim: int, both: bool, real, module):
    """Kernel over cells: tiles that hold some of a scalar (both: of either)."""
    S, f, tile = grid_structs(real), grid_functions(dim, real), tile_function(dim, real)

    def mark_filled_tiles(g: S.Grid, q: wp.array(dtype=real), r: wp.array(dtype=real), holds_out: wp.array(dtype=int)):
        c = wp.tid()
        found = q[c] != real(0.0)
        if wp.static(both):
            found = found or r[c] != real(0.0)
        if found:
            holds_out[tile(g, f.place(c, g.n))] = 1

    return wp.kernel(mark_filled_tiles, name=f"tiles_mark{'_both' * both}_{f.name}", module=module, enable_backward=False)


@cache
def near_tile_kernel(dim: int, real, module):
    """Kernel over tiles: which are near to one that holds some. speed: greatest |u| of the faces [m/s], (1,)."""
    S, t = grid_structs(real), types(real)

    @wp.func
    def periodic_tile(j: int, n: int):
        """Tile of place j of n, which may be further than once around."""
        return wp.where(j < 0 or j >= n, (j + n * wp.static(2 * FAR + 4)) % n, j)

    def mark_near_tiles(g: S.Grid, holds: wp.array(dtype=int), speed: wp.array(dtype=real), clock: wp.array(dtype=real),
                        near_out: wp.array(dtype=int)):
        c = wp.tid()
        n = wp.vec3i((g.n[0] + 7) >> 3, (g.n[1] + 7) >> 3, (g.n[2] + 7) >> 3)
        i = c // (n[1] * n[2])
        j = (c // n[2]) % n[1]
        k = c % n[2]
        cells = speed[0] * clock[0] / g.dx + real(wp.static(READ))
        far = int(wp.static(FAR + 1))
        if cells < real(wp.static(FAR * EDGE)):                # not finite: all
            far = int(wp.ceil(cells / real(wp.static(EDGE))))
        found = int(far > wp.static(FAR))
        at = wp.vec3i(i, j, k)
        low = wp.vec3i()
        high = wp.vec3i()
        for a in range(3):
            reach = far
            if g.periodic[a] != 0 and (g.n[a] & 7) != 0:
                reach = far + 1                                # the last tile has fewer cells
            low[a] = at[a] - reach
            high[a] = at[a] + reach
            if g.periodic[a] == 0 or 2 * reach + 1 >= n[a]:
                low[a] = wp.max(low[a], 0)
                high[a] = wp.min(high[a], n[a] - 1)
            if g.periodic[a] != 0 and 2 * reach + 1 >= n[a]:
                low[a] = 0
                high[a] = n[a] - 1
        if found == 0:
            for x in range(low[0], high[0] + 1):
                for y in range(low[1], high[1] + 1):
                    row = (periodic_tile(x, n[0]) * n[1] + periodic_tile(y, n[1])) * n[2]
                    for z in range(low[2], high[2] + 1):
                        found = wp.max(found, holds[row + periodic_tile(z, n[2])])
        near_out[c] = found

    return wp.kernel(mark_near_tiles, name=f"tiles_near_{dim}d_{t.name}", module=module, enable_backward=False)


@cache
def tile_advection_kernel(dim: int, scheme: str, third: bool, both: bool, real, module):
    """Kernel over cells, of those that are near: a scalar (both: two, which have the way back in common) followed back over the
    step clock[0] [s]. Others are left as they are."""
    S, f, tile = grid_structs(real), grid_functions(dim, real), tile_function(dim, real)
    back, at = backtrace_function(dim, -1, real, third), carried_value_function(dim, -1, scheme, scheme == "cubic", real)

    def advect_near_tiles(g: S.Grid, u: S.Faces, q: wp.array(dtype=real), r: wp.array(dtype=real), clock: wp.array(dtype=real),
                          near: wp.array(dtype=int), q_out: wp.array(dtype=real), r_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, g.n)
        if near[tile(g, i)] != 0:
            X = back(g, u, i, clock[0])
            q_out[c] = at(g, q, X)
            if wp.static(both):
                r_out[c] = at(g, r, X)

    name = f"tiles_carry{'_both' * both}_{scheme}{'_rk3' * third}_{f.name}"
    return wp.kernel(advect_near_tiles, name=name, module=module, enable_backward=False, launch_bounds=BOUNDS)


@cache
def flush_small_function(real):
    """Function q -> q, or 0 below LEAST."""
    least = LEAST[types(real).name]

    @wp.func
    def flush_small_value(q: real):
        value = q
        if wp.abs(q) < real(wp.static(least)):
            value = real(0.0)
        return value

    return flush_small_value


@cache
def tile_scalar_kernel(dim: int, both: bool, real, module):
    """Kernel over cells: scalars of those that are near become what `tile_advection_kernel` has found, and mark their tiles."""
    S, f, tile, seen = grid_structs(real), grid_functions(dim, real), tile_function(dim, real), flush_small_function(real)

    def store_near_tiles(g: S.Grid, near: wp.array(dtype=int), q: wp.array(dtype=real), r: wp.array(dtype=real),
                         holds_out: wp.array(dtype=int), q_out: wp.array(dtype=real), r_out: wp.array(dtype=real)):
        c = wp.tid()
        m = tile(g, f.place(c, g.n))
        if near[m] != 0:
            value = seen(q[c])
            q_out[c] = value
            other = real(0.0)
            if wp.static(both):
                other = seen(r[c])
                r_out[c] = other
            if value != real(0.0) or other != real(0.0):
                holds_out[m] = 1

    return wp.kernel(store_near_tiles, name=f"tiles_keep{'_both' * both}_{f.name}", module=module, enable_backward=False)
