"""Particles by cell: a counting sort on the device, the same in every run.

    count    how many are in each cell, and for each particle which of its cell's it is (any order)
    scan     first[c] = count[0] + .. + count[c - 1]; first[cells] is the number of all
    place    order[first[c] + rank] = particle
    settle   the particles of each cell in ascending order: what atomics have mixed is mended, so that sums over a cell's
             particles have one order

Integers alone are added atomically, and integers do not round. On a CPU threads come in ascending order, and
`insertion_sort_kernel` is not needed. A particle whose id is below 0 is none.
"""

# ruff: noqa: UP018
# int(0) makes a variable of what would be a constant.

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs
from wsim.kernels.math.real import types
from wsim.kernels.solver.pcg import block_sum


@cache
def particle_structs(real) -> SimpleNamespace:
    """Structs: Particles (one row each), Cells (which particles are in which cell)."""
    t = types(real)

    @wp.struct
    class ParticleRows:
        x: wp.array(dtype=t.vec3)          # from the low corner, along the axes of the grid [m]
        v: wp.array(dtype=t.vec3)          # [m/s]
        C: wp.array(dtype=t.mat33)         # rows: gradient of each component of v [1/s], of affine transfers
        id: wp.array(dtype=int)            # below 0: there is none
        seen: wp.array(dtype=int)          # beside thin walls: bits of the rows of the grid that no wall hides (walls.py)
        reach: wp.array(dtype=real)        # and the sum of the hats of the centres among them

    @wp.struct
    class Cells:
        first: wp.array(dtype=int)         # of each cell's particles in `order`, (cells + 1,)
        order: wp.array(dtype=int)
        clear: wp.array(dtype=t.vec2)      # beside thin walls (walls.py): distance of the centre to a shape, to a thin wall [m]
        share: wp.array(dtype=real)        # and what it has of particles at their density at rest [cells]

    return SimpleNamespace(Particles=ParticleRows, Cells=Cells)


@cache
def particle_cell_function(dim: int, real):
    """Function (g, x) -> cell of a place [m], within the grid."""
    t, S = types(real), grid_structs(real)

    @wp.func
    def find_particle_cell(g: S.Grid, x: t.vec3):
        i = wp.vec3i(0, 0, 0)
        for a in range(wp.static(dim)):
            i[a] = wp.clamp(int(wp.floor(x[a] / g.dx)), 0, g.n[a] - 1)
        return i

    return find_particle_cell


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __shared__ int part[32];
    int sum = v;
    unsigned lane = threadIdx.x & 31;
    for (unsigned k = 1; k < 32; k <<= 1) {
        int before = __shfl_up_sync(0xffffffffu, sum, k);
        if (lane >= k) sum += before;
    }
    __syncthreads();
    if (lane == 31) part[threadIdx.x >> 5] = sum;
    __syncthreads();
    sum -= v;
    for (unsigned k = 0; k < (threadIdx.x >> 5); ++k) sum += part[k];
    return sum;
#else
    return 0;
#endif
""")
def block_exclusive_sum(v: int) -> int:
    """Sum over the threads of a block before this one; every one must come. Blocks of whole warps."""
    ...


@cache
def particle_count_kernel(dim: int, real, module):
    """Kernel over rows: particles of each cell, and which of them each is."""
    S, T, f, cell = grid_structs(real), particle_structs(real), grid_functions(dim, real), particle_cell_function(dim, real)

    def count_cell_particles(g: S.Grid, particles: T.Particles, count_out: wp.array(dtype=int), rank_out: wp.array(dtype=int)):
        p = wp.tid()
        if particles.id[p] >= 0:
            rank_out[p] = wp.atomic_add(count_out, flat_cell_index(cell(g, particles.x[p]), g.n), 1)

    return wp.kernel(count_cell_particles, name=f"particles_count_{f.name}", module=module, enable_backward=False)


@cache
def prefix_sum_kernels(module):
    """Kernels over blocks of threads: parts (count) -> sum of each block's cells; starts (one block): sums before each, and of
    all; first (count, starts) -> first. flag: (1,), 0 leaves all as it is; None: it is done."""

    @wp.func
    def block_row_share(n: int, blocks: int):
        """Rows of a block: whole numbers of threads."""
        return (n + blocks * wp.block_dim() - 1) // (blocks * wp.block_dim()) * wp.block_dim()

    def prefix_sum_parts(count: wp.array(dtype=int), blocks: int, flag: wp.array(dtype=int), part_out: wp.array(dtype=int)):
        if flag:
            if flag[0] == 0:
                return
        b = wp.tid() // wp.block_dim()
        m = block_row_share(count.shape[0], blocks)
        sum = int(0)
        for c in range(b * m + wp.tid() % wp.block_dim(), wp.min((b + 1) * m, count.shape[0]), wp.block_dim()):
            sum += count[c]
        whole = int(block_sum(wp.float64(sum)))
        if wp.tid() % wp.block_dim() == 0:
            part_out[b] = whole

    def prefix_sum_starts(part: wp.array(dtype=int), blocks: int, flag: wp.array(dtype=int), start_out: wp.array(dtype=int)):
        if flag:
            if flag[0] == 0:
                return
        m = block_row_share(blocks, 1) // wp.block_dim()
        sum = int(0)
        for k in range(wp.tid() * m, wp.min((wp.tid() + 1) * m, blocks)):
            sum += part[k]
        before = block_exclusive_sum(sum)
        for k in range(wp.tid() * m, wp.min((wp.tid() + 1) * m, blocks)):
            start_out[k] = before
            before += part[k]

    def prefix_sum_firsts(count: wp.array(dtype=int), start: wp.array(dtype=int), blocks: int, flag: wp.array(dtype=int),
                          first_out: wp.array(dtype=int)):
        if flag:
            if flag[0] == 0:
                return
        b = wp.tid() // wp.block_dim()
        n = count.shape[0]
        m = block_row_share(n, blocks)
        before = start[b]
        for k in range(m // wp.block_dim()):
            c = b * m + k * wp.block_dim() + wp.tid() % wp.block_dim()
            v = int(0)
            if c < n:
                v = count[c]
            at = before + block_exclusive_sum(v)
            if c < n:
                first_out[c] = at
            if c == n - 1:
                first_out[n] = at + v
            before += int(block_sum(wp.float64(v)))

    return [wp.kernel(f, name=f"particles_scan_{f.__name__}", module=module, enable_backward=False, grid_stride=False)
            for f in (prefix_sum_parts, prefix_sum_starts, prefix_sum_firsts)]


@cache
def particle_order_kernel(dim: int, real, module):
    """Kernel over rows: where each stands in the order."""
    S, T, f, cell = grid_structs(real), particle_structs(real), grid_functions(dim, real), particle_cell_function(dim, real)

    def order_particles(g: S.Grid, particles: T.Particles, first: wp.array(dtype=int), rank: wp.array(dtype=int),
                        order_out: wp.array(dtype=int)):
        p = wp.tid()
        if particles.id[p] >= 0:
            order_out[first[flat_cell_index(cell(g, particles.x[p]), g.n)] + rank[p]] = p

    return wp.kernel(order_particles, name=f"particles_place_{f.name}", module=module, enable_backward=False)


@cache
def insertion_sort_kernel(module):
    """Kernel over cells: its particles in ascending order, by insertion: they come nearly so."""

    def insertion_sort_cells(first: wp.array(dtype=int), order_out: wp.array(dtype=int)):
        c = wp.tid()
        begin = first[c]
        for k in range(begin + 1, first[c + 1]):
            p = order_out[k]
            m = int(k)
            while m > begin and order_out[m - 1] > p:
                order_out[m] = order_out[m - 1]
                m -= 1
            order_out[m] = p

    return wp.kernel(insertion_sort_cells, name="particles_settle", module=module, enable_backward=False)


@cache
def particle_gather_kernel(affine: bool, real, module):
    """Kernel over rows: the particles in order, one behind the other; rows beyond them are none."""
    T = particle_structs(real)

    def gather_sorted_particles(order: wp.array(dtype=int), count: wp.array(dtype=int), last: int, particles: T.Particles,
                                out: T.Particles):
        k = wp.tid()
        if k < count[last]:
            p = order[k]
            out.x[k] = particles.x[p]
            out.v[k] = particles.v[p]
            if wp.static(affine):
                out.C[k] = particles.C[p]
            out.id[k] = particles.id[p]
        else:
            out.id[k] = -1

    return wp.kernel(gather_sorted_particles, name=f"particles_gather{'_affine' * affine}_{types(real).name}", module=module,
                     enable_backward=False)
