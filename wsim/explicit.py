"""Explicit integrators: forces are gathered by points, a launch a substep. See kernels/explicit.py and kernels/corner.py.

Where nothing but springs, elements and hard pins acts, the positions at the start of a frame stay and displacements grow
through it ("frame"); small nets then take a whole frame in one launch of one block. Wind, contacts, soft pins, tethers and
strain limits act on every substep: its positions are committed at its end, and what they changed becomes a velocity.
"""


import numpy as np
import warp as wp

from wsim import frequency
from wsim.choice import needed
from wsim.cloth import Rows, in_worlds
from wsim.gather import Elements, sliced
from wsim.integrator import Integrator
from wsim.kernels import explicit as kernels
from wsim.kernels import spring as kernels_spring
from wsim.kernels.real import types
from wsim.model import Model, edge_lengths
from wsim.stage import RESIDUAL, Clock, Method, Stage
from wsim.state import State
from wsim.topology import incident

MOST = 2.0             # length over rest length from which an edge is suspect
ONE_BLOCK = 2048       # points up to which one block takes the whole frame


class Explicit(Method):
    """Stages of an explicit integrator. `steps`: whether others act within a substep."""

    def __init__(self, model: Model, state: State, points, rows: dict[str, list[Rows]], clock: Clock, steps: bool, pins=None):
        """rows: soft constraints of each body of world 0, by path; pins: the method that knows the hard pins, or None."""
        super().__init__("explicit")
        self.model, self.state, self.points, self.status = model, state, points, points.status
        self.integrator: Integrator = points.integrator
        self.singles, self.rows, self.pins, self.steps = rows, in_worlds(model, rows), pins, steps
        n, t = model.points, types(model.real)
        self.field = None             # function (position, velocity) -> acceleration, for problems of one's own
        self.damped = any(r.tau > 0.0 for r in self.rows)
        springs = [r for r in self.rows if r.kind == "distance"]
        elements = [r for r in self.rows if r.kind != "distance"]
        self.pair, self.carry = (wp.zeros(k * n, dtype=t.vec3, device=model.device) for k in (4, 2))
        self.own = wp.zeros(3 * n, dtype=t.vec3, device=model.device) if self.integrator.stages else None
        self.tables(springs)
        self.elements = [Elements(model, kind, [r for r in elements if r.kind == kind]) for kind in
                         sorted({r.kind for r in elements})]
        self.gather()
        self.make(springs, clock.substeps)
        self.watch()

    # tables

    def tables(self, springs: list[Rows]) -> None:
        """The net: springs interleaved by slices of points, masses, gravity, pins."""
        model, real, constants = self.model, self.model.real, self.points.constants
        self.net = kernels.net(real)()
        for name in ("w", "object", "gravity", "decay"):
            setattr(self.net, name, getattr(constants, name))
        self.net.pin = model.upload(np.full(model.points, -1, np.int32) if self.pins is None else self.pins.columns(), int)
        self.springs = springs
        if not springs:
            return
        start, count, self.place, other, self.row = sliced(np.concatenate([r.ids for r in springs]), model.points)
        self.net.start, self.net.count = model.upload(start, int), model.upload(count, int)
        self.net.other = model.upload(other, int)
        rest, k, damping = self.values()
        self.net.rest, self.net.k = self.send(rest), self.send(k)
        self.net.damping = self.send(damping) if self.damped else None

    def values(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rest length, stiffness and damping of each spring in the order of the rows."""
        k = [np.broadcast_to(1.0 / r.alpha, len(r.ids)) for r in self.springs]
        return (np.concatenate([r.rest for r in self.springs]), np.concatenate(k),
                np.concatenate([r.tau * each for r, each in zip(self.springs, k, strict=True)]))

    def send(self, values: np.ndarray) -> wp.array:
        """Values of the springs, at the entries of the net."""
        spread = np.zeros(len(self.place))
        spread[self.place >= 0] = values[self.row[self.place >= 0]]
        return self.model.upload(spread, self.model.real)

    def gather(self) -> None:
        """Places of each point's forces among the corners of all elements."""
        if not self.elements:
            self.force = None
            return
        model, size = self.model, sum(e.ids.size for e in self.elements)
        self.force = wp.zeros(size, dtype=types(model.real).vec3, device=model.device)
        starts, items = incident(np.concatenate([e.ids.ravel() for e in self.elements])[:, None], model.points)
        self.net.first, self.net.item = model.upload(starts.astype(np.int32), int), model.upload(items, int)
        first = 0
        for e in self.elements:
            e.first, first = first, first + e.ids.size

    # stages

    def make(self, springs: list[Rows], count: int) -> None:
        """Kernels and stages."""
        model, real, module = self.model, self.model.real, self.model.module
        flags = tuple({"springs": bool(springs), "corners": bool(self.elements), "damped": self.damped}.items())
        self.begin, self.commit = kernels.begin(real, module), kernels.commit(real, module)
        self.fused = (model.device.is_cuda and not (self.steps or self.elements or self.integrator.stages)
                 and model.points <= ONE_BLOCK)
        if self.fused:
            self.run = kernels.run(real, model.sweep_module, flags)
        if self.integrator.stages:
            self.part = kernels.stage(real, module, flags, self.field)
        else:
            self.leap = kernels.leap(real, module, flags, self.field)
        what = f"{sum(len(r.ids) for r in springs)} springs, {sum(len(e.ids) for e in self.elements)} elements"
        launches = self.integrator.forces * (1 + len(self.elements))
        size = self.bytes
        if self.steps:
            self.correct, self.settle = kernels.correct(real, module), kernels.settle(real, module)
            self.change = wp.zeros(model.points, dtype=types(real).vec3, device=model.device)
            self.stages = [Stage("start", "pose", self.resume, 2, 0, "frame", "displacements are zero"),
                           Stage(self.integrator.name, "predict", self.predict, launches + 1, size, what=what),
                           Stage("correct", "finish", self.finish, 1, 0, what="what others changed")]
            return
        self.stages = [Stage(self.integrator.name, "predict", self.frame_fused if self.fused else self.frame,
                             4 if self.fused else 3 + count * launches, size * count, "frame", what)]

    def watch(self) -> None:
        """An edge that has more than doubled, or is no number, may be one that an unstable step has thrown: `Simulation`
        repeats the frame with another solver where the scene leaves it the choice, and warns where not."""
        edges = [(b, edge_lengths(b)) for b in self.model.bodies if len(b.edges)]
        if not edges:
            return
        ids = np.concatenate([b.edges[rest > 0.0] for b, rest in edges]).astype(np.int32)
        self.edges = self.model.upload(ids, wp.vec2i)
        self.lengths = self.model.upload(np.concatenate([rest[rest > 0.0] for _, rest in edges]), self.model.real)
        self.stretched = kernels_spring.stretched(self.model.real, self.model.module)
        self.stages.append(Stage("watch", "deform", self.look, 1, len(ids) * 24, "frame", f"{len(ids)} edges"))

    def look(self, clock: Clock) -> None:
        s = self.state
        if len(self.lengths):
            self.model.launch(self.stretched, len(self.lengths), [self.edges, self.lengths, s.x, s.e, MOST],
                              [self.status[RESIDUAL:]])

    @property
    def bytes(self) -> int:
        """Moved by one evaluation of all forces, when every gather hits the cache once."""
        real, n = np.dtype(self.model.dtype).itemsize, self.model.points
        entries = 2 * sum(len(r.ids) for r in self.springs)
        return (entries * (4 + real * (2 + self.damped)) + n * real * (21 + 6 * self.damped) + n * 12
                + sum(e.ids.size * (4 + 3 * 2 * real) for e in self.elements))

    def start(self, clock: Clock) -> None:
        s = self.state
        self.model.launch(self.begin, self.model.points, [s.e, s.v, 0], [self.pair, self.carry, self.own])

    def resume(self, clock: Clock) -> None:
        """As `start`, where others act within substeps: leapfrog goes on from its half step, so that all substeps are alike.
        """
        self.start(clock)
        if self.state.has("b") and not clock.starting:
            wp.copy(self.state.v, self.state.b)

    def forces(self, source: int) -> None:
        """Forces of elements at copy `source` of the displacements."""
        for e in self.elements:
            self.model.launch(e.corners(self.damped), len(e.ids), [e.data, self.state.x, self.pair, source, e.first],
                              [self.force])

    @property
    def stride(self) -> int:
        """Rows of the pins' targets a substep."""
        return int(self.pins is not None and self.pins.moves)

    def step(self, clock: Clock, kick: float, drift: float, source: int):
        s = kernels.steps(self.model.real)()
        s.kick, s.later, s.drift, s.h = kick * clock.h, clock.h, drift * clock.h, clock.h
        s.ahead = 0.5 * clock.h if len(self.integrator.steps) == 2 else 0.0
        s.source, s.count = source, clock.substeps
        s.stride = self.stride
        s.row = clock.k * s.stride
        return s

    def kick(self, clock: Clock, kick: float, drift: float, source: int) -> None:
        s = self.state
        self.forces(source)
        self.model.launch(self.leap, self.model.points,
                          [self.net, self.force, s.x, self.pair, s.v, self.carry, self.step(clock, kick, drift, source)],
                          [self.pair, s.v, self.carry])

    def advance(self, clock: Clock, source: int) -> int:
        """One substep from copy `source`; returns the copy that it ends in. Leapfrog's velocity stays at the half step."""
        m = self.integrator
        if m.stages:
            return self.stage_by_stage(clock, source)
        half = len(m.steps) == 2 and clock.k == 0 and (clock.starting or not self.steps)
        self.kick(clock, 0.5 if half else 1.0, 1.0, source)
        return 1 - source

    def stage_by_stage(self, clock: Clock, source: int) -> int:
        s, coefficients = self.state, self.integrator.stages
        for number, (_, b) in enumerate(coefficients):
            self.forces(source)
            part = kernels.parts(self.model.real)()
            part.last = int(number == len(coefficients) - 1)
            part.reach = 1.0 if part.last else coefficients[number + 1][0]
            part.c, part.b, part.h, part.source = part.reach * clock.h, b * clock.h, clock.h, source
            part.row = clock.k * self.stride
            self.model.launch(self.part, self.model.points,
                              [self.net, self.force, s.x, self.pair, s.v, self.carry, self.own, part],
                              [self.pair, s.v, self.carry, self.own])
            source = 1 - source
        return source

    def read_out(self, clock: Clock, source: int) -> int:
        """Leapfrog's last half kick."""
        if len(self.integrator.steps) < 2:
            return source
        self.kick(clock, 0.5, 0.0, source)
        return 1 - source

    def frame(self, clock: Clock) -> None:
        """All substeps, a launch for each evaluation of the forces."""
        self.start(clock)
        source = 0
        for k in range(clock.substeps):
            clock.k = k
            source = self.advance(clock, source)
        self.close(clock, self.read_out(clock, source))

    def frame_fused(self, clock: Clock) -> None:
        """All substeps in one launch."""
        s = self.state
        self.start(clock)
        clock.k = 0
        half = len(self.integrator.steps) == 2
        self.model.sweep(self.run, [self.net, self.force, s.x, self.pair, s.v, self.carry,
                                    self.step(clock, 0.5 if half else 1.0, 1.0, 0)], [self.pair, s.v, self.carry])
        self.close(clock, self.read_out(clock, clock.substeps % 2))

    def close(self, clock: Clock, source: int) -> None:
        s = self.state
        self.model.launch(self.commit, self.model.points, [self.pair, self.carry, s.x, source], [s.x, s.e])

    def predict(self, clock: Clock) -> None:
        """Where others act on the substep: the displacement goes where they look for it."""
        if clock.k == 0:
            self.at = 0
        s, n = self.state, self.model.points
        self.at = self.advance(clock, self.at)
        wp.copy(s.d, self.pair, 0, self.at * n, n)
        wp.copy(s.a, s.e)

    def finish(self, clock: Clock) -> None:
        s = self.state
        self.model.launch(self.correct, self.model.points, [s.d, s.a, s.e, self.pair, s.x, s.v, clock.h, self.at],
                          [s.x, s.e, s.v, self.pair, self.change])
        if self.own is not None:
            wp.copy(self.own, self.pair, 0, self.at * self.model.points, self.model.points)
        if clock.k == clock.substeps - 1 and len(self.integrator.steps) == 2:
            wp.copy(s.b, s.v)
            self.read_out(clock, self.at)
            self.model.launch(self.settle, self.model.points, [s.b, self.change, s.v, 0.5], [s.v])

    # around a frame

    def before_frame(self, time: float, clock: Clock) -> None:
        if self.pins is not None:
            self.net.target = self.pins.target["hard"]

    def indicators(self, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
        """elastic_energy [J]."""
        from wsim.elastic import energy
        return {"elastic_energy": energy(self.model, self.rows, self.state)}

    def set(self, path: str, name: str, value, world: int | None = None) -> bool:
        """stretch, shear, bend of a cloth, stiffness of a spring net, damping [s] of either where there is some."""
        hit = False
        for r in self.rows:
            if r.body is None or r.body.path != path or world not in (None, r.body.world):
                continue
            if name == "damping" and self.damped:
                r.tau, hit = float(value), True
            elif name in r.stiffness:
                r.stiffness, hit = r.stiffness | {name: np.atleast_1d(np.asarray(value, np.float64))}, True
        if hit:
            self.refresh()
        return hit

    def refresh(self) -> None:
        """Uploads stiffness and damping anew."""
        if self.springs:
            _, k, damping = self.values()
            self.net.k.assign(self.send(k))
            if self.damped:
                self.net.damping.assign(self.send(damping))
        for e in self.elements:
            e.refresh()

    def least(self) -> int:
        """Substeps that keep the present stiffness stable."""
        omega, c = frequency.bound(self.model, self.singles)
        return needed(self.model.scene, self.integrator, omega, c)
