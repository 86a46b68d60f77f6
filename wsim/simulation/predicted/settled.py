"""Strain that a converged run has, estimated beside a run of XPBD where its edges are stretched.

Sweeps that a substep leaves out let edges lag behind their forces (`wsim.simulation.predicted.sweep_strain`). The lag is local:
from the end of a frame, one further substep, divided into parts of some sweeps each (PARTS), removes it. The cloth as a whole
moves no further than in a substep. What strain is left then is mostly above a converged run's, which has held the cloth in all
frames before as well: a cloth that sweeps let hang too low has stored that strain, and swings with it. More sweeps, parts or
substeps do not take it back (1 to 8 substeps of 4 x 20, 8 x 20 and 4 x 80 of ten scenes: the twisted cloth stays at 20 %, where
a converged run has 1).

Measured in 51 estimates, random scenes (tools/bench/choice/reported_errors.py): 0.96 to 8 times the converged strain in four of
five, 2.0 in the median. The shirt on its dummy by XPBD 213 x 1 (tools/bench/choice/peak_strains.py), frames 3, 6 and 12: 64, 22
and 23 %, estimated 11, 8.7 and 8.7, converged 8.6, 6.0 and 4.7.

A frame only keeps the state that an estimate begins with. The estimate itself is made when the report asks for it: on an H200
it takes 30 to 300 ms, where frames of the ribbon take 26.
"""

from dataclasses import dataclass, replace

import numpy as np

from wsim.model.kernel_cache import GATE
from wsim.scene import SceneError
from wsim.scene.methods import other_objects
from wsim.simulation.measure.indicators import edge_strain

# (parts, sweeps of a part) for runs of one sweep a substep, whose compiled kernels are used again (others take 2 to 4 s to
# compile), and for runs of several sweeps. Medians of 51 estimates over the converged strain: 20 x 1 1.96, 40 x 1 2.3,
# 160 x 1 2.9, 4 x 10 1.71; 2 x 10: twice 4 x 10 in one of ten
PARTS = (20, 1), (4, 10)
FRAMES, CHECKS = 24, 3     # frames that are looked at, and estimates that are made in them at most: 20 to 40 sweeps each
GROWN = 2.0                # strain over that of the last estimate, from which another is made
LEAST = 0.02               # strain below which nobody sees it
OVER = 1.1                 # strain over the estimate, from which a run is warned of: a sheet with long substeps that a rope
                           # falls into had 1.14 to 1.17, and 1.5 times the converged strain
SPREAD = 8.0               # of estimates over converged strains
ROUNDED = 1e-3             # of an edge: what float32 rounds of its length
MOST = 100_000             # points, beyond which nothing is estimated
BESIDE = {"Skeleton", "Rods"}      # others than points that may be there


@dataclass(frozen=True)
class StrainedState:
    """State at the end of a frame. strain: the largest of an edge [1]; steps, sweeps: substeps a frame, iterations of each."""

    strain: float
    frame: int
    steps: int
    sweeps: int
    fields: dict[str, dict[str, np.ndarray]]


class SettledStrain:
    """Strains of a run's first frames beside those that a converged run has."""

    def __init__(self, sim):
        self.plan, self.given, self.last, self.going = sim.plan, sim.given, 0.0, True
        self.made, self.on = type(sim), {"device": sim.device, "precision": sim.precision}
        self.waiting: list[StrainedState] = []                 # states whose estimates are still to be made
        self.known: list[tuple[float, float, int]] = []        # strain, its estimate, frame

    def look(self, sim) -> bool:
        """Looks at a frame that was stepped; False: no more are looked at."""
        if sim.plan is not self.plan or sim.changes:
            return False
        least, clock = max(LEAST, GROWN * self.last), sim.plan.clock
        now = peak_strain(sim) if self.strained(sim, least) else 0.0
        if now > least:
            self.last = now
            fields = {path: sim.fields(path) for path in sim.state.paths()}
            self.waiting.append(StrainedState(now, sim.frame, clock.steps, clock.iterations, fields))
        return sim.frame < FRAMES and len(self.waiting) + len(self.known) < CHECKS

    @staticmethod
    def strained(sim, least: float) -> bool:
        """False where the device finds in one launch that no edge strains by so much: the host takes 3 ms for 19 000 edges."""
        watch, muscles = sim.plan.ports.stretch_watch, any(body.actuation for body in sim.scene.bodies())
        with GATE.shared():                                    # else the launch goes into what another thread captures
            return watch is None or muscles or watch.stretch_exceeds(1.0 + least - ROUNDED)

    @property
    def found(self) -> list[tuple[float, float, int]]:
        """Strains, their estimates and frames."""
        self.make_all_estimates()
        return self.known

    def make_all_estimates(self) -> None:
        """Makes the estimates that are not there yet."""
        other, of = None, (0, 0)
        while self.waiting:
            state = self.waiting.pop(0)
            try:
                if (state.steps, state.sweeps) != of:
                    other, of = self.with_more_substeps(state), (state.steps, state.sweeps)
                self.known.append((state.strain, estimate_strain_of_state(other, state), state.frame))
            except SceneError:                                 # it cannot go on from there
                self.waiting, self.going = [], False

    def with_more_substeps(self, state: StrainedState):
        """A simulation whose frames are substeps of the run, divided into parts."""
        parts, sweeps = PARTS[state.sweeps > 1]
        finer = replace(self.given, solver="xpbd", integrator="backward_euler", fps=self.given.fps * state.steps,
                        substeps=parts, iterations=sweeps)
        other = self.made(finer, **self.on)
        # a frame of ribbon's estimate, CPU ms: launched 26, captured 78 and then 11; on an H200 launched 100 to 115
        other.graphs.wanted = bool(self.plan.model.device.is_cuda)
        return other

    def warnings(self) -> list[str]:
        """A warning of the frame that is stretched most beyond its estimate."""
        far = [(s, right, frame) for s, right, frame in self.found if s > OVER * right]
        if not far:
            return []
        s, right, frame = max(far)
        steps, sweeps = self.plan.clock.steps, self.plan.clock.iterations
        return [f"warning: /: edges strain by up to {100.0 * s:.2g} % in frame {frame}, where a converged run has about "
                f"{100.0 * right / SPREAD:.2g} to {100.0 * right:.2g} %: {steps} x {sweeps} sweeps leave the rest; "
                'name more substeps or iterations, or solver "explicit"']


def estimate_strain_of_state(other, state: StrainedState) -> float:
    """Strain after one substep more. other: steps it."""
    other.restart(state.frame * state.steps, state.fields, alike=False)
    other.step()
    return peak_strain(other)


def peak_strain(sim) -> float:
    """Largest strain of an edge now [1]."""
    x = sim.state.x.numpy().astype(np.float64) + sim.state.e.numpy()
    return max((float(edge_strain(b, x).max(initial=0.0)) for b in sim.model.bodies if len(b.edges)), default=0.0)


def estimate_of(sim) -> SettledStrain | None:
    """The estimate of a run's strain; None where it has none of sweeps, or things beside that may not be stepped twice."""
    alone = sim.worlds == 1 and not sim.gradients and sim.fps is None and sim.model.alias is None
    there = {type(thing).__name__ for thing in other_objects(sim.scene)}
    swept = sim.plan.choice.solver == "xpbd" and sim.model.points <= MOST
    return SettledStrain(sim) if alone and swept and there <= BESIDE else None
