"""Forces of pins on what they hold [N], in the world, at the end of a frame.

    hard    R = m (a + k v - g) - f(x, v)          soft    R = s (X - x) - c v

f     elastic, damping and wind forces and loads on the point; k v drag of the air, s and c stiffness and damping of a soft pin
a     (X(t + dt) - 2 X(t) + X(t - dt)) / dt^2 of where the pin puts the point, dt a frame: of a motion that is given frame
      by frame its acceleration, to second order; past its ends a motion stands still

What a hanging weight pulls is m g; summed over all pins R is what momentum does not have from gravity, air and loads: to
rounding for leapfrog between frames of one substep (by the trapezoid), for backward Euler as far as its residual. f is the law
of the material at the state that is there: an unconverged solver (XPBD of few sweeps) has moved points by other forces.
Contacts do not move what is pinned hard and take no part. Where two pins hold one point, each says all of it.
Pins of rods: wsim/physics/rods/forces.py.
"""

import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.solver import newton_adjoint
from wsim.model.midnodes import held_with_midnodes
from wsim.model.model import Model
from wsim.physics.motion.forces import ForceGather
from wsim.scene import Problem, SceneError
from wsim.scene.methods import all_scene_pins
from wsim.scene.values.coverage import gradient_refusal
from wsim.simulation.plan import SimulationPlan


@dataclass
class HeldPoints:
    """A pin of one world. places of its points, then of middles between two of them (`ends`); share: of what a place feels each
    of its points has (a weld makes one of several)."""

    pin: Any
    places: np.ndarray
    ends: np.ndarray
    share: np.ndarray

    @staticmethod
    def of(pin) -> "HeldPoints":
        places, ends = held_with_midnodes(pin.body, pin.pin.points)
        own = places[:len(pin.pin.points)]
        _, which, count = np.unique(own, return_inverse=True, return_counts=True)
        return HeldPoints(pin, places, ends, 1.0 / count[which])

    @property
    def hard(self) -> bool:
        return not np.isfinite(self.pin.pin.stiffness)

    def gathered(self, f: np.ndarray) -> np.ndarray:
        """Forces of the author's points [N] (n, 3), from what the places feel: middles give half to each end."""
        n = len(self.share)
        found = f[:n] * self.share[:, None]
        for end in self.ends.T:
            np.add.at(found, end, 0.5 * f[n:])
        return found

    def spread(self, r: np.ndarray) -> np.ndarray:
        """The transposed."""
        middle = 0.5 * r[self.ends].sum(axis=1) if len(self.ends) else np.zeros((0, 3))
        return np.concatenate([r * self.share[:, None], middle])

    def acceleration(self, time: float, dt: float) -> np.ndarray:
        """a of the places [m/s^2]."""
        after, now, before = (self.pin.targets(time + s * dt) for s in (1.0, 0.0, -1.0))
        return ((after - now) - (now - before)) / dt**2


class PinReactions:
    """Reaction forces of pins of a plan; kernels of a module of their own, compiled when first asked for. Raises SceneError
    where tethers or strain limits act: these have no law of force."""

    def __init__(self, plan: SimulationPlan):
        self.plan, self.model = plan, plan.model
        for body in self.model.scene.bodies():
            if body.tethers or np.isfinite(body.material_number("strain_limit", np.inf)):
                raise gradient_refusal("limits", body.path)
        pins = plan.ports.pins
        self.constants, self.held = plan.ports.constants, [HeldPoints.of(p) for group in pins.groups.values() for p in group]
        self.make()

    def make(self) -> None:
        """Forces of their own: the plan's may be summed on the way, or differ in what is hard."""
        plan, own = self.plan, copy.copy(self.plan.model)
        own.module, own.modules, own.gradients, own.tape = f"{own.module}_reactions", {}, False, None
        own.tables = dict(own.tables)
        self.pull = ForceGather(own, self.constants, constraints_with_force(self.model), None, shared=False)
        self.pull.need_springs()
        for table, live in zip(self.pull.tables, plan.solids, strict=True):
            table.plastic = None
            for name in live.data._cls.vars:                  # stiffness and rest shapes as they are
                if isinstance(getattr(live.data, name), wp.array):
                    setattr(table.data, name, getattr(live.data, name))
        flags = tuple((dict(self.pull.flags()) | {"lanes": 1}).items())
        self.kernel = newton_adjoint.implicit_force_kernel(own.real, own.module, flags)
        vec3, n = types(own.real).vec3, own.points
        self.pair, self.f = (wp.zeros(k * n, dtype=vec3, device=own.device) for k in (4, 1))
        own.load()

    def felt(self, x: wp.array, e: wp.array | None, v: wp.array) -> np.ndarray:
        """f at x + e with velocities v [N], (points, 3)."""
        return self.elastic(x, e, v) + self.wind(x, v)

    def loads(self) -> np.ndarray | float:
        """Forces of loads at that time [N], (points, 3)."""
        loads = self.plan.ports.loads
        return loads.forces(self.time) if loads else 0.0

    def elastic(self, x: wp.array, e: wp.array | None, v: wp.array) -> np.ndarray:
        """Forces of springs and elements [N], (points, 3), at x + e with velocities v."""
        n = self.model.points
        self.pull.refresh()
        muscles = self.plan.ports.muscles
        if muscles and self.pull.springs:
            rest = np.concatenate([r.rest for r in muscles.present(self.pull.springs, self.time)])
            self.pull.table.rest.assign(np.append(rest, 0.0)[self.pull.entry].astype(self.model.dtype))
        for table in self.plan.solids:
            if table.plastic:
                table.plastic.shape()
        if e is not None:
            wp.copy(self.pair, e, 0, 0, n)
        wp.copy(self.pair, v, 2 * n, 0, n)
        self.pull.launch(0, x, self.pair)
        self.model.launch(self.kernel, n, [self.pull.net, self.pull.force, x, self.pair], [self.f])
        return self.f.numpy().astype(np.float64)

    def wind(self, x: wp.array, v: wp.array) -> np.ndarray:
        """Forces of the air on triangles [N], (points, 3)."""
        air = self.plan.ports.wind
        found = np.zeros((self.model.points, 3))
        if air is None:
            return found
        inputs = [air.triangle, air.ended, x, wp.zeros_like(v), v, 1.0]
        self.model.launch(air.press, air.k.size, inputs, [air.force, air.k])
        each = air.force.numpy().astype(np.float64)
        for corner in air.triangle.numpy().T:
            np.add.at(found, corner, each)
        return found

    def see(self, x: wp.array, e: wp.array | None, v: wp.array, time: float) -> None:
        """Forces at x + e with velocities v, at `time` [s]; `of` then says what each pin bears."""
        self.time = time
        self.force = self.felt(x, e, v) + self.loads()
        c, own, points = self.constants, self.constants.object.numpy(), self.plan.ports.points
        self.v, self.x = v.numpy().astype(np.float64), x.numpy().astype(np.float64)
        if e is not None:
            self.x = self.x + e.numpy()
        self.drive = (c.decay.numpy()[own, None] * self.v - points.gravity()).astype(np.float64)
        self.masses = self.model.stack("masses")

    def of(self, path: str | None, world: int = 0) -> np.ndarray:
        """Reaction forces of a pin [N] (points, 3), in the order in which it names them; after `see`."""
        h = self.find(path, world)
        if not h.hard:
            k, c = h.pin.part * h.pin.pin.stiffness, h.pin.part * h.pin.pin.damping
            return h.gathered(k * (h.pin.targets(self.time) - self.x[h.places]) - c * self.v[h.places])
        a = h.acceleration(self.time, self.plan.clock.dt) + self.drive[h.places]
        return h.gathered(self.masses[h.places, None] * a - self.force[h.places])

    def find(self, path: str | None, world: int) -> HeldPoints:
        """A pin; None: the only one."""
        found = [h for h in self.held if path in (None, h.pin.pin.path) and h.pin.body.world == world]
        if len(found) == 1:
            return found[0]
        raise SceneError(no_pin(self.model, path, world))


def no_pin(model: Model, path: str | None, world: int) -> Problem:
    if path in [tie.path for tie in model.scene.ties]:
        return Problem(path, "is a tie of cloth, a net or a soft body; allowed: pins, and ties of ropes and hair; fix: pin "
                             "the points to a collider, whose reaction is read")
    return Problem(path or "reactions", f"in world {world} is no pin; there are "
                   f"{', '.join(p.path for p in all_scene_pins(model.scene)) or 'none'} in worlds 0 to {model.worlds - 1}")


def constraints_with_force(model: Model) -> list:
    """Constraints that have a law of force."""
    return [r for r in model.constraints if not r.hard]


def current_reactions(sim) -> PinReactions:
    """Reactions of a simulation as it stands."""
    if sim.pulled is None or sim.pulled.plan is not sim.plan:
        sim.pulled = PinReactions(sim.plan)
    s = sim.state
    sim.pulled.see(s.x, s.e, s.v, sim.time)
    return sim.pulled


def reactions_in_all_worlds(sim, path: str) -> np.ndarray:
    """Reaction forces of a pin in all worlds [N], (worlds, points, 3)."""
    found = current_reactions(sim)
    return np.stack([found.of(path, world) for world in range(sim.worlds)])


def reactions_of_pin(sim, path: str | None = None, world: int = 0) -> np.ndarray:
    """Reaction forces as `Simulation.reactions` returns them."""
    ports = sim.plan.ports
    for own in (ports.strand_reactions, ports.grid_reactions):
        if own and (own.takes(path) or path is None and not sim.model.scene.pins and len(own.paths()) == 1):
            return own.of(path or own.paths()[0], world, sim.time)
    if not sim.model.scene.pins:
        raise SceneError(no_pin(sim.model, path, world))
    return current_reactions(sim).of(path, world)
