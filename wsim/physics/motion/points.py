"""Free points and pins: prediction, velocities, where pinned points go. See kernels/motion/points.py for the equations."""

from collections.abc import Callable
from math import isfinite
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion import points as kernels
from wsim.model.midnodes import held, spread
from wsim.model.model import Body, Model, hard_places
from wsim.model.stage import NOT_FINITE, Clock, Method, Stage
from wsim.model.state import State
from wsim.physics.cloth.constraints import AT_REST
from wsim.scene import Motion, Pin, Springs
from wsim.scene.integrator import Integrator
from wsim.scene.masses import density_of


class Points(Method):
    """Stages predict and finish, and the guard that no position stops being a number."""

    def __init__(self, model: Model, state: State, status: wp.array, struck: wp.array | None, integrator: Integrator):
        super().__init__("points")
        self.model, self.state, self.status, self.struck = model, state, status, struck
        self.integrator = integrator
        self.densities: dict[int, float] = {}         # that were set, by number of the body
        self.loads: Any = None                        # the method that adds to gravity, see `wsim.physics.motion.loads`
        self.constants = self.tables()
        self.kernels = {"guard": kernels.not_finite(model.real, model.module)}
        size = 3 * np.dtype(model.dtype).itemsize * model.points
        if integrator.g:
            self.implicit(size, integrator)
        self.stages.append(Stage("guard", "deform", self.guard, 1, 2 * size, rate="frame", what="not finite"))

    def implicit(self, size: int, integrator: Integrator) -> None:
        """Stages of an implicit integrator; an explicit one (`wsim.physics.motion.explicit`) has its own."""
        real, module, bdf2 = self.model.real, self.model.module, integrator.name == "bdf2"
        self.kernels |= {"predict": kernels.predict_euler(real, module), "finish": kernels.finish_euler(real, module)}
        self.adjoints: dict[str, Callable] = {}       # by hand
        if self.model.gradients:
            from wsim.physics.motion.points_adjoint import EulerAdjoint
            euler = EulerAdjoint(self.model)
            self.adjoints = {"predict": euler.predict, "finish": euler.finish}
        if integrator.beyond:
            self.kernels |= {"finish_beyond": kernels.finish_beyond(real, module)}
        if integrator.solves > 1:
            from wsim.kernels.motion import sdirk3
            self.kernels |= {"stage": sdirk3.finish_stage(real, module), "step": sdirk3.finish_step(real, module)}
        if bdf2:
            self.kernels |= {"predict_bdf2": kernels.predict_bdf2(real, module),
                             "finish_bdf2": kernels.finish_bdf2(real, module)}
        what = f"{self.model.points} points"
        self.stages += [Stage("predict", "predict", self.predict, 1, size * (6 if bdf2 else 4), what=what),
                        Stage("velocity", "finish", self.finish, 1, size * (11 if bdf2 else 6), what=what)]

    def tables(self):
        """Inverse masses, object of each point, gravity and air drag of each object."""
        model, t = self.model, types(self.model.real)
        scene, bodies = model.scene, model.bodies
        inverse = 1.0 / model.stack("masses")
        inverse[hard_places(model)] = 0.0
        c = kernels.constants(model.real)()
        c.w = model.upload(inverse, t.scalar)
        own = np.repeat([b.number for b in bodies], [b.count for b in bodies])
        rows = model.points if model.by_point else len(bodies)       # gradients of many points are not summed by atomics
        c.object = model.upload((np.arange(rows) if model.by_point else own).astype(np.int32), int)
        c.gravity = model.upload(np.tile(np.asarray(scene.gravity, model.dtype), (rows, 1)), t.vec3)
        c.decay = model.upload(np.full(rows, scene.air_drag, model.dtype), t.scalar)
        return c

    @property
    def anchor(self) -> wp.array:
        """Backward Euler without contacts measures velocity from e itself: no array of its own."""
        return self.state.a if self.state.has("a") else self.state.e

    def predict(self, clock: Clock) -> None:
        s, n = self.state, self.model.points
        if clock.bdf2:
            self.model.launch(self.kernels["predict_bdf2"], n, [self.constants, s.e, s.v, s.s, s.u, clock.g],
                              [self.anchor, s.d])
        else:
            self.model.launch(self.kernels["predict"], n, [self.constants, s.e, s.v, clock.g], [self.anchor, s.d],
                              self.adjoints.get("predict"))

    def finish(self, clock: Clock) -> None:
        s, n = self.state, self.model.points
        if clock.multistep:
            self.model.launch(self.kernels["finish_bdf2"], n,
                              [self.anchor, s.d, s.x, s.e, s.v, self.struck, clock.h, clock.g],
                              [s.x, s.e, s.v, s.s, s.u])
        elif clock.staged and clock.k % 2 == 0:
            self.model.launch(self.kernels["stage"], n, [s.e, s.d, s.x, s.v, clock.g], [s.x, s.e, s.v, s.s, s.u])
        elif clock.staged:
            self.model.launch(self.kernels["step"], n, [s.e, s.d, s.x, s.v, s.s, s.u, clock.g], [s.x, s.e, s.v, s.s, s.u])
        elif clock.beyond:
            self.model.launch(self.kernels["finish_beyond"], n, [s.e, s.d, s.x, s.v, clock.g], [s.x, s.e, s.v])
        else:
            self.model.launch(self.kernels["finish"], n, [self.anchor, s.d, s.x, clock.g], [s.x, s.e, s.v],
                              self.adjoints.get("finish"))

    def guard(self, clock: Clock) -> None:
        self.model.launch(self.kernels["guard"], self.model.points, [self.state.x, self.state.v], [self.status[NOT_FINITE:]])

    def set(self, path: str, name: str, value, world: int | None = None) -> bool:
        """gravity [m/s^2] and air_drag [1/s], of one body or, with path "/", of all; density [kg/m^3], rest_shape, lengths
        [m] of a body, mass [kg] of a net."""
        rows = self.model.rows(path, world)
        bodies = [b for b in self.model.bodies if b.path == path and world in (None, b.world)]
        if name in ("density", "mass"):
            return (self.weigh if name == "density" else self.scale)(bodies, float(value))
        if name in AT_REST:
            from wsim.physics.cloth.rest_shape import reshape
            reshape(self.model, name, value, bodies, self.densities)
            self.send(bodies)
            return bool(bodies)
        if name not in ("gravity", "air_drag") or not rows:
            return False
        array = self.constants.gravity if name == "gravity" else self.constants.decay
        values = array.numpy()
        values[rows] = value
        array.assign(values)
        return True

    def gravity(self) -> np.ndarray:
        """Of each point [m/s^2], without what loads add, (points, 3)."""
        values = self.constants.gravity.numpy()
        if self.loads:
            values[self.loads.point] = self.loads.own.numpy()
        return values[self.constants.object.numpy()]

    def weigh(self, bodies: list[Body], density: float) -> bool:
        """Masses follow the density; False where a body has none (`wsim.scene.masses.density_of`), or shares points with
        another."""
        if not bodies or self.model.alias is not None or any(density_of(b.source) is None for b in bodies):
            return False
        for b in bodies:
            before = self.densities.get(b.number) or density_of(b.source)
            assert before is not None
            b.masses, self.densities[b.number] = b.masses * (density / before), density
        self.send(bodies)
        return True

    def scale(self, bodies: list[Body], mass: float) -> bool:
        """Points of spring nets get this mass [kg] together, in the proportions that they have."""
        if not bodies or self.model.alias is not None or not all(isinstance(b.source, Springs) for b in bodies):
            return False
        for b in bodies:
            b.masses = b.masses * (mass / b.masses.sum())
        self.send(bodies)
        return True

    def send(self, bodies: list[Body]) -> None:
        """Uploads their masses."""
        w = self.constants.w.numpy()
        for b in bodies if self.model.alias is None else ():
            w[b.first:b.last] = np.where(w[b.first:b.last] > 0.0, 1.0 / b.masses, 0.0)
        self.constants.w.assign(w)


class _Pinned:
    """A pin of one world: its places in the arrays and its points in the target's frame."""

    def __init__(self, pin: Pin, body: Body):
        self.pin, self.body, self.motion = pin, body, pin.motion
        self.places, ends = held(body, pin.points)
        self.part = len(pin.points) / len(self.places)       # of stiffness and damping: points between share them
        start = body.source.motion.points(body.source.points[pin.points], 0.0)
        self.locals = spread(pin.places if pin.places is not None else _local(pin.motion, start), ends)

    def targets(self, time: float) -> np.ndarray:
        """Where its points belong at `time` [s], relative to the body's origin [m]."""
        return self.motion.points(self.locals, time) - self.body.origin


def _local(motion: Motion, places: np.ndarray) -> np.ndarray:
    M = motion.at(0.0)
    return np.linalg.solve(M[:3, :3], (places - M[:3, 3]).T).T


def pins_of(model: Model) -> list[_Pinned]:
    """Every pin of every world."""
    return [_Pinned(p, b) for p in model.scene.pins for b in model.bodies if b.path == p.body]


class Pins(Method):
    """Stages pose and, where a step of sdirk3 ends, put (hard pins), hold (soft pins). Targets of a whole frame are computed in
    float64 on the host and uploaded only when a pin moves or was set."""

    def __init__(self, model: Model, state: State, points: Points, explicit: bool = False):
        """explicit: hard pins are moved by the integrator itself, which reads `target` and `columns`."""
        super().__init__("pins")
        self.model, self.state, self.points = model, state, points
        pins = pins_of(model)
        self.groups = {"hard": [p for p in pins if not isfinite(p.pin.stiffness)],
                       "soft": [p for p in pins if isfinite(p.pin.stiffness)]}
        self.place: dict[str, wp.array] = {}
        self.target: dict[str, wp.array] = {}
        self.changed = True
        t, real, module = types(model.real), model.real, model.module
        for kind, group in self.groups.items():
            if group:
                places = np.concatenate([p.places for p in group])
                self.place[kind] = model.upload(places.astype(np.int32), int)
                self.target[kind] = wp.zeros((1, len(places)), dtype=t.vec3, device=model.device,
                                             requires_grad=model.gradients)
        self.explicit = explicit
        if self.groups["hard"] and not explicit:
            self.move = kernels.move_pins(real, module)
            n = self.place["hard"].size
            self.stages.append(Stage("pins", "predict", self.pose, 1, n * 40, what=f"{n} points"))
            if points.integrator.solves > 1:
                from wsim.kernels.motion.sdirk3 import place_pins
                self.place_kernel = place_pins(real, module)
                self.stages.append(Stage("pins placed", "finish", self.put, 1, n * 60, what=f"{n} points"))
        if self.groups["soft"]:
            self.add_soft(t, real, module)

    def add_soft(self, t, real, module) -> None:
        group, n = self.groups["soft"], self.place["soft"].size
        each = [len(p.places) for p in group]
        self.soft = kernels.soft_pins(real)()
        self.soft.point, self.soft.w = self.place["soft"], self.points.constants.w
        self.soft.alpha = self.model.upload(np.repeat([1.0 / (p.part * p.pin.stiffness) for p in group], each), t.scalar)
        self.soft.damping = self.model.upload(np.repeat([p.part * p.pin.damping for p in group], each), t.scalar)
        self.lam = wp.zeros(n, dtype=t.vec3, device=self.model.device)
        self.hold_kernel = kernels.hold_pins(real, module)
        self.stages.append(Stage("soft pins", "solve", self.hold, 1, n * 80, "iteration", f"{n} points"))

    @property
    def moves(self) -> bool:
        """Whether any pin does."""
        return any(p.motion.moves for g in self.groups.values() for p in g)

    def columns(self) -> np.ndarray:
        """Column of the hard target of each point, or -1, (points,)."""
        column = np.full(self.model.points, -1, np.int32)
        if self.groups["hard"]:
            places = self.place["hard"].numpy()
            column[places] = np.arange(len(places))
        return column

    def pose(self, clock: Clock) -> None:
        s = self.state
        row, part = (clock.k + clock.k // 2, 1.0) if clock.staged else (clock.k, clock.part)
        self.model.launch(self.move, self.place["hard"].size,
                          [self.place["hard"], self.target["hard"], s.x, s.e, row, part], [s.d])

    def put(self, clock: Clock) -> None:
        """Behind the last stage of a step."""
        s = self.state
        if clock.staged and clock.k % 2:
            pinned, row = self.place["hard"], clock.k + clock.k // 2 + 1
            self.model.launch(self.place_kernel, pinned.size, [pinned, self.target["hard"], s.x, s.e, s.s, row, 2.0 * clock.h],
                              [s.x, s.e, s.v])

    def hold(self, clock: Clock) -> None:
        s = self.state
        if clock.i == 0:
            self.model.tape.zero(self.lam) if self.model.tape else self.lam.zero_()
        self.model.launch(self.hold_kernel, self.lam.size,
                          [self.soft, self.target["soft"], s.x, self.points.anchor, s.d, self.lam, clock.k, clock.g],
                          [s.d, self.lam])

    def before_frame(self, time: float, clock: Clock) -> None:
        moves = self.moves
        at = {kind: clock.moments(kind == "hard") for kind in self.target}      # a soft pin pulls at the solved positions
        if self.explicit and not moves and not self.groups["soft"]:
            at = {kind: moments[:1] for kind, moments in at.items()}
        if not (moves or self.changed or any(t.shape[0] != len(at[kind]) for kind, t in self.target.items())):
            return
        self.changed = False
        for kind, group in self.groups.items():
            if group:
                values = np.stack([np.concatenate([p.targets(time + moment) for p in group]) for moment in at[kind]])
                if self.target[kind].shape[0] != len(values):
                    self.target[kind] = self.model.upload(values, types(self.model.real).vec3)
                else:
                    self.target[kind].assign(values.astype(self.model.dtype))

    def set(self, path: str, name: str, value, world: int | None = None) -> bool:
        """motion of a pin: a Motion or a (4, 4) matrix; it takes effect with the next frame."""
        hit = [p for g in self.groups.values() for p in g if p.pin.path == path and world in (None, p.body.world)]
        if name != "motion" or not hit:
            return False
        for p in hit:
            p.motion = value if isinstance(value, Motion) else Motion.still(value)
        self.changed = True
        return True
