"""Velocities that particles of a fluid exchange at the end of a substep: viscosity. See density.py for symbols.

    v_i += sum_j (c_ij h 2 mu / rho (-V W') / r + s V W / S) (v_j - v_i)

The first term is viscosity (Morris, Fox, Zhu 1997, eq. 22, for one density), in an explicit step; the second the XSPH form
(Schechter, Bridson 2012; Macklin, Mueller 2013, eq. 17), which damps what particles do and a fluid does not, by the part s a
substep. Pairs take opposite impulses; coefficients of two fluids are means. c = 1 / 0.93 makes up for the few particles within
reach: the mean over lattices of sum_j -V W' r / 3, which is 1 where they are many.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import kernel_over_cores
from wsim.kernels.math.real import types
from wsim.kernels.position_based.density import fluid_structs
from wsim.kernels.position_based.neighbours import neighbour_structs
from wsim.kernels.position_based.packets.sums import row_sums


@cache
def flow_gather_kernel(real, module):
    """Kernel over places: places and velocities in the order of cells, with mu / rho [m^2/s] and s [1] of `flow`, by p."""
    t, N, S = types(real), neighbour_structs(real), fluid_structs(real)

    def gather_fluid_velocity(rows: N.ParticleTable, c: N.CellTable, f: S.FluidTable, flow: wp.array(dtype=t.vec2),
                              x: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3)):
        k = wp.tid()
        p = c.order[k]
        i = rows.point[p]
        y = x[i] + rows.shift[p]
        f.y[k] = t.vec4(y[0], y[1], y[2], flow[p][0])
        f.at[k] = t.vec4(v[i][0], v[i][1], v[i][2], flow[p][1])

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
