"""Loads and air on material points: changes of a particle's velocity where a step of h begins.

    load    dv = h sum_k s_k F_k(t + h / 2) / m          s_k the part of load k; F_k linear within a frame
    decay   v and its gradient times exp(-k h)           k is `Scene.air_drag`
    drag    F = 1/2 rho C_d A |u| u,  u = wind - v;      dv = (c / (1 + c)) u,  c = h rho C_d A |u| / (2 m)

A is the part of the body's frontal area that a particle bears. The gradient of the volume fraction phi is the area of the
surface times its inner normal (Brackbill, Kothe, Zemach 1992, eq. 15), here by the n particles of the cells beside:

    a = 2 V grad phi,   dphi/dx_i = (V / dx^3) (n_+i - n_-i) / (2 dx),   A = max(a . u / |u|, 0)

Along a column of cells the sum of phi d(phi)/dx up to where it is full is 1/2; so a convex body bears its frontal area,
wherever its surface cuts the cells. A grain or drop that flies alone has no surface; it bears the area of a ball of its volume.
"""

# ruff: noqa: UP018
# int(0) makes a variable of what would be a constant.

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.tables import CELLS, point_tables

ALONE = wp.constant(0.5)           # of a cell's volume, in seven cells: what is less has no surface
BALL = wp.constant(1.2089939655)   # frontal area of a ball of the volume 1: (pi / 4) (6 / pi)^(2/3)


@cache
def force_tables(real) -> SimpleNamespace:
    """Structs LoadRows (what loads give to particles), AirRows (worlds, and rows of materials)."""
    t = types(real)

    @wp.struct
    class LoadRows:
        point: wp.array(dtype=int)         # particles that bear loads
        first: wp.array(dtype=int)         # first entry of each, one more than there are
        load: wp.array(dtype=int)          # of each entry
        share: wp.array(dtype=real)        # part of the load that the particle bears [1]
        start: wp.array(dtype=t.vec3)      # of each load where the frame begins [N]
        end: wp.array(dtype=t.vec3)        # and where it ends
        dt: real                           # of a frame [s]

    @wp.struct
    class AirRows:
        wind: wp.array(dtype=t.vec3)       # of each world [m/s]
        decay: wp.array(dtype=real)        # of each world [1/s]
        drag: wp.array(dtype=real)         # of each row of materials: density of the air times C_d [kg/m^3]

    return SimpleNamespace(LoadRows=LoadRows, AirRows=AirRows)


@cache
def load_kernel(real, module):
    """Kernel over particles that bear loads."""
    t, T, F = types(real), point_tables(real), force_tables(real)

    def push_points(f: F.LoadRows, points: T.PointRows, materials: T.MaterialRows, clock: wp.array(dtype=real)):
        j = wp.tid()
        part = (clock[1] + real(0.5) * clock[0]) / f.dt
        force = t.vec3()
        for n in range(f.first[j], f.first[j + 1]):
            k = f.load[n]
            force += f.share[n] * ((real(1.0) - part) * f.start[k] + part * f.end[k])
        p = f.point[j]
        m = materials.density[points.row[p]] * points.volume[p]
        points.v[p] = points.v[p] + (clock[0] / m) * force

    return wp.kernel(push_points, name=f"mpm_push_points_{t.name}", module=module, enable_backward=False)


@cache
def air_kernel(drags: bool, real, module):
    """Kernel over rows of the order. drags: some bodies have a drag coefficient."""
    t, T, F = types(real), point_tables(real), force_tables(real)

    @wp.func
    def count_points(g: T.BlockGrid, b: int, i: int, j: int, k: int):
        """Particles of a cell, by its place from the first of a block."""
        found = int(0)
        other = g.near[27 * b + (9 * ((i >> 2) + 1) + 3 * ((j >> 2) + 1) + (k >> 2) + 1)]
        if other >= 0:
            found = g.count[other * CELLS + (16 * (i & 3) + 4 * (j & 3) + (k & 3))]
        return found

    @wp.func
    def fraction_gradient(g: T.BlockGrid, b: int, i: int, j: int, k: int):
        """(n_+ - n_-) / 2 of a cell along each axis, the inner normal of the surface times particles a cell; and the particles
        of the cell and of the six beside."""
        low = wp.vec3i(count_points(g, b, i - 1, j, k), count_points(g, b, i, j - 1, k), count_points(g, b, i, j, k - 1))
        high = wp.vec3i(count_points(g, b, i + 1, j, k), count_points(g, b, i, j + 1, k), count_points(g, b, i, j, k + 1))
        d = high - low
        all = high + low
        count = count_points(g, b, i, j, k) + all[0] + all[1] + all[2]
        return real(0.5) * t.vec3(real(d[0]), real(d[1]), real(d[2])), real(count)

    def blow_points(points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid, air: F.AirRows,
                    clock: wp.array(dtype=real)):
        n = wp.tid()
        if n >= g.used[1]:
            return
        p = g.order[n]
        row = points.row[p]
        world = materials.world[row]
        h = clock[0]
        v = points.v[p]
        if wp.static(drags):
            drag = air.drag[row]
            if drag > real(0.0):
                u = air.wind[world] - v
                speed = wp.length(u)
                V = points.volume[p]
                fill = V / (g.dx * g.dx * g.dx)
                normal, count = fraction_gradient(g, g.block[p], points.i[p] & 3, points.j[p] & 3, points.k[p] & 3)
                area = real(0.0)
                if count * fill <= real(ALONE):
                    area = real(BALL) * wp.pow(V, real(2.0 / 3.0))
                elif speed > real(0.0):
                    area = wp.max((real(2.0) * g.dx * g.dx * fill * fill) * wp.dot(normal, u) / speed, real(0.0))
                c = real(0.5) * h * drag * area * speed / (materials.density[row] * V)
                v += (c / (real(1.0) + c)) * u
        keep = wp.exp(-h * air.decay[world])
        points.v[p] = keep * v
        points.C[p] = keep * points.C[p]

    return wp.kernel(blow_points, name=f"mpm_blow_points_{'drag_' * drags}{t.name}", module=module,
                     enable_backward=False)
