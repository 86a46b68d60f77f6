"""Free points and pins: prediction, velocities, where pinned points go. See kernels/motion/points.py for the equations."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion import points as kernels
from wsim.model.model import Body, Model, hard_places
from wsim.model.stage import Clock, Method, Remedy, Stage
from wsim.model.state import State
from wsim.model.status import Status
from wsim.model.structs import filled
from wsim.physics.cloth.constraints import AT_REST
from wsim.scene import Springs
from wsim.scene.integrator import Integrator
from wsim.scene.masses import density_of

if TYPE_CHECKING:
    from wsim.simulation.methods import Build


NOT_FINITE = "points: not finite"        # status word: 1 + row of the last point that is not


def build(b: Build) -> Points:
    struck = None
    if b.reasons["contact"] and b.clock.multistep:
        struck = wp.zeros(b.model.points, dtype=b.model.real, device=b.model.device)
    return Points(b.model, b.state, b.status, struck, b.choice.integrator)


class Points(Method):
    """Stages predict and finish, and the guard that no position stops being a number."""

    def __init__(self, model: Model, state: State, status: Status, struck: wp.array | None, integrator: Integrator):
        super().__init__("points")
        status.reserve(NOT_FINITE)
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

    def at(self, **others: wp.array | None):
        """The struct of x, e, v and others, for a launch."""
        s = self.state
        return filled(kernels.states(self.model.real), x=s.x, e=s.e, v=s.v, **others)

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
                              [self.at(d=s.d, a=self.anchor, struck=self.struck), clock.h, clock.g],
                              [s.x, s.e, s.v, s.s, s.u])
        elif clock.staged and clock.k % 2 == 0:
            self.model.launch(self.kernels["stage"], n, [self.at(d=s.d), clock.g], [s.x, s.e, s.v, s.s, s.u])
        elif clock.staged:
            self.model.launch(self.kernels["step"], n, [self.at(d=s.d, s=s.s, u=s.u), clock.g], [s.x, s.e, s.v, s.s, s.u])
        elif clock.beyond:
            self.model.launch(self.kernels["finish_beyond"], n, [s.e, s.d, s.x, s.v, clock.g], [s.x, s.e, s.v])
        else:
            self.model.launch(self.kernels["finish"], n, [self.anchor, s.d, s.x, clock.g], [s.x, s.e, s.v],
                              self.adjoints.get("finish"))

    def guard(self, clock: Clock) -> None:
        self.model.launch(self.kernels["guard"], self.model.points, [self.state.x, self.state.v],
                          [self.status.word(NOT_FINITE)])

    def carriers(self) -> dict[str, Any]:
        from wsim.physics.carrier.carriers import PointCarrier
        return {"points": PointCarrier(self.model, self.state, self)}

    def retry(self, status: Status) -> list[Remedy]:
        bad = int(status.said(NOT_FINITE)[0])
        return [Remedy("refine", part="points", row=bad - 1)] if bad else []

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

    def bear(self, loads) -> None:
        """What `gravity` leaves out, see `wsim.physics.motion.loads`."""
        self.loads = loads

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
