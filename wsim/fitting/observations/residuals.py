"""Residuals of a fit and their derivatives, by copies of the scene that differ along one direction of theta each.

    r       (simulated - observed) sqrt(weight) / sigma         J = dr/dtheta        theta: parameters in the mapped space
    central   1 + 2 p copies:  J b = (r+ - r-) / 2 h,  K = (r+ - 2 r + r-) / h^2, the second derivative along b
    forward   1 + p copies:    J b = (r+ - r) / h, no K

b, h: directions and steps (`Steps`), at first the axes and eps.

A `Misfit` walks through time, so that who asks can stop early. `residuals` and `jacobian` are the whole walk: the seam at which
another way to the derivatives (an adjoint) may stand.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wsim.fitting.copies import Broken, Copies
from wsim.fitting.least_squares.noise_floor import floor
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
class Steps:
    """Along which directions of theta differences are taken, and how far."""

    B: np.ndarray                 # orthonormal columns, (parameters, directions)
    h: np.ndarray                 # of theta, (directions,); of forward differences of either sign

    @staticmethod
    def axes(count: int, eps: float) -> "Steps":
        return Steps(np.eye(count), np.full(count, eps))


class Misfit:
    """Residuals of experiments [(scene, observations)] with parameters that they share."""

    def __init__(self, experiments: list[tuple[Scene, list]], parameters: list[Parameter], *, device=None,
                 differences: str = "central", eps: float | None = None):
        """eps: of theta; None: by the solver, see EPS."""
        self.experiments, self.parameters, self.device = experiments, parameters, device
        self.central = differences == "central"
        self.copies: dict[int, list[Copies]] = {}
        self.walked, self.launches = 0.0, 0             # whole simulations of one copy; batches begun
        self.events: dict[float, list] = {}             # what was seen at each time [s]: (experiment, frame, observation, row)
        for k, (scene, seen) in enumerate(experiments):
            for o in seen:
                for row, f in enumerate(o.frames):
                    self.events.setdefault(int(f) / scene.fps, []).append((k, int(f), o, row))
        self.moments = sorted(self.events)
        solvers = [c.sim.plan.choice.solver for c in self.of(1 + len(parameters) * (1 + self.central))]
        self.eps = eps or max(EPS[name] for name in solvers)
        self.lasts = [max(int(o.frames.max()) for o in seen) for _, seen in experiments]
        self.floor = floor(experiments)

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

    def of(self, worlds: int) -> list[Copies]:
        """Copies of every experiment, made once for each number of worlds."""
        if worlds not in self.copies:
            self.copies[worlds] = [Copies(scene, self.parameters, worlds, self.device) for scene, _ in self.experiments]
            for copies, (_, seen) in zip(self.copies[worlds], self.experiments, strict=True):
                for o in seen:
                    o.prepare(copies.sim.model)
        return self.copies[worlds]

    def notes(self) -> list[str]:
        """Warnings of the simulations."""
        found = []
        for c in (c for each in self.copies.values() for c in each):
            found += [w.removeprefix("warning: ") for w in c.warnings]
            if c.substeps != c.scene.substeps:
                found.append(f"the stiffest copies needed {c.substeps} explicit substeps a frame, not "
                             f"{c.scene.substeps}: all took them")
        return list(dict.fromkeys(found))

    def values(self, theta: np.ndarray) -> np.ndarray:
        """Parameters of theta, in their units."""
        return np.array([p.map.inverse(float(t)) for p, t in zip(self.parameters, theta, strict=True)])

    def worlds(self, theta: np.ndarray, steps: Steps | None) -> np.ndarray:
        """theta of every copy, (worlds, parameters)."""
        if steps is None:
            return theta[None]
        along = (steps.B * steps.h).T
        return np.concatenate([theta[None], theta + along, *([theta - along] if self.central else [])])

    def walk(self, theta: np.ndarray, derivatives: bool = True, steps: Steps | None = None) -> Iterator[ResidualBlock]:
        """Moment by moment; steps: None: along the axes. Raises Broken where a copy stops being a number; the walk may be left
        at any moment."""
        steps = (steps or Steps.axes(len(self.parameters), self.eps)) if derivatives else None
        each = self.worlds(np.asarray(theta, np.float64), steps)
        copies = self.of(len(each))
        values = np.array([self.values(row) for row in each])
        for c in copies:
            c.begin(values)
        self.launches += len(copies)
        at = [0] * len(copies)
        for moment in self.moments:
            rows = []
            for k, frame, seen, row in self.events[moment]:
                copies[k].to(frame)
                self.walked += len(each) * (frame - at[k]) / self.lasts[k] / len(copies)
                at[k] = frame
                residual = seen.residuals(row, copies[k].look(seen)) / (seen.sigma or 1.0)
                if not np.isfinite(residual).all():
                    raise Broken(frame, f"the misfit of {seen.path} is no number")
                rows.append(residual)
            yield self.part(moment, frame, np.concatenate(rows, axis=1), steps)

    def part(self, time: float, frame: int, r: np.ndarray, steps: Steps | None) -> ResidualBlock:
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
        problems += observe.wrong(seen, one)
        found.append((one, seen))
    problems += observe.mixed([o for _, seen in found for o in seen])
    if problems:
        raise SceneError(problems)
    return found
