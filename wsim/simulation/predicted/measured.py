"""The error of a run, measured while its first frames are stepped, where its solver was chosen for the scene. What is predicted
before (`wsim.simulation.predicted.errors`) knows neither slivers beside colliders nor folds.

    implicit    a companion run takes the same frames with a fifth of the substeps, when the report asks for the error: until
    steps       then a frame only keeps where its points are. D is the RMS distance of the two runs, over the size. The reported
                error is D, or D / 2 while nothing touches a collider and nothing folds, plus the rounding of float32. The true
                error is D / 4 for a method of order 1, and less for a higher order. It is up to D where points hit colliders,
                or folds come out differently
    leapfrog    a companion would cost as much as the run: `wsim.simulation.predicted.growth`

Of 20 runs with a companion whose references agree, the error was 0.05 to 0.96 D in 18, 1.1 D in one, and 2 D, 1e-5 of the size,
in one. In the nine without contacts and folds it was 0.05 to 0.37 D (tools/bench/choice/reported_errors.py; random meshes,
nets, soft bodies on and off colliders).
"""

from dataclasses import replace
from math import inf, isfinite, sqrt
from typing import Any

import numpy as np

from wsim.scene import SceneError
from wsim.scene.methods import has_other_objects
from wsim.simulation.duration import percent_of_size
from wsim.simulation.predicted.errors import ROUNDED, falling_bodies
from wsim.simulation.predicted.growth import DifferenceGrowth, LeapfrogErrorGrowth

FRAMES = 24            # that are looked at, and the time of a fall through the size at least
MOST = 100_000         # points, beyond which nothing is measured
COARSER = 5            # substeps of a run over those of its companion
OVER = 4.0             # error over the wanted one, from which a run is warned of: what is said is 4 times the true one (median)


class MeasuredRunError:
    """The measured error of a simulation's first frames."""

    def __init__(self, sim):
        self.plan, explicit = sim.plan, sim.plan.choice.solver == "explicit"
        self.last = max([FRAMES, *(sim.scene.fps * sqrt(2.0 * b.size / b.g) for b in falling_bodies(sim.model))])
        self.growth = LeapfrogErrorGrowth(sim) if explicit else DifferenceGrowth(sim)
        self.coarser: Any = None if explicit else _companion_maker(sim)
        self.companion: Any = None
        self.waiting: list[np.ndarray] = []                    # positions of frames that the companion has not taken yet
        self.frames, self.moved, self.compared, self.done = 0, 0.0, 0, False

    @property
    def error(self) -> float | None:
        """Over the size; None: so few substeps as the companion's do not carry the scene, and nothing is known."""
        if isinstance(self.growth, LeapfrogErrorGrowth) and self.frames:
            return self.growth.error
        self.compare()
        if not isfinite(self.moved):
            return None
        return self.moved * (0.5 if self.growth.smooth else 1.0) + ROUNDED if self.compared else self.plan.choice.error

    @property
    def sensitive(self) -> bool:
        """True where other steps, or another device, fold it otherwise."""
        return self.growth.folded

    def report(self) -> dict:
        """Figures of the run's report: the measured error beside the one that was predicted."""
        error, explicit = self.error, isinstance(self.growth, LeapfrogErrorGrowth)
        return {"error": error, "error_before": self.plan.choice.error,
                "error_frames": self.frames if explicit else self.compared, "sensitive": self.sensitive}

    def warnings(self) -> list[str]:
        """Warnings of an error beyond the wanted one that more substeps lower."""
        error, steps, wanted, found = self.error, self.plan.choice.steps, self.plan.model.scene.error, list[str]()
        if self.compared and (error is None or error > OVER * wanted and not self.sensitive):
            what = "more than the size of the scene" if error is None else f"about {percent_of_size(error)} of the size"
            found.append(f"warning: /: positions err by {what} after {self.compared} frames, where {percent_of_size(wanted)} "
                         f"was wanted; name more than {steps} substeps, or another solver")
        return found

    def look(self, sim) -> bool:
        """Looks at a frame that was stepped; False: the frames to come are not looked at."""
        if sim.plan is not self.plan or sim.changes or sim.frame != self.frames + 1:
            return False
        self.frames, x = sim.frame, _positions_with_remainder(sim)
        if isinstance(self.growth, LeapfrogErrorGrowth):
            self.growth.follow(sim, x)
        elif self.coarser is None:
            return False
        else:
            self.growth.look(x)
            self.growth.touch(sim, len(x))
            self.waiting.append(x)
        return self.frames < self.last

    def compare(self) -> None:
        """Lets the companion take the frames that it has not taken yet."""
        if self.waiting and self.companion is None:
            self.companion = self.coarser()
        while self.waiting and isfinite(self.moved):
            x = self.waiting.pop(0)
            try:
                self.companion.step()
            except SceneError:                                  # so few substeps do not carry it: nothing is known
                self.moved, self.waiting = inf, []
                break
            y = _positions_with_remainder(self.companion)
            self.moved = max(self.moved, float(np.sqrt(((x - y)**2).sum(axis=1).mean())) / self.growth.size)
            self.compared += 1
        if self.done:
            self.companion = None


def follow_start(sim) -> None:
    """Looks at a frame of a simulation after it was stepped, of its first ones."""
    if sim.measured is None and sim.frame == 1:
        sim.measured, sim.settled = _measured_error_of_run(sim) or False, _strain_estimate_of_run(sim)
    if sim.settled and sim.settled.going:
        sim.settled.going = sim.settled.look(sim)
    if sim.measured and not sim.measured.done:
        sim.measured.done = not sim.measured.look(sim)


def step_report_estimates(sim) -> None:
    """Steps all that the report waits for."""
    if sim.measured:
        sim.measured.compare()
    if sim.settled:
        sim.settled.make_all_estimates()


def leave_out(sim) -> None:
    """Steps nothing more for the report: it has what was compared so far."""
    sim.settled = None
    if sim.measured:
        sim.measured.waiting = []


def _strain_estimate_of_run(sim):
    """The estimate of strains that sweeps leave; None of other solvers."""
    if sim.plan.choice.solver != "xpbd":
        return None
    from wsim.simulation.predicted.settled import estimate_of
    return estimate_of(sim)


def _measured_error_of_run(sim) -> MeasuredRunError | None:
    """What measures a run; None where its steps are not chosen for an error, or other things than points are simulated."""
    scene, plan = sim.scene, sim.plan
    chosen = (scene.solver, scene.integrator) == ("auto", "auto") and plan.choice.error is not None and sim.fps is None
    alone = sim.worlds == 1 and not sim.gradients and not has_other_objects(scene) and sim.model.alias is None
    return MeasuredRunError(sim) if chosen and alone and sim.model.points <= MOST else None


def _companion_maker(sim):
    """What makes the companion of implicit steps; None where there are too few."""
    choice = sim.plan.choice
    n = choice.steps // COARSER
    if not n:
        return None
    named = {"solver": choice.solver, "integrator": choice.integrator.name, "iterations": choice.iterations}
    made, scene, on = type(sim), replace(sim.given, substeps=n, **named), {"device": sim.device, "precision": sim.precision}

    def make_companion():
        other = made(scene, **on)
        other.measured = False
        return other
    return make_companion


def _positions_with_remainder(sim) -> np.ndarray:
    return sim.state.x.numpy().astype(np.float64) + sim.state.e.numpy()
