"""Preconditioner of conjugate gradients of an implicit elastic step: the inverse of a node's own block of the matrix.

    B_i = (m_i + drag_i) 1 + sum_p V h^2 (16 / dx^2) w_i^2 ((lambda + mu) d d^T + mu |d|^2 1),  d = (x_i - x_p) / dx

That is df_i/dv_i of small strains, see elastic_points.py: a particle's force on a node grows with w_i^2, and a node's mass with
w_i. Nodes at the rim of a body, of little mass, have much smaller blocks over their masses than those within. mu and lambda are
those of the material, in the ratio of rest, so that lambda + 2 mu is the stiffness of the particle's fastest wave.

The total of m y is that of r less what conjugate gradients leave of it. A world in which no collider holds a node gets
the shift sum r / sum m on top, so that its momentum stays to rounding.
"""

# ruff: noqa: UP018
# int(3) makes a variable of what would be a constant.

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.implicit.elastic_nodes import SLIDES, node_rows, solve_functions
from wsim.kernels.particles.mpm.spline import spline_weight
from wsim.kernels.particles.mpm.tables import CELLS, LAYER, point_tables
from wsim.kernels.solver.pcg import block_sum


@cache
def precondition_kernel(real, module):
    """Kernel over nodes: `inverse`, the inverse of a node's block [1/kg], and z = inverse r."""
    t, T, N, f = types(real), point_tables(real), node_rows(real), solve_functions(real)

    @wp.func
    def add_particle(points: T.PointRows, materials: T.MaterialRows, p: int, d: t.vec3, scale: real, h: real):
        w = spline_weight(d[0]) * spline_weight(d[1]) * spline_weight(d[2])
        m = materials.numbers[points.row[p]]
        part = points.a[p] / (m[1] + real(2.0) * m[0])
        mu = part * m[0] + m[7] / h
        k = scale * points.volume[p] * w * w
        one = wp.identity(n=3, dtype=real)
        return (k * (part * m[1] + mu)) * wp.outer(d, d) + (k * mu * wp.dot(d, d)) * one

    def precondition_nodes(g: T.BlockGrid, points: T.PointRows, materials: T.MaterialRows,
                           clock: wp.array(dtype=real), nodes: N):
        n = wp.tid()
        b = n // CELLS
        if b >= wp.min(g.used[0], g.key.shape[0]):
            return
        m = nodes.star[n][3]
        if m == real(0.0):
            return
        at = n % CELLS
        h = clock[0]
        scale = real(16.0) * h * h / (g.dx * g.dx)
        block = (m + nodes.drag[n]) * wp.identity(n=3, dtype=real)
        sides = int(3)
        for x in range(sides):
            i = at // 16 + x - 1
            for y in range(sides):
                j = (at // 4) % 4 + y - 1
                for z in range(sides):
                    k = at % 4 + z - 1
                    other = g.near[27 * b + 9 * ((i >> 2) + 1) + 3 * ((j >> 2) + 1) + (k >> 2) + 1]
                    if other >= 0:
                        cell = other * CELLS + 16 * (i & 3) + 4 * (j & 3) + (k & 3)
                        for row in range(g.first[cell], g.first[cell] + g.count[cell]):
                            p = g.order[row]
                            d = t.vec3(real(1 - x), real(1 - y), real(1 - z)) - points.o[p]
                            block += add_particle(points, materials, p, d, scale, h)
        inverse = wp.inverse(block)
        nodes.inverse[n] = inverse
        nodes.z[n] = f.row(f.filtered(nodes.hold[n], inverse * f.head(nodes.r[n])), real(0.0))

    return wp.kernel(precondition_nodes, name=f"mpm_precondition_nodes_{t.name}", module=module, enable_backward=False)


@cache
def shift_kernels(cpu: bool, real, module, apart) -> SimpleNamespace:
    """Kernels: sum_residuals over layers of blocks, parts of (sum r, sum m) in the order of ranks; sum_shifts, in the module
    `apart`, over `threads` a world: the shift of each world [m/s]; add_change over nodes: v += y + shift."""
    t, T, N = types(real), point_tables(real), node_rows(real)

    def sum_residuals(g: T.BlockGrid, rank: wp.array(dtype=int), nodes: N, part_out: wp.array(dtype=wp.vec4d),
                      world_out: wp.array(dtype=int)):
        n = wp.tid()
        b = n * LAYER // CELLS
        if b >= wp.min(g.used[0], g.key.shape[0]):
            return
        sum = wp.vec4d()
        cells = int(LAYER)
        for c in range(n * LAYER, n * LAYER + cells):
            r = nodes.r[c]
            m = wp.float64(nodes.star[c][3])
            if nodes.hold[c][3] >= real(SLIDES):
                m = wp.float64(wp.inf)                         # no shift
            sum += wp.vec4d(wp.float64(r[0]), wp.float64(r[1]), wp.float64(r[2]), m)
        at = int(b)
        if not wp.static(cpu):
            at = rank[b]
        part_out[(CELLS // LAYER) * at + n % (CELLS // LAYER)] = sum
        world_out[(CELLS // LAYER) * at + n % (CELLS // LAYER)] = int(g.key[b] >> wp.int64(3 * g.bits))

    def sum_shifts(g: T.BlockGrid, part: wp.array(dtype=wp.vec4d), world: wp.array(dtype=int), threads: int,
                   shift_out: wp.array(dtype=t.vec4)):
        thread = wp.tid() % threads
        own = wp.tid() // threads
        sum = wp.vec4d()
        for n in range(thread, (CELLS // LAYER) * wp.min(g.used[0], g.key.shape[0]), threads):
            if world[n] == own:
                sum += part[n]
        x = block_sum(sum[0])
        y = block_sum(sum[1])
        z = block_sum(sum[2])
        m = block_sum(sum[3])
        if thread == 0 and m > wp.float64(0.0):
            shift_out[own] = t.vec4(real(x / m), real(y / m), real(z / m), real(0.0))

    def add_change(g: T.BlockGrid, shift: wp.array(dtype=t.vec4), nodes: N):
        n = wp.tid()
        b = n // CELLS
        if b < wp.min(g.used[0], g.key.shape[0]):
            change = nodes.y[n]
            if nodes.star[n][3] > real(0.0):
                change += shift[int(g.key[b] >> wp.int64(3 * g.bits))]
            nodes.y[n] = change
            nodes.v[n] = nodes.v[n] + change

    name = f"{'cpu_' * cpu}{t.name}"
    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{name}", module=m, enable_backward=False)
            for k, m in ((sum_residuals, module), (sum_shifts, apart), (add_change, module))}
    return SimpleNamespace(**made)
