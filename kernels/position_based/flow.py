"""Velocities that particles of a fluid exchange at the end of a substep: viscosity. See density.py for symbols.

    v_i += sum_j c_ij h 2 mu / rho (-V W') / r (v_j - v_i) + 3 s V W / S ((v_j - v_i) . e) e

The first term is viscosity (Morris, Fox, Zhu 1997, eq. 22, for one density), in an explicit step; the second, after the XSPH
form (Schechter, Bridson 2012; Macklin, Mueller 2013, eq. 17), damps what particles do and a fluid does not, by the part s a
substep. It acts along e, three times as much, so that a fluid that turns as a whole keeps its spin: all of v_j - v_i, as there,
takes a third of it in 2 s in a bucket that turns along.
Pairs take opposite impulses; coefficients of two fluids are means. c = 1 / 0.93 makes up for the few particles within
reach: the mean over lattices of sum_j -V W' r / 3, which is 1 where they are many.

A wall that is s away holds viscous fluids: its layers (density.py), at z_k = s + (k + 1/2) d, each spread over its plane, have
velocities that make that of the wall where the wall is (Morris, Fox, Zhu 1997, section 3.4), so that along the wall

    v_i += K h / (1 + K h) (v_wall - v_i),    K = c 2 mu / rho sum_k (30 d / H^3) (1 - z_k / H)^3 z_k / s

For a flow v = g s over particles that are spread evenly, the drag on an area is 1.04 mu g; on the lattice it is 1.01 mu g.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import kernel_over_cores
from wsim.kernels.math.real import types
from wsim.kernels.position_based.density import WALLS, fluid_structs, place_of
from wsim.kernels.position_based.neighbours import neighbour_structs
from wsim.kernels.position_based.packets.sums import row_sums
from wsim.kernels.position_based.pair_sums import FEW, REACHED

LEAST_GAP = 0.25       # of d: nearer walls drag as if they were so far


@cache
def wall_drag_func(real):
    """Function (f, k, way, u, nu) -> change of the velocity u of place k by its walls, since it went by `way`; nu is h mu / rho
    [m^2]."""
    t, S = types(real), fluid_structs(real)

    @wp.func
    def drag_of_walls(f: S.FluidTable, k: int, way: t.vec3, u: t.vec3, nu: real):
        H = real(REACHED) * f.d
        given = t.vec3()
        for e in range(wp.static(WALLS)):
            row = f.wall[e * f.y.shape[0] + k]
            if row[3] < H:
                n = t.vec3(row[0], row[1], row[2])
                s = wp.max(row[3] + wp.dot(n, way), real(LEAST_GAP) * f.d)
                K = real(0.0)
                for layer in range(2):
                    z = s + (real(layer) + real(0.5)) * f.d
                    q = wp.max(real(1.0) - z / H, real(0.0))
                    K += real(2.0 / FEW) * nu * real(30.0) * f.d / (H * H * H) * q * q * q * z / s
                lack = f.rate[e * f.y.shape[0] + k] - u - given
                given += K / (real(1.0) + K) * (lack - wp.dot(lack, n) * n)
        return given

    return drag_of_walls


@cache
def flow_gather_kernel(real, module):
    """Kernel over places: places and velocities in the order of cells, with mu / rho [m^2/s] and s [1] of `flow`, by p; v: what
    walls leave of it. h: substep [s]."""
    t, N, S, drag = types(real), neighbour_structs(real), fluid_structs(real), wall_drag_func(real)

    def gather_fluid_velocity(rows: N.ParticleTable, c: N.CellTable, f: S.FluidTable, flow: wp.array(dtype=t.vec2),
                              x: wp.array(dtype=t.vec3), h: real, v: wp.array(dtype=t.vec3)):
        k = wp.tid()
        p = c.order[k]
        i = rows.point[p]
        y = x[i] + rows.shift[p]
        u = v[i]
        if flow[p][0] > real(0.0) and f.w[i] > real(0.0):
            u = u + drag(f, k, y - place_of(f.y[k]), u, h * flow[p][0])
            v[i] = u
        f.y[k] = t.vec4(y[0], y[1], y[2], flow[p][0])
        f.at[k] = t.vec4(u[0], u[1], u[2], flow[p][1])

    return kernel_over_cores(gather_fluid_velocity, f"flow_gather_{t.name}", module)


@cache
def flow_viscosity_kernel(lanes: int, real, module):
    """Kernel over `lanes` places each: what pairs exchange. h: substep [s]."""
    t, N, S, sums = types(real), neighbour_structs(real), fluid_structs(real), row_sums(lanes, real)

    def exchange_fluid_velocity(rows: N.ParticleTable, c: N.CellTable, lists: N.PairLists, f: S.FluidTable, h: real,
                                v_out: wp.array(dtype=t.vec3)):
        first = wp.static(lanes) * wp.tid()
        found = sums.flow(f.y, f.at, lists, first, f.d, h)
        for m in range(wp.static(lanes)):
            k = first + m
            if k < lists.size:
                i = rows.point[c.order[k]]
                if f.w[i] > real(0.0):
                    v_out[i] = v_out[i] + t.vec3(found[m, 0], found[m, 1], found[m, 2])

    return kernel_over_cores(exchange_fluid_velocity, f"flow_viscosity_{lanes}_{t.name}", module)
