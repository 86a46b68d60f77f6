"""Transfers of implicit steps of sand: particles to cells and their corners, and back (APIC with trilinear weights).

    m_a = sum_p w m,  (m v)_a = sum_p w m (v + C (x_a - x_p))       by cell, then gathered by corner from 8 cells
    v = sum_a w v_a,  C = sum_a v_a grad w^T                        Jiang et al. 2015, section 5.3, for trilinear weights

A cell has the mean of its particles' stress, as a first guess of that at the end of the step, and of their opening. Each sum
has one order, so that bits repeat.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.implicit.contacts import contact_functions
from wsim.kernels.particles.mpm.implicit.granular_tables import granular_tables
from wsim.kernels.particles.mpm.motion import motion_functions
from wsim.kernels.particles.mpm.tables import CELLS, point_tables
from wsim.kernels.particles.mpm.walls import wall_functions

OPENED = wp.constant(1.0)          # largest opening: beyond it what has flown apart does not count
WAY = wp.constant(2.0)             # cells that a grain may cross in a step
CLOSED = wp.constant(0.01)         # largest loss of volume that a step makes good


@cache
def sand_kernels(kinds: tuple[str, ...], real, module) -> SimpleNamespace:
    """Kernels: sum_corners over 8 threads a cell; average_cells over cells; move_corners over corners; move_grains over rows of
    the order. clock: h, time in the frame [s]."""
    t, T, sand, Colliders = types(real), point_tables(real), granular_tables(real), collider_type(real)
    contact, wall, walls = contact_functions(kinds, real), wall_functions(kinds, real), bool(kinds)
    f, vec8i = motion_functions(("sand",), real), wp.types.vector(8, int)

    @wp.func
    def corner_weight(o: t.vec3, n: int):
        """Trilinear weight of corner n at the offset o [cells] from the middle, and the way from there to it [cells]."""
        half = real(0.5)
        s = t.vec3(real(n // 4) - half, real((n // 2) % 2) - half, real(n % 2) - half)
        w = (half + real(2.0) * s[0] * o[0]) * (half + real(2.0) * s[1] * o[1]) * (half + real(2.0) * s[2] * o[2])
        return w, s - o

    @wp.func
    def gather_grain(corners: sand.SandCorners, rows: vec8i, o: t.vec3, dx: real):
        """Velocity, its gradient, that of the cell's middle summed (tr D), and the most colliders near a corner."""
        v = t.vec3()
        C = t.mat33()
        near = int(-1)
        open = real(0.0)
        half = real(0.5)
        for n in range(8):
            at = corners.v[rows[n]]
            u = t.vec3(at[0], at[1], at[2])
            s = t.vec3(real(2 * (n // 4) - 1), real(2 * ((n // 2) % 2) - 1), real(2 * (n % 2) - 1))
            a = t.vec3(half + s[0] * o[0], half + s[1] * o[1], half + s[2] * o[2])
            v += (a[0] * a[1] * a[2]) * u
            C += wp.outer(u, t.vec3(s[0] * a[1] * a[2], s[1] * a[0] * a[2], s[2] * a[0] * a[1]))
            near = wp.max(near, corners.count[rows[n]])
            open += real(0.25) * wp.dot(u, s)
        return v, C / dx, open / dx, near

    @wp.func
    def matter_side(g: T.BlockGrid, b: int, at: int):
        """Mean way from a corner to the particles of its eight cells [cells]."""
        sum = t.vec3()
        count = int(0)
        cells_about = int(8)
        for n in range(cells_about):
            s = wp.vec3i(n // 4, (n // 2) % 2, n % 2)
            i = at // 16 - s[0]
            j = (at // 4) % 4 - s[1]
            k = at % 4 - s[2]
            other = g.near[27 * b + (9 * ((i >> 2) + 1) + 3 * ((j >> 2) + 1) + (k >> 2) + 1)]
            if other >= 0:
                m = g.count[other * CELLS + (16 * (i & 3) + 4 * (j & 3) + (k & 3))]
                count += m
                sum += real(m) * (t.vec3(real(0.5)) - t.vec3(real(s[0]), real(s[1]), real(s[2])))
        return sum / real(wp.max(count, 1))

    def sum_corners(points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid, cells: sand.SandCells):
        cell = wp.tid() // 8
        n = wp.tid() % 8
        if cell // CELLS >= wp.min(g.used[0], g.key.shape[0]):
            return
        count = g.count[cell]
        if count == 0:
            return
        first = g.first[cell]
        sum = t.vec4()
        for at in range(first, first + count):
            p = g.order[at]
            m = materials.density[points.row[p]] * points.volume[p]
            w, r = corner_weight(points.o[p], n)
            v = points.v[p] + g.dx * (points.C[p] * r)
            sum += (w * m) * t.vec4(v[0], v[1], v[2], real(1.0))
        cells.sum[n, cell] = sum

    def average_cells(points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid, cells: sand.SandCells):
        cell = wp.tid()
        if cell // CELLS >= wp.min(g.used[0], g.key.shape[0]):
            return
        count = g.count[cell]
        if count == 0:
            return
        first = g.first[cell]
        rule = t.vec4()
        S = t.vec3()
        R = t.vec3()
        for at in range(first, first + count):
            p = g.order[at]
            m = materials.numbers[points.row[p]]
            V = points.volume[p]
            S -= V * points.T[p]
            R -= V * points.S[p]
            rule += V * t.vec4(real(1.0), points.q[p], m[2], m[3])
        V = rule[0]
        cells.S[cell] = S / V
        cells.R[cell] = R / V
        for n in range(3):
            cells.G[n, cell] = t.vec4()
        cells.rule[cell] = t.vec4(V, wp.max(rule[1] / V, -real(CLOSED)), rule[2] / V, rule[3] / V)

    def move_corners(g: T.BlockGrid, cells: sand.SandCells, materials: T.MaterialRows, c: Colliders,
                     clock: wp.array(dtype=real), corners: sand.SandCorners, contacts: sand.CornerContacts):
        """Velocities with gravity and with the stress that is guessed."""
        row = wp.tid()
        b = row // CELLS
        if b >= wp.min(g.used[0], g.key.shape[0]):
            return
        at = row % CELLS
        sum = t.vec4()
        push = t.vec3()
        cells_about = int(8)
        for n in range(cells_about):
            i = at // 16 - n // 4
            j = (at // 4) % 4 - (n // 2) % 2
            k = at % 4 - n % 2
            other = g.near[27 * b + (9 * ((i >> 2) + 1) + 3 * ((j >> 2) + 1) + (k >> 2) + 1)]
            if other >= 0:
                cell = other * CELLS + (16 * (i & 3) + 4 * (j & 3) + (k & 3))
                if g.count[cell] > 0:
                    sum += cells.sum[n, cell]
                    V = cells.rule[cell][0]
                    x = real(2 * (n // 4) - 1) * V
                    y = real(2 * ((n // 2) % 2) - 1) * V
                    z = real(2 * (n % 2) - 1) * V
                    S = cells.S[cell]
                    R = cells.R[cell]
                    push += t.vec3(S[0] * x + R[2] * y + R[1] * z, R[2] * x + S[1] * y + R[0] * z,
                                   R[1] * x + R[0] * y + S[2] * z)
        v = t.vec4()
        count = int(-1)
        if sum[3] > real(0.0):
            w = real(1.0) / sum[3]
            world = int(g.key[b] >> wp.int64(3 * g.bits))
            u = w * t.vec3(sum[0], sum[1], sum[2]) + clock[0] * (materials.gravity[world] + (w / (real(4.0) * g.dx)) * push)
            v = t.vec4(u[0], u[1], u[2], w)
            if wp.static(walls):
                place = wall.node_place(g, b, at) - t.vec3(real(0.5) * g.dx)
                count = contact.find_contacts(c, place, matter_side(g, b, at), clock[0] + clock[1], g.dx, row, contacts)
        corners.count[row] = count
        corners.free[row] = t.vec3(v[3])
        if count > 0:
            v[3] = -v[3]
        corners.v[row] = v
        corners.held[row] = t.vec3()

    def move_grains(g: T.BlockGrid, cells: sand.SandCells, corners: sand.SandCorners, c: Colliders, clock: wp.array(dtype=real),
                    points: T.PointRows, word: wp.array(dtype=int), pace: wp.array(dtype=real)):
        row = wp.tid()
        if row >= g.used[1]:
            return
        p = g.order[row]
        i = points.i[p]
        j = points.j[p]
        k = points.k[p]
        o = points.o[p]
        b = g.block[p]
        local = 16 * (i & 3) + 4 * (j & 3) + (k & 3)
        rows = sand.corner_rows(g, b, local)
        v, C, open, near = gather_grain(corners, rows, o, g.dx)
        h = clock[0]
        way = (h / g.dx) * v
        cell = b * CELLS + local
        S = cells.S[cell]
        R = cells.R[cell]
        open *= h                                              # h tr D of the cell
        q = points.q[p] + open
        if S[0] + S[1] + S[2] > real(0.0):
            q = cells.rule[cell][1] + open
        if wp.static(walls):
            if near >= 0:
                way, v = wall.stop_particle(c, t.vec3(real(i), real(j), real(k)) + o, way, v, clock[1], h, g.dx)
        points.v[p] = v
        points.C[p] = C
        points.q[p] = wp.min(q, real(OPENED))
        points.T[p] = -S
        points.S[p] = -R
        f.shift_particle(points, p, i, j, k, o, way)
        need = wp.length(v) / (real(WAY) * g.dx)
        if need > pace[1]:
            wp.atomic_max(pace, 1, need)
        limit = (1 << (g.bits + 1)) - 8                        # cells that a key has room for, to either side
        if wp.abs(i) > limit or wp.abs(j) > limit or wp.abs(k) > limit:
            word[2] = p + 1

    def measure_speed(points: T.PointRows, materials: T.MaterialRows, dx: real, dt: real, threads: int,
                      pace: wp.array(dtype=real)):
        """Steps [1/s] that the fastest grain needs, over `threads` that take grains a stride apart."""
        most = real(0.0)
        for p in range(wp.tid(), points.row.shape[0], threads):
            most = wp.max(most, wp.length(points.v[p]) + dt * wp.length(materials.gravity[materials.world[points.row[p]]]))
        wp.atomic_max(pace, 0, most / (real(WAY) * dx))

    end = f"{'_'.join(kinds)}_{t.name}"
    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{end}", module=module, enable_backward=False)
            for k in (sum_corners, average_cells, move_corners, move_grains, measure_speed)}
    return SimpleNamespace(**made)
