"""Explicit integrators: forces are gathered by points, a launch a substep. See kernels/motion/explicit.py.

Where nothing but springs, elements and hard pins acts, the positions at the start of a frame stay and displacements grow
through it ("frame"). Small nets then take a whole frame in one launch: by a cluster of blocks, on a CPU by a thread team. Wind,
contacts, soft pins, tethers and strain limits act on every substep: positions are committed at its end, and what they changed
is a velocity. One launch: `fused.kernel_fusion`; sheets and tets on a GPU, loads too: `fast_paths.one_launch`.
"""

from __future__ import annotations

from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion import explicit as kernels
from wsim.kernels.motion.fast_paths import march_cpu
from wsim.kernels.motion.fast_paths.threads import team_type
from wsim.model.model import Model
from wsim.model.stage import THROWN, CallPort, Clock, Method, Methods, Ports, Remedy, Stage
from wsim.model.state import SimulationState
from wsim.model.status import FrameStatus
from wsim.model.structs import fill_struct
from wsim.model.vjp import beside
from wsim.physics.cloth.constraints import Constraints, apply_live_value
from wsim.physics.motion import frequency
from wsim.physics.motion.divergence_monitor import Watch, watch_explicit
from wsim.physics.motion.forces import ForceGather
from wsim.scene.integrator import Integrator

if TYPE_CHECKING:
    from wsim.simulation.methods import Build


def build(b: Build) -> Explicit:
    found = Explicit(b.model, b.state, b.ports.points, b.kept(soft=True), b.clock, b.taken or b.within,
                     b.ports.hard_pins, b.free and bool(b.taken or not b.others_within) or b.alone)
    return watch_explicit(found, b.choice.bears)


class Explicit(Method):
    """Stages of an explicit integrator. `steps`: whether others act within a substep."""

    def __init__(self, model: Model, state: SimulationState, points, rows: list[Constraints], clock: Clock,
                 steps: bool | frozenset[str], pins=None, free: bool = False):
        """rows: soft constraints of all bodies; steps: whether others act within a substep, or the names of all that do, which
        blocks may take; pins: the method of the hard pins, or None; free: frames may have no contacts, and nothing acts."""
        super().__init__("explicit", by_world=not any(len(b.tets) for b in model.bodies))
        self.model, self.state, self.points, self.status = model, state, points, points.status
        self.integrator: Integrator = points.integrator
        self.rows, self.pins, self.muscles = rows, pins, None         # type: Any, Any, Any    # muscles change rest lengths
        self.target = self.field = None       # of pins, as the net has it; (position, velocity) -> acceleration, of one's own
        self.forces = CallPort()      # called with a row of time tables before forces are evaluated: muscles, loads
        self.impacts = CallPort()     # called with `change` behind leapfrog's last half kick: restitution takes impacts out
        self.staged: Any = import_module("wsim.kernels.motion.runge_kutta") if self.integrator.stages else None
        self.moving = self.at_once = self.free = None    # type: Any    # what a march works on, `OneLaunch`, `FreeFrames`
        self.columns = None if pins is None else pins.columns()
        self.acts = int(any(r.body and getattr(r.body.source, "actuation", None) for r in self.rows)) + bool(model.scene.loads)
        whole = not (self.integrator.stages or steps and (not free or model.device.is_cuda))
        names = steps if isinstance(steps, frozenset) else frozenset[str]()
        self.pull = ForceGather(model, points.constants, self.rows, self.columns, staged=bool(self.integrator.stages),
                                alone=names or whole, packed=not (self.integrator.stages or self.acts))
        self.taken, self.apart = (names, free) if self.pull.cluster else (frozenset(), free and names <= {"contact", "loads"})
        self.steps, free = bool(names - {"loads"} if names else steps) and not self.taken, self.apart
        self.net, self.damped, self.solids = self.pull.net, self.pull.damped, self.pull.tables
        state.add(*(table.kept for table in self.solids if table.kept))
        self.make(clock.substeps)
        looks = self.marches and not (self.steps or self.pull.sheets)           # at its edges, by itself
        self.watch = None if looks else Watch(model, state, self.status, explicit=True)
        self.stages += self.watch.stages if self.watch else []
        self.offers = Ports(force_gather=self.pull, constraint_rows=self.rows, tet_tables=self.solids,
                            spring_tables=self.pull.spring_tables, before_forces=self.forces, before_half_kick=self.impacts,
                            earlier_change=lambda: self.earlier, stable_substeps=self.least, upload_constraints=self.send,
                            predicted_copies=lambda: (self.at, self.pair), target_stride=lambda: self.stride,
                            half_step=lambda: (self.at, self.pair, self.change), whole_frames=self.apart,
                            fused_effects=self.taken, stretch_watch=self.watch)
        if free:
            from wsim.physics.motion.fast_paths.one_launch import FreeFrames
            self.free = FreeFrames(self, clock)

    def make(self, count: int) -> None:
        """Kernels and stages."""
        model, real, module, pull = self.model, self.model.real, self.model.module, self.pull
        what, size = f"{pull.count} springs, {sum(len(e.ids) for e in pull.elements)} elements{pull.form()}", pull.bytes
        self.march = None if self.integrator.stages or self.field or self.acts else pull.march(module, self.apart)
        self.marches = self.march is not None
        if not self.steps and (self.marches or pull.cluster and not self.field):
            from wsim.physics.motion.fast_paths.one_launch import whole_frames
            self.at_once, self.stages = whole_frames(self, size * count, what)
            return
        self.room()
        self.begin, self.commit = kernels.explicit_begin_kernel(real, module), kernels.position_commit_kernel(real, module)
        if self.marches:
            n = model.points
            self.move(self.pair[:n], self.pair[2 * n:3 * n], self.carry[:n], self.carry[n:])
        else:
            pull.need_springs()
            make = self.staged.rk_step if self.staged else kernels.leapfrog_kernel
            self.kernel = make(real, module, pull.flags(), self.field)
            self.kernel.own = pull.lanes * (not pull.springs)     # threads of a point, that read no other's place
            if not self.integrator.stages:
                beside(model, "wsim.physics.motion.forces", "LeapAdjoint", pull, self.kernel)
        launches = self.integrator.forces * (1 + pull.launches + self.acts)
        if self.steps:
            self.correct = kernels.velocity_correction_kernel(real, module)
            self.settle = kernels.resting_kick_kernel(real, module)
            self.change, self.earlier = (wp.zeros(model.points, dtype=types(real).vec3, device=model.device) for _ in range(2))
            beside(model, "wsim.physics.motion.points", "CorrectAdjoint", model, self.correct)
            self.stages = [Stage("start", "pose", self.resume, 2, 0, "frame", "displacements are zero"),
                           Stage(self.integrator.name, "predict", self.predict, launches + 1, size, what=what),
                           Stage("correct", "finish", self.finish, 1, 0, what="what others changed")]
            return
        if model.gradients:                      # substep by substep, so that a recording may begin and end at each
            self.stages = [Stage("start", "pose", self.start, 1, 0, "frame", "displacements are zero"),
                           Stage(self.integrator.name, "predict", self.one, launches, size, what=what),
                           Stage("commit", "deform", self.last, 2, 0, "frame", "positions")]
            return
        self.stages = [Stage(self.integrator.name, "predict", self.frame, 3 + count * launches, size * count, "frame", what)]

    def room(self) -> None:
        """Arrays that outlive a launch: displacements and velocities twice, remainders, sums of Runge-Kutta stages."""
        n, vec3, device = self.model.points, types(self.model.real).vec3, self.model.device
        self.pair, self.carry = (wp.zeros(k * n, dtype=vec3, device=device) for k in (4, 2))
        self.own = wp.zeros(3 * n, dtype=vec3, device=device) if self.integrator.stages else None

    def move(self, d: wp.array, q: wp.array, carry: wp.array, slip: wp.array | None) -> None:
        """Arrays that a march works on, in place. slip: None where it takes frames."""
        self.status.reserve(THROWN)
        s, frame = self.state, int(slip is None)
        given = {"x": s.x, "d": d, "q": q, "v": s.v, "carry": carry, "slip": slip, "frame": frame}
        self.moving = fill_struct(march_cpu.march_set(self.model.real), **given)

    def start(self, clock: Clock) -> None:
        s = self.state
        for table in self.solids:
            table.forget()
        self.model.launch(self.begin, self.model.points, [s.e, s.v, s.r, 0], [self.pair, self.carry, self.own])

    def resume(self, clock: Clock) -> None:
        """Starts as `start` does, where others act within substeps: leapfrog goes on from its half step: all substeps are
        alike."""
        self.start(clock)
        if self.state.has_point_field("b") and not clock.halved:
            self.model.copy(self.state.v, self.state.b)

    @property
    def stride(self) -> int:
        """Rows of the pins' targets a substep."""
        return len(self.integrator.moments) if self.pins is not None and self.pins.moves else 0

    def step(self, clock: Clock, kick: float, drift: float, source: int):
        h, stride = clock.h, self.stride
        return fill_struct(kernels.explicit_steps(self.model.real), kick=kick * h, later=h, drift=drift * h, h=h, source=source,
                           ahead=0.5 * h if len(self.integrator.steps) == 2 else 0.0, count=clock.substeps, stride=stride,
                           row=clock.k * stride)

    def phase(self):
        """Arrays that a launch reads."""
        s = self.state
        return fill_struct(kernels.phase_spaces(self.model.real), x=s.x, d=self.pair, v=s.v, carry=self.carry, own=self.own)

    def kick(self, clock: Clock, kick: float, drift: float, source: int) -> int:
        """Kicks from copy `source`; returns the copy that it ends in."""
        s, step = self.state, self.step(clock, kick, drift, source)
        self.act(clock, float(drift == 0.0))
        if self.marches:
            step.count = 1
            self.model.launch(self.march, 1, [self.net, self.pull.table, step, team_type()()], [self.moving, self.pull.space])
            return source
        self.pull.launch(source, s.x, self.pair)
        kernel, more = (self.free.kernel, [self.free.bounds]) if self.free and clock.free else (self.kernel, [])
        self.model.launch(kernel, self.model.points * self.pull.lanes, [self.net, self.pull.force, self.phase(), step, *more],
                          [self.pair, s.v, self.carry])
        return 1 - source

    def act(self, clock: Clock, part: float) -> None:
        """Muscles have the lengths, and loads the forces, of that part of the substep."""
        self.forces(2 * clock.k + round(2.0 * part))

    def advance(self, clock: Clock, source: int) -> int:
        """One substep from copy `source`; returns the copy that it ends in. Leapfrog's velocity stays at the half step."""
        m = self.integrator
        if m.stages:
            return self.stage_by_stage(clock, source)
        half = len(m.steps) == 2 and clock.k == 0 and (clock.halved or not self.steps or bool(self.free) and clock.free)
        return self.kick(clock, 0.5 if half else 1.0, 1.0, source)

    def stage_by_stage(self, clock: Clock, source: int) -> int:
        s, n, m = self.state, self.model.points, self.integrator
        for number, (c, b) in enumerate(m.stages):
            self.act(clock, c)
            self.pull.launch(source, s.x, self.pair)
            reach, first, rows = m.after[number], clock.k * self.stride, self.stride and m.moments.index(m.after[number])
            part = fill_struct(self.staged.stage_parts(self.model.real), c=reach * clock.h, b=b * clock.h, h=clock.h,
                               source=source, row=first + rows, end=first + max(self.stride - 1, 0),
                               curved=int(m.moments == (0.5, 1.0) and rows), last=int(number == m.forces - 1))
            self.model.launch(self.kernel, n * self.pull.lanes, [self.net, self.pull.force, self.phase(), part],
                              [self.pair, s.v, self.carry, self.own])
            source = 1 - source
        if self.free and clock.free:
            self.free.look(s.x, self.pair[source * n:(source + 1) * n])
        return source

    def read_out(self, clock: Clock, source: int) -> int:
        """Leapfrog's last half kick."""
        return source if len(self.integrator.steps) < 2 else self.kick(clock, 0.5, 0.0, source)

    def frame(self, clock: Clock) -> None:
        """All substeps, a launch for each evaluation of the forces."""
        self.start(clock)
        self.model.repeat(partial(self.one, clock), 0, clock.substeps)
        self.last(clock)

    def side(self, clock: Clock) -> int:
        """The copy that this substep starts from; a march works on one."""
        return 0 if self.marches else clock.k * self.integrator.forces % 2

    def one(self, clock: Clock, k: int | None = None) -> None:
        """Substep k of a frame, or the present one."""
        clock.k = clock.k if k is None else k
        self.advance(clock, self.side(clock))

    def last(self, clock: Clock) -> None:
        """The end of a frame, after its last substep."""
        clock.k = clock.substeps - 1
        self.close(clock, self.read_out(clock, (self.side(clock) + self.integrator.forces) % 2))

    def close(self, clock: Clock, source: int) -> None:
        s = self.state
        self.model.launch(self.commit, self.model.points, [self.pair, self.carry, s.x, source], [s.x, s.e, s.r])

    def predict(self, clock: Clock) -> None:
        """Predicts the substep on which others act: the displacement goes where they look for it."""
        s, n = self.state, self.model.points
        self.at = self.advance(clock, self.side(clock))
        self.model.copy(s.d, self.pair, 0, self.at * n, n)
        self.model.copy(s.a, s.e)

    def finish(self, clock: Clock) -> None:
        s, step = self.state, self.step(clock, 0.0, 0.0, self.at)
        if s.has_point_field("b") and clock.substeps > 1 and (self.model.fuser or clock.k == clock.substeps - 1):
            self.model.copy(self.earlier, self.change)
        self.model.launch(self.correct, self.model.points, [self.points.at(d=s.d, a=s.a), self.pair, step],
                          [s.x, s.e, s.v, self.pair, self.change])
        if self.own is not None:
            self.model.copy(self.own, self.pair, 0, self.at * self.model.points, self.model.points)
        if clock.k == clock.substeps - 1:
            self.model.copy(s.r, self.carry, 0, 0, self.model.points)
        if clock.k == clock.substeps - 1 and s.has_point_field("b"):
            self.model.copy(s.b, s.v)
            self.read_out(clock, self.at)
            self.impacts(self.change)
            self.model.launch(self.settle, self.model.points, [s.b, self.change, self.earlier, s.v, 0.5], [s.v])

    def connect_ports(self, others: Methods) -> None:
        self.muscles = others.ports.muscles
        if not self.taken <= {"aero", "loads"}:
            self.at_once.connect_ports(others)
        if self.moving is not None:
            self.moving.status = self.status.word(THROWN)
        if self.free:
            contact = others.ports.contact
            self.free.meet(contact.clearance if contact else others.ports.free_flight)

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        return [Remedy("doubt")] if status.said(THROWN)[0] else []

    def before_frame(self, time: float, clock: Clock) -> None:
        if self.pins is not None:
            self.target = self.net.target = self.pins.target["hard"]
        for each in filter(None, (self.at_once, self.free, self.model.fuser)):
            each.send(clock)

    def indicators(self, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
        """elastic_energy [J]."""
        from wsim.physics.cloth.table import stored_energy
        solid = self.solids[0].indicators(self.solids, self.state) if self.solids else {}
        now = self.muscles.present(self.rows) if self.muscles else self.rows
        return {"elastic_energy": stored_energy(self.model, now, self.state) + solid.get("solid_energy", 0.0), **solid}

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        """stretch, weft, shear, bend, poisson of a cloth, stiffness of a net, damping [s] of either; what is at rest."""
        hit = any([table.set_value(path, name, value, world) for table in self.solids])
        if hit := bool(apply_live_value(self.model, self.rows, path, name, value, world, self.damped)) or hit:
            self.send()
        return hit

    def send(self) -> None:
        """Uploads constraints."""
        for pull in {self.pull, self.free.pull if self.free else self.pull}:
            self.moved = pull.refresh() or self.moved
        if self.watch:
            self.watch.follow()

    def least(self) -> int:
        """Substeps that keep the present stiffness stable, in every world."""
        return frequency.least_substeps(self.model, self.integrator, self.solids)
