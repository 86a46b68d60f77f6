"""Density errors of a fluid where a substep begins, the pressures that last, and the energy that errors hold. See density.py.

A fluid that iterations leave pressed together is lifted again: U = sum_i V p_i C_i is the work of its pressures as errors go
(p_i K and C_i / K are the pressure and the error of the volume). A tank of 12 layers, 8 x 4, that is let go sinks and rises:
kinetic and potential energy rise by 0.006 J, and stay below what they were with U. Where a blow raises p for a substep U is no
measure, so that the balance takes it as the most that is stored, and 0 as the least.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import kernel_over_cores
from wsim.kernels.math.real import types
from wsim.kernels.position_based.density import MOST_KEPT, fluid_structs, wall_density_func
from wsim.kernels.position_based.neighbours import neighbour_structs
from wsim.kernels.position_based.packets.sums import row_sums

MOST_THIN = 0.05       # -C at most, of which E keeps some: thinner fluids begin anew
TOLD = 0.1             # C of which a warning tells


@cache
def fluid_error_kernel(lanes: int, real, module):
    """Kernel over `lanes` places each: E, which iterations keep where a substep begins."""
    t, N, S, walls = types(real), neighbour_structs(real), fluid_structs(real), wall_density_func(real)
    sums = row_sums(lanes, real)

    def find_density_error(rows: N.ParticleTable, c: N.CellTable, lists: N.PairLists, f: S.FluidTable):
        first = wp.static(lanes) * wp.tid()
        found = sums.density(f.y, lists, first, f.d)
        for m in range(wp.static(lanes)):
            k = first + m
            if k < lists.size:
                B, wall = walls(f, k, t.vec3())
                C = found[m, 0] + B - real(1.0)
                E = wp.max(C, wp.min(-real(MOST_THIN) - C, real(0.0)))
                w = f.w[rows.point[c.order[k]]]
                lam = f.lam[k]
                if lam <= real(0.0):
                    E = wp.max(C, real(0.0))
                if w * lam > real(0.999 * MOST_KEPT) * f.d * f.d:
                    E = real(0.0)
                f.start[k] = E

    return kernel_over_cores(find_density_error, f"fluid_errors_{lanes}_{t.name}", module)


@cache
def fluid_keep_kernel(real, module):
    """Kernel over places: pressures [Pa] for the next substep, after one of h [s]; the worst C beyond TOLD, in millionths."""
    N, S = neighbour_structs(real), fluid_structs(real)

    def keep_fluid_pressure(c: N.CellTable, f: S.FluidTable, h: real, worst: wp.array(dtype=int)):
        k = wp.tid()
        if f.tight[k] > real(TOLD):
            wp.atomic_max(worst, 0, int(real(1.0e6) * wp.min(f.tight[k], real(1.0e3))))
        f.pressure[c.order[k]] = f.lasting[k] / (h * h * f.d * f.d * f.d)

    return kernel_over_cores(keep_fluid_pressure, f"fluid_keep_{types(real).name}", module)


@cache
def fluid_energy_kernel(real, module):
    """Kernel over (worlds x threads): a row of the ledger (kernels/math/ledger.py), of U."""
    N, S = neighbour_structs(real), fluid_structs(real)

    def sum_fluid_energy(c: N.CellTable, f: S.FluidTable, worlds: int, rows: wp.array(dtype=wp.vec4d)):
        threads = rows.shape[0] // worlds
        world = wp.tid() // threads
        sum = wp.float64(0.0)
        for k in range(c.first[world * c.size] + wp.tid() % threads, c.first[(world + 1) * c.size], threads):
            sum += wp.float64(f.pressure[c.order[k]]) * wp.float64(wp.max(f.tight[k], real(0.0)))
        d = wp.float64(f.d)
        rows[wp.tid()] = wp.vec4d(wp.float64(0.0), wp.float64(0.0), d * d * d * sum, wp.float64(0.0))

    return wp.kernel(sum_fluid_energy, name=f"fluid_energy_{types(real).name}", module=module, enable_backward=False)
