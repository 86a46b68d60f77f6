"""Fields from what was seen: L-BFGS on gradients by the adjoint, over a horizon that grows, with beliefs about neighbours.

    found = wsim.fit(scene, seen, "young[]")              # of each tet; young[tv] where it jumps
    print(found.text()); found.values["young[]"]; wsim.Simulation(found.scene)

The horizon is a quarter, a half and all of the time, each begun from where the one before has come to. s is what is left at
the present place: at first all of the misfit, so that beliefs weigh most and the field comes out smooth, and less the better
it fits, down to the noise where it is given. It never grows within a horizon. (With the noise from the start a bar of two
halves takes more than twice the steps.)

Converged means that Newton's step from the place that is returned would take less than PROMISE a value off F
(`wsim.fitting.fields.error_bars`), and that something was seen.
"""

import os
from collections.abc import Callable
from math import inf, sqrt
from time import perf_counter

import numpy as np

from wsim.fitting import state
from wsim.fitting.fields.error_bars import newton_step_gain, theta_deviations
from wsim.fitting.fields.field import ParameterField
from wsim.fitting.fields.lbfgs import FitPoint, LbfgsDescent
from wsim.fitting.fields.misfit import AdjointMisfit
from wsim.fitting.fields.number import NumberField, numbers_and_fields
from wsim.fitting.fields.preconditioner import SketchedHessian
from wsim.fitting.fields.result import FieldFit, NumberErrorBar
from wsim.fitting.fields.time_step import FieldHalfStep
from wsim.scene import Problem, Scene, SceneError

PARTS = (0.25, 0.5, 1.0)      # of the time
RADIUS = 1.0                  # largest step of a value in the mapped space: a factor e
FEW = 8                       # steps on a part of the horizon, at most
DONE = 1e-3                   # of F a value, a step that takes less off is one of the last: each moves by 0.05 of its error bar
STILL = 3                     # such steps, one after the other
FRESH, SETS = 10, 4           # steps after which what is seen is probed anew, and sets of probes that count together
GAIN = 0.8                    # what a smaller s must make of what is left to be worth it
PROMISE = 2e-3                # of F a value: each is within 0.06 of its error bar
LOUD = 4.0                    # deviations of chance of chi^2 that are not yet told


class FieldSearch:
    """theta, and how it got there. `run` until it is found, or `limit` gradients are spent."""

    def __init__(self, misfit: AdjointMisfit, theta: np.ndarray, limit: float, file: str | None = None,
                 each: Callable[["FieldSearch"], None] = lambda search: None):
        self.misfit, self.limit, self.file, self.each = misfit, limit, file, each
        times = np.array(misfit.moments())
        self.horizons = sorted({float(times[times <= p * times[-1] + 1e-9].max(initial=0.0)) for p in PARTS} - {0.0})
        self.stage, self.steps, self.sigma, self.least = 0, 0, inf, max(misfit.floor, 1.0 if misfit.known else 0.0)
        self.converged, self.still, self.rows = False, 0, []        # type: ignore[var-annotated]
        self.visible, self.promise, self.settled = True, inf, False
        self.proof: tuple[np.ndarray, np.ndarray] | None = None    # theta, and probes there
        self.descent = LbfgsDescent(misfit.look, FitPoint(theta, np.zeros(2), np.zeros((2, len(theta)))), np.ones(2), RADIUS)
        self.notes: list[str] = []
        self.probed: list[np.ndarray] = []
        self.tried: tuple[float, float, FitPoint] | None = None    # what was left, s, and where, before s was halved

    @property
    def theta(self) -> np.ndarray:
        return self.descent.at.x

    @property
    def last(self) -> bool:
        return self.stage == len(self.horizons) - 1

    def arrive(self) -> None:
        """Evaluates F anew at a horizon. Raises SceneError where the start breaks."""
        m, d = self.misfit, self.descent
        m.time, self.still, self.tried, self.settled = self.horizons[self.stage], 0, None, False
        d.at = d.look(d.at.x)
        if not np.isfinite(d.at.f[0]):
            raise SceneError(Problem("start", f"with the start values the simulation breaks: {m.broken}; give other start "
                                     "values, or more substeps"))
        self.sigma = max(self.left(), self.least)
        self.weigh()

    def left(self) -> float:
        """Noise by what is left [m]: as many residuals as values at most, and no more than half of all, count as spent."""
        count = self.misfit.seen.count
        return sqrt(2.0 * self.descent.at.f[0] / max(count - len(self.theta), 0.5 * count, 1.0))

    def weigh(self) -> None:
        self.descent.weights = np.array([1.0 / self.sigma**2, 1.0])

    def run(self) -> None:
        while not self.converged and self.misfit.walked < self.limit:
            self.arrive()
            first = self.steps
            while self.misfit.walked < self.limit:
                before = self.descent.value
                if (self.steps - first) % FRESH == 0:
                    self.probe_hessian(self.steps == first)
                if self.descent.step():
                    self.steps += 1
                    self.note(before)
                else:
                    self.still = STILL
                if not self.last and self.steps - first >= FEW:
                    break
                if self.still >= STILL and not self.goes_on():
                    if not self.last or self.done() or self.descent.lost:
                        break
                    self.still = 0
            if self.last:
                break
            self.stage += 1
        if not (self.converged or self.settled) and self.taken_back() and self.last:
            self.done()
        if not self.converged and self.misfit.walked >= self.limit:
            self.notes.append(f"not converged within {self.limit:g} gradients: allow more, or start nearer")
        elif not self.converged:
            self.notes.append("nothing that is fitted shows in what was observed by more than its noise: the values are about "
                              "those at the start, and say nothing" if not self.visible else
                              f"no lower F is found along the gradient, though F should fall by {self.promise:.2g}")

    def done(self) -> bool:
        """True if the fit has converged here."""
        m, Y = self.misfit, self.misfit.probe_jacobian(self.theta)
        self.proof = (self.theta, Y)
        self.visible = bool((np.linalg.norm(Y, axis=1) > self.sigma).any())
        self.promise = newton_step_gain(m, self.theta, self.descent.gradient, self.sigma, Y)
        self.converged = self.visible and self.promise <= PROMISE * len(self.theta)
        return self.converged or not self.visible

    def probe_hessian(self, fresh: bool) -> None:
        """A Hessian to begin from, by probes here and at the last few places."""
        m, theta = self.misfit, self.theta
        self.probed = [*([] if fresh else self.probed[1 - SETS:]), m.probe_jacobian(theta)]
        metric = SketchedHessian(m.beliefs, m.parts(theta), np.concatenate(self.probed, axis=1) / sqrt(len(self.probed)))
        self.descent.inverse = lambda q, weights: metric(q, float(weights[0]))

    def note(self, before: float) -> None:
        """Notes what a step has done; the noise follows."""
        d = self.descent
        self.still = self.still + 1 if before - d.value < DONE * min(len(d.at.x), before) else 0
        now = max(self.left(), self.least)
        if now < 0.9 * self.sigma or (now == self.least < self.sigma):
            self.sigma, self.still = now, 0
            self.weigh()
        self.log()
        if self.file:
            self.save(self.file)
        self.each(self)

    def log(self) -> None:
        d, count = self.descent, max(self.misfit.seen.count, 1)
        self.rows.append((self.steps, self.misfit.time, sqrt(2.0 * d.at.f[0] / count), d.value,
                          float(np.linalg.norm(d.gradient)), self.misfit.walked))

    def goes_on(self) -> bool:
        """True if a fit that no longer moves does once beliefs weigh less. A given noise is gone down to; an estimate is
        halved to see whether that fits much better, and is taken back where not."""
        self.settled = self.settled or self.taken_back()
        if self.settled:
            return False
        if self.sigma <= self.least:
            return False
        self.tried = None if self.misfit.known else (self.left(), self.sigma, self.descent.at)
        self.sigma, self.still = max((0.25 if self.misfit.known else 0.5) * self.sigma, self.least), 0
        self.weigh()
        return True

    def taken_back(self) -> bool:
        """True if half of s did not fit much better: then all is as before."""
        if not self.tried or self.left() <= GAIN * self.tried[0]:
            return False
        _, self.sigma, self.descent.at = self.tried
        self.weigh()
        self.log()
        return True

    # stopping and going on

    @property
    def names(self) -> list[str]:
        return [f"{f.name} of {s[0]} x {s[1]}" for f, s in zip(self.misfit.fields, self.misfit.shapes, strict=True)]

    def save(self, path) -> None:
        d = self.descent
        state.write_fit_state(path, self.names, {
            "theta": d.at.x.tolist(), "pairs": [[s.tolist(), y.tolist()] for s, y in d.pairs], "stage": self.stage,
            "steps": self.steps, "converged": self.converged, "gradients": self.misfit.walked, "rows": self.rows})

    def resume(self, path) -> None:
        """Goes on from a file of `save`. Raises SceneError where it is of another fit."""
        d = self.descent
        with state.reading_fit_state(path, self.names) as found:
            d.at = FitPoint(np.array(found["theta"]), np.zeros(2), np.zeros((2, len(self.theta))))
            d.pairs = [(np.array(s), np.array(y)) for s, y in found["pairs"]]
            self.stage, self.steps, self.misfit.walked = int(found["stage"]), int(found["steps"]), float(found["gradients"])
            self.rows = [tuple(r) for r in found["rows"]]


def fit_fields(experiments: list[tuple[Scene, list]], names: list[str], *, start=None, priors=None, each=None,
               settings) -> FieldFit:
    """A fit of fields, which `wsim.fit` calls with the same arguments. start: {name: number or array}; priors: {name:
    (mean, sigma)} of every element."""
    began = perf_counter()
    found, scenes = numbers_and_fields(names, [s for s, _ in experiments], start or {})
    misfit = AdjointMisfit([(s, seen) for s, (_, seen) in zip(scenes, experiments, strict=True)], found, settings.device)
    theta = misfit.theta(_start_values(misfit, start or {}))
    misfit.set_beliefs(misfit.values(theta))
    _set_field_priors(misfit, priors or {})
    search = FieldSearch(misfit, theta, settings.limit, settings.state, lambda s: _tell_field_step(s, each))
    if settings.state and os.path.exists(settings.state):
        search.resume(settings.state)
    search.run()
    return _field_fit_result(search, found, scenes, perf_counter() - began)


def _start_values(misfit: AdjointMisfit, given: dict) -> list[np.ndarray]:
    """Values of each field. Raises SceneError for those that fit none."""
    values, problems, left = list(misfit.start), [], dict(given)
    for k, f in enumerate(misfit.fields):
        value = np.asarray(left.pop(f.name, values[k]), np.float64)
        try:
            value = value[:, None] if value.shape == values[k].shape[:1] and values[k].shape[1] == 1 else value
            values[k] = np.broadcast_to(value, values[k].shape)
            f.map.forward(values[k])
        except ValueError as error:
            problems.append(Problem(f.name, f"start has shape {value.shape} of {values[k].shape}: {error}"))
    problems += [Problem(name, f"has a start value and is not fitted; fitted are {', '.join(f.name for f in misfit.fields)}")
                 for name in left]
    if problems:
        raise SceneError(problems)
    return values


def _set_field_priors(misfit: AdjointMisfit, given: dict) -> None:
    for name, pair in given.items():
        row = next((k for k, f in enumerate(misfit.fields) if f.name == name), None)
        if row is None:
            raise SceneError(Problem(name, f"has a prior and is not fitted; fitted are "
                                     f"{', '.join(f.name for f in misfit.fields)}"))
        try:
            mean, sigma = pair
            if not (np.isfinite(sigma) and sigma > 0.0):
                raise ValueError("sigma must be a finite number > 0")
            belief = misfit.beliefs[row]
            belief.mean, belief.wide = np.full(belief.mean.shape, misfit.fields[row].map.forward(float(mean))), float(sigma)
        except (TypeError, ValueError) as error:
            raise SceneError(Problem(name, f"prior is {pair}; allowed is (mean, sigma): {error}")) from None


def _tell_field_step(search: FieldSearch, each: Callable[[dict], None] | None) -> None:
    if not each:
        return
    m, (step, time, rms, value, slope, walked) = search.misfit, search.rows[-1]
    first = m.experiments[0]
    each({"step": step, "accepted": True, "frame": round(time * first.scene.fps), "frames": first.last, "rms": rms,
          "value": value, "slope": slope, "simulations": walked,
          "values": {f.name: float(np.median(v)) for f, v in zip(m.fields, m.values(search.theta), strict=True)}})


def _field_fit_result(search: FieldSearch, found: list[ParameterField | NumberField], scenes: list[Scene],
                      seconds: float) -> FieldFit:
    m, sigma = search.misfit, search.sigma if not search.misfit.known else search.least
    given = 1.0 if not m.known or m.unit == "sigma" else m.experiments[0].seen[0].sigma or 1.0
    Y, known = search.proof[1] if search.proof and search.proof[0] is search.theta else m.probe_jacobian(search.theta), {}
    for f, part in zip(found, m.parts(np.linalg.norm(Y, axis=1)), strict=True):
        known[f.name] = _flat_column(part / sigma)
    rms = sqrt(2.0 * search.descent.at.f[0] / max(m.seen.count, 1))
    wide, notes = _widening_by_misfit(search, rms / sigma)
    numbers = [f for f in found if isinstance(f, NumberField)]         # they come first
    bars = theta_deviations(m, search.theta, list(range(len(numbers))), sigma * wide, Y)
    values = dict(zip([f.name for f in found], m.values(search.theta), strict=True))
    for e in m.experiments:
        notes += [w.removeprefix("warning: ") for w in e.sim.warnings if w not in notes]
    notes += [f"the error bar of {n.name} is a lower bound: conjugate gradients did not converge"
              for n, b in zip(numbers, bars, strict=True) if not b.close]
    half = FieldHalfStep(m, search.theta, sigma * wide, Y, bars)
    for f in found:
        scenes = [f.written(s, values[f.name]) if f.belongs_to_scene(s) else s for s in scenes]
    errors = {n.name: NumberErrorBar.of(n.map, float(n.map.forward(values[n.name][0, 0])), b.sigma, d)
              for n, b, d in zip(numbers, bars, half.shifts, strict=True)}
    return FieldFit(found, {name: _flat_column(v) for name, v in values.items()}, known, scenes[0], scenes,
                    search.converged, sigma * given, rms / sigma, float(np.linalg.norm(search.descent.gradient)), search.steps,
                    m.walked, m.launches, round(m.time * m.experiments[0].scene.fps), seconds, search.rows,
                    [*search.notes, *half.notes(), *notes], errors, m.unit,
                    "floor" if sigma <= m.floor else "given" if m.known else "estimated", half)


def _widening_by_misfit(search: FieldSearch, left: float) -> tuple[float, list[str]]:
    """By how much error bars are widened where what is left is no noise, and what is said of it. left: rms over the noise."""
    m = search.misfit
    if not m.known and m.seen.count < 2 * len(search.theta):
        return 1.0, [f"{m.seen.count} numbers were observed for {len(search.theta)} values: give the noise, or what is left "
                     "says little about it"]
    if m.known and left**2 - 1.0 > LOUD * sqrt(2.0 / max(m.seen.count, 1)):
        return left, [f"what is left is {left:.3g} times the noise that was given: the model, or the noise, is not right; "
                      "error bars were widened by that, and are not to be trusted all the same"]
    return 1.0, []


def _flat_column(values: np.ndarray) -> np.ndarray:
    """(n, 1) as (n,)."""
    return values[:, 0] if values.shape[1] == 1 else values
