"""Misfit of fields and its gradient: one run forward and one backward, whatever the number of values.

    F = F1 / s^2 + F2        F1 = |r|^2 / 2 of the residuals [m] (of the given noise, where there is one: s = 1), F2 of beliefs

    probes   Y = J^T Z / sqrt(k) of k random signs Z, a run backward each: Y Y^T is J^T J in the mean, and the root of its
             diagonal, to 1 / sqrt(2 k), what each value moves of all that is observed (Bekas, Kokiopoulou, Saad 2007)
"""

from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from wsim.fitting.copies import scene_with_named_choices
from wsim.fitting.fields.field import ParameterField
from wsim.fitting.fields.number import NumberField, set_fields_and_numbers
from wsim.fitting.least_squares.noise_floor import observation_noise_floor
from wsim.gradient.gradient import Gradient
from wsim.gradient.recording import Recording
from wsim.scene import Scene, SceneError
from wsim.simulation.simulation import Simulation

PROBES = 16
EPS = 1e-5             # of theta: a run in float64 has rounding of 1e-14 m or so


class RecordedExperiment:
    """One scene with what was seen of it, recorded up to a horizon."""

    def __init__(self, scene: Scene, seen: list, device=None):
        self.scene, self.seen, self.device = scene_with_named_choices(scene, device), seen, device
        self.sim = Simulation(self.scene, device=device, precision="float64", gradients=True)
        for o in seen:
            o.prepare(self.sim.model)
        self.last = max(int(o.frames.max()) for o in seen)
        self.recording: Recording | None = None
        self.given: list[tuple[ParameterField | NumberField, np.ndarray]] = []

    def with_more_substeps(self) -> "RecordedExperiment":
        """The same experiment with half the time step."""
        return RecordedExperiment(replace(self.scene, substeps=2 * self.sim.plan.clock.steps), self.seen, self.device)

    def begin(self, given: list[tuple[ParameterField | NumberField, np.ndarray]], frames: int) -> None:
        """Values for the next run, of so many frames."""
        sim, old = self.sim, self.recording
        if old:
            old.rewind()
            sim.frame = 0
        set_fields_and_numbers(sim, given)
        if old and old.frames == frames:
            wp.copy(old.initial, old.every)            # velocities are a part of it
            old.pose(0)
        if old is None or old.frames != frames or old.shape != old.recorded:
            self.recording = old = None
            sim.plan.clock.starting = True
            self.recording = Recording(sim, frames)
            self.pulls = self.recording.pulls if any(o.unit == "N" for o in self.seen) else None      # or says why not

    def rows(self, frames: int) -> list[tuple[int, int]]:
        """(number of the observation, its row) of all that was seen up to a frame."""
        return [(k, row) for k, o in enumerate(self.seen) for row, f in enumerate(o.frames) if f <= frames]

    def residuals(self, frames: int) -> list[np.ndarray]:
        """Residuals of each of `rows`, over the noise where it is given. Raises SceneError where the run breaks."""
        assert self.recording
        self.recording.run()
        return [self.seen[k].residuals(row, self.at(k, row)[None])[0] / (self.seen[k].sigma or 1.0)
                for k, row in self.rows(frames)]

    def at(self, k: int, row: int) -> np.ndarray:
        """Quantity that an observation is about: positions [m], or forces of a pin [N]."""
        o, recording = self.seen[k], self.recording
        assert recording
        return (recording.positions if o.unit == "m" else recording.reactions)(int(o.frames[row]), o.path)

    def back(self, frames: int, r: list[np.ndarray]) -> Gradient:
        """Gradient of the sum of products of residuals and r."""
        assert self.recording
        by: dict[str, dict[int, dict[str, np.ndarray]]] = {"m": {}, "N": {}}
        for (k, row), each in zip(self.rows(frames), r, strict=True):
            o = self.seen[k]
            bodies = by[o.unit].setdefault(int(o.frames[row]), {})
            bodies[o.path] = bodies.get(o.path, 0.0) + o.back(row, self.at(k, row), each) / (o.sigma or 1.0)
        return self.recording.backward(by["m"], reactions=by["N"])


@dataclass
class ObservedResiduals:
    """Observations that a run has met, with their residuals."""

    count: int = 0                 # residuals
    rms: float = np.inf            # [m], or of the given noise


class AdjointMisfit:
    """F of theta, a flat vector of all fields in the mapped space; `horizon` in frames of the first experiment's rate."""

    def __init__(self, experiments: list[tuple[Scene, list]], fields: list[ParameterField | NumberField], device=None):
        self.experiments = [RecordedExperiment(scene, seen, device) for scene, seen in experiments]
        self.fields, first = fields, self.experiments[0]
        self.owner = {f.name: next(e for e in self.experiments if f.belongs_to_scene(e.scene)) for f in fields}
        self.start = [f.values(self.owner[f.name].sim, first.last) for f in fields]
        self.shapes = [v.shape for v in self.start]
        self.ends = np.cumsum([0, *(v.size for v in self.start)])
        self.known = first.seen[0].sigma is not None
        self.floor = observation_noise_floor([(e.scene, e.seen) for e in self.experiments])
        self.time = max(e.last / e.scene.fps for e in self.experiments)       # [s]
        self.walked, self.launches, self.backward, self.seen = 0.0, 0, 0, ObservedResiduals()

    def set_beliefs(self, means: list[np.ndarray]) -> None:
        """Beliefs about means (values of each field)."""
        self.beliefs = [f.belief_at(self.owner[f.name].sim, f.map.forward(m)) for f, m in zip(self.fields, means, strict=True)]

    def parts(self, theta: np.ndarray) -> list[np.ndarray]:
        """Shares of each field, (n, c)."""
        return [theta[i:j].reshape(s) for i, j, s in zip(self.ends[:-1], self.ends[1:], self.shapes, strict=True)]

    def values(self, theta: np.ndarray) -> list[np.ndarray]:
        return [f.map.inverse(t) for f, t in zip(self.fields, self.parts(theta), strict=True)]

    def theta(self, values: list[np.ndarray]) -> np.ndarray:
        return np.concatenate([f.map.forward(v).ravel() for f, v in zip(self.fields, values, strict=True)])

    @property
    def unit(self) -> str:
        """Unit of noise, as of `wsim.fitting.observations.residuals.Misfit`."""
        found = {o.unit for e in self.experiments for o in e.seen}
        return found.pop() if len(found) == 1 else "sigma"

    def moments(self) -> list[float]:
        """Times [s] at which something was seen."""
        return sorted({f / e.scene.fps for e in self.experiments for o in e.seen for f in o.frames})

    def frames(self, e: RecordedExperiment) -> int:
        """Frames of an experiment that the horizon takes; 0: nothing was seen of it yet."""
        seen = [int(f) for o in e.seen for f in o.frames if f / e.scene.fps <= self.time + 1e-9]
        return max(seen, default=0)

    def look(self, theta: np.ndarray, slope: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """(F1, F2) and their gradients (2, n); inf where a run breaks. Raises SceneError for what cannot be recorded at all."""
        own = [b.look(t) for b, t in zip(self.beliefs, self.parts(theta), strict=True)]
        value, by = np.array([0.0, sum(v for v, _ in own)]), np.zeros((2, len(theta)))
        by[1] = np.concatenate([g.ravel() for _, g in own])
        count = 0
        for e, frames in self.begun(theta):
            try:
                r = e.residuals(frames)
                value[0] += 0.5 * sum(float((each**2).sum()) for each in r)
                count += sum(len(each) for each in r)
                if slope and np.isfinite(value[0]):
                    by[0] += self.chain(e, e.back(frames, r), theta)
            except SceneError as error:
                self.broken = error
                return np.array([np.inf, value[1]]), by
        if not np.isfinite(value[0]):
            value[0] = np.inf
        self.seen = ObservedResiduals(count, float(np.sqrt(2.0 * value[0] / max(count, 1))))
        return value, by

    def begun(self, theta: np.ndarray):
        """The experiments that the horizon takes, ready to run, and its frames."""
        values = dict(zip([f.name for f in self.fields], self.values(theta), strict=True))
        for e in self.experiments:
            frames = self.frames(e)
            if frames:
                e.begin([(f, values[f.name]) for f in self.fields if f.belongs_to_scene(e.scene)], frames)
                self.walked += frames / e.last / len(self.experiments)
                self.launches += 1
                yield e, frames

    def chain(self, e: RecordedExperiment, gradient: Gradient, theta: np.ndarray) -> np.ndarray:
        """Gradient with respect to theta, from a gradient of one experiment."""
        parts = zip(self.fields, self.parts(theta), self.shapes, strict=True)
        return np.concatenate([(f.slope(e.sim, gradient, s) * f.map.slope(t)).ravel() if f.belongs_to_scene(e.scene)
                               else np.zeros(t.size) for f, t, s in parts])

    def probe_jacobian(self, theta: np.ndarray) -> np.ndarray:
        """Y (n, PROBES) with Y Y^T about J^T J: products of J^T with random signs. Raises SceneError where a run breaks."""
        rng, found = np.random.default_rng(self.launches), np.zeros((len(theta), PROBES))
        for e, frames in self.begun(theta):
            sizes = [len(r) for r in e.residuals(frames)]
            for k in range(PROBES):
                signs = [rng.choice([-1.0, 1.0], size) for size in sizes]
                found[:, k] += self.chain(e, e.back(frames, signs), theta)
        self.backward += PROBES
        return found / np.sqrt(PROBES)

    def half_step(self, theta: np.ndarray) -> np.ndarray:
        """J^T (r' - r), r' the residuals with half the time step. Raises SceneError where a run breaks."""
        values, found = dict(zip([f.name for f in self.fields], self.values(theta), strict=True)), np.zeros(len(theta))
        for e, frames in self.begun(theta):
            r, fine = e.residuals(frames), e.with_more_substeps()
            fine.begin([(f, values[f.name]) for f in self.fields if f.belongs_to_scene(e.scene)], frames)
            found += self.chain(e, e.back(frames, [b - a for a, b in zip(r, fine.residuals(frames), strict=True)]), theta)
            self.walked += 2.0 * frames / e.last / len(self.experiments)
        return found

    def gauss_newton(self, theta: np.ndarray, v: np.ndarray) -> np.ndarray:
        """J^T J v: a central difference of residuals along v, and back. Raises SceneError where a run breaks."""
        step = EPS / float(np.abs(v).max())
        ends = [[np.concatenate(e.residuals(frames)) for e, frames in self.begun(theta + s * step * v)] for s in (1.0, -1.0)]
        found = np.zeros(len(theta))
        for (e, frames), ahead, behind in zip(self.begun(theta), *ends, strict=True):
            sizes = np.cumsum([len(r) for r in e.residuals(frames)])[:-1]
            along = np.split((ahead - behind) / (2.0 * step), sizes)
            found += self.chain(e, e.back(frames, along), theta)
        self.backward += 1
        return found
