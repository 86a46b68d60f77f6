"""More substeps for a frame whose figures are bad: at most RISES times a run, where the scene leaves their number open.

A check may know how many substeps are enough (`Remedy.steps`). The frame then gets that number, and at the last rise of a run
twice that number: a body that rolls down a slope speeds up further. Otherwise the substeps are multiplied by TIMES.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from wsim.scene.bodies import DefaultCount
from wsim.simulation.measure.checks.lost import FixedStepsError
from wsim.simulation.predicted.sag import MOST

if TYPE_CHECKING:
    from wsim.model.stage import Remedy
    from wsim.simulation.simulation import Simulation

RISES = 2
FIRST = 5              # frames in which contacts push apart the objects that overlap at the start
TIMES = 2              # substeps over those before


def left_open(scene) -> bool:
    """True if the number of substeps is the program's choice."""
    return (scene.solver, scene.integrator) == ("auto", "auto") and isinstance(scene.substeps, DefaultCount)


def raise_substeps(sim: Simulation, checks: list[Remedy]) -> bool:
    """True if the frame is to be repeated with more substeps, which stay. False if the frame is kept, with a warning: also in
    the FIRST frames of a run in which objects overlap at the start, where more substeps do not help."""
    balance, clock = sim.plan.ports.balance, sim.plan.clock
    if sim.overlaps and balance.frames < FIRST:
        return False
    if not (clock.open if clock.apart else left_open(sim.given)) or balance.rises >= RISES:
        return False
    before = clock.steps
    more = TIMES if balance.rises == RISES - 1 else 1
    wanted = [min(more * c.steps, MOST) or TIMES * before for c in checks]
    if (steps := max(wanted)) <= before:
        return False
    if clock.apart:
        raise FixedStepsError({world for c, n in zip(checks, wanted, strict=True) if n > before for world in c.worlds})
    clock.substeps, clock.starting = steps * clock.integrator.solves, True
    sim.graphs.forget("substeps were raised")
    balance.rises += 1
    sim.repeats.append(f"frame {sim.frame + 1}: {'; '.join(dict.fromkeys(c.why for c in checks))}; repeated with {clock.steps} "
                       f"substeps in place of {before}, which stay")
    return True
