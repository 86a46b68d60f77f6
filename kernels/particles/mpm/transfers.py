"""Transfers of MLS-MPM between particles and nodes (Hu et al. 2018, eq. 16-18; APIC: Jiang et al. 2015, eq. 8 and 11).

    A = m C - h V0 (4 / dx^2) tau                                               of a particle: momentum's gradient, stress
    m_i = sum_p w m,  (m v)_i = sum_p w (m v + A (x_i - x_p))                   by cell, then gathered by node from 27 cells
    v_i = (m v)_i / m_i + h g,  held by colliders (walls.py)
    v = sum_i w v_i,  C = 4 / dx^2 sum_i w v_i (x_i - x_p)^T                    gathered by particle

tau = J sigma is the Kirchhoff stress, tau V0 = P F^T V0. Each sum has one order, so that bits repeat. On a CPU, whose threads
come one after the other, a particle adds to its nodes (cpu/vectors.py).
"""

# ruff: noqa: UP018
# int(0) makes a variable of what would be a constant.

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.cpu.atomics import real_raise
from wsim.kernels.particles.mpm.cpu.tiles import tile_transfers
from wsim.kernels.particles.mpm.cpu.vectors import vector_transfers
from wsim.kernels.particles.mpm.motion import motion_functions
from wsim.kernels.particles.mpm.spline import spline_rows, spline_weight
from wsim.kernels.particles.mpm.tables import CELLS, point_tables
from wsim.kernels.particles.mpm.walls import wall_functions


@cache
def sorted_kernels(real, module) -> SimpleNamespace:
    """Kernels over rows of the order, clock: h, time in the frame [s]. sort_momentum: what nodes read of a particle, row behind
    row; scatter_momentum, on a CPU: adds it to the nodes; scatter_to_tiles: to tiles (cpu/tiles.py)."""
    t, T, vectors, by_tile = types(real), point_tables(real), vector_transfers(real), tile_transfers(real)

    @wp.func
    def read_momentum(points: T.PointRows, materials: T.MaterialRows, p: int, dx: real, h: real):
        """Momentum and mass, and their gradients a cell."""
        volume = points.volume[p]
        m = materials.density[points.row[p]] * volume
        v = m * points.v[p]
        C = (m * dx) * points.C[p]
        stress = real(4.0) * h * volume / dx
        T = stress * points.T[p]
        S = stress * points.S[p]
        zero = real(0.0)
        return t.mat44(v[0], C[0, 0] - T[0], C[0, 1] - S[2], C[0, 2] - S[1], v[1], C[1, 0] - S[2], C[1, 1] - T[1],
                       C[1, 2] - S[0], v[2], C[2, 0] - S[1], C[2, 1] - S[0], C[2, 2] - T[2], m, zero, zero, zero)

    def sort_momentum(points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid, clock: wp.array(dtype=real),
                      out: T.SortedRows):
        n = wp.tid()
        if n >= g.used[1]:
            return
        p = g.order[n]
        o = points.o[p]
        found = read_momentum(points, materials, p, g.dx, clock[0])
        out.m[n] = t.vec4(o[0], o[1], o[2], found[3, 0])
        out.x[n] = found[0]
        out.y[n] = found[1]
        out.z[n] = found[2]

    def scatter_momentum(points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid, clock: wp.array(dtype=real),
                         nodes: wp.array(dtype=t.vec4)):
        n = wp.tid()
        if n >= g.used[1]:
            return
        p = g.order[n]
        vectors.scatter_row(g, g.block[p], points.i[p], points.j[p], points.k[p], points.o[p],
                            read_momentum(points, materials, p, g.dx, clock[0]), nodes)

    def scatter_to_tiles(points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid, clock: wp.array(dtype=real),
                         tiles: wp.array2d(dtype=t.vec4)):
        p = g.order[wp.tid()]
        by_tile.scatter_row(g.block[p], points.i[p], points.j[p], points.k[p], points.o[p],
                            read_momentum(points, materials, p, g.dx, clock[0]), tiles)

    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{t.name}", module=module, enable_backward=False)
            for k in (sort_momentum, scatter_momentum, scatter_to_tiles)}
    return SimpleNamespace(**made)


@cache
def cell_kernel(real, module):
    """Kernel over 32 threads a cell, of which 27 work: what a cell's particles give to each of its nodes, momentum [kg m/s] and
    mass [kg]. They read the same particle at a time; node (x, y, z) of the cell has the row 9 x + 3 y + z."""
    t, T = types(real), point_tables(real)

    def sum_cells(g: T.BlockGrid, rows: T.SortedRows, sum_out: wp.array2d(dtype=t.vec4)):
        cell = wp.tid() // 32
        n = wp.tid() % 32
        if cell // CELLS >= wp.min(g.used[0], g.key.shape[0]) or n >= 27:
            return
        count = g.count[cell]
        if count == 0:
            return
        x = real(n // 9 - 1)
        y = real((n // 3) % 3 - 1)
        z = real(n % 3 - 1)
        first = g.first[cell]
        sum = t.vec4()
        for at in range(first, first + count):
            m = rows.m[at]
            r = t.vec4(real(1.0), x - m[0], y - m[1], z - m[2])
            w = spline_weight(r[1]) * spline_weight(r[2]) * spline_weight(r[3])
            sum += w * t.vec4(wp.dot(rows.x[at], r), wp.dot(rows.y[at], r), wp.dot(rows.z[at], r), m[3])
        sum_out[n, cell] = sum

    return wp.kernel(sum_cells, name=f"mpm_sum_cells_{t.name}", module=module, enable_backward=False)


@cache
def node_function(real):
    """Function (grid, sums of cells, block, cell) -> momentum [kg m/s] and mass [kg] of a node."""
    t, T = types(real), point_tables(real)

    @wp.func
    def gather_node(g: T.BlockGrid, sums: wp.array2d(dtype=t.vec4), b: int, c: int):
        sum = t.vec4()
        cells = int(27)
        for n in range(cells):
            i = c // 16 + n // 9 - 1
            j = (c // 4) % 4 + (n // 3) % 3 - 1
            k = c % 4 + n % 3 - 1
            other = g.near[27 * b + (9 * ((i >> 2) + 1) + 3 * ((j >> 2) + 1) + (k >> 2) + 1)]
            if other >= 0:
                cell = other * CELLS + (16 * (i & 3) + 4 * (j & 3) + (k & 3))
                if g.count[cell] > 0:
                    sum += sums[26 - n, cell]
        return sum

    return gather_node


@cache
def gather_kernel(real, module):
    """Kernel over nodes of all blocks: momentum and mass, of sums of cells."""
    t, T, gather = types(real), point_tables(real), node_function(real)

    def gather_nodes(g: T.BlockGrid, sums: wp.array2d(dtype=t.vec4), node_out: wp.array(dtype=t.vec4)):
        n = wp.tid()
        b = n // CELLS
        if b < wp.min(g.used[0], g.key.shape[0]):
            node_out[n] = gather(g, sums, b, n % CELLS)

    return wp.kernel(gather_nodes, name=f"mpm_gather_nodes_{t.name}", module=module, enable_backward=False)


@cache
def node_kernel(kinds: tuple[str, ...], cpu: bool, real, module, tiles: bool = False):
    """Kernel over nodes of all blocks: velocities at the end of the step, and 1 where a collider is near. clock as above. cpu:
    nodes hold what particles have added. tiles: `sums` are tiles (cpu/tiles.py)."""
    t, T, Colliders = types(real), point_tables(real), collider_type(real)
    gather, wall = tile_transfers(real).sum_tiles if tiles else node_function(real), wall_functions(kinds, real)
    walls = bool(kinds)

    def move_nodes(g: T.BlockGrid, sums: wp.array2d(dtype=t.vec4), materials: T.MaterialRows, c: Colliders,
                   clock: wp.array(dtype=real), node_out: wp.array(dtype=t.vec4)):
        n = wp.tid()
        b = n // CELLS
        if b >= wp.min(g.used[0], g.key.shape[0]):
            return
        sum = t.vec4()
        if wp.static(cpu):                                     # noqa: SIM108 - one of them is compiled
            sum = node_out[n]
        else:
            sum = gather(g, sums, b, n % CELLS)
        v = t.vec3()
        near = real(0.0)
        if sum[3] > real(0.0):
            world = int(g.key[b] >> wp.int64(3 * g.bits))
            v = t.vec3(sum[0], sum[1], sum[2]) / sum[3] + clock[0] * materials.gravity[world]
            if wp.static(walls):
                v, near = wall.hold_node(c, g, b, n % CELLS, v, clock[0] + clock[1])
        node_out[n] = t.vec4(v[0], v[1], v[2], near)

    return wp.kernel(move_nodes, name=f"mpm_move_nodes_{'_'.join(kinds)}_{'cpu_' * cpu}{'tiles_' * tiles}{t.name}",
                     module=module, enable_backward=False)


@cache
def gather_function(cpu: bool, real):
    """Function (grid, block, i, j, k, o, nodes) -> velocity [m/s] and 0 where no collider is near, and gradients a cell."""
    t, T, vectors = types(real), point_tables(real), vector_transfers(real)

    @wp.func
    def gather_velocity(g: T.BlockGrid, b: int, i: int, j: int, k: int, o: t.vec3, nodes: wp.array(dtype=t.vec4)):
        rows = spline_rows(o)
        v = t.vec4()
        x = t.vec4()
        y = t.vec4()
        z = t.vec4()
        sides = int(3)
        for e in range(sides):
            ci = (i & 3) + e - 1
            for f in range(sides):
                cj = (j & 3) + f - 1
                near = 27 * b + 9 * ((ci >> 2) + 1) + 3 * ((cj >> 2) + 1) + 1
                s = t.vec4()
                w = t.vec4()
                for n in range(3):
                    ck = (k & 3) + n - 1
                    other = g.near[near + (ck >> 2)]
                    if other >= 0:
                        u = rows[n, 2] * nodes[other * CELLS + (16 * (ci & 3) + 4 * (cj & 3) + (ck & 3))]
                        s += u
                        w += (real(n - 1) - o[2]) * u
                part = rows[e, 0] * rows[f, 1]
                s = part * s
                v += s
                x += (real(e - 1) - o[0]) * s
                y += (real(f - 1) - o[1]) * s
                z += part * w
        return wp.matrix_from_cols(v, x, y, z)

    return vectors.gather_row if cpu else gather_velocity


@cache
def particle_kernel(kinds: tuple[str, ...], laws: tuple[str, ...], cpu: bool, real, module, tiles: bool = False):
    """Kernel over rows of the order: velocity, its gradient, strain, stress and place of a particle after the step. word, pace:
    see steps.py. tiles: nodes are tiles (cpu/tiles.py), of threads that share the pace."""
    t, T, Colliders = types(real), point_tables(real), collider_type(real)
    f, wall, walls, gather = motion_functions(laws, real), wall_functions(kinds, real), bool(kinds), gather_function(cpu, real)
    nodes_type, raise_pace = wp.array(dtype=t.vec4), real_raise(real)
    if tiles:
        nodes_type, gather = wp.array2d(dtype=t.vec4), tile_transfers(real).gather_row

    def move_particles(g: T.BlockGrid, nodes: nodes_type, materials: T.MaterialRows, c: Colliders,
                       clock: wp.array(dtype=real), points: T.PointRows, word: wp.array(dtype=int),
                       pace: wp.array(dtype=real)):
        n = wp.tid()
        if n >= g.used[1]:
            return
        p = g.order[n]
        i = points.i[p]
        j = points.j[p]
        k = points.k[p]
        o = points.o[p]
        u = gather(g, g.block[p], i, j, k, o, nodes)
        v = t.vec3(u[0, 0], u[1, 0], u[2, 0])
        s = real(4.0) / g.dx
        C = s * t.mat33(u[0, 1], u[0, 2], u[0, 3], u[1, 1], u[1, 2], u[1, 3], u[2, 1], u[2, 2], u[2, 3])
        h = clock[0]
        way = (h / g.dx) * v                                   # [cells]
        if wp.static(walls):
            if u[3, 0] > real(0.0):
                way, v = wall.stop_particle(c, t.vec3(real(i), real(j), real(k)) + o, way, v, clock[1], h, g.dx)
        points.v[p] = v
        need = f.deform_particle(points, materials, p, h, C, v, g.dx)
        f.shift_particle(points, p, i, j, k, o, way)
        if need > pace[1]:
            if wp.static(tiles):
                raise_pace(pace, 1, need)
            else:
                wp.atomic_max(pace, 1, need)
        limit = (1 << (g.bits + 1)) - 8                        # cells that a key has room for, to either side
        if wp.abs(i) > limit or wp.abs(j) > limit or wp.abs(k) > limit:
            word[2] = p + 1

    form = "cpu_" * cpu + "tiles_" * tiles
    return wp.kernel(move_particles, name=f"mpm_move_particles_{'_'.join((*kinds, *laws))}_{form}{t.name}", module=module,
                     enable_backward=False)
