"""Which particles are near each other: sorted cells, and lists that last while nothing has moved far (Verlet 1967).

    p  number of a particle, 0 .. count - 1                k  its place in the order of cells
    y = x + d  where it will be as a substep ends [m]      y0  the same when the lists were made
    R  distance up to which a pair is wanted [m]           s  skin [m]

A list holds all pairs with |y0_i - y0_j| < R_i + R_j + s. It is complete while |y - y0| <= s / 2 for every particle, since

    |y0_i - y0_j| <= |y_i - y_j| + |y_i - y0_i| + |y_j - y0_j| <= R_i + R_j + s

holds then for each pair that is nearer than R_i + R_j. `travel` tests this in every substep; a particle that went farther
raises a flag, and only then do the kernels that make cells and lists do anything.

Cells have the edge R_max + R_max + s, so that a pair is in neighbouring ones. They are numbered row by row in a box of powers
of two, beyond which numbers repeat: space has no bounds, and what shares a number by chance is dropped by its distance. An
axis has at least 4 cells, so that the 27 about a particle differ. Each world has cells of its own. Integers alone are added
atomically, and the particles of a cell are sorted by number: the order is the same in every run. A particle that is not there
stands in a last cell, which nobody looks into, with an empty list and y0 = NOWHERE.
"""

# ruff: noqa: UP018
# int(0) makes a variable of what would be a constant.

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.marks import kernel_over_cores
from wsim.kernels.math.real import types

NOWHERE = 1e30         # [m] y0 of a particle before the first list, and of one that is not there


@cache
def neighbour_structs(real) -> SimpleNamespace:
    """Structs: ParticleTable (constants by particle), CellTable (who is in which cell), PairLists (who is near whom)."""
    t = types(real)

    @wp.struct
    class ParticleTable:
        point: wp.array(dtype=int)         # place among the points of the state, (count,)
        reach: wp.array(dtype=t.scalar)    # R [m], (count,)
        group: wp.array(dtype=int)         # pairs of one group >= 0 are none, (count,)
        world: wp.array(dtype=int)         # (count,)
        shift: wp.array(dtype=t.vec3)      # origin of its object from that of the first [m], whole metres, (count,)
        there: wp.array(dtype=int)         # of points of the state: not 1 of one that is not there; empty: all are

    @wp.struct
    class CellTable:
        edge: t.scalar                     # [m]
        n: wp.vec3i                        # cells of the box along each axis, powers of two
        size: int                          # cells of a world
        skin: t.scalar                     # s [m]
        flag: wp.array(dtype=int)          # 1: lists are made anew, (1,)
        count: wp.array(dtype=int)         # particles of a cell, (cells + 1,): the last of what is not there
        rank: wp.array(dtype=int)          # which of its cell a particle is, in any order, (count,)
        first: wp.array(dtype=int)         # place of the first particle of a cell, (cells + 2,)
        order: wp.array(dtype=int)         # p at place k, (count,)
        place: wp.array(dtype=int)         # k of particle p, (count,)
        y0: wp.array(dtype=t.vec3)         # by p [m]
        near: wp.array(dtype=t.vec3)       # y0 by k [m]
        reach: wp.array(dtype=t.scalar)    # R by k [m]

    @wp.struct
    class PairLists:
        room: int                          # entries that a list has room for
        size: int                          # particles: entry s of place k stands at s * size + k
        count: wp.array(dtype=int)         # entries of a list, by k
        other: wp.array(dtype=int)         # k of the neighbour
        wanted: wp.array(dtype=int)        # entries of the longest list that had no room, (1,)

    return SimpleNamespace(ParticleTable=ParticleTable, CellTable=CellTable, PairLists=PairLists)


@cache
def absence_func(real):
    """Function (rows, i) -> whether point i of the state is not there."""
    S = neighbour_structs(real)

    @wp.func
    def particle_is_absent(rows: S.ParticleTable, i: int):
        if rows.there.shape[0] > 0:
            return rows.there[i] != 1
        return False

    return particle_is_absent


@cache
def cell_number_func(real):
    """Function (c, cell along each axis, world) -> number of a cell."""
    S = neighbour_structs(real)

    @wp.func
    def number_of_cell(c: S.CellTable, i: int, j: int, k: int, world: int):
        x = i & (c.n[0] - 1)
        y = j & (c.n[1] - 1)
        z = k & (c.n[2] - 1)
        return world * c.size + x + c.n[0] * (y + c.n[1] * z)

    return number_of_cell


@cache
def travel_kernel(real, module):
    """Kernel over particles: the flag, where one is farther than s / 2 from where lists have it. A place that is no number
    raises it too, and one that comes or goes."""
    t, S, absent = types(real), neighbour_structs(real), absence_func(real)

    def test_travel(rows: S.ParticleTable, c: S.CellTable, x: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3)):
        p = wp.tid()
        i = rows.point[p]
        if absent(rows, i) and c.y0[p][0] == real(NOWHERE):
            return
        y = x[i] + rows.shift[p] + d[i]
        if absent(rows, i):
            y = t.vec3(-real(NOWHERE))
        way = wp.length(y - c.y0[p])
        if not way <= real(0.5) * c.skin:
            c.flag[0] = 1

    return kernel_over_cores(test_travel, f"neighbour_travel_{t.name}", module)


@cache
def clear_kernel(real, module):
    """Kernel over cells: none has a particle."""
    S = neighbour_structs(real)

    def clear_cells(c: S.CellTable):
        if c.flag[0] == 1:
            c.count[wp.tid()] = 0

    return kernel_over_cores(clear_cells, f"neighbour_clear_{types(real).name}", module)


@cache
def count_kernel(real, module):
    """Kernel over particles: y0, and how many are in each cell."""
    t, S, number, absent = types(real), neighbour_structs(real), cell_number_func(real), absence_func(real)

    def count_particles(rows: S.ParticleTable, c: S.CellTable, x: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3)):
        if c.flag[0] == 0:
            return
        p = wp.tid()
        i = rows.point[p]
        y = x[i] + rows.shift[p] + d[i]
        cell = c.count.shape[0] - 1
        if absent(rows, i):
            y = t.vec3(real(NOWHERE))
        else:
            q = y / c.edge
            cell = number(c, int(wp.floor(q[0])), int(wp.floor(q[1])), int(wp.floor(q[2])), rows.world[p])
        c.y0[p] = y
        c.place[p] = cell                                # until `place_particles` puts it right
        c.rank[p] = wp.atomic_add(c.count, cell, 1)

    return wp.kernel(count_particles, name=f"neighbour_count_{t.name}", module=module, enable_backward=False)


@cache
def order_kernel(real, module):
    """Kernel over particles: the order of cells, behind the sums `first`."""
    S = neighbour_structs(real)

    def order_particles(c: S.CellTable):
        if c.flag[0] == 1:
            p = wp.tid()
            c.order[c.first[c.place[p]] + c.rank[p]] = p

    return kernel_over_cores(order_particles, f"neighbour_order_{types(real).name}", module)


@cache
def settle_kernel(real, module):
    """Kernel over cells: the particles of each in ascending order, which atomics have mixed on a GPU."""
    S = neighbour_structs(real)

    def sort_cell(c: S.CellTable):
        if c.flag[0] == 0:
            return
        cell = wp.tid()
        if cell == c.count.shape[0] - 1:
            return
        begin = c.first[cell]
        for k in range(begin + 1, begin + c.count[cell]):
            p = c.order[k]
            m = int(k)
            while m > begin and c.order[m - 1] > p:
                c.order[m] = c.order[m - 1]
                m -= 1
            c.order[m] = p

    return wp.kernel(sort_cell, name=f"neighbour_settle_{types(real).name}", module=module, enable_backward=False)


@cache
def place_kernel(real, module):
    """Kernel over places: the place of each particle, y0 and R in the order of places."""
    S = neighbour_structs(real)

    def place_particles(rows: S.ParticleTable, c: S.CellTable):
        if c.flag[0] == 1:
            k = wp.tid()
            p = c.order[k]
            c.place[p] = k
            c.near[k] = c.y0[p]
            c.reach[k] = rows.reach[p]

    return kernel_over_cores(place_particles, f"neighbour_place_{types(real).name}", module)


@cache
def list_kernel(real, module):
    """Kernel over places: the list of each particle, in the order of cells. Where one is too long, `wanted` says how long.
    A CPU has another (packets/lists.py)."""
    t, S, number = types(real), neighbour_structs(real), cell_number_func(real)

    def list_neighbours(rows: S.ParticleTable, c: S.CellTable, lists: S.PairLists):
        if c.flag[0] == 0:
            return
        k = wp.tid()
        p = c.order[k]
        y = c.near[k]
        if y[0] == real(NOWHERE):
            lists.count[k] = 0
            return
        q = y / c.edge
        x0 = int(wp.floor(q[0]))
        y0 = int(wp.floor(q[1]))
        z0 = int(wp.floor(q[2]))
        far = c.reach[k] + c.skin
        farthest = c.edge * c.edge                       # of the largest ones
        group = rows.group[p]
        m = int(0)
        rows_of_cells = int(9)                           # a variable: Warp unrolls a literal, to 57 KB of code for a GPU
        for a in range(rows_of_cells):
            low = number(c, x0 - 1, y0 + a % 3 - 1, z0 + a // 3 - 1, rows.world[p])
            high = number(c, x0 + 1, y0 + a % 3 - 1, z0 + a // 3 - 1, rows.world[p])
            runs = wp.where(high == low + 2, 1, 3)       # cells in a row stand one behind the other, but at the box's ends
            for b in range(runs):
                if runs == 3:
                    low = number(c, x0 + b - 1, y0 + a % 3 - 1, z0 + a // 3 - 1, rows.world[p])
                    high = int(low)
                for other in range(c.first[low], c.first[high + 1]):
                    apart = wp.length_sq(c.near[other] - y)
                    if other != k and apart < farthest:
                        way = far + c.reach[other]
                        if apart < way * way and (group < 0 or rows.group[c.order[other]] != group):
                            if m < lists.room:
                                lists.other[m * lists.size + k] = other
                            m += 1
        lists.count[k] = wp.min(m, lists.room)
        if m > lists.room:
            wp.atomic_max(lists.wanted, 0, m)

    return wp.kernel(list_neighbours, name=f"neighbour_list_{t.name}", module=module, enable_backward=False)
