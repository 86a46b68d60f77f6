"""Kernels compiled ahead. What a scene needs lies in Warp's cache afterwards, which workers of one machine, or of one file
system, share: they load it in milliseconds.

Where several worlds share arrays the kernels are those of several: both are compiled, and those that only a report launches.
"""

from typing import TYPE_CHECKING

from wsim.simulation.simulation import Simulation

if TYPE_CHECKING:
    from collections.abc import Iterable


def compile_kernels_ahead(one: Simulation) -> list[str]:
    """Compiles the kernels of a simulation, of two worlds of it, and of its report; returns the names of their modules."""
    found: Iterable[Simulation] = [one, Simulation(one.given, device=one.device, precision=one.precision, worlds=2)]
    names: dict[str, None] = {}
    for each in found:
        each.load()
        names[each.model.module] = None
        names |= dict.fromkeys(each.model.modules)
    one.indicators()
    return list(names)
