"""The error of a run, measured while its first frames are stepped, where its solver was chosen for the scene. What is predicted
before (`wsim.simulation.predicted.errors`) knows neither slivers beside colliders nor folds.

    implicit    a companion takes the same frames with a fifth of the substeps: D is the RMS distance of the two over the
    steps       size. A method of order 1 errs by D / 4, of a higher order by less; where folds as large as an edge, l over the
                size, come out differently, both err as much. In all  D (1/2 + D / (D + l/2))
    leapfrog    a companion would cost as much as the run. Instead the growth of small perturbations is estimated. A point
                that moves across its sheet by u is driven back by u sum_e T_e, T_e = f_e / l_e the tension of its edges
                [N/m]: of springs k strain, of a sheet stretch strain + bend (pi / l)^2. Where the sum is negative u grows as
                exp(sigma t),

                    sigma^2 = -sum_e T_e / m,    S = integral of RMS sigma dt,    growth = exp(GROWS S)

                and the run errs by what was predicted, plus SEED growth, at most FOLD l

Measured (tools/bench/choice/reported_errors.py; random meshes, nets, soft bodies on and off colliders): the logarithm of the
growth of a perturbation that two runs show is 0.5 to 1.4 times GROWS S where that is above 3.
"""

from dataclasses import replace
from math import exp, inf, isfinite, sqrt

import numpy as np

from wsim.model.model import edge_lengths
from wsim.scene import Cloth, SceneError
from wsim.simulation.duration import percent
from wsim.simulation.measure.indicators import edge_strain

FRAMES = 24            # that are looked at, and the time of a fall through the size at least
MOST = 100_000         # points, beyond which nothing is measured
COARSER = 5            # substeps of a run over those of its companion
GROWS = 0.81           # points of a sheet do not move one by one, and compression comes and goes
SEED, FOLD = 1e-6, 1.5 # over the size: eight roundings of float32; folds differ by so many edges at most
SENSITIVE = 1e3        # growth from which a run is called sensitive
OVER = 2.0             # error over the wanted one, from which a run is warned of


class Measured:
    """The measured error of a simulation's first frames."""

    def __init__(self, sim):
        from wsim.simulation.predicted.errors import falls, size
        bodies = falls(sim.model)
        self.plan, self.size = sim.plan, size(sim.model)
        self.last = max([FRAMES, *(sim.scene.fps * sqrt(2.0 * b.size / b.g) for b in bodies)])
        self.edge = max(b.size / b.row for b in bodies) / self.size
        self.frames, self.moved, self.exponent = 0, 0.0, 0.0
        self.companion, self.compared, self.done = None, False, False
        if sim.plan.choice.solver != "explicit":
            self.companion = _coarser(sim)

    @property
    def growth(self) -> float:
        """Factor by which a small perturbation has grown in the frames that were looked at."""
        return exp(min(GROWS * self.exponent, 300.0))

    @property
    def error(self) -> float | None:
        """Over the size; None: so few substeps as the companion's do not carry the scene, and nothing is known."""
        predicted = self.plan.choice.error
        if predicted is None or not self.frames:
            return predicted
        if self.plan.choice.solver == "explicit":
            return predicted + min(SEED * self.growth, FOLD * self.edge)
        if not isfinite(self.moved):
            return None
        return self.moved * (0.5 + self.moved / (self.moved + 0.5 * self.edge)) if self.compared else predicted

    @property
    def sensitive(self) -> bool:
        """True where other steps, or another device, fold it otherwise."""
        return self.growth >= SENSITIVE or self.moved > self.edge

    def report(self) -> dict:
        """Figures of the run's report: the measured error beside the one that was predicted."""
        return {"error": self.error, "error_before": self.plan.choice.error, "error_frames": self.frames,
                "sensitive": self.sensitive}

    def warnings(self) -> list[str]:
        """Warnings of an error beyond the wanted one that more substeps lower."""
        error, steps, wanted, found = self.error, self.plan.choice.steps, self.plan.model.scene.error, list[str]()
        if self.compared and (error is None or error > OVER * wanted and not self.sensitive):
            what = "more than the size of the scene" if error is None else f"about {percent(error)} of the size"
            found.append(f"warning: /: positions err by {what} after {self.frames} frames, where {percent(wanted)} was wanted; "
                         f"name more than {steps} substeps, or another solver")
        return found

    def look(self, sim) -> bool:
        """Looks at a frame that was stepped; False: the frames to come are not looked at."""
        if sim.plan is not self.plan or sim.changes or sim.frame != self.frames + 1:
            return False
        self.frames = sim.frame
        if self.plan.choice.solver == "explicit":
            self.exponent += _instability(sim) / sim.scene.fps
        elif self.companion is None:
            return False
        else:
            try:
                self.companion.step()
            except SceneError:                                  # so few substeps do not carry it: nothing is known
                self.moved = inf
                return False
            x, y = _positions(sim), _positions(self.companion)
            self.moved = max(self.moved, float(np.sqrt(((x - y)**2).sum(axis=1).mean())) / self.size)
            self.compared = True
        return self.frames < self.last


def follow(sim) -> None:
    """Looks at a frame of a simulation after it was stepped, of its first ones."""
    if sim.measured is None and sim.frame == 1:
        sim.measured, sim.settled = _begun(sim) or False, _strains(sim)
    if sim.settled and sim.settled.going:
        sim.settled.going = sim.settled.look(sim)
    if sim.measured and not sim.measured.done:
        sim.measured.done = not sim.measured.look(sim)
        if sim.measured.done:
            sim.measured.companion = None


def _strains(sim):
    """The estimate of strains that sweeps leave; None of other solvers."""
    if sim.plan.choice.solver != "xpbd":
        return None
    from wsim.simulation.predicted.settled import estimate_of
    return estimate_of(sim)


def _begun(sim) -> Measured | None:
    """What measures a run; None where its steps are not chosen for an error, or other things than points are simulated."""
    scene, plan = sim.scene, sim.plan
    chosen = (scene.solver, scene.integrator) == ("auto", "auto") and plan.choice.error is not None and sim.fps is None
    alone = sim.worlds == 1 and not sim.gradients and not scene.others and sim.model.alias is None
    return Measured(sim) if chosen and alone and sim.model.points <= MOST else None


def _coarser(sim):
    """The companion of implicit steps; None where there are too few."""
    choice = sim.plan.choice
    n = choice.steps // COARSER
    if not n:
        return None
    named = {"solver": choice.solver, "integrator": choice.integrator.name, "iterations": choice.iterations}
    other = type(sim)(replace(sim.given, substeps=n, **named), device=sim.device, precision=sim.precision)
    other.measured = False
    return other


def _positions(sim) -> np.ndarray:
    return sim.state.x.numpy().astype(np.float64) + sim.state.e.numpy()


def _instability(sim) -> float:
    """Largest RMS over the points of a body of sigma [1/s]; soft bodies have none of it."""
    x, found = _positions(sim), 0.0
    for body in (b for b in sim.model.bodies if len(b.edges) and not len(b.tets)):
        rest = edge_lengths(body)
        good = rest > 0.0
        ends, length = (body.edges - body.first)[good], rest[good]
        strain, source = edge_strain(body, x), body.source
        if isinstance(source, Cloth):
            stretch = source.material.stretch if source.stretches is None else float(np.mean(source.stretches))
            tension = stretch * strain + source.material.bend * (np.pi / length)**2
        else:
            tension = float(np.mean(source.stiffness)) * strain
        across = np.bincount(ends[:, 0], tension, body.count) + np.bincount(ends[:, 1], tension, body.count)
        free = body.masses > 0.0
        found = max(found, float(np.sqrt(np.mean(np.maximum(-across[free] / body.masses[free], 0.0)))))
    return found
