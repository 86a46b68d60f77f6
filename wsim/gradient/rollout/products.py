"""A recording as a function of named inputs, y = f(p), and products with its derivatives, for identification and control.

    run              y, positions [m] and velocities [m/s] of all bodies after the chosen frames
    vjp              J^T s                exact: one backward pass
    jvp              J d                  differences of perturbed copies, all in one batch
    gauss_newton     J^T W J d            of both: one batch, one backward pass
    hvp              H d, H = d2L/dp2     differences of exact gradients

Differences are extrapolated (`wsim.gradient.rollout.richardson`), of order 12 and 6; where a value stands at the end of what it
may be, such as a friction of 0, they are from the other side alone, of order 11 and 5, and `DerivativeProduct.said` says so.
`DerivativeProduct.error` is an estimate, and no bound. Of `jvp` it was 0.6 to 3 times the true error, which was 3e-9 to 1e-14
(chains, sheets, soft bodies; leapfrog, XPBD, Newton's method; two frames, each input alone); of `hvp`, 1e-6 to 1e-13, it was up
to 500 times too large. Both presume that the scheme is smooth within the step; where it is not, the estimate is large. Worlds
share their colliders: copies that differ in where one is run one after the other.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wsim.gradient.inputs.by_name import RecordingInput, inputs_by_name, require_stable_substeps
from wsim.gradient.recording import Recording
from wsim.gradient.rollout.richardson import richardson_derivative, richardson_offsets, richardson_order
from wsim.scene import Problem, SceneError
from wsim.simulation.simulation import Simulation

Values = dict[str, np.ndarray]
SIZES = 6              # step sizes of `jvp`: twice as many copies of the scene
FEW = 3                # of `hvp`: twice as many runs forward and backward,
NEAR = 1.0 / 16.0           # with steps smaller by this: gradients are right to 1e-11 or better, and order 6 needs no more


@dataclass
class DerivativeProduct:
    """A product and its error, relative in the 2-norm: of `jvp` an array and (2,) for positions and velocities, else both by
    name of the input. order: of the differences; said: of what side they are, and why."""

    value: Any
    error: Any
    order: int
    said: str


class Rollout:
    """A recording as a function of the inputs of these names (`wsim.gradient.inputs.by_name`).

    frames   after which positions and velocities are given, 0 the start; None: each from 1 on
    Motions y and seeds s are float64 (2, frames, points, 3): positions, velocities; points of all bodies behind each other, in
    the author's order (`part` says where a body is); of several worlds (worlds, 2, frames, points, 3). Values p are
    dictionaries by name. Raises SceneError with all names that are none.
    """

    def __init__(self, recording: Recording, names, frames=None):
        self.recording, self.sim = recording, recording.sim
        self.inputs: dict[str, RecordingInput] = inputs_by_name(recording, list(names))
        self.frames = list(range(1, recording.frames + 1)) if frames is None else [int(f) for f in frames]
        if not self.frames or min(self.frames) < 0 or max(self.frames) > recording.frames \
                or len(set(self.frames)) < len(self.frames):
            raise SceneError(Problem("frames", f"found {frames}; allowed are 0 to {recording.frames}, each once"))
        bodies, worlds = self.sim.model.bodies, range(self.sim.worlds)
        self.index = np.stack([np.concatenate([b.index for b in bodies if b.world == w]) for w in worlds])    # (worlds, points)
        first = [b for b in bodies if b.world == 0]
        self.origin = np.concatenate([np.tile(b.origin, (len(b.index), 1)) for b in first])                 # (points, 3) [m]
        ends = np.cumsum([0, *(len(b.index) for b in first)])
        self.parts = {b.path: slice(*ends[k:k + 2].tolist()) for k, b in enumerate(first)}
        self.copied: dict[int, Rollout] = {}

    def part(self, path: str | None = None) -> slice:
        """Places of the points of a body; None: of the only one."""
        return self.parts[self.sim.model.body(path).path]

    @property
    def shape(self) -> tuple[int, ...]:
        worlds, points = self.index.shape
        return (*[worlds] * (worlds > 1), 2, len(self.frames), points, 3)

    # values and runs

    def values(self) -> Values:
        """Values of the inputs now, of the first world."""
        return {name: i.read_value() for name, i in self.inputs.items()}

    def write(self, values: dict) -> None:
        """Sets some of the inputs. Raises SceneError for names and shapes that are none, and where explicit steps would have to
        be shorter than those recorded; other values may be written then."""
        if wrong := values.keys() - self.inputs.keys():
            raise SceneError(Problem("inputs", f"found {', '.join(sorted(wrong))}; there are {', '.join(self.inputs)}"))
        for name, value in values.items():
            self.inputs[name].write_value(value)
        require_stable_substeps(self.recording, values)

    def run(self, values: dict | None = None) -> np.ndarray:
        """y of these values, of those not given as they are."""
        self.write(values or {})
        self.recording.run()
        return self.motion()

    def motion(self) -> np.ndarray:
        """y of the last run."""
        r = self.recording
        x, e, v = (a.numpy()[self.frames].astype(np.float64)[:, self.index] for a in (r.states, r.rests, r.speeds))
        y = np.stack([x + e + self.origin, v])
        return np.moveaxis(y, 2, 0).reshape(self.shape)

    # first derivatives

    def vjp(self, seeds: np.ndarray, shapes: dict | None = None) -> Values:
        """J^T s by name, at the values of the last run: exact for the scheme that ran, as `Recording.backward`. shapes: of the
        values that gradients are wanted by, where they are not those of `values`: one of each element, say."""
        seeds = np.asarray(seeds, np.float64)
        if seeds.shape != self.shape:
            raise SceneError(Problem("seeds", f"found shape {seeds.shape}; allowed is {self.shape}"))
        s = seeds.reshape(-1, *self.shape[-4:])
        given = [{frame: {path if len(s) == 1 else (path, w): each[kind, k, part] for w, each in enumerate(s)
                          for path, part in self.parts.items()}
                  for k, frame in enumerate(self.frames) if s[:, kind, k].any()} for kind in (0, 1)]
        return self.of(self.recording.backward(*given), shapes)

    def of(self, gradient, shapes: dict | None = None) -> Values:
        """Gradients of the inputs, by name; shapes: as `vjp`."""
        found = {}
        for name, i in self.inputs.items():
            shape = tuple((shapes or {}).get(name, i.read_value().shape))
            own = shape in i.value_shapes()                     # else of each world
            each = [i.gradient(gradient, w, shape if own else shape[1:]) for w in range(self.sim.worlds)]
            found[name] = np.asarray(np.sum(each, axis=0)) if own else np.stack(each)
        return found

    def jvp(self, direction: dict, step: float | None = None) -> DerivativeProduct:
        """J d at the present values, (2, frames, points, 3), with d by name, and (2,) errors. step: the largest multiple of d
        that is taken; None: one that moves no input by more than a part of it (`RecordingInput.scale`)."""
        d, step = self.direction(direction, step)
        side, said = self.side(d, step)
        base, at = self.values(), step * richardson_offsets(SIZES, side)
        y = self.run_varied_copies({name: base[name] + np.multiply.outer(at, each) for name, each in d.items()}, len(at))
        found = [richardson_derivative(y[:, kind], step, side) for kind in (0, 1)]
        return DerivativeProduct(np.stack([value for value, _ in found]), np.array([error for _, error in found]),
                                 richardson_order(SIZES, side), said)

    def run_varied_copies(self, rows: Values, count: int) -> np.ndarray:
        """Motions of so many copies in float64, (count, *shape). rows: values of some inputs, (count, ...) by name; the others
        are as they are. In one batch of worlds; where these share what varies, one after the other."""
        base, alone = self.values(), any(self.inputs[name].shared for name in rows)
        copies = self.copies(1 if alone else count)

        def run_copies_with_values(varied: Values) -> np.ndarray:
            for name, value in {**base, **varied}.items():
                copies.inputs[name].write_value(value)
            return copies.run()
        return np.stack([run_copies_with_values({name: value[k] for name, value in rows.items()})
                         for k in range(count)]) if alone else run_copies_with_values(rows)

    def gauss_newton(self, direction: dict, weights=1.0, step: float | None = None) -> DerivativeProduct:
        """J^T W J d at the present values; weights: the diagonal of W, of any shape that broadcasts to that of a motion. The
        error is that of J d, the larger of its two: J^T W is exact."""
        inner = self.jvp(direction, step)
        self.recording.run()
        W = np.broadcast_to(weights, self.shape)
        value = self.vjp(W * inner.value, {name: np.shape(each) for name, each in direction.items()})
        return DerivativeProduct(value, dict.fromkeys(value, float(np.max(inner.error))), inner.order, inner.said)

    # second derivatives

    def hvp(self, direction: dict, slope: Callable[[np.ndarray], np.ndarray], step: float | None = None) -> DerivativeProduct:
        """H d by name, of the loss L(f(p)) at the present values; slope(y): dL/dy, such as `lambda y: y - wanted`. Six runs
        forward and backward one after the other; the inputs are left as they were. step: as `jvp`. Needs float64."""
        if self.sim.precision != "float64":
            raise SceneError(Problem("precision", f"found {self.sim.precision}; second derivatives need Simulation(scene, "
                                     "precision=\"float64\", gradients=True)"))
        d, step = self.direction(direction, step, NEAR)
        side, said = self.side(d, step)
        base, shapes = self.values(), {name: each.shape for name, each in d.items()}
        rows: list[Values] = []
        try:
            for s in step * richardson_offsets(FEW, side):
                for name, each in d.items():
                    self.inputs[name].write_value(base[name] + s * each)
                self.recording.run()
                rows.append(self.vjp(slope(self.motion()), shapes))
        finally:
            for name in d:
                self.inputs[name].write_value(base[name])
        found = {name: richardson_derivative(np.stack([g[name] for g in rows]), step, side) for name in self.inputs}
        return DerivativeProduct({name: value for name, (value, _) in found.items()},
                                 {name: error for name, (_, error) in found.items()}, richardson_order(FEW, side), said)

    # directions and copies

    def direction(self, given: dict, step: float | None, part: float = 1.0) -> tuple[Values, float]:
        """The direction, and the largest step along it, if not given a part of what the inputs allow."""
        if self.sim.worlds > 1:
            raise SceneError(Problem("worlds", f"found {self.sim.worlds}; products by differences need one"))
        if (wrong := given.keys() - self.inputs.keys()) or not given:
            raise SceneError(Problem("direction", f"found {', '.join(sorted(wrong)) or 'none'}; there are "
                                     f"{', '.join(self.inputs)}"))
        d = {name: self.inputs[name].values_by_world(value)[0] for name, value in given.items()}
        most = {name: float(np.abs(each).max(initial=0.0)) for name, each in d.items()}
        if not any(most.values()):
            raise SceneError(Problem("direction", "is zero"))
        return d, step or part * min(self.scale(name) / size for name, size in most.items() if size)

    def scale(self, name: str) -> float:
        """`RecordingInput.scale`. Raises SceneError where it is none."""
        found = self.inputs[name].difference_scale()
        if not found > 0.0:
            raise SceneError(Problem(name, "is 0 in some of its values, so that a part of it is no step; give the step of a "
                                     "product, or the spread of a verdict"))
        return found

    def side(self, d: Values, step: float) -> tuple[int, str]:
        """Side from which differences can be (`wsim.gradient.rollout.richardson.richardson_offsets`), and that in words. Raises
        SceneError where there is none."""
        base = self.values()
        ahead, behind = ([name for name, each in d.items() if not self.inputs[name].allows_value(base[name] + s * step * each)]
                         for s in (1.0, -1.0))
        if not (ahead or behind):
            return 0, "from both sides"
        name = (ahead or behind)[0]
        low, high = self.inputs[name].bounds()
        if ahead and behind:
            size = step * float(np.abs(d[name]).max())
            other = "" if set(ahead) & set(behind) else ", or take the product with each input by itself"
            raise SceneError(Problem(name,
                                     f"is {range_in_words(base[name])}, and a step of {size:.3g} along the direction leaves "
                                     f"{low:g} to {high:g}, which is allowed, or takes {(behind or ahead)[0]} out of what is; "
                                     f"give a smaller step{other}"))
        return -1 if ahead else 1, f"from one side: {name} is {range_in_words(base[name])}, and allowed is {low:g} to {high:g}"

    def copies(self, worlds: int = 2 * SIZES) -> "Rollout":
        """Simulation of as many worlds of the same start, scheme and live parameters, in float64."""
        if worlds not in self.copied:
            self.copied[worlds] = Rollout(float64_copy_of_recording(self.recording, worlds), list(self.inputs), self.frames)
        resume_copies(self.recording, self.copied[worlds].recording)
        return self.copied[worlds]


def range_in_words(values: np.ndarray) -> str:
    """Values in words."""
    low, high = float(np.min(values)), float(np.max(values))
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"


def float64_copy_of_recording(recording: Recording, worlds: int) -> Recording:
    """A recording of so many worlds of the same scene by the same scheme, in float64."""
    sim, clock, choice = recording.sim, recording.plan.clock, recording.plan.choice
    scene = replace(sim.scene, solver=choice.solver, integrator=choice.integrator.name,
                    substeps=clock.substeps // choice.integrator.solves, iterations=choice.iterations)
    copy = Simulation(scene, device=sim.device, precision="float64", worlds=worlds, gradients=True)
    other = copy.plan.clock
    copy.frame, other.integrator, other.starting = recording.start, clock.integrator, recording.begins
    _copy_live_parameters(sim, copy)
    return Recording(copy, recording.frames)


def resume_copies(recording: Recording, copy: Recording) -> None:
    """Gives every world of a copy the start and the live parameters of a recording."""
    one, worlds = recording.initial.numpy().astype(np.float64), copy.sim.worlds
    fields = one.reshape(-1, 1, recording.sim.model.points, 3)
    copy.initial.assign(np.tile(fields, (1, worlds, 1, 1)).reshape(-1, 3))
    parts = ([part for part in r.sim.state.parts.values() if part.name != "points"] for r in (recording, copy))
    for own, other, (_, start), (_, into) in zip(*parts, recording.flowed, copy.flowed, strict=True):
        values, given = into.numpy(), start.numpy()
        for b in (b for b in copy.sim.model.bodies if (b.path, b.world) in other.rows):
            values[other.rows[b.path, b.world]] = given[own.rows[b.path, 0]]
        into.assign(values)
    _copy_live_parameters(recording.sim, copy.sim)


def _copy_live_parameters(sim: Simulation, copy: Simulation) -> None:
    for path, name, value, world in sim.changes:
        if world in (None, 0) and name not in ("motion", "positions", "velocities"):
            for method in copy.plan.methods:
                method.set_value(path, name, value, None)
    pins, others = sim.plan.ports.pins, copy.plan.ports.pins
    if pins and others:
        for kind, group in others.groups.items():
            own = {p.pin.path: p for p in pins.groups[kind]}
            for p in group:
                p.motion = own[p.pin.path].motion
        others.changed = True
    contacts = sim.plan.ports.contacts
    for collider in contacts.rows.colliders if contacts else ():
        copy.plan.ports.contacts.move(collider.path, collider.motion)
