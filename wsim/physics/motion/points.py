"""Free points and pins: prediction, velocities, where pinned points go. See kernels/motion/points.py for the equations."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion import points as kernels
from wsim.model.model import Model, PointBody, hard_places
from wsim.model.stage import ByWorld, Clock, Method, Methods, Ports, Remedy, Stage, value_of_world
from wsim.model.state import SimulationState
from wsim.model.status import FrameStatus
from wsim.model.structs import fill_struct
from wsim.model.vjp import beside
from wsim.physics.cloth.constraints import AT_REST
from wsim.scene.integrator import Integrator
from wsim.scene.nodal.masses import single_density

if TYPE_CHECKING:
    from wsim.simulation.methods import Build


NOT_FINITE = "points: not finite"        # status word: 1 + row of the last point that is not


def build(b: Build) -> FreePoints:
    struck = None
    if b.reasons["contact"] and b.clock.integrator.memory:
        struck = wp.zeros(b.model.points, dtype=b.model.real, device=b.model.device)
    return FreePoints(b.model, b.state, b.status, struck, b.choice.integrator)


class Euler:
    """Prediction and end of a substep of backward Euler, and of what solves as it does; kernels/motion/points.py.

    moved    vectors a point that both move
    """

    moved = 4, 6

    def __init__(self, points: FreePoints, row: Integrator):
        self.points, self.row, self.model, self.state = points, row, points.model, points.state
        real, module = self.model.real, self.model.module
        self.kernels = {"predict": kernels.euler_prediction_kernel(real, module),
                        "finish": kernels.euler_finish_kernel(real, module)}
        beside(self.model, __name__, "EulerAdjoint", self)
        self.make_kernels(real, module)

    def make_kernels(self, real, module: str) -> None:
        """Further kernels."""

    def launch(self, name: str, inputs: list, outputs: list) -> None:
        self.model.launch(self.kernels[name], self.model.points, inputs, outputs)

    def predict(self, clock: Clock) -> None:
        s, points = self.state, self.points
        self.launch("predict", [points.constants, s.e, s.v, clock.effective_step], [points.anchor, s.d])

    def finish(self, clock: Clock) -> None:
        s = self.state
        self.launch("finish", [self.points.anchor, s.d, s.x, clock.effective_step], [s.x, s.e, s.v])


class ProlongedEuler(Euler):
    """One node before the end of the step (implicit midpoint)."""

    def make_kernels(self, real, module: str) -> None:
        self.kernels["end"] = kernels.beyond_finish_kernel(real, module, self.row.nodes[0])
        self.more = 1.0 / self.row.nodes[0] - 1.0
        self.met = False                  # contacts act where substeps end, and have d and v there

    def meet(self) -> None:
        """Makes what contacts need that act where substeps end."""
        self.met, self.kernels["land"] = True, kernels.point_landing_kernel(self.model.real, self.model.module)

    def surfaces(self) -> None:
        """Makes what surfaces need besides where there are no colliders."""
        self.kernels["prolong"] = kernels.beyond_prolong_kernel(self.model.real, self.model.module, self.row.nodes[0])

    def prolong(self, clock: Clock, ahead: wp.array) -> None:
        """d and v become those of the end of the substep, before contacts; ahead: d."""
        s, w = self.state, self.points.constants.w
        self.launch("prolong", [w, s.e, s.d, s.v, clock.effective_step], [s.d, s.v, ahead])

    def finish(self, clock: Clock) -> None:
        s = self.state
        if self.met and not clock.free:
            return self.launch("land", [s.d, s.x], [s.x, s.e])
        self.launch("end", [s.e, s.d, s.x, s.v, clock.effective_step], [s.x, s.e, s.v])


class Multistep(Euler):
    """BDF2, which begins with a substep of backward Euler."""

    moved = 6, 11

    def make_kernels(self, real, module: str) -> None:
        self.kernels |= {"on": kernels.bdf2_prediction_kernel(real, module), "end": kernels.bdf2_finish_kernel(real, module)}

    def predict(self, clock: Clock) -> None:
        s, points = self.state, self.points
        if clock.carries_history:
            self.launch("on", [points.constants, s.e, s.v, s.s, s.u, clock.effective_step], [points.anchor, s.d])
        else:
            super().predict(clock)

    def finish(self, clock: Clock) -> None:
        s, at = self.state, self.points.at(d=self.state.d, a=self.points.anchor, struck=self.points.struck)
        self.launch("end", [at, clock.h, clock.effective_step], [s.x, s.e, s.v, s.s, s.u])


class Staged(Euler):
    """Two stages of backward Euler, from starts of their own (sdirk3); kernels/motion/sdirk3.py."""

    def make_kernels(self, real, module: str) -> None:
        from wsim.kernels.motion import sdirk3
        self.kernels |= {"stage": sdirk3.stage_finish_kernel(real, module), "step": sdirk3.sdirk3_finish_kernel(real, module)}

    def finish(self, clock: Clock) -> None:
        s, before = self.state, {"s": self.state.s, "u": self.state.u} if clock.ends else {}
        self.launch("step" if clock.ends else "stage", [self.points.at(d=s.d, **before), clock.effective_step],
                    [s.x, s.e, s.v, s.s, s.u])


class FreePoints(Method):
    """Stages predict and finish, and the guard that no position stops being a number."""

    def __init__(self, model: Model, state: SimulationState, status: FrameStatus, struck: wp.array | None,
                 integrator: Integrator):
        super().__init__("points", by_world=True)
        status.reserve(NOT_FINITE)
        self.model, self.state, self.status, self.struck = model, state, status, struck
        self.integrator, self.alike = integrator, integrator.solves == 1 and not integrator.explicit
        self.densities: dict[int, float] = {}         # that were set, by number of the body
        self.held_worlds: Any = None                  # who writes inverse masses anew asks it which worlds are held, (worlds,)
        self.loads: Any = None                        # the method that adds to gravity, see `wsim.physics.motion.loads`
        self.constants = self.tables()
        self.offers = Ports(points=self, constants=self.constants, densities=self.densities)
        self.kernels = {"guard": kernels.not_finite_kernel(model.real, model.module)}
        size = 3 * np.dtype(model.dtype).itemsize * model.points
        if integrator.g:
            self.implicit(size, integrator)
        self.stages.append(Stage("guard", "deform", self.guard, 1, 2 * size, rate="frame", what="not finite"))

    def implicit(self, size: int, integrator: Integrator) -> None:
        """Stages of an implicit integrator; an explicit one (`wsim.physics.motion.explicit`) has its own."""
        file, _, name = integrator.motion.rpartition(".")
        self.euler = Euler(self, integrator)                      # what takes over where the integrator gives way
        self.motion: Euler = getattr(import_module(file), name)(self, integrator)
        what, (first, last) = f"{self.model.points} points", self.motion.moved
        self.stages += [Stage("predict", "predict", self.predict, 1, size * first, what=what),
                        Stage("velocity", "finish", self.finish, 1, size * last, what=what)]

    def tables(self):
        """Inverse masses, object of each point, gravity and air drag of each object."""
        model, t = self.model, types(self.model.real)
        scene, bodies = model.scene, model.bodies
        inverse = 1.0 / model.stack("masses")
        inverse[hard_places(model)] = 0.0
        c = kernels.point_constants(model.real)()
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
        return self.state.a if self.state.has_point_field("a") else self.state.e

    def at(self, **others: wp.array | None):
        """The struct of x, e, v and others, for a launch."""
        s = self.state
        return fill_struct(kernels.point_states(self.model.real), x=s.x, e=s.e, v=s.v, **others)

    def now(self, clock: Clock) -> Euler:
        """Integrator that steps now."""
        return self.motion if clock.integrator is self.integrator else self.euler

    def predict(self, clock: Clock) -> None:
        self.now(clock).predict(clock)

    def finish(self, clock: Clock) -> None:
        self.now(clock).finish(clock)

    def guard(self, clock: Clock) -> None:
        self.model.launch(self.kernels["guard"], self.model.points, [self.state.x, self.state.v],
                          [self.status.word(NOT_FINITE)])

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        bad = int(status.said(NOT_FINITE)[0])
        return [Remedy("refine", part="points", row=bad - 1)] if bad else []

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        """gravity [m/s^2] and air_drag [1/s], of one body or, with path "/", of all; density [kg/m^3], rest_shape, lengths
        [m] of a body, mass [kg] of a net."""
        rows = self.model.rows(path, world)
        bodies = [b for b in self.model.bodies if b.path == path and world in (None, b.world)]
        if name in ("density", "mass"):
            return (self.weigh if name == "density" else self.scale)(bodies, value)
        if name in AT_REST:
            from wsim.physics.cloth.rest_shape import reshape_bodies
            reshape_bodies(self.model, name, value, bodies, self.densities)
            self.send(bodies)
            return bool(bodies)
        if name not in ("gravity", "air_drag") or not rows:
            return False
        array = self.constants.gravity if name == "gravity" else self.constants.decay
        values = array.numpy()
        values[rows] = value.rows(self.model, path) if isinstance(value, ByWorld) else value
        array.assign(values)
        return True

    def connect_ports(self, others: Methods) -> None:
        self.loads = others.ports.loads

    def gravity(self) -> np.ndarray:
        """Gravity of each point [m/s^2], without what loads add, (points, 3)."""
        values = self.constants.gravity.numpy()
        if self.loads:
            values[self.loads.point] = self.loads.own.numpy()
        return values[self.constants.object.numpy()]

    def weigh(self, bodies: list[PointBody], density: float | ByWorld) -> bool:
        """Masses follow the density; False where a body has none (`wsim.scene.nodal.masses.single_density`), or shares points
        with another."""
        if not bodies or self.model.alias is not None or any(single_density(b.source) is None for b in bodies):
            return False
        for b in bodies:
            before = self.densities.get(b.number) or single_density(b.source)
            assert before is not None
            own = float(value_of_world(density, b.world))
            b.masses, self.densities[b.number] = b.masses * (own / before), own
        self.send(bodies)
        return True

    def scale(self, bodies: list[PointBody], mass: float | ByWorld) -> bool:
        """Points of spring nets get this mass [kg] together, in the proportions that they have."""
        if not bodies or self.model.alias is not None or not all(b.source.is_net for b in bodies):
            return False
        for b in bodies:
            b.masses = b.masses * (float(value_of_world(mass, b.world)) / b.masses.sum())
        self.send(bodies)
        return True

    def hold(self, free: np.ndarray, worlds: Iterable[int], held: bool) -> None:
        """Holds all points of worlds where they are, or lets those go that were free. free: inverse masses of one world at the
        start, (points of a world,)."""
        w, each = self.constants.w.numpy(), self.model.points // self.model.worlds
        for world in worlds:
            own = slice(world * each, (world + 1) * each)
            masses = self.model.stack("masses")[own]
            w[own] = 0.0 if held else np.where(free > 0.0, 1.0 / masses, 0.0)
        self.constants.w.assign(w)
        if self.held_worlds is not None:
            now = self.held_worlds.numpy()
            now[list(worlds)] = int(held)
            self.held_worlds.assign(now)

    def send(self, bodies: list[PointBody]) -> None:
        """Uploads their masses."""
        w = self.constants.w.numpy()
        for b in bodies if self.model.alias is None else ():
            w[b.first:b.last] = np.where(w[b.first:b.last] > 0.0, 1.0 / b.masses, 0.0)
        self.constants.w.assign(w)
