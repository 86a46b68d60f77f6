"""Velocities that particles of a fluid exchange at the end of a substep: viscosity. See density.py for symbols.

    v_i += sum_j (c_ij h 2 mu / rho (-V W') / r + s V W / S) (v_j - v_i)

The first term is viscosity (Morris, Fox, Zhu 1997, eq. 22, for one density), in an explicit step; the second the XSPH form
(Schechter, Bridson 2012; Macklin, Mueller 2013, eq. 17), which damps what particles do and a fluid does not, by the part s a
substep. Pairs take opposite impulses; coefficients of two fluids are means. c = 1 / 0.93 makes up for the few particles within
reach: the mean over lattices of sum_j -V W' r / 3, which is 1 where they are many.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.position_based.density import LATTICE, REACHED, fluid_structs, kernel_slope, kernel_weight
from wsim.kernels.position_based.neighbours import neighbour_structs

FEW = 0.93             # 1 / c
MOST_RUBBED = 0.1      # of a difference of velocity, by viscosity, of one pair a substep: what nearly meets is not thrown


@cache
def flow_gather_kernel(real, module):
    """Kernel over places: places and velocities in the order of cells, in y and u."""
    t, N, S = types(real), neighbour_structs(real), fluid_structs(real)

    def gather_fluid_velocity(rows: N.ParticleTable, c: N.CellTable, f: S.FluidTable, x: wp.array(dtype=t.vec3),
                              v: wp.array(dtype=t.vec3)):
        k = wp.tid()
        p = c.order[k]
        i = rows.point[p]
        f.y[k] = x[i] + rows.shift[p]
        f.u[k] = v[i]

    return wp.kernel(gather_fluid_velocity, name=f"flow_gather_{t.name}", module=module, enable_backward=False)


@cache
def flow_viscosity_kernel(real, module):
    """Kernel over places: what pairs exchange. flow: by p, mu / rho [m^2/s] and s [1]; h: substep [s]."""
    t, N, S = types(real), neighbour_structs(real), fluid_structs(real)

    def exchange_fluid_velocity(rows: N.ParticleTable, c: N.CellTable, lists: N.PairLists, f: S.FluidTable,
                                flow: wp.array(dtype=t.vec2), h: real, v_out: wp.array(dtype=t.vec3)):
        k = wp.tid()
        p = c.order[k]
        H = real(REACHED) * f.d
        own = f.u[k]
        rate = flow[p]
        given = t.vec3()
        for s in range(lists.count[k]):
            other = lists.other[s * lists.size + k]
            r = wp.length(f.y[k] - f.y[other])
            if r < H and r > real(0.0):
                mean = real(0.5) * (rate + flow[c.order[other]])
                rubbed = -real(2.0 * LATTICE / FEW) * h * mean[0] * kernel_slope(r, H) / r
                part = mean[1] * kernel_weight(r, H) + wp.min(rubbed, real(MOST_RUBBED))
                given += part * (f.u[other] - own)
        i = rows.point[p]
        if f.w[i] > real(0.0):
            v_out[i] = v_out[i] + given

    return wp.kernel(exchange_fluid_velocity, name=f"flow_viscosity_{t.name}", module=module, enable_backward=False)
