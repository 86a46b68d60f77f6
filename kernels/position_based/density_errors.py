"""What a substep may leave of density errors that are there as it begins, the pressures that last, and the energy that errors
hold. See density.py.

A push that takes all of an error at once is a velocity, and the fluid boils: of C, up to MOST_LEFT, the part `keep` may stay.
What is more is corrected whole, since a deep fluid that begins without pressures would stay pressed together: 40 layers, 8
substeps of 2 iterations, keep 0.98 of their height, and 0.935 where the part stays of any error.

A fluid that iterations leave pressed together is a spring: it holds U = 1/2 sum_i V p_i C_i, and gives that back as it parts
(p_i K and C_i / K are the pressure and the error of the volume). A tank of 12 layers, 8 x 4, that is let go sinks and rises:
kinetic and potential energy rise by 0.017 J, with U by 0.001 J. Where a blow raises p for a substep U is no
measure, so that the balance takes it as the most that is stored, and 0 as the least.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import kernel_over_cores
from wsim.kernels.math.real import types
from wsim.kernels.position_based.density import fluid_structs, wall_density_func
from wsim.kernels.position_based.neighbours import neighbour_structs
from wsim.kernels.position_based.packets.sums import row_sums

MOST_LEFT = 0.01       # C of which a part may stay: 0.003 boils, 0.02 leaves deep fluids pressed together
TOLD = 0.1             # C of which a warning tells


@cache
def fluid_left_kernel(lanes: int, real, module):
    """Kernel over `lanes` places each: what a substep may leave of the error where it begins."""
    t, N, S, walls = types(real), neighbour_structs(real), fluid_structs(real), wall_density_func(real)
    sums = row_sums(lanes, real)

    def allow_density_error(lists: N.PairLists, f: S.FluidTable):
        first = wp.static(lanes) * wp.tid()
        found = sums.density(f.y, lists, first, f.d)
        for m in range(wp.static(lanes)):
            k = first + m
            if k < lists.size:
                B, wall = walls(f, k, t.vec3())
                f.left[k] = f.keep * wp.clamp(found[m, 0] + B - real(1.0), real(0.0), real(MOST_LEFT))

    return kernel_over_cores(allow_density_error, f"fluid_left_{lanes}_{t.name}", module)


@cache
def fluid_keep_kernel(real, module):
    """Kernel over places: pressures [Pa] for the next substep, after one of h [s]; the worst C beyond TOLD, in millionths."""
    N, S = neighbour_structs(real), fluid_structs(real)

    def keep_fluid_pressure(c: N.CellTable, f: S.FluidTable, h: real, worst: wp.array(dtype=int)):
        k = wp.tid()
        if f.tight[k] > real(TOLD):
            wp.atomic_max(worst, 0, int(real(1.0e6) * wp.min(f.tight[k], real(1.0e3))))
        f.pressure[c.order[k]] = f.lam[k] / (h * h * f.d * f.d * f.d)

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
        rows[wp.tid()] = wp.vec4d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.5) * d * d * d * sum, wp.float64(0.0))

    return wp.kernel(sum_fluid_energy, name=f"fluid_energy_{types(real).name}", module=module, enable_backward=False)
