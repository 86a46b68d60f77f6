"""Surface tension of fluids by constraints: impulses of pairs at the end of a substep (Akinci, Akinci, Teschner 2013, eq. 1-5).

    F_ij = -sigma d (A s(r) e + B (n_i - n_j))        sigma  surface tension [N/m]; of two fluids, the mean      q = r / H

    s = 64 (1 - q)^3 q^3   where q > 1/2,   128 (1 - q)^3 q^3 - 1   nearer: pairs attract, and very close ones repel
    n = H (sum_j G_ij + G_wall)                       normal of the colour field, into the fluid [1]; 0 deep in it

The first term is cohesion; the second evens out the normals, which makes the surface small. See density.py for other symbols.
Pairs take opposite impulses: linear momentum stays to rounding. Cohesion acts along e and keeps angular momentum too; the
second term does not.

The paper's coefficient has no unit. Here A and B are such that the pressure in a drop at rest is 2 sigma / R (Laplace), by the
virial of all pairs: within 7 % for drops of 10 to 18 particles across. At A / B = 2.07 a drop has its volume, too; at 0.7 it is
3 % too wide. With A alone, pushes of the density cancel nine tenths of the tension.
Cohesion also holds particles in their order: a drop oscillates faster than by sigma alone (tools/results). Walls have no part
in cohesion: a fluid does not wet them. The step is explicit: h^2 sigma / (rho d^3) has to be small.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.math.marks import kernel_over_cores
from wsim.kernels.math.real import types
from wsim.kernels.position_based.density import fluid_structs, place_of
from wsim.kernels.position_based.grains import pair_normal_func
from wsim.kernels.position_based.neighbours import neighbour_structs
from wsim.kernels.position_based.packets.sums import row_sums
from wsim.kernels.position_based.pair_sums import REACHED

COHESION = 0.227       # A, by Laplace pressures
EVEN = 0.109           # B, the same


@wp.func
def cohesion_weight(r: Any, H: Any):
    """s(r) [1]: 1 at H / 2, 0 from H on, -1 where particles meet."""
    one = type(r)(1.0)
    q = r / H
    if q >= one:
        return type(r)(0.0)
    a = type(r)(4.0) * (one - q) * q
    if q > type(r)(0.5):
        return a * a * a
    return type(r)(2.0) * a * a * a - one


@cache
def tension_normal_kernel(lanes: int, real, module):
    """Kernel over `lanes` places each: normals n, where the table has G_wall."""
    t, N, S, sums = types(real), neighbour_structs(real), fluid_structs(real), row_sums(lanes, real)

    def find_surface_normals(lists: N.PairLists, f: S.FluidTable):
        first = wp.static(lanes) * wp.tid()
        found = sums.density(f.y, lists, first, f.d)
        for m in range(wp.static(lanes)):
            k = first + m
            if k < lists.size:
                f.push[k] = real(REACHED) * f.d * (f.push[k] + t.vec3(found[m, 1], found[m, 2], found[m, 3]))

    return kernel_over_cores(find_surface_normals, f"tension_normals_{lanes}_{t.name}", module)


@cache
def tension_kernel(real, module):
    """Kernel over places: what pairs exchange. tension: sigma by p [N/m]; h: substep [s]."""
    t, N, S, normal = types(real), neighbour_structs(real), fluid_structs(real), pair_normal_func(real)

    def pull_fluid_together(rows: N.ParticleTable, c: N.CellTable, lists: N.PairLists, f: S.FluidTable,
                            tension: wp.array(dtype=real), h: real, v_out: wp.array(dtype=t.vec3)):
        k = wp.tid()
        p = c.order[k]
        H = real(REACHED) * f.d
        force = t.vec3()
        for s in range(lists.count[k]):
            other = lists.other[s * lists.size + k]
            way = place_of(f.y[k]) - place_of(f.y[other])
            if wp.length_sq(way) < H * H:
                e, r = normal(way, k, other)
                sigma = real(0.5) * (tension[p] + tension[c.order[other]])
                pull = real(COHESION) * cohesion_weight(r, H) * e
                force -= sigma * (pull + real(EVEN) * (f.push[k] - f.push[other]))
        i = rows.point[p]
        v_out[i] = v_out[i] + (f.w[i] * h * f.d) * force

    return kernel_over_cores(pull_fluid_together, f"tension_{t.name}", module)
