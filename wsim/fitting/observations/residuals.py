"""Residuals of a fit and their derivatives, by copies of the scene that differ along one direction of theta each.

    r       (simulated - observed) sqrt(weight) / sigma         J = dr/dtheta        theta: parameters in the mapped space
    central   1 + 2 p copies:  J b = (r+ - r-) / 2 h,  K = (r+ - 2 r + r-) / h^2, the second derivative along b
    forward   1 + p copies:    J b = (r+ - r) / h, no K

b, h: directions and steps (`DifferenceSteps`), at first the axes and eps.

A `Misfit` walks through time, so that who asks can stop early. `residuals` and `jacobian` are the whole walk: the seam at which
another way to the derivatives (an adjoint) may stand.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from wsim.fitting.batch import CopiesBatch, observations_by_time
from wsim.fitting.least_squares.noise_floor import observation_noise_floor
from wsim.fitting.observations import observe
from wsim.fitting.observations.observed_usd import read
from wsim.fitting.parameter import Parameter
from wsim.scene import Scene, SceneError

EPS = {"none": 1e-5, "explicit": 1e-5, "xpbd": 1e-5, "implicit": 1e-3}
                       # of theta, by solver. A sheet after 1 s has rounding of 1e-14 m
                       # in float64; Newton steps, which stop at a residual, leave 3e-8 m


@dataclass
class ResidualBlock:
    """Residuals of what was seen at one moment."""

    time: float                   # [s]
    frame: int
    r: np.ndarray                 # (m,)
    J: np.ndarray | None = None   # (m, parameters)
    K: np.ndarray | None = None   # (m, directions)


@dataclass
class DifferenceSteps:
    """Along which directions of theta differences are taken, and how far."""

    B: np.ndarray                 # orthonormal columns, (parameters, directions)
    h: np.ndarray                 # of theta, (directions,); of forward differences of either sign

    @staticmethod
    def axes(count: int, eps: float) -> "DifferenceSteps":
        return DifferenceSteps(np.eye(count), np.full(count, eps))


class Misfit:
    """Residuals of experiments [(scene, observations)] with parameters that they share."""

    def __init__(self, experiments: list[tuple[Scene, list]], parameters: list[Parameter], *, device=None,
                 differences: str = "central", eps: float | None = None, make: Callable | None = None):
        """eps: of theta; None: by the solver, see EPS. make(experiments, parameters, copies): what runs so many copies, a
        `wsim.fitting.batch.CopiesBatch` or what does the same."""
        self.experiments, self.parameters = experiments, parameters
        self.make: Callable = make or partial(CopiesBatch, device=device)
        self.central = differences == "central"
        self.batches: dict[int, Any] = {}
        self.walked, self.launches = 0.0, 0             # whole simulations of one copy; batches begun
        self.substeps: list[int] = []                   # substeps of a frame in each experiment, in the last walk
        self.events = observations_by_time(experiments)
        self.moments = [time for time, _ in self.events]
        solvers = self.of(1 + len(parameters) * (1 + self.central)).solvers
        self.eps = eps or max(EPS[name] for name in solvers)
        self.lasts = [max(int(o.frames.max()) for o in seen) for _, seen in experiments]
        self.floor = observation_noise_floor(experiments)

    @property
    def unit(self) -> str:
        """Unit of noise: "m" or "N"; "sigma" where both were observed, each with its own."""
        found = {o.unit for _, seen in self.experiments for o in seen}
        return found.pop() if len(found) == 1 else "sigma"

    @property
    def sigma(self) -> float:
        """Noise as given [unit], of several the root of the mean square; 1 where none is given, or units differ."""
        if self.unit == "sigma":
            return 1.0
        return float(np.sqrt(np.mean([(o.sigma or 1.0)**2 for _, seen in self.experiments for o in seen])))

    def of(self, copies: int):
        """Batch of so many copies of every experiment, made once for each number."""
        if copies not in self.batches:
            self.batches[copies] = self.make(self.experiments, self.parameters, copies)
        return self.batches[copies]

    def notes(self) -> list[str]:
        """Warnings of the simulations."""
        return list(dict.fromkeys(text for batch in self.batches.values() for text in batch.notes()))

    def values(self, theta: np.ndarray) -> np.ndarray:
        """Parameters of theta, in their units."""
        return np.array([p.map.inverse(float(t)) for p, t in zip(self.parameters, theta, strict=True)])

    def worlds(self, theta: np.ndarray, steps: DifferenceSteps | None) -> np.ndarray:
        """theta of every copy, (worlds, parameters)."""
        if steps is None:
            return theta[None]
        along = (steps.B * steps.h).T
        return np.concatenate([theta[None], theta + along, *([theta - along] if self.central else [])])

    def walk(self, theta: np.ndarray, derivatives: bool = True, steps: DifferenceSteps | None = None,
             finer: int = 1) -> Iterator[ResidualBlock]:
        """Moment by moment; steps: None: along the axes; finer: factor on the substeps of the last walk, in copies made
        for it. Raises Broken where a copy is not finite any more; the walk may be left at any moment."""
        steps = (steps or DifferenceSteps.axes(len(self.parameters), self.eps)) if derivatives else None
        each = self.worlds(np.asarray(theta, np.float64), steps)
        batch = self.of(len(each)) if finer == 1 else self.make(self.experiments, self.parameters, len(each))
        least = batch.begin(np.array([self.values(row) for row in each]))
        if finer == 1:
            self.substeps = least
        batch.take([finer * n for n in self.substeps])
        self.launches += len(self.experiments)
        at = [0] * len(self.experiments)
        for number, (moment, seen) in enumerate(self.events):
            r = batch.residuals(number)
            for k, frame, _, _ in seen:
                self.walked += finer * len(each) * (frame - at[k]) / self.lasts[k] / len(at)
                at[k] = frame
            yield self.part(moment, frame, r, steps)

    def part(self, time: float, frame: int, r: np.ndarray, steps: DifferenceSteps | None) -> ResidualBlock:
        if steps is None:
            return ResidualBlock(time, frame, r[0])
        p = len(steps.h)
        ahead = r[1:p + 1] - r[0]
        if not self.central:
            return ResidualBlock(time, frame, r[0], (ahead.T / steps.h) @ steps.B.T)
        behind = r[p + 1:] - r[0]
        slope, bend = (ahead - behind).T / (2.0 * steps.h), (ahead + behind).T / steps.h**2
        return ResidualBlock(time, frame, r[0], slope @ steps.B.T, bend)

    # all at once

    def residuals(self, theta: np.ndarray) -> np.ndarray:
        """All residuals, (m,)."""
        return np.concatenate([part.r for part in self.walk(theta, derivatives=False)])

    def jacobian(self, theta: np.ndarray) -> np.ndarray:
        """Derivatives of all residuals, (m, parameters)."""
        return np.concatenate([part.J for part in self.walk(theta) if part.J is not None])


def experiments_of(scene: Scene, observations, also) -> list[tuple[Scene, list]]:
    """Scenes, each with its observations; those that are files are read. Raises SceneError with all that is wrong."""
    found, problems = [], []
    for one, seen in [(scene, observations), *also]:
        try:
            seen = read(seen, one) if isinstance(seen, str) or hasattr(seen, "__fspath__") else list(seen)
        except SceneError as error:
            problems += error.problems
            continue
        problems += observe.problems_of_observations(seen, one)
        found.append((one, seen))
    problems += observe.problems_of_mixed_noise([o for _, seen in found for o in seen])
    if problems:
        raise SceneError(problems)
    return found
