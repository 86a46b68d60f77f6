"""Parameters of a scene from what was seen of it, and how sure they are.

    result = wsim.fit(scene, "observed.usdc", "stretch,bend")
    print(result.text())
    wsim.save(result.scene, "fitted.usda")

`search` is the method (Levenberg-Marquardt with a growing horizon), `misfit` what it makes small, `estimate_with_errors` what
is known in the end, `doubt` whether what is left looks like noise. Priors act on the mapped space: {"stretch": (500.0, 0.2)} is
a factor e^0.2 about 500 N/m.
"""

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from math import isfinite, sqrt
from time import perf_counter

import numpy as np

from wsim.fitting import parameter as table
from wsim.fitting import shared as sharing
from wsim.fitting.batch import CopiesBatch
from wsim.fitting.fields.field import is_field
from wsim.fitting.fields.fit import fit_fields
from wsim.fitting.least_squares import goodness
from wsim.fitting.least_squares.levenberg_marquardt import NormalPrior
from wsim.fitting.least_squares.search import FitSearch
from wsim.fitting.least_squares.time_step import TimeStepShift, shift_by_half_time_step, unknown_time_step_shift
from wsim.fitting.least_squares.uncertainty import ParameterEstimate, estimate_with_errors
from wsim.fitting.observations.residuals import Misfit, experiments_of
from wsim.fitting.parameter import Parameter
from wsim.scene import Problem, Scene, SceneError


@dataclass(frozen=True)
class Settings:
    """Settings of a fit. Raises SceneError for values out of range."""

    device: str | None = None              # None: the GPU if there is one
    differences: str = "central"           # "central": 1 + 2 p copies; "forward": 1 + p copies, and less is known of curvature
    accuracy: float = 0.0                  # two error bars (of theta) that are enough; 0: what all the data give
    limit: float = 200.0                   # simulations, each copy over the whole horizon counts 1
    state: str | None = None               # file to save to after every step, and to go on from where it is there
    eps: float | None = None               # difference of theta; None: by the solver
    shared: tuple[str, ...] | None = None  # parameters that all experiments share, see `wsim.fitting.shared`; None: all
    copies: int | None = None              # at once at most, where memory is small; the others take turns. None: all
    team: Callable | None = None           # what runs copies, elsewhere say (`wsim.sweep.team`): `make` of `Misfit`

    def __post_init__(self):
        wrong = []
        if self.differences not in ("central", "forward"):
            wrong.append(Problem("differences", f"found {self.differences!r}; allowed are central, forward"))
        if self.copies is not None and self.copies < 2:
            wrong.append(Problem("copies", f"found {self.copies}; allowed are 2 or more"))
        for name in ("accuracy", "limit", "eps"):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and (value > 0.0 or (name == "accuracy" and value == 0.0))):
                least = ">= 0" if name == "accuracy" else "> 0"
                wrong.append(Problem(name, f"found {value}; allowed is a finite number {least}"))
        if wrong:
            raise SceneError(wrong)


@dataclass
class Fit:
    """The result of a fit. `estimate` has it as arrays."""

    parameters: list[Parameter]
    estimate: ParameterEstimate
    scene: Scene                           # the first scene, with what was found
    scenes: list[Scene]
    converged: bool
    sigma: float                           # noise [unit]: estimated, or as given
    misfit: float                          # rms of the residuals at the end over sigma: 1 where the model is right
    steps: int
    simulations: float                     # of the whole horizon: every copy counts, a part as a part
    launches: int                          # batches of copies that were run
    worlds: int                            # copies in each
    frames: int                            # last frame that was used
    seconds: float
    residuals: list[tuple[float, int, float]] = field(default_factory=list)     # time [s], frame, rms [m or sigma]
    notes: list[str] = field(default_factory=list)
    unit: str = "m"                        # of sigma; where positions and forces have one each, "sigma" and 1
    origin: str = "given"                  # of sigma: "given", "estimated", or "floor", below which none is claimed
    half_step: TimeStepShift | None = None  # by how much half the time step shifts the values

    @property
    def values(self) -> dict[str, float]:
        return {p.name: float(v) for p, v in zip(self.parameters, self.estimate.values, strict=True)}

    @property
    def errors(self) -> dict[str, float]:
        """Standard deviations; inf: not identifiable."""
        return {p.name: float(v) for p, v in zip(self.parameters, self.estimate.errors, strict=True)}

    def as_dict(self) -> dict:
        """The result as a dictionary for JSON."""
        e, half = self.estimate, self.half_step or unknown_time_step_shift(len(self.parameters))
        return {"parameters": [{"name": p.name, "value": v, "error": s, "low": a, "high": b, "unit": p.unit,
                                "half_time_step_shift": d if np.isfinite(d) else None,
                                "identifiable": bool(np.isfinite(s)), **({} if p.only is None else {"experiment": p.only + 1})}
                               for p, v, s, a, b, d in zip(self.parameters, e.values, e.errors, e.low, e.high, half.values,
                                                           strict=True)],
                "correlation": e.correlation.tolist(), "singular_values": e.singular.tolist(), "not_identifiable": e.words,
                "converged": self.converged, "sigma": self.sigma, "sigma_unit": self.unit, "sigma_is": self.origin,
                "misfit_over_sigma": self.misfit, "frames": self.frames,
                "simulations": self.simulations, "launches": self.launches, "worlds": self.worlds, "steps": self.steps,
                "seconds": self.seconds, "residuals": self.residuals, "notes": self.notes}

    def text(self) -> str:
        """The result as a table."""
        from wsim.fitting.report import fit_report_text
        return fit_report_text(self)


def fit(scene: Scene, observations, parameters: str | Iterable[str], *, also=(), start: dict[str, float] | None = None,
        priors: dict[str, tuple[float, float]] | None = None, each: Callable[[dict], None] | None = None,
        settings: Settings | None = None):
    """Fits parameters (`wsim.fitting.parameter`), fields such as young[] (`wsim.fitting.fields.field`), or both, of a scene to
    observations (`wsim.fitting.observations.observe`). Returns a `Fit`, where there are fields a `FieldFit`
    (`wsim.fitting.fields.result`), as in `print(fit(scene, [Track("/flag", [1, 2], seen)], "stretch").text())`.

    observations   Track, Scan, Functional, Profile, Pull, Markers objects, or a USD file with sampled points and forces, same
                   paths
    also           further experiments [(scene, observations)] that share the parameters, or those of `settings.shared`
    start          {name: value}; else the scene's present values
    priors         {name: (mean, sigma)}, the mean in the parameter's unit, sigma in the mapped space
    each           called after every step with a dict: step, accepted, frame, frames, values, rms, simulations
    Raises SceneError with everything that is wrong, by prim path.
    """
    began, settings = perf_counter(), settings or Settings()
    experiments = experiments_of(scene, observations, also)
    names = [n.strip() for n in (parameters.split(",") if isinstance(parameters, str) else parameters)]
    if any(is_field(name) for name in names):
        for name in ("shared", "team", "copies"):
            if getattr(settings, name) is not None:
                raise SceneError(Problem(name, "a fit of fields shares all, and runs one copy in this process; leave it out"))
        return fit_fields(experiments, names, start=start, priors=priors, each=each, settings=settings)
    found, scenes = table.parameters_of_names(parameters, [s for s, _ in experiments], start, settings.shared)
    prior = _prior_of_parameters(found, priors or {})
    theta = np.array([_start_theta(p, p.among(scenes)) for p in found])
    misfit = Misfit([(s, seen) for s, (_, seen) in zip(scenes, experiments, strict=True)], found, device=settings.device,
                    differences=settings.differences, eps=settings.eps,
                    make=settings.team or partial(CopiesBatch, device=settings.device, most=settings.copies))
    known = experiments[0][1][0].sigma is not None
    search = FitSearch(misfit, theta, prior, sigma=known, limit=settings.limit, accuracy=settings.accuracy,
                       each=lambda s: _tell_search_step(s, settings, each))
    if settings.state and os.path.exists(settings.state):
        search.resume(settings.state)
    search.run()
    return _result_of_search(search, found, scenes, perf_counter() - began)


def _start_theta(p: Parameter, scenes: list[Scene]) -> float:
    """theta of its value; of several experiments that of the first which has it."""
    value = next(v for v in (p.value(s) for s in scenes) if v is not None)
    return p.map.forward(value)


def _prior_of_parameters(found: list[Parameter], given: dict[str, tuple[float, float]]) -> NormalPrior:
    prior, problems = NormalPrior(np.zeros(len(found)), np.zeros(len(found))), list[Problem]()
    used: set[str] = set()
    for row, p in enumerate(found):
        if believed := sharing.value_given_by_name(p, given):
            name, pair = believed
            used.add(name)
            try:
                mean, sigma = map(float, pair)
                if not (isfinite(sigma) and sigma > 0.0):
                    raise ValueError("sigma must be a finite number > 0")
                prior.mean[row], prior.weight[row] = p.map.forward(mean), 1.0 / sigma**2
            except (TypeError, ValueError) as error:
                problems.append(Problem(name, f"prior is {pair}; allowed is (mean, sigma): {error}"))
    problems += [Problem(name, f"has a prior and is not fitted; fitted are {', '.join(p.name for p in found)}")
                 for name in given if name not in used]
    if problems:
        raise SceneError(dict.fromkeys(problems))
    return prior


def _tell_search_step(search: FitSearch, settings: Settings, each: Callable[[dict], None] | None) -> None:
    if settings.state:
        search.save(settings.state)
    best, misfit = search.best, search.misfit
    if each and best:
        each({"step": search.steps, "accepted": search.accepted, "frame": best.frame, "frames": misfit.lasts[0],
              "values": dict(zip((p.name for p in misfit.parameters), misfit.values(search.theta).tolist(), strict=True)),
              "rms": sqrt(best.misfit / max(best.count, 1)), "simulations": misfit.walked})


def _result_of_search(search: FitSearch, found: list[Parameter], scenes: list[Scene], seconds: float) -> Fit:
    """At the best theta that was run, with what was seen there."""
    best, misfit = search.best, search.misfit
    assert best is not None
    noise = search.noise(best, best.misfit)
    left = sqrt(best.misfit / max(best.count - len(found), 1) / noise)
    doubts = goodness.notes_on_goodness(search, noise, left)
    widened = noise * max(1.0, left)**2
    e = estimate_with_errors(found, best.theta, search.spectrum(best), widened, search.prior.weight)
    half = shift_by_half_time_step(search, e, widened)
    for p, value in zip(found, e.values, strict=True):
        scenes = p.in_all(scenes, float(value))
    sigma = misfit.sigma * sqrt(noise) if search.known else sqrt(noise)
    return Fit(found, e, scenes[0], scenes, search.converged, sigma, left, search.steps, misfit.walked, misfit.launches,
               1 + len(found) * (1 + misfit.central), best.frame, seconds, best.rows,
               [*search.notes, *half.notes(found, e.values), *doubts, *misfit.notes()], misfit.unit,
               goodness.origin_of_noise(search, noise), half)
