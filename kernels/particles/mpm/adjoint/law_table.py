"""The adjoint of the law of a particle, by its number (`wsim.kernels.particles.mpm.material.law_table`)."""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.adjoint import laws, sand
from wsim.kernels.particles.mpm.tables import point_tables

BACK = {"neo_hookean": laws.neo_hookean_back, "corotational": laws.corotational_back, "snow": laws.snow_back,
        "sand": sand.sand_back, "water": laws.water_back}


@cache
def choose_law_adjoint(names: tuple[str, ...], real):
    """Function (number, B, q, m, by_B, by_q, by_tau) -> cotangents of B, q, m, of the laws of a scene."""
    t, vec8 = types(real), point_tables(real).vec8
    first = BACK[names[0]]
    further = choose_law_adjoint(names[1:], real) if len(names) > 1 else None

    if not further:
        @wp.func
        def back_by_law(law: int, B: t.mat33, q: real, m: vec8, by_B: t.mat33, by_q: real, by_tau: t.mat33):
            found_B, found_q, found_m = first(B, q, m, by_B, by_q, by_tau)
            return found_B, found_q, found_m
    else:
        @wp.func
        def back_by_law(law: int, B: t.mat33, q: real, m: vec8, by_B: t.mat33, by_q: real, by_tau: t.mat33):
            if law == 0:
                found_B, found_q, found_m = first(B, q, m, by_B, by_q, by_tau)
                return found_B, found_q, found_m
            more_B, more_q, more_m = further(law - 1, B, q, m, by_B, by_q, by_tau)
            return more_B, more_q, more_m

    return back_by_law
