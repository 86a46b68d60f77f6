"""Lists of the particles near each, cell by cell: on a CPU, which looks at eight others together (Clang's vectors).

The particles of a cell have the same 27 cells about them. What is in there is copied into a row once, ROOM at a time, in the
order in which `list_kernel` (neighbours.py) looks at it. Each particle of the cell then looks at eight after eight. Which of
eight are near is a byte, and PLACES has the numbers of its bits one behind the other, so that no branch depends on it. Tests
and order are those of `list_kernel`. 20 480 particles of a fluid with 240 others about each take 3.2 ms, and 21 one by one (a
core of a Xeon).
"""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import kernel_over_cores
from wsim.kernels.math.real import types
from wsim.kernels.position_based.neighbours import NOWHERE, cell_number_func, neighbour_structs

ROOM = 1024            # others of a cell's particles that are looked at together: 22 KB in float32
PLACES = ", ".join(str(([i for i in range(8) if byte >> i & 1] + 8 * [0])[:8]).replace("[", "{{").replace("]", "}}")
                   for byte in range(256))
CELL = """
#if !defined(__CUDA_ARCH__)
    typedef {real} R;
    typedef R eight __attribute__((vector_size(8 * sizeof(R)), aligned(sizeof(R))));
    typedef {whole} flags __attribute__((vector_size(8 * sizeof(R))));
    typedef bool bits __attribute__((ext_vector_type(8)));
    typedef unsigned short numbers __attribute__((vector_size(16), aligned(2)));
    static const numbers places[256] = {{""" + PLACES + """}};
    const int begin = c.first.data[cell], end = c.first.data[cell + 1];
    for (int k = begin; k < end; ++k) lists.count.data[k] = 0;
    const R *near = (const R*)c.near.data, *reach = c.reach.data, farthest = c.edge * c.edge;
    R x[{room} + 8], y[{room} + 8], z[{room} + 8], R_j[{room} + 8];
    int other[{room}], n = 0, most = 0;
    unsigned short found[{room} + 8];
    auto look = [&] {{
        for (int l = n; l < n + 8; ++l) x[l] = y[l] = z[l] = R_j[l] = R({nowhere});
        for (int k = begin; k < end; ++k) {{
            const R *own = near + 3 * k, far = reach[k] + c.skin;
            const int group = rows.group.data[c.order.data[k]];
            int met = 0, m = lists.count.data[k];
            for (int j = 0; j < n; j += 8) {{
                const eight dx = *(const eight*)(x + j) - own[0], dy = *(const eight*)(y + j) - own[1],
                            dz = *(const eight*)(z + j) - own[2], way = *(const eight*)(R_j + j) + far;
                const eight apart = dx * dx + dy * dy + dz * dz;
                const flags is_near = (apart < way * way) & (apart < farthest);
                const bits some = __builtin_convertvector(is_near, bits);
                unsigned char set;
                __builtin_memcpy(&set, &some, 1);
                *(numbers*)(found + met) = places[set] + (unsigned short)j;
                met += __builtin_popcount(set);
            }}
            for (int i = 0; i < met; ++i) {{
                const int o = other[found[i]];
                if (o == k || (group >= 0 && rows.group.data[c.order.data[o]] == group)) continue;
                if (m < lists.room) lists.other.data[(long long)m * lists.size + k] = o;
                ++m;
            }}
            lists.count.data[k] = m;
            most = m > most ? m : most;
        }}
        n = 0;
    }};
    const int nx = c.n[0], ny = c.n[1], nz = c.n[2], at = cell % c.size, cx = at % nx, cy = at / nx % ny, cz = at / nx / ny;
    for (int a = 0; a < 27; ++a) {{
        const int ay = (cy + a / 3 % 3 - 1) & (ny - 1), az = (cz + a / 9 - 1) & (nz - 1), ax = (cx + a % 3 - 1) & (nx - 1);
        const int there = cell - at + ax + nx * (ay + ny * az);
        for (int j = c.first.data[there]; j < c.first.data[there + 1];) {{
            if (n == {room}) look();
            const int stop = c.first.data[there + 1] - j < {room} - n ? c.first.data[there + 1] : j + {room} - n;
            for (; j < stop; ++j, ++n) {{
                x[n] = near[3 * j]; y[n] = near[3 * j + 1]; z[n] = near[3 * j + 2]; R_j[n] = reach[j];
                other[n] = j;
            }}
        }}
    }}
    look();
    for (int k = begin; k < end; ++k) if (lists.count.data[k] > lists.room) lists.count.data[k] = lists.room;
    return most;
#else
    return 0;
#endif
"""


@cache
def cell_list_kernel(real, module):
    """Kernel over places: the first of a cell makes the lists of all its cell. `wanted`: the length of one without room."""
    S, number = neighbour_structs(real), cell_number_func(real)
    names = {"real": "float", "whole": "int"} if real is wp.float32 else {"real": "double", "whole": "long long"}

    @wp.func_native(CELL.format(room=ROOM, nowhere="1e18", **names))
    def list_near_packets(rows: S.ParticleTable, c: S.CellTable, lists: S.PairLists, cell: int) -> int: ...

    def list_cell_neighbours(rows: S.ParticleTable, c: S.CellTable, lists: S.PairLists):
        if c.flag[0] == 0:
            return
        k = wp.tid()
        y = c.near[k]
        if y[0] == real(NOWHERE):
            lists.count[k] = 0
            return
        q = y / c.edge
        cell = number(c, int(wp.floor(q[0])), int(wp.floor(q[1])), int(wp.floor(q[2])), rows.world[c.order[k]])
        if c.first[cell] == k:
            most = list_near_packets(rows, c, lists, cell)
            if most > lists.room:
                wp.atomic_max(lists.wanted, 0, most)

    return kernel_over_cores(list_cell_neighbours, f"neighbour_list_cells_{types(real).name}", module)
