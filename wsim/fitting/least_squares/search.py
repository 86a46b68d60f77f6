"""A search for theta by Levenberg's and Marquardt's steps, over a horizon that grows as far as the fit holds.

At theta all copies are run together and the normal equations are summed up moment by moment. As soon as what curvature adds to
the step (`wsim.fitting.least_squares.levenberg_marquardt`) is larger than the error bars that the data so far allow, later data
cannot make the step any better: the run is left there, and the step is taken. So first steps cost a few frames, and only those
near the end the whole horizon. A step after which the misfit over the same frames is larger is taken back, with a quarter of
the radius. If no step reduces the misfit, the next run goes on to later frames, twice as far.
"""

from collections.abc import Callable

import numpy as np

from wsim.fitting import state
from wsim.fitting.copies import BrokenRun
from wsim.fitting.least_squares.levenberg_marquardt import RADIUS, LevenbergMarquardt, NormalPrior
from wsim.fitting.least_squares.normal_equations import NormalEquations
from wsim.fitting.observations.residuals import DifferenceSteps, Misfit, ResidualBlock
from wsim.scene import Problem, SceneError

LINEAR = 0.2           # part of the answer to a change of theta by NEAR that curvature may be, where it is more than noise
NEAR = 1e-3            # no model knows a parameter better: where such a change is not answered in proportion, all is chance
SLACK = 1e-3           # of the misfit: as good as equal
LEAST = 1e-9           # of theta: a shorter step counts as none


class FitSearch(LevenbergMarquardt):
    """theta, and how it got there. `run` until it is found, or `limit` simulations are spent; `best` is the result."""

    def __init__(self, misfit: Misfit, theta: np.ndarray, prior: NormalPrior, *, sigma: bool, limit: float = 200.0,
                 accuracy: float = 0.0, each: Callable[["FitSearch"], None] = lambda search: None):
        """sigma, accuracy: as of LevenbergMarquardt."""
        super().__init__(prior, sigma=sigma, accuracy=accuracy, floor=misfit.floor, eps=misfit.eps, end=misfit.moments[-1])
        self.misfit, self.theta, self.limit, self.each, self.steps = misfit, theta, limit, each, 0
        self.best: NormalEquations | None = None
        self.least = 0.0                       # time [s] to which the next run goes in any case
        self.accepted, self.converged, self.notes = False, False, []      # type: ignore[var-annotated]

    # a walk through time

    def look(self) -> NormalEquations | None:
        """Sums at theta as far as they are worth it; None where the last step was wrong."""
        best = self.best
        sums, most = NormalEquations.at(self.theta, self.next_steps(best, len(self.theta)), self.misfit.central), np.inf
        if best:
            most = self.cost(best, best) + SLACK
            most += SLACK * most
        try:
            for part in self.misfit.walk(self.theta, steps=sums.steps):
                if self.responds_nonlinearly(part, sums):
                    break
                sums.add(part)
                if best and sums.time <= best.time and self.cost(sums, best) > most:
                    return None
                if sums.time >= max(self.least, best.time if best else 0.0) and self.ends(sums):
                    return sums
        except BrokenRun as broken:
            if not sums.rows and best is None:
                raise SceneError(Problem("start", f"with the start values the simulation breaks before anything was seen: "
                                         f"{broken}; give other start values, or more substeps")) from None
            if best and sums.time < best.time:
                return None
            self.stop(sums, f"the simulation breaks: {broken}")
            return sums
        if best and sums.time < best.time:
            return None
        return sums

    def cost(self, sums: NormalEquations, best: NormalEquations) -> float:
        return sums.misfit / self.noise(best) + self.prior.misfit(sums.theta)

    def responds_nonlinearly(self, part: ResidualBlock, sums: NormalEquations) -> bool:
        """True if a change by NEAR is no longer answered in proportion: beyond this moment nothing can be said."""
        if part.K is None or part.J is None or not len(part.r) or not sums.rows:
            return False
        each = (NEAR * part.J @ sums.steps.B, 0.5 * NEAR**2 * part.K)
        first, second = (np.sqrt(np.mean(a**2, axis=0)) for a in each)
        if not np.any((second > LINEAR * first) & (second > np.sqrt(self.noise(sums)))):
            return False
        self.stop(sums, f"the motion is chaotic or not smooth beyond: a change of {100.0 * NEAR:g} % is no longer answered in "
                        f"proportion; {describe_growth_rate(sums)}")
        return True

    def stop(self, sums: NormalEquations, text: str) -> None:
        """The horizon ends at what was summed up."""
        if not sums.rows:
            raise SceneError(Problem("horizon", f"nothing can be fitted: {text}; observe earlier frames, or give better start "
                                     "values"))
        self.end = min(self.end, sums.time)
        self.notes = [f"frames up to {sums.frame} of {self.misfit.lasts[0]} are used; {text}"]

    # until it is found

    def run(self) -> None:
        while not self.converged and self.misfit.walked < self.limit:
            before, of_the_best = self.best, (self.end, self.notes)
            self.end, self.notes = self.misfit.moments[-1], []
            sums = self.look()
            self.steps, self.accepted = self.steps + 1, sums is not None
            if sums is None:
                assert self.best is not None
                d, _ = self.step(self.best)
                self.radius = 0.25 * float(np.abs(d).max())
                self.end, self.notes = of_the_best
            else:
                d, _ = self.step(sums)
                if self.best is not None:
                    self.radius = min(RADIUS, max(self.radius, 2.0 * float(np.abs(d).max())))
                self.best, self.converged = sums, self.there(sums)
                if self.converged and not self.misfit.central:
                    self.best = self.look_behind(sums)
                    self.converged = self.there(self.best)
            self.theta = self.best.theta + self.step(self.best)[0]
            if self.stalls_before_end(before):
                self.go_on()
            self.each(self)
            if self.no_step_is_left():
                break
        if not self.converged and self.misfit.walked >= self.limit:
            self.notes.append(f"not converged within {self.limit:g} simulations: allow more, or start nearer")

    def look_behind(self, best: NormalEquations) -> NormalEquations:
        """Forward differences see no curvature, and cannot tell chance from answers: once more with the other sign, which makes
        central ones of them."""
        sums = NormalEquations.at(best.theta, best.steps, central=True)
        first: list[ResidualBlock] = []
        try:
            for steps in (best.steps, DifferenceSteps(best.steps.B, -best.steps.h)):
                for k, part in enumerate(self.misfit.walk(best.theta, steps=steps)):
                    if part.time > best.time:
                        break
                    if steps is best.steps:
                        first.append(part)
                        continue
                    curves = (first[k].J - part.J) @ best.steps.B / best.steps.h          # type: ignore[operator]
                    sums.add(ResidualBlock(part.time, part.frame, part.r, 0.5 * (first[k].J + part.J), curves))      # type: ignore[operator]
        except BrokenRun:
            return best
        return sums

    def stalls_before_end(self, before: NormalEquations | None) -> bool:
        """True if no step reduces the misfit, and later frames are left. before: the best sums before this step."""
        best = self.best
        assert best is not None
        if self.converged or best.time >= self.end or before is None:
            return False
        if not self.accepted:
            return self.radius < NEAR
        return best.time <= before.time and self.cost(best, before) >= (1.0 - SLACK) * self.cost(before, before) - SLACK

    def go_on(self) -> None:
        """Sets the next run: at the best theta again, to later frames."""
        assert self.best is not None
        later = [t for t in self.misfit.moments if t > self.best.time]
        self.least = next((t for t in later if t >= 2.0 * self.best.time), later[-1])
        self.theta, self.radius = self.best.theta.copy(), RADIUS

    def no_step_is_left(self) -> bool:
        """True if no step is left though the fit has not converged; it says why."""
        best = self.best
        assert best is not None
        if self.converged or best.time < self.end or self.hidden(best):
            return False
        strong, weak = self.promised_decrease(best)
        if strong is None and weak <= 1.0:
            self.notes.append("nothing that is fitted shows in what was observed by more than its noise: the values are about "
                              "those at the start, and say nothing")
            return True
        if self.radius >= LEAST and np.abs(self.theta - best.theta).max() > 0.0:
            return False
        self.notes.append("no step makes the misfit any smaller, though first derivatives promise it")
        return True

    # stopping and going on

    @property
    def names(self) -> list[str]:
        return [p.name for p in self.misfit.parameters]

    def save(self, path) -> None:
        b = self.best
        best = b and {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in vars(b).items()
                      if name not in ("steps", "before", "blocks")}
        state.write_fit_state(path, self.names, {
            "theta": self.theta.tolist(), "radius": self.radius, "steps": self.steps, "simulations": self.misfit.walked,
            "launches": self.misfit.launches, "converged": self.converged, "end": self.end, "notes": self.notes, "best": best,
            "along": b and [b.steps.B.tolist(), b.steps.h.tolist()]})

    def resume(self, path) -> None:
        """Goes on from a file of `save`. Raises SceneError where it is of another fit."""
        with state.reading_fit_state(path, self.names) as found:
            b = found["best"]
            self.theta, self.radius, self.steps = np.array(found["theta"]), float(found["radius"]), int(found["steps"])
            self.misfit.walked, self.misfit.launches = float(found["simulations"]), int(found["launches"])
            self.converged, self.end, self.notes = bool(found["converged"]), float(found["end"]), list(found["notes"])
            if b:
                arrays = {k: None if b[k] is None else np.array(b[k]) for k in ("theta", "R", "bend", "second")}
                self.best = NormalEquations(**b | arrays, steps=DifferenceSteps(*(np.array(a) for a in found["along"])))


def describe_growth_rate(sums: NormalEquations) -> str:
    """Growth of derivatives at the end of the horizon, in words."""
    times, J = np.array([r[0] for r in sums.rows]), np.array(sums.growth)
    late = times >= 0.5 * times[-1] if len(times) else np.zeros(0, bool)
    good = late & (J.max(axis=1, initial=0.0) > 0.0) if len(times) else late
    if good.sum() < 3:
        return "too early to tell how fast perturbations grow"
    slope = float(np.polyfit(times[good], np.log(J[good].max(axis=1)), 1)[0])
    return f"perturbations grow by exp({slope:.3g} t), t in seconds"
