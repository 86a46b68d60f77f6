"""Modules of kernels that scenes with self-contact share: compiled once, and found in Warp's cache by later scenes, whatever
their solver. What only some scenes need stays in the module of the plan.

    core        search, proof, projections and cuts, of surfaces and of strands: 3 CPU-s to compile
    sweeps      contact rows of surfaces, and frames without contacts: 1 CPU-s
    newton      the same rows in Newton steps, for each kind of forces

Warp knows a module by its set of kernels, and compiles it anew where one comes to it: all of a set are made at once. On CUDA
the threads of a block are in the name, since strands and surfaces of one plan may have others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from wsim.kernels.math.real import types
from wsim.kernels.selfcontact import certificate, cut, pairs, rows, search, tree, tubes
from wsim.kernels.selfcontact.newton import energy, push, solve
from wsim.kernels.solver import line_search, pcg

if TYPE_CHECKING:
    from collections.abc import Callable

    from wsim.model.model import Model

CORE = (tree.number, tree.lay, tubes.tally, tubes.fold, tubes.fit, tubes.axes, tubes.watch, tubes.thin, search.sift,
        search.listed, certificate.inspect, certificate.share, certificate.project, pairs.settle_sums, cut.claim, cut.shorten,
        cut.cut, cut.tell)                               # and search.meet
CORE_WORDS = tree.join, certificate.proceed              # of no precision
SWEEPS = tubes.way, rows.lean, rows.nearer               # and rows.press
SWEEPS_WORDS = (rows.further,)
NEWTON = (push.stiffen, push.renew, push.join, push.give, push.take, energy.multiply, energy.change, energy.tell,
          solve.spread, solve.measure, solve.compare, solve.count)
NEWTON_WORDS = (solve.share,)


def core(model: Model) -> str:
    """Name of the module of search and proof."""
    def meet(real, module):
        return search.meet(real, module, not model.device.is_cuda)
    return _made(model, "wsim_selfcontact", (*CORE, meet), CORE_WORDS)


def sweeps(model: Model, turns: bool) -> str:
    """Name of the module of contact rows. turns: as `rows.press`."""
    def press(real, module):
        return rows.press(real, module, turns)
    return _made(model, f"wsim_selfcontact_sweeps{'_turns' * turns}", (*SWEEPS, press), SWEEPS_WORDS)


def newton(model: Model, springs: bool, elements: bool) -> str:
    """Name of the module of contact rows in Newton steps of such forces."""
    def of_forces(real, module):
        solve.multiply(real, module, springs, elements)
        pcg.several(real, module, springs, elements)
        line_search.choose(real, module)
    name = "_".join(["wsim_selfcontact_newton", *["springs"] * springs, *["elements"] * elements])
    return _made(model, name, (*NEWTON, of_forces), NEWTON_WORDS)


def _made(model: Model, name: str, kernels: tuple[Callable, ...], words: tuple[Callable, ...]) -> str:
    """Makes all kernels of a module, which the model loads with its own; returns its name."""
    name = f"{name}_{types(model.real).name}" + f"_{model.block}" * model.device.is_cuda
    for make in kernels:
        make(model.real, name)
    for make in words:
        make(name)
    model.modules[name] = model.block
    return name
