"""Stiffnesses that are set live, and what is known of explicit steps without looking at the whole scene again.

The highest frequency was bounded last at some stiffnesses k. K is a sum of terms k K_k, K_k positive semidefinite, so that at
stiffnesses of at most r k it is at most r K, and the steps that are stable then, times r (r >= 1: with damping c goes with k,
without it omega with its root), are stable now. Where the frame has that many substeps already, nothing is bounded anew: a
parameter that is moved to and fro costs a scene's bound (14 ms of 1000 points) where it is set first, and where it is more than
ever before.

Steps that a scene names between the limit at rest and the bound bear as much tension as is left of that limit
(`wsim.physics.motion.stability.stable_stretch`); the frame in which an edge is longer is repeated with as many as the bound
asks for. They would grow, twofold in many frames, and then by 1e7 in one.
"""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.model.stage import STRETCHED
from wsim.physics.motion.divergence_monitor import MOST
from wsim.simulation.measure.exceeded import CAP

if TYPE_CHECKING:
    from wsim.simulation.simulation import Simulation

SCALED = ("stretch", "shear", "bend", "stiffness", "young")      # K is linear in each, the others as they are


class LiveStability:
    """Stiffnesses at which `least` substeps were found to be stable, by (path, name)."""

    def __init__(self) -> None:
        self.least = 0
        self.bounded: dict[tuple[str, str], Any] = {}
        self.now: dict[tuple[str, str], Any] = {}

    def holds(self, thing, path: str, name: str, value, world: int | None, substeps: int) -> bool:
        """True if so many substeps are stable with that value too. What is no stiffness for all worlds, and membranes whose
        weft has a stiffness of its own, is never known."""
        if not self.known(thing, name, world):
            self.forget()
            return False
        self.now[path, name] = np.asarray(value, np.float64)
        if not all(key in self.bounded for key in self.now):
            return False
        ratios = [self._largest_ratio(self.now[key], self.bounded[key]) for key in self.now]
        return ceil(self.least * max(1.0, *ratios)) <= substeps

    def found(self, least: int) -> None:
        """The bound of all as it is now takes so many substeps."""
        self.least, self.bounded = least, dict(self.now)

    def forget(self) -> None:
        self.bounded, self.now = {}, {}

    @staticmethod
    def known(thing, name: str, world: int | None) -> bool:
        weft = getattr(getattr(thing, "material", None), "weft", 0.0)
        return thing is not None and name in SCALED and world is None and not weft

    @staticmethod
    def _largest_ratio(now: np.ndarray, then: np.ndarray) -> float:
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(np.nan_to_num(now / then, nan=1.0, posinf=np.inf).max())


def shorten_steps(sim: Simulation) -> bool:
    """Takes the substeps of the bound from here on, as at a start, where steps are not that short and an edge is longer than
    they bear. False where they are, or bear twice its length."""
    plan, clock = sim.plan, sim.plan.clock
    choice = plan.choice
    percent = plan.status.said(STRETCHED)
    if choice.bears >= MOST or clock.substeps >= choice.least or not percent.any():
        return False
    body, longest = sim.model.bodies[int(percent.argmax())], max(min(percent.max(), CAP) / 100.0, choice.bears)
    sim.warnings.append(f"frame {sim.frame + 1}: an edge of {body.path} is {longest:.3g} times as long as at rest, and tension "
                        f"makes it stiffer: {clock.substeps} substeps of {plan.integrator} are sure to be stable up to "
                        f"{choice.bears:.3g} times; repeated with {choice.least}, which stay; give --substeps {choice.least}")
    clock.substeps, clock.starting = choice.least, True
    sim.graphs.forget("substeps were raised")
    plan.ports.edge_watch.most = MOST
    return True
