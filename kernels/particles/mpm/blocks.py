"""A sparse grid: blocks of 4 x 4 x 4 cells about particles, found by a hash table, and the particles of each cell.

    mark      each block that a particle's 27 nodes lie in gets a number
    count     how many particles are in each cell, and which of them each is
    start     where each cell's particles begin in the order
    place     order[first + rank] = particle;  settle: in ascending order, so that sums have one order

A cell is the cube about a node. Numbers of blocks and places in the order differ from run to run on a GPU. Sums do not see
that: a node adds the particles of 27 cells in one order. Integers alone are added atomically.
"""

# ruff: noqa: UP018
# int(0) makes a variable of what would be a constant.

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.cpu.atomics import SHARED
from wsim.kernels.particles.mpm.tables import CELLS, LAYER, SIDE, point_tables

EMPTY = wp.constant(wp.int64(0))    # the key of a corner that no particle reaches
PROBES = wp.constant(512)          # slots that are looked at for a key: half of the slots are empty where there is room
CROWD = wp.constant(4096)          # particles of a cell, at most


@cache
def block_functions(real, team: bool = False) -> SimpleNamespace:
    """make_key(grid, world, i, j, k) of a cell's block; shift_key(grid, key, number of a neighbour); insert_block(grid, key);
    find_block(grid, key) -> number or -1; local_cell(i, j, k) within its block. team: threads of a CPU insert side by side."""
    G, shared = point_tables(real).BlockGrid, SHARED

    @wp.func
    def claim_slot(g: G, s: int, key: wp.int64):
        """The key that a slot had."""
        if wp.static(team):
            return shared.swap(g.slot, s, EMPTY, key)
        else:                                                  # noqa: RET505 - one of them is compiled
            return wp.atomic_cas(g.slot, s, EMPTY, key)

    @wp.func
    def next_number(g: G):
        if wp.static(team):
            return shared.add(g.used, 0, 1)
        else:                                                  # noqa: RET505
            return wp.atomic_add(g.used, 0, 1)

    @wp.func
    def make_key(g: G, world: int, i: int, j: int, k: int):
        half = wp.int64(1) << wp.int64(g.bits - 1)
        n = wp.int64(g.bits)
        x = wp.int64(i >> 2) + half
        y = wp.int64(j >> 2) + half
        z = wp.int64(k >> 2) + half
        return (((((wp.int64(world) << n) + x) << n) + y) << n) + z

    @wp.func
    def shift_key(g: G, key: wp.int64, near: int):
        n = wp.int64(g.bits)
        x = wp.int64(near // 9 - 1)
        y = wp.int64((near // 3) % 3 - 1)
        z = wp.int64(near % 3 - 1)
        one = wp.int64(1)
        return key + x * (one << (n + n)) + y * (one << n) + z

    @wp.func
    def hash_key(g: G, key: wp.int64):
        mixed = wp.uint64(key) * wp.uint64(6364136223846793005)
        return int(mixed >> wp.uint64(33)) & (g.slot.shape[0] - 1)

    @wp.func
    def find_block(g: G, key: wp.int64):
        s = hash_key(g, key)
        probes = int(PROBES)
        for _ in range(probes):
            found = g.slot[s]
            if found == key:
                return g.number[s]
            if found == EMPTY:
                return -1
            s = (s + 1) & (g.slot.shape[0] - 1)
        return -1

    @wp.func
    def insert_block(g: G, key: wp.int64):
        s = hash_key(g, key)
        probes = int(PROBES)
        for _ in range(probes):
            found = g.slot[s]
            if found == EMPTY:
                found = claim_slot(g, s, key)
                if found == EMPTY:
                    n = next_number(g)
                    g.number[s] = -1
                    if n < g.key.shape[0]:
                        g.number[s] = n
                        g.key[n] = key
                    return
            if found == key:
                return
            s = (s + 1) & (g.slot.shape[0] - 1)
        next_number(g)                                         # too full: counted, so that more room is made

    @wp.func
    def local_cell(i: int, j: int, k: int):
        return ((i & 3) * SIDE + (j & 3)) * SIDE + (k & 3)

    return SimpleNamespace(make_key=make_key, shift_key=shift_key, find_block=find_block, insert_block=insert_block,
                           local_cell=local_cell)


@cache
def block_kernels(real, module, flow: bool = False, team: bool = False) -> SimpleNamespace:
    """Kernels: mark, count, place over particles; near over 27 of each block, start over its four layers; settle over cells.
    flow: particles come and go (actions/flow.py). team: threads of a CPU share them; a block's particles are then in a row."""
    T, f, name, shared = point_tables(real), block_functions(real, team), types(real).name, SHARED
    layer = int(CELLS if team else LAYER)

    def mark_blocks(points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid):
        p = wp.tid()
        i = points.i[p]
        j = points.j[p]
        k = points.k[p]
        row = points.row[p]
        before = p > 0
        if wp.static(flow):
            if points.there[p] != 1:
                return
            if before:
                before = points.there[p - 1] == 1
        if before:                                             # what shares the cell of the one before is marked by that
            if points.i[p - 1] == i and points.j[p - 1] == j and points.k[p - 1] == k and points.row[p - 1] == row:
                return
        world = materials.world[row]
        for x in range((i - 1) >> 2, ((i + 1) >> 2) + 1):
            for y in range((j - 1) >> 2, ((j + 1) >> 2) + 1):
                for z in range((k - 1) >> 2, ((k + 1) >> 2) + 1):
                    f.insert_block(g, f.make_key(g, world, x << 2, y << 2, z << 2))

    def count_points(points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid):
        p = wp.tid()
        if wp.static(flow):
            if points.there[p] != 1:
                g.block[p] = -1
                return
        i = points.i[p]
        j = points.j[p]
        k = points.k[p]
        b = f.find_block(g, f.make_key(g, materials.world[points.row[p]], i, j, k))
        g.block[p] = b
        if b >= 0:
            if wp.static(team):
                g.rank[p] = shared.add(g.count, b * CELLS + f.local_cell(i, j, k), 1)
            else:
                g.rank[p] = wp.atomic_add(g.count, b * CELLS + f.local_cell(i, j, k), 1)

    def near_blocks(g: T.BlockGrid):
        n = wp.tid()
        b = n // 27
        if b < wp.min(g.used[0], g.key.shape[0]):
            g.near[n] = f.find_block(g, f.shift_key(g, g.key[b], n % 27))

    def start_cells(g: T.BlockGrid, word: wp.array(dtype=int)):
        n = wp.tid()
        cells = int(layer)
        begin = n * cells
        if begin // CELLS >= wp.min(g.used[0], g.key.shape[0]):
            return
        sum = int(0)
        most = int(0)
        for c in range(begin, begin + cells):
            m = g.count[c]
            sum += m
            most = wp.max(most, m)
        at = int(0)
        if wp.static(team):                                    # noqa: SIM108 - one of them is compiled
            at = shared.add(g.used, 1, sum)
        else:
            at = wp.atomic_add(g.used, 1, sum)
        for c in range(begin, begin + cells):
            g.first[c] = at
            at += g.count[c]
        if most > word[1]:
            if wp.static(team):
                shared.raise_int(word, 1, most)
            else:
                wp.atomic_max(word, 1, most)
        if n == 0 and g.used[0] > word[0]:
            word[0] = g.used[0]

    def place_points(points: T.PointRows, g: T.BlockGrid):
        p = wp.tid()
        b = g.block[p]
        if b >= 0:
            g.order[g.first[b * CELLS + f.local_cell(points.i[p], points.j[p], points.k[p])] + g.rank[p]] = p

    def settle_cells(g: T.BlockGrid):
        c = wp.tid()
        if c // CELLS >= wp.min(g.used[0], g.key.shape[0]):
            return
        begin = g.first[c]
        n = g.count[c]
        if n > CROWD:                                          # such a frame is refused
            return
        for k in range(begin + 1, begin + n):
            p = g.order[k]
            m = int(k)
            while m > begin and g.order[m - 1] > p:
                g.order[m] = g.order[m - 1]
                m -= 1
            g.order[m] = p

    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{'flow_' * flow}{'team_' * team}{name}", module=module,
                                    enable_backward=False)
            for k in (mark_blocks, count_points, near_blocks, start_cells, place_points, settle_cells)}
    return SimpleNamespace(**made)
