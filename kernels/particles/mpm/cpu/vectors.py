"""Transfers of a particle on a CPU, four numbers at a time (Clang's vectors): threads of a CPU come one after the other, and a
particle may add to its 27 nodes in place. The formulas are those of transfers.py, in which sums over z are taken first:

    s = sum_z w_z u,  t = sum_z w_z r_z u;   v += w_x w_y s,  C_x += w_x w_y r_x s,  C_y += w_x w_y r_y s,  C_z += w_x w_y t
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.tables import point_tables

WEIGHTS = """
    typedef {real} R;
    typedef R four __attribute__((ext_vector_type(4), aligned(sizeof(R))));
    R w[3][3], r[3][3];
    for (int a = 0; a < 3; ++a) {{
        const R below = R(0.5) - o[a], above = R(0.5) + o[a];
        w[a][0] = R(0.5) * below * below; w[a][1] = R(0.75) - o[a] * o[a]; w[a][2] = R(0.5) * above * above;
        for (int n = 0; n < 3; ++n) r[a][n] = R(n - 1) - o[a];
    }}
"""
NODES = WEIGHTS + """
    const int local[3] = {{i & 3, j & 3, k & 3}}, cells[3] = {{16, 4, 1}}, blocks[3] = {{9, 3, 1}};
    int cell[3][3], block[3][3];
    for (int a = 0; a < 3; ++a)
        for (int n = 0; n < 3; ++n) {{
            const int c = local[a] + n - 1;
            cell[a][n] = (c & 3) * cells[a];
            block[a][n] = ((c >> 2) + 1) * blocks[a];
        }}
    const int* near = g.near.data + 27 * b;
"""
SCATTER = """
#if !defined(__CUDA_ARCH__)
""" + NODES + """
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
            const int* at = near + block[0][e] + block[1][f];
            const int start = cell[0][e] + cell[1][f];
            #pragma clang loop unroll(full)
            for (int n = 0; n < 3; ++n) {{
                const int other = at[block[2][n]];
                if (other < 0) continue;
                four* node = (four*)(nodes.data + (64 * other + start + cell[2][n]));
                *node += part * (w[2][n] * row + along[n]);
            }}
        }}
#endif
"""
GATHER = """
#if !defined(__CUDA_ARCH__)
""" + NODES + """
    four v = 0, x = 0, y = 0, z = 0;
    #pragma clang loop unroll(full)
    for (int e = 0; e < 3; ++e)
        #pragma clang loop unroll(full)
        for (int f = 0; f < 3; ++f) {{
            const R part = w[0][e] * w[1][f];
            const int* at = near + block[0][e] + block[1][f];
            const int start = cell[0][e] + cell[1][f];
            four s = 0, t = 0;
            #pragma clang loop unroll(full)
            for (int n = 0; n < 3; ++n) {{
                const int other = at[block[2][n]];
                if (other < 0) continue;
                const four u = *(const four*)(nodes.data + (64 * other + start + cell[2][n]));
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


@cache
def vector_transfers(real) -> SimpleNamespace:
    """scatter_row(grid, block, i, j, k, o, p, nodes) adds a particle to its nodes: rows of p are momentum and mass, its columns
    the value and its gradient a cell. gather_row(grid, block, i, j, k, o, nodes) -> such a matrix of the nodes' values."""
    t, G = types(real), point_tables(real).BlockGrid
    name = "float" if real is wp.float32 else "double"
    mat44, vec3, vec4 = t.mat44, t.vec3, t.vec4

    @wp.func_native(SCATTER.format(real=name))
    def scatter_row(g: G, b: int, i: int, j: int, k: int, o: vec3, p: mat44, nodes: wp.array(dtype=vec4)): ...

    @wp.func_native(GATHER.format(real=name))
    def gather_row(g: G, b: int, i: int, j: int, k: int, o: vec3, nodes: wp.array(dtype=vec4)) -> mat44: ...

    return SimpleNamespace(scatter_row=scatter_row, gather_row=gather_row)
