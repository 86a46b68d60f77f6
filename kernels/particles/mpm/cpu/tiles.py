"""Transfers by tiles on a CPU: the 6 x 6 x 6 nodes that the particles of a block of 4 x 4 x 4 cells reach.

    particles add to the tile of their block, in the order of cells;  a node adds up to eight tiles, in the order of blocks
    a tile gets the velocities of its nodes;  particles read them there

A tile stays in the first cache, no particle looks for its nodes' blocks, and no two threads write to one place. So sums have
one order, whatever the number of threads. The formulas are those of vectors.py.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.cpu.vectors import WEIGHTS
from wsim.kernels.particles.mpm.tables import point_tables

NODES = 216                # of a tile
PLACE = WEIGHTS + """
    four* tile = (four*)(tiles.data + 216 * b + 36 * (i & 3) + 6 * (j & 3) + (k & 3));
"""
SCATTER = """
#if !defined(__CUDA_ARCH__)
""" + PLACE + """
    const four m = {{p.data[0][0], p.data[1][0], p.data[2][0], p.data[3][0]}},
        x = {{p.data[0][1], p.data[1][1], p.data[2][1], 0}}, y = {{p.data[0][2], p.data[1][2], p.data[2][2], 0}},
        z = {{p.data[0][3], p.data[1][3], p.data[2][3], 0}};
    four along[3];
    for (int n = 0; n < 3; ++n) along[n] = (w[2][n] * r[2][n]) * z;
    #pragma clang loop unroll(full)
    for (int e = 0; e < 3; ++e)
        #pragma clang loop unroll(full)
        for (int f = 0; f < 3; ++f) {{
            const four row = m + r[0][e] * x + r[1][f] * y;
            const R part = w[0][e] * w[1][f];
            #pragma clang loop unroll(full)
            for (int n = 0; n < 3; ++n) tile[36 * e + 6 * f + n] += part * (w[2][n] * row + along[n]);
        }}
#endif
"""
GATHER = """
#if !defined(__CUDA_ARCH__)
""" + PLACE + """
    four v = 0, x = 0, y = 0, z = 0;
    #pragma clang loop unroll(full)
    for (int e = 0; e < 3; ++e)
        #pragma clang loop unroll(full)
        for (int f = 0; f < 3; ++f) {{
            const R part = w[0][e] * w[1][f];
            four s = 0, t = 0;
            #pragma clang loop unroll(full)
            for (int n = 0; n < 3; ++n) {{
                const four u = tile[36 * e + 6 * f + n];
                s += w[2][n] * u;
                t += (w[2][n] * r[2][n]) * u;
            }}
            s *= part;
            v += s; x += r[0][e] * s; y += r[1][f] * s; z += part * t;
        }}
    wp::mat_t<4, 4, R> found;
    for (int a = 0; a < 4; ++a) {{
        found.data[a][0] = v[a]; found.data[a][1] = x[a]; found.data[a][2] = y[a]; found.data[a][3] = z[a];
    }}
    return found;
#else
    return wp::mat_t<4, 4, {real}>();
#endif
"""
FILL = """
#if !defined(__CUDA_ARCH__)
    typedef {real} R;
    typedef R four __attribute__((ext_vector_type(4), aligned(sizeof(R))));
    four* tile = (four*)(tiles.data + 216 * b);
    for (int x = -1; x < 5; ++x)
        for (int y = -1; y < 5; ++y) {{
            const int* near = g.near.data + 27 * b + 9 * ((x >> 2) + 1) + 3 * ((y >> 2) + 1);
            const int row = 16 * (x & 3) + 4 * (y & 3);
            for (int z = -1; z < 5; ++z) {{
                const int other = near[(z >> 2) + 1];
                if (other < 0) *tile++ = 0;
                else *tile++ = *(const four*)(nodes.data + 64 * other + row + (z & 3));
            }}
        }}
#endif
"""
CLEAR = """
#if !defined(__CUDA_ARCH__)
    typedef {real} R;
    R* tile = (R*)(tiles.data + 216 * b);
    for (int n = 0; n < 4 * 216; ++n) tile[n] = 0;
#endif
"""


@cache
def tile_transfers(real) -> SimpleNamespace:
    """clear_tile(block, tiles); scatter_row(block, i, j, k, o, p, tiles) and gather_row(grid, block, i, j, k, o, tiles), as of
    `vector_transfers`; fill_tile(grid, block, nodes, tiles); sum_tiles(grid, tiles, block, cell) -> momentum and mass of a
    node. tiles: (blocks, NODES)."""
    t, G = types(real), point_tables(real).BlockGrid
    name = "float" if real is wp.float32 else "double"
    mat44, vec3, vec4 = t.mat44, t.vec3, t.vec4

    @wp.func_native(CLEAR.format(real=name))
    def clear_tile(b: int, tiles: wp.array2d(dtype=vec4)): ...

    @wp.func_native(SCATTER.format(real=name))
    def scatter_row(b: int, i: int, j: int, k: int, o: vec3, p: mat44, tiles: wp.array2d(dtype=vec4)): ...

    @wp.func_native(GATHER.format(real=name))
    def gather_row(g: G, b: int, i: int, j: int, k: int, o: vec3, tiles: wp.array2d(dtype=vec4)) -> mat44: ...

    @wp.func_native(FILL.format(real=name))
    def fill_tile(g: G, b: int, nodes: wp.array(dtype=vec4), tiles: wp.array2d(dtype=vec4)): ...

    @wp.func
    def first_near(c: int):
        """-1 where a cell lies at the low face of its block."""
        return wp.where(c == 0, -1, 0)

    @wp.func
    def end_near(c: int):
        """One behind the last neighbour whose tile has the cell."""
        return wp.where(c == 3, 2, 1)

    @wp.func
    def sum_tiles(g: G, tiles: wp.array2d(dtype=vec4), b: int, c: int):
        x = c // 16
        y = (c // 4) % 4
        z = c % 4
        sum = t.vec4()
        for i in range(first_near(x), end_near(x)):
            for j in range(first_near(y), end_near(y)):
                for k in range(first_near(z), end_near(z)):
                    other = g.near[27 * b + 9 * i + 3 * j + k + 13]
                    if other >= 0:
                        sum += tiles[other, 36 * (x + 1 - 4 * i) + 6 * (y + 1 - 4 * j) + z + 1 - 4 * k]
        return sum

    return SimpleNamespace(clear_tile=clear_tile, scatter_row=scatter_row, gather_row=gather_row, fill_tile=fill_tile,
                           sum_tiles=sum_tiles)
