"""Adjoint of a step of the material point method, a kernel for each of its kernels (`wsim.kernels.particles.mpm.transfers`).

    move_particles   U_p, Y_p: cotangents of the velocity and the gradient a cell that a particle has gathered
    gather           u_i* = sum_p w (U_p + Y_p (x_i - x_p)): the transfer of momentum to nodes, of other rows
    move_nodes       Q_i* = D^T u_i* / m_i,  m_i* = -Q_i* . v_i;  D: of colliders (walls.py)
    transfer         V = sum_i w (Q_i*, m_i*),  A* = sum_i w Q_i* (x_i - x_p)^T: the gather to particles, of other nodes

So both adjoints of transfers are the transfers of the forward step, with their order of sums, and what weights get:

    o* = sum_i dw/do (n_i . (P0 + P r)) - w P^T n_i       of a row P0 + P r that meets values n_i of nodes,  r = x_i - x_p

Gravity changes v_i as it does v_p: it gets h sum_p m V.
"""

# ruff: noqa: UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.adjoint.motion import motion_adjoint
from wsim.kernels.particles.mpm.adjoint.tables import cotangent_rows
from wsim.kernels.particles.mpm.adjoint.walls import wall_slopes
from wsim.kernels.particles.mpm.cpu.vectors import vector_transfers
from wsim.kernels.particles.mpm.spline import spline_rows
from wsim.kernels.particles.mpm.tables import CELLS, point_tables
from wsim.kernels.particles.mpm.transfers import node_function


@cache
def gather_functions(real) -> SimpleNamespace:
    """gather(grid, block, i, j, k, o, nodes, P) -> (values of nodes and their moments a cell, (4, 4), and o* of a row P)."""
    t, T = types(real), point_tables(real)

    @wp.func
    def spline_slopes(o: t.vec3):
        """Row n: derivatives of the weights of the three nodes along each axis, as `spline_rows`."""
        half = t.vec3(real(0.5), real(0.5), real(0.5))
        return wp.matrix_from_rows(o - half, real(-2.0) * o, o + half)

    @wp.func
    def gather(g: T.BlockGrid, b: int, i: int, j: int, k: int, o: t.vec3, nodes: wp.array(dtype=t.vec4), P: t.mat44):
        w = spline_rows(o)
        dw = spline_slopes(o)
        v = t.vec4()
        x = t.vec4()
        y = t.vec4()
        z = t.vec4()
        by = t.vec3()
        sides = int(3)
        for e in range(sides):
            ci = (i & 3) + e - 1
            rx = real(e - 1) - o[0]
            for f in range(sides):
                cj = (j & 3) + f - 1
                ry = real(f - 1) - o[1]
                near = 27 * b + 9 * ((ci >> 2) + 1) + 3 * ((cj >> 2) + 1) + 1
                for n in range(sides):
                    ck = (k & 3) + n - 1
                    other = g.near[near + (ck >> 2)]
                    if other >= 0:
                        rz = real(n - 1) - o[2]
                        value = nodes[other * CELLS + (16 * (ci & 3) + 4 * (cj & 3) + (ck & 3))]
                        weight = w[e, 0] * w[f, 1] * w[n, 2]
                        u = weight * value
                        v += u
                        x += rx * u
                        y += ry * u
                        z += rz * u
                        a = value * P
                        dot = a[0] + rx * a[1] + ry * a[2] + rz * a[3]
                        by += t.vec3(dw[e, 0] * w[f, 1] * w[n, 2] * dot - weight * a[1],
                                     w[e, 0] * dw[f, 1] * w[n, 2] * dot - weight * a[2],
                                     w[e, 0] * w[f, 1] * dw[n, 2] * dot - weight * a[3])
        return wp.matrix_from_cols(v, x, y, z), by

    return SimpleNamespace(gather=gather)


@cache
def row_functions(real) -> SimpleNamespace:
    """momentum_row, cotangent_row: rows that a particle gives to its nodes, (4, 4), see `read_momentum`."""
    t, T, Rows = types(real), point_tables(real), cotangent_rows(real)

    @wp.func
    def cotangent_row(by: Rows, p: int):
        v = by.v[p]
        C = by.C[p]
        zero = real(0.0)
        return t.mat44(v[0], C[0, 0], C[0, 1], C[0, 2], v[1], C[1, 0], C[1, 1], C[1, 2], v[2], C[2, 0], C[2, 1], C[2, 2],
                       zero, zero, zero, zero)

    @wp.func
    def momentum_row(points: T.PointRows, m: real, p: int, dx: real, stress: real):
        v = m * points.v[p]
        C = (m * dx) * points.C[p]
        T = stress * points.T[p]
        S = stress * points.S[p]
        zero = real(0.0)
        return t.mat44(v[0], C[0, 0] - T[0], C[0, 1] - S[2], C[0, 2] - S[1], v[1], C[1, 0] - S[2], C[1, 1] - T[1],
                       C[1, 2] - S[0], v[2], C[2, 0] - S[1], C[2, 1] - S[0], C[2, 2] - T[2], m, zero, zero, zero)

    return SimpleNamespace(cotangent_row=cotangent_row, momentum_row=momentum_row)


@cache
def node_kernels(kinds: tuple[str, ...], gathers: bool, real, module) -> SimpleNamespace:
    """Kernels over nodes of all blocks. keep_momentum: momentum [kg m/s] and mass [kg], also into `node_out`; gathers: from
    sums of cells, else from what `node_out` holds. node_back: u* becomes Q* and m*."""
    t, T, Colliders = types(real), point_tables(real), collider_type(real)
    gather, slopes, walls = node_function(real), wall_slopes(kinds, real), bool(kinds)

    def keep_momentum(g: T.BlockGrid, sums: wp.array2d(dtype=t.vec4), momentum_out: wp.array(dtype=t.vec4),
                      node_out: wp.array(dtype=t.vec4)):
        n = wp.tid()
        if n // CELLS >= wp.min(g.used[0], g.key.shape[0]):
            return
        if wp.static(gathers):
            node_out[n] = gather(g, sums, n // CELLS, n % CELLS)
        momentum_out[n] = node_out[n]

    def node_back(g: T.BlockGrid, sums: wp.array2d(dtype=t.vec4), momentum: wp.array(dtype=t.vec4),
                  materials: T.MaterialRows, c: Colliders, clock: wp.array(dtype=real), node_out: wp.array(dtype=t.vec4)):
        n = wp.tid()
        b = n // CELLS
        if b >= wp.min(g.used[0], g.key.shape[0]):
            return
        by = node_out[n]
        if wp.static(gathers):
            by = gather(g, sums, b, n % CELLS)
        sum = momentum[n]
        found = t.vec4()
        if sum[3] > real(0.0):
            a = t.vec3(by[0], by[1], by[2])
            v = t.vec3(sum[0], sum[1], sum[2]) / sum[3]
            if wp.static(walls):
                world = int(g.key[b] >> wp.int64(3 * g.bits))
                D = slopes.held_slope(c, g, b, n % CELLS, v + clock[0] * materials.gravity[world], clock[0] + clock[1])
                a = wp.transpose(D) * a
            a = a / sum[3]
            found = t.vec4(a[0], a[1], a[2], -wp.dot(a, v))
        node_out[n] = found

    name = f"{'_'.join(kinds)}_{'gather_' * gathers}{t.name}"
    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{name}", module=module, enable_backward=False)
            for k in (keep_momentum, node_back)}
    return SimpleNamespace(**made)


@cache
def give_kernel(gathers: bool, real, module):
    """Kernel over rows of the order: U and Y of particles behind each other (gathers), or added to nodes."""
    t, T, Rows = types(real), point_tables(real), cotangent_rows(real)
    rows, vectors = row_functions(real), vector_transfers(real)

    def sort_cotangents(points: T.PointRows, by: Rows, g: T.BlockGrid, out: T.SortedRows):
        n = wp.tid()
        if n >= g.used[1]:
            return
        p = g.order[n]
        o = points.o[p]
        found = rows.cotangent_row(by, p)
        out.m[n] = t.vec4(o[0], o[1], o[2], real(0.0))
        out.x[n] = found[0]
        out.y[n] = found[1]
        out.z[n] = found[2]

    def scatter_cotangents(points: T.PointRows, by: Rows, g: T.BlockGrid, nodes: wp.array(dtype=t.vec4)):
        n = wp.tid()
        if n >= g.used[1]:
            return
        p = g.order[n]
        vectors.scatter_row(g, g.block[p], points.i[p], points.j[p], points.k[p], points.o[p], rows.cotangent_row(by, p), nodes)

    chosen = sort_cotangents if gathers else scatter_cotangents
    return wp.kernel(chosen, name=f"mpm_{chosen.__name__}_{t.name}", module=module, enable_backward=False)


@cache
def particle_kernels(kinds: tuple[str, ...], laws: tuple[str, ...], real, module) -> SimpleNamespace:
    """Kernels over particles. particle_back: of place, velocity, its gradient and strain; momentum_back: of what nodes got."""
    t, T, Colliders, Rows = types(real), point_tables(real), collider_type(real), cotangent_rows(real)
    deform_back, slopes, walls = motion_adjoint(laws, real), wall_slopes(kinds, real), bool(kinds)
    transfers, rows = gather_functions(real), row_functions(real)

    def particle_back(g: T.BlockGrid, nodes: wp.array(dtype=t.vec4), materials: T.MaterialRows, c: Colliders,
                      clock: wp.array(dtype=real), points: T.PointRows, by: Rows):
        p = wp.tid()
        b = g.block[p]
        if b < 0:
            return
        i = points.i[p]
        j = points.j[p]
        k = points.k[p]
        o = points.o[p]
        u, none = transfers.gather(g, b, i, j, k, o, nodes, t.mat44())
        v = t.vec3(u[0, 0], u[1, 0], u[2, 0])
        s = real(4.0) / g.dx
        C = s * t.mat33(u[0, 1], u[0, 2], u[0, 3], u[1, 1], u[1, 2], u[1, 3], u[2, 1], u[2, 2], u[2, 3])
        h = clock[0]
        by_C = deform_back(points, materials, p, h, C, by)
        by_o = by.o[p]
        by_v = by.v[p]
        by_way = by_o
        if wp.static(walls):
            if u[3, 0] > real(0.0):
                W, D = slopes.stopped_slopes(c, t.vec3(real(i), real(j), real(k)) + o, (h / g.dx) * v, v, clock[1], h, g.dx)
                by_both = wp.transpose(W) * by_way
                by_o = by_o + t.vec3(by_both[0], by_both[1], by_both[2])
                by_way = t.vec3(by_both[3], by_both[4], by_both[5])
                by_v = wp.transpose(D) * by_v
        by.v[p] = by_v + (h / g.dx) * by_way
        by.C[p] = s * by_C
        again, own = transfers.gather(g, b, i, j, k, o, nodes, rows.cotangent_row(by, p))
        by.o[p] = by_o + own

    def momentum_back(g: T.BlockGrid, nodes: wp.array(dtype=t.vec4), materials: T.MaterialRows, clock: wp.array(dtype=real),
                      points: T.PointRows, by: Rows):
        p = wp.tid()
        b = g.block[p]
        if b < 0:
            return
        volume = points.volume[p]
        m = materials.density[points.row[p]] * volume
        h = clock[0]
        stress = real(4.0) * h * volume / g.dx
        u, own = transfers.gather(g, b, points.i[p], points.j[p], points.k[p], points.o[p], nodes,
                                  rows.momentum_row(points, m, p, g.dx, stress))
        v = t.vec3(u[0, 0], u[1, 0], u[2, 0])
        A = t.mat33(u[0, 1], u[0, 2], u[0, 3], u[1, 1], u[1, 2], u[1, 3], u[2, 1], u[2, 2], u[2, 3])
        by.o[p] = by.o[p] + own
        by.mass[p] = by.mass[p] + wp.float64(wp.dot(v, points.v[p]) + g.dx * wp.ddot(A, points.C[p]) + u[3, 0])
        by.g[p] = by.g[p] + wp.float64(h * m) * wp.vec3d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))
        by.v[p] = m * v
        by.C[p] = (m * g.dx) * A
        by.T[p] = -stress * wp.get_diag(A)
        by.S[p] = -stress * t.vec3(A[1, 2] + A[2, 1], A[2, 0] + A[0, 2], A[0, 1] + A[1, 0])

    name = f"{'_'.join((*kinds, *laws))}_{t.name}"
    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{name}", module=module, enable_backward=False)
            for k in (particle_back, momentum_back)}
    return SimpleNamespace(**made)
