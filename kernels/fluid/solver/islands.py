"""Sealed regions of openings that change: found on the device, by a forest whose roots are the lowest cells of the regions
(Komura 2015: a root is hung below a lower one by an atomic minimum, and what it was hung below meanwhile goes on with). What
the right-hand side sums to in each is taken off, as regions.py does; sums are whole numbers of SCALE / (cells |b|), so that
they do not depend on the order of cells. A region is sealed where no face of it is an open side's and, of a liquid (`free`), no
cell of it is beside air.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.fluid.grid import grid_functions
from wsim.kernels.fluid.pressure import FREE, poisson_stencil, pressure_levels
from wsim.kernels.math.real import types
from wsim.kernels.solver.pcg import block_sum

SCALE = wp.constant(wp.float64(2.0**61))       # |sum of b| <= cells |b|: no sum is beyond 63 bits


@wp.func
def find_forest_root(parent: wp.array(dtype=int), cell: int):
    c = int(cell)
    above = parent[c]
    while above != c:
        c = above
        above = parent[c]
    return c


@wp.func
def unite_trees(parent: wp.array(dtype=int), one: int, other: int):
    a = find_forest_root(parent, one)
    b = find_forest_root(parent, other)
    while a != b:
        high = wp.max(a, b)
        low = wp.min(a, b)
        above = wp.atomic_min(parent, high, low)       # what it was; high itself, where it was a root
        a = low
        b = low
        if above != high:
            b = find_forest_root(parent, above)


@wp.struct
class Forest:
    parent: wp.array(dtype=int)            # (cells,), -1: no face of the cell is open
    label: wp.array(dtype=int)             # root of each cell, -1: none
    vented: wp.array(dtype=int)            # of a root: 1 if its region is not sealed
    count: wp.array(dtype=int)             # of a root: cells
    sum: wp.array(dtype=wp.int64)          # of a root: of b, in |b| cells / SCALE


@cache
def island_finder_kernels(dim: int, free: bool, real, module) -> SimpleNamespace:
    """Kernels over cells, one after another: plant (each its own root), join (cells with an open face between them), settle
    (labels, cells and vents of roots)."""
    Level, s, f = pressure_levels(real), poisson_stencil(dim, FREE if free else True, real), grid_functions(dim, real)

    def plant_forest(level: Level, to: Forest):
        c = wp.tid()
        to.parent[c] = wp.where(s.diagonal(level, f.place(c, level.n)) > real(0.0), c, -1)
        to.vented[c] = 0
        to.count[c] = 0

    def join_open_cells(level: Level, to: Forest):
        c = wp.tid()
        i = f.place(c, level.n)
        for a in range(wp.static(dim)):
            _, high = s.couplings(level, i, a)
            step = int(1)
            if a == 0:
                step = level.n[1] * level.n[2]
            if a == 1:
                step = level.n[2]
            if high > real(0.0):
                if i[a] + 1 < level.n[a]:
                    unite_trees(to.parent, c, c + step)
                elif level.periodic[a] != 0:
                    unite_trees(to.parent, c, c - (level.n[a] - 1) * step)

    def label_islands(level: Level, to: Forest):
        c = wp.tid()
        to.label[c] = -1
        if to.parent[c] >= 0:
            r = find_forest_root(to.parent, c)
            to.label[c] = r
            wp.atomic_add(to.count, r, 1)
            i = f.place(c, level.n)
            for a in range(wp.static(dim)):
                low, high = s.couplings(level, i, a)
                beyond = (i[a] == 0 and low > real(0.0)) or (i[a] + 1 == level.n[a] and high > real(0.0))
                if beyond and level.periodic[a] == 0:
                    wp.atomic_max(to.vented, r, 1)
            if wp.static(free):
                if level.own[c] > real(0.0):
                    wp.atomic_max(to.vented, r, 1)

    make = [wp.kernel(k, name=f"islands_{k.__name__}{'_free' * free}_{f.name}", module=module, enable_backward=False)
            for k in (plant_forest, join_open_cells, label_islands)]
    return SimpleNamespace(plant=make[0], join=make[1], settle=make[2])


@cache
def island_level_kernels(real, module) -> SimpleNamespace:
    """Kernels: scale (one block: S is SCALE / (cells |b|), of parts of b.b), clear (over cells), gather (over cells: sums),
    level (over cells: means off)."""
    name = types(real).name

    def island_sum_scale(part: wp.array(dtype=wp.vec2d), cells: int, S_out: wp.array(dtype=wp.float64)):
        sum = wp.float64(0.0)
        for k in range(wp.tid(), part.shape[0], wp.block_dim()):
            sum += part[k][0]
        sum = block_sum(sum)
        if wp.tid() == 0:
            size = wp.float64(cells) * wp.sqrt(sum)
            S_out[0] = wp.where(size > wp.float64(0.0), SCALE / size, wp.float64(0.0))

    def clear_island_sums(to: Forest):
        to.sum[wp.tid()] = wp.int64(0)

    def gather_island_sums(b: wp.array(dtype=real), S: wp.array(dtype=wp.float64), to: Forest):
        c = wp.tid()
        r = to.label[c]
        if r >= 0:
            if to.vented[r] == 0:
                wp.atomic_add(to.sum, r, wp.int64(S[0] * wp.float64(b[c])))

    def remove_island_means(of: Forest, S: wp.array(dtype=wp.float64), b_out: wp.array(dtype=real)):
        c = wp.tid()
        r = of.label[c]
        if r >= 0:
            if of.vented[r] == 0 and S[0] > wp.float64(0.0):
                b_out[c] = real(wp.float64(b_out[c]) - wp.float64(of.sum[r]) / (S[0] * wp.float64(of.count[r])))

    one = wp.kernel(island_sum_scale, name="islands_scale", module=module, enable_backward=False, grid_stride=False)
    make = [wp.kernel(k, name=f"islands_{k.__name__}_{name}", module=module, enable_backward=False)
            for k in (clear_island_sums, gather_island_sums, remove_island_means)]
    return SimpleNamespace(scale=one, clear=make[0], gather=make[1], level=make[2])
