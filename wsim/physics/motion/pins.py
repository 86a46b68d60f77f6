"""Pins: points that are put where a prim is (hard), or pulled there by a spring (soft). Kernels: kernels/motion/points.py."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion import points as kernels
from wsim.model.midnodes import held_with_midnodes, with_midnode_values
from wsim.model.model import Model, PointBody
from wsim.model.ports import NONE, Ports
from wsim.model.stage import Clock, Method, Methods, Stage
from wsim.model.state import SimulationState
from wsim.model.structs import fill_struct, struct_values
from wsim.scene import Motion, Pin

if TYPE_CHECKING:
    from wsim.physics.motion.points import FreePoints
    from wsim.simulation.methods import Build


def build(b: Build) -> Pins:
    return Pins(b.model, b.state, b.ports.points, b.choice.integrator.explicit)


class _Pinned:
    """A pin of one world: its places in the arrays and its points in the target's frame."""

    def __init__(self, pin: Pin, body: PointBody):
        self.pin, self.body = pin, body
        self.places, ends = held_with_midnodes(body, pin.points)
        self.ends = ends
        self.part = len(pin.points) / len(self.places)       # of stiffness and damping: points between share them
        start = body.source.motion.points(body.source.points[pin.points], 0.0)
        self.motion: Any = pin.motion if pin.follows is None else _following_motion(pin.follows, ends)
        self.locals = with_midnode_values(pin.places if pin.places is not None else _local_places(pin.motion, start), ends)

    @property
    def evaluated_on_device(self) -> bool:
        """True if it moves and the device evaluates its targets."""
        return self.motion.moves and getattr(self.motion, "by_keys", False)

    def targets(self, time: float) -> np.ndarray:
        """Places of its points at `time` [s], relative to the body's origin [m]."""
        return self.motion.points(self.locals, time) - self.body.origin

    def speed(self, time: float) -> np.ndarray:
        """Velocities of its points at `time` [m/s], (points, 3)."""
        rate = self.motion.rate(time)[0]
        return self.locals @ rate[:3, :3].T + rate[:3, 3]

    def table(self, times: np.ndarray) -> np.ndarray:
        """Places as `targets` has them, at times (n,) [s]: (n, points, 3)."""
        if hasattr(self.motion, "follow"):
            return self.motion.over(times) - self.body.origin
        if not hasattr(self.motion, "sampled"):                # a table of places
            return np.stack([self.targets(time) for time in times])
        M = self.motion.sampled(times)
        if self.motion.plain:
            same = (M[:, :3, :3] == M[0, :3, :3]).all()
            turned = self.locals @ (M[0, :3, :3].T if same else M[:, :3, :3].swapaxes(1, 2))
            return turned + M[:, None, :3, 3] - self.body.origin
        return self.locals @ M[:, :3, :3].swapaxes(1, 2) + (M[:, None, :3, 3] - self.body.origin)


def _following_motion(follow, ends: np.ndarray):
    from wsim.physics.animation.pin_targets import FollowedPlaces
    return FollowedPlaces(follow, ends)


def _local_places(motion: Motion, places: np.ndarray) -> np.ndarray:
    M = motion.at(0.0)
    return np.linalg.solve(M[:3, :3], (places - M[:3, 3]).T).T


def pins_of(model: Model) -> list[_Pinned]:
    """Every pin of every world."""
    return [_Pinned(p, b) for p in model.scene.pins for b in model.bodies if b.path == p.body]


def pin_turns(places: np.ndarray) -> list[np.ndarray]:
    """Pins in turns, by the place of the point that each pulls: the first pin of each point, the second of those with two.."""
    order = np.argsort(places, kind="stable")
    first = np.searchsorted(places[order], places[order])
    turn = np.empty(len(places), np.int64)
    turn[order] = np.arange(len(places)) - first
    return [np.flatnonzero(turn == k).astype(np.int32) for k in range(turn.max() + 1)]


class Pins(Method):
    """Stages pose and, where a step of several solves ends, put (hard pins), hold (soft pins). Targets of a whole frame are
    computed in float64 before it, on the device, only when a pin moves or was set; on the host where a motion is no curve."""

    def __init__(self, model: Model, state: SimulationState, points: FreePoints, explicit: bool = False):
        """explicit: hard pins are moved by the integrator itself, which reads `target` and `columns`."""
        super().__init__("pins")
        self.alike = points.integrator.solves == 1
        self.model, self.state, self.points = model, state, points
        pins = pins_of(model)
        self.groups = {"hard": [p for p in pins if not isfinite(p.pin.stiffness)],
                       "soft": [p for p in pins if isfinite(p.pin.stiffness)]}
        self.place: dict[str, wp.array] = {}
        self.target: dict[str, wp.array] = {}
        self.changed = True
        self.sampled: dict[str, Any] = {}                   # `wsim.physics.animation.pin_targets.PinTargets`
        self.own: dict[str, list[bool]] = {}                # which pins of a group they have
        self.at: dict[str, np.ndarray] = {}                 # moments of their targets in a frame [s]
        self.rates: Any = None                              # `wsim.physics.animation.pin_targets.PinVelocities`
        self.driven: list[_Pinned] = []                     # which rigid bodies carry within the frame
        # greatest speed of each hard pin in the frame [m/s], 0 of those in `unseen`
        self.pull = wp.zeros(len(self.groups["hard"]), dtype=wp.float64, device=model.device)
        t, real, module = types(model.real), model.real, model.module
        for kind, group in self.groups.items():
            if group:
                places = np.concatenate([p.places for p in group])
                self.place[kind] = model.upload(places.astype(np.int32), int)
                self.target[kind] = wp.zeros((1, len(places)), dtype=t.vec3, device=model.device,
                                             requires_grad=model.gradients)
        self.explicit = explicit
        if self.groups["hard"] and not explicit:
            self.move = kernels.pin_motion_kernel(real, module)
            n = self.place["hard"].size
            self.stages.append(Stage("pins", "predict", self.pose, 1, n * 40, what=f"{n} points"))
            if points.integrator.solves > 1:
                from wsim.kernels.motion.sdirk3 import sdirk3_pin_kernel
                self.place_kernel = sdirk3_pin_kernel(real, module)
                self.stages.append(Stage("pins placed", "finish", self.put, 1, n * 60, what=f"{n} points"))
        self.carried = [p for p in self.groups["hard"] if not p.motion.plain and not model.gradients]
        if self.carried:
            self.add_carried(t, real, module)
        if self.groups["soft"]:
            self.add_soft(t, real, module)
        self.offers = Ports(pins=self, hard_pins=self if self.groups["hard"] else NONE,
                            soft_pins=self if self.groups["soft"] else NONE)

    def add_carried(self, t, real, module) -> None:
        """Adds velocities of curves other than linear keys, which are known: at the end of a frame points have it, to no
        order."""
        self.carry = kernels.pin_velocity_kernel(real, module)
        places = np.concatenate([p.places for p in self.carried])
        self.at_ends = self.model.upload(places.astype(np.int32), int)
        self.speed = wp.zeros(len(places), dtype=t.vec3, device=self.model.device)
        self.stages.append(Stage("pin velocities", "deform", self.set_end_velocities, 1, len(places) * 28, rate="frame",
                                 what=f"{len(places)} points"))

    def set_end_velocities(self, clock: Clock) -> None:
        self.model.launch(self.carry, self.at_ends.size, [self.at_ends, self.speed], [self.state.v])

    def add_soft(self, t, real, module) -> None:
        group, n = self.groups["soft"], self.place["soft"].size
        each = [len(p.places) for p in group]
        self.soft = kernels.soft_pins(real)()
        self.soft.point, self.soft.w = self.place["soft"], self.points.constants.w
        self.soft.alpha = self.model.upload(np.repeat([1.0 / (p.part * p.pin.stiffness) for p in group], each), t.scalar)
        self.soft.damping = self.model.upload(np.repeat([p.part * p.pin.damping for p in group], each), t.scalar)
        self.lam = wp.zeros(n, dtype=t.vec3, device=self.model.device)
        self.hold_kernel = kernels.pin_holding_kernel(real, module)
        shared = struct_values(self.soft)
        self.turns = [(len(pins), fill_struct(kernels.soft_pins(real), **shared | {"turn": self.model.upload(pins, int)}))
                      for pins in pin_turns(self.place["soft"].numpy())]
        if len(self.turns) == 1:
            self.turns = [(n, self.soft)]
        self.stages.append(Stage("soft pins", "solve", self.hold, len(self.turns), n * 80, "iteration", f"{n} points"))

    @property
    def moves(self) -> bool:
        """True if any pin does."""
        return any(p.motion.moves for g in self.groups.values() for p in g)

    def connect_ports(self, others: Methods) -> None:
        """Soft pins act within Newton steps, where there are some, or explicit ones take them
        (kernels/motion/fused/hold.py)."""
        if "soft pins" in (others.ports.fused_effects or ()):
            self.stages = [s for s in self.stages if s.name != "soft pins"]
        terms, adjoint = others.ports.newton_terms, others.ports.solve_adjoint
        if terms is None or not self.groups["soft"]:
            return
        from wsim.physics.motion.soft_pins.soft_pin import NewtonSoftPins
        self.stages = [s for s in self.stages if s.name != "soft pins"]
        term = NewtonSoftPins(others.ports.newton_assembly, self)
        self.soft.first, self.soft.item = term.first, term.item
        terms.append(term)
        if adjoint:
            adjoint.enter("pins", self, term)

    def columns(self) -> np.ndarray:
        """Column of the hard target of each point, or -1, (points,)."""
        column = np.full(self.model.points, -1, np.int32)
        if self.groups["hard"]:
            places = self.place["hard"].numpy()
            column[places] = np.arange(len(places))
        return column

    def pose(self, clock: Clock) -> None:
        s = self.state
        solves = clock.integrator.solves
        row, part = (clock.k + clock.k // solves, 1.0) if solves > 1 else (clock.k, clock.part)
        row, now = (0, clock.loop.number) if clock.loop else (row, None)
        self.model.launch(self.move, self.place["hard"].size,
                          [self.place["hard"], self.target["hard"], s.x, s.e, row, now, part], [s.d])

    def put(self, clock: Clock) -> None:
        """Puts the points in their places behind the last stage of a step."""
        s, solves = self.state, clock.integrator.solves
        if solves > 1 and clock.ends:
            pinned, row = self.place["hard"], clock.k + clock.k // solves + 1
            at = fill_struct(kernels.point_states(self.model.real), x=s.x, e=s.e, s=s.s)
            self.model.launch(self.place_kernel, pinned.size, [pinned, self.target["hard"], at, row, solves * clock.h],
                              [s.x, s.e, s.v])

    def hold(self, clock: Clock) -> None:
        s = self.state
        if clock.i == 0:
            (self.model.tape or self.model).zero(self.lam)
        at = fill_struct(kernels.point_states(self.model.real), x=s.x, d=s.d, a=self.points.anchor)
        target, row = clock.read_rows(self.target["soft"], clock.k)
        for count, soft in self.turns:
            self.model.launch(self.hold_kernel, count, [soft, target, at, self.lam, row, clock.effective_step], [s.d, self.lam])

    def before_frame(self, time: float, clock: Clock) -> None:
        moves = self.moves
        if self.carried:
            self.upload_end_velocities(time, clock.dt)
        at = {kind: clock.moments(kind == "hard") for kind in self.target}      # a soft pin pulls at the solved positions
        if self.explicit and not moves and not self.groups["soft"]:
            at = {kind: moments[:1] for kind, moments in at.items()}
        if not (moves or self.changed or any(t.shape[0] != len(at[kind]) for kind, t in self.target.items())):
            return
        for kind, group in self.groups.items():
            if group:
                self.aim(kind, time, clock.dt, at[kind])
        self.changed = False

    def unseen(self) -> list[_Pinned]:
        """Hard pins that move and have no speed in `pull`: the host evaluates them."""
        own = self.own.get("hard", [False] * len(self.groups["hard"]))
        return [p for p, mine in zip(self.groups["hard"], own, strict=True) if not mine and p.motion.moves]

    def upload_end_velocities(self, time: float, dt: float) -> None:
        """Velocities of what goes by smooth curves, where the frame of dt [s] that starts at a time [s] ends."""
        if not all(getattr(p.motion, "by_keys", False) for p in self.carried):
            self.speed.assign(np.concatenate([p.speed(time + dt) for p in self.carried]).astype(self.model.dtype))
            return
        if self.rates is None or any(p.motion is not m for p, m in zip(self.carried, self.rates.motions, strict=True)):
            from wsim.physics.animation.pin_targets import PinVelocities
            self.rates = PinVelocities(self.carried, dt, self.speed, self.model.real)
        self.rates.launch(time)

    def aim(self, kind: str, time: float, dt: float, at: np.ndarray) -> None:
        """Targets of a group in the frame of dt [s] that starts at a time [s]; at: times in it."""
        group, rows = self.groups[kind], self.target[kind].shape[0]
        if anew := self.changed or rows != len(at) or not np.array_equal(self.at.get(kind, np.zeros(0)), at):
            self.own[kind], self.at[kind] = [p.evaluated_on_device for p in group], at
            moving = {p.pin.path for g in self.groups.values() for p in g if not p.evaluated_on_device and p.motion.moves}
            moving -= {p.pin.path for p in self.driven}
            self.evaluates["targets"] = sorted(moving)
        own = self.own[kind]
        if kind == "hard":
            self.pull.zero_()
        if anew or any(p.motion.moves and p not in self.driven for p, mine in zip(group, own, strict=True) if not mine):
            values = np.concatenate([np.zeros((len(at), len(p.places), 3)) if mine else p.table(time + at)
                                     for p, mine in zip(group, own, strict=True)], axis=1)
            if rows != len(values):
                self.target[kind] = self.model.upload(values, types(self.model.real).vec3)
                self.moved = True                      # a graph has the array before, and how many rows it has
            else:
                self.target[kind].assign(values.astype(self.model.dtype))
        if any(own):
            if kind not in self.sampled:
                from wsim.physics.animation.pin_targets import PinTargets
                self.sampled[kind] = PinTargets(self.model.device, self.model.real)
            if anew:
                self.sampled[kind].take(group, own, at, dt, self.target[kind], self.pull if kind == "hard" else None)
            self.sampled[kind].launch(time)

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        """motion of a pin: a Motion or a (4, 4) matrix; it takes effect with the next frame."""
        hit = [p for g in self.groups.values() for p in g if p.pin.path == path and world in (None, p.body.world)]
        if name != "motion" or not hit:
            return False
        for p in hit:
            p.motion = value if isinstance(value, Motion) else Motion.still(value)
        self.changed = True
        return True
