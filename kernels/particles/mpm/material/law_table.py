"""The table of laws of the material point method (laws.py), and functions that pick one by its number."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm import laws
from wsim.kernels.particles.mpm.tables import point_tables


@dataclass(frozen=True)
class PointLaw:
    """respond, energy: functions as in laws.py. source: where it is from."""

    respond: Callable
    energy: Callable
    source: str


LAWS: dict[str, PointLaw] = {
    "neo_hookean": PointLaw(laws.neo_hookean_respond, laws.neo_hookean_energy, "Bonet, Wood 2008, eq. 6.27"),
    "corotational": PointLaw(laws.corotational_respond, laws.corotational_energy, "Stomakhin et al. 2012"),
    "snow": PointLaw(laws.snow_respond, laws.snow_energy, "Stomakhin et al. 2013"),
    "sand": PointLaw(laws.sand_respond, laws.sand_energy, "Klar et al. 2016; Tampubolon et al. 2017"),
    "water": PointLaw(laws.water_respond, laws.water_energy, "Monaghan 1994"),
}


@cache
def choose_law(names: tuple[str, ...], real):
    """Functions (number, B, q, m) of the laws of a scene, by their numbers in `names`: respond and energy."""
    t, vec8 = types(real), point_tables(real).vec8
    first = LAWS[names[0]].respond
    first_energy = LAWS[names[0]].energy
    further, energy_further = choose_law(names[1:], real) if len(names) > 1 else (None, None)

    if not further:
        @wp.func
        def respond_by_law(law: int, B: t.mat33, q: real, m: vec8):
            B_out, q_out, tau, a = first(B, q, m)
            return B_out, q_out, tau, a

        @wp.func
        def energy_by_law(law: int, B: t.mat33, q: real, m: vec8):
            return first_energy(B, q, m)
    else:
        @wp.func
        def respond_by_law(law: int, B: t.mat33, q: real, m: vec8):
            if law == 0:
                B_out, q_out, tau, a = first(B, q, m)
                return B_out, q_out, tau, a
            B_more, q_more, tau_more, a_more = further(law - 1, B, q, m)
            return B_more, q_more, tau_more, a_more

        @wp.func
        def energy_by_law(law: int, B: t.mat33, q: real, m: vec8):
            if law == 0:
                return first_energy(B, q, m)
            return energy_further(law - 1, B, q, m)

    return respond_by_law, energy_by_law
