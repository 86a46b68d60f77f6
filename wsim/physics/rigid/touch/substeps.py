"""Substeps of rigid bodies in three parts, between which others push them (kernels/rigid/touch/step.py): forces, sweeps of
their own contacts, places."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import warp as wp

from wsim.kernels.rigid.touch.step import touch_step, touch_sweep
from wsim.model.stage import Clock, Methods, Stage
from wsim.physics.rigid.solids import asks_for_sleep
from wsim.scene.attachments import body_ties

if TYPE_CHECKING:
    from wsim.simulation.methods import Build


class RigidSubsteps:
    """The parts as stages: `begin`, and `end` behind what pushes. rigid: the method, whose `contacts` are made."""

    foreseen: Any = None                                 # `wsim.physics.rigid.touch.newton.ForeseenBodies`
    roll: Any = None                                     # table of balls that turn (kernels/position_based/rolling/law.py)

    def __init__(self, b: Build, rigid, swept: bool = True):
        """swept: False if `sweep` is never called."""
        self.model, self.rigid = b.model, rigid
        self.form = rigid.contacts.form
        self.rolling = b.choice.solver == "xpbd" and any(body.rolling_friction is not None for body in b.scene.bodies())
        self.trees: Any = None           # `wsim.physics.rigid.touch.trees.PushedTrees`, in reduced coordinates
        self.joints = self.step = self.swept = None      # type: Any
        if rigid.joints and rigid.joints.reduced:
            from wsim.physics.rigid.touch.trees import PushedTrees
            self.trees = PushedTrees(rigid)
        else:
            self.step = self.form.parts(touch_step, rigid.contacts.bouncing, linked=rigid.joints is not None)
            self.swept = self.form.parts(touch_sweep, False) if swept else None
            self.joints = rigid.joints.passes() if rigid.joints else None
        size, what = rigid.part.bytes, f"{len(rigid.bodies)} bodies: forces"
        if asks_for_sleep(b.scene):
            what += "; none sleeps, as points never do"
        self.stages = [Stage("rigid bodies", "predict", self.begin, 1, size, what=what),
                       Stage("rigid bodies: places", "finish", self.end, 2, size, what="and what pushed them apart")]

    def make_kernel(self, make: Any, threads: int) -> Any:
        """A kernel; threads: of blocks of another size, which stand in a module of their own; 0: as other kernels have."""
        model = self.model
        if self.rolling:
            from wsim.physics.rigid.touch.turning import ROLLING
            if make in ROLLING:
                return make(model.real, model.shared_module("rolling_touch", threads, threads=threads), True)
        return make(model.real, model.module_of(threads) if threads else model.module)

    def connect_ports(self, others: Methods) -> None:
        """Connects itself with what other methods offer."""

    def before_frame(self) -> None:
        """What a frame needs on the host."""

    def indicators(self) -> dict[str, float]:
        return {}

    def steps(self, clock: Clock) -> list:
        own = self.rigid.contacts
        return [wp.vec3i(clock.k, clock.k + 1, own.sweeps), clock.h, self.form.threads, own.rig()]

    def begin(self, clock: Clock) -> None:
        """Forces on bodies; manifolds."""
        own, k = self.rigid.contacts, clock.k
        own.renew(clock, k)
        if self.trees:
            return self.trees.begin(clock)
        if len(self.step) > 2:                           # joints take part in blows
            self.form.launch(self.step[2], self.steps(clock), [])
            self.joined(clock, lined=k)
            joints = self.rigid.joints.with_contacts(own.work)
            self.form.launch(self.form.kernels["thrown"], [self.form.threads, k, clock.h, own.rig(), joints], [])
        self.form.launch(self.step[0], self.steps(clock), [])
        self.joined(clock, lined=k, reset=(k, clock.h))
        self.joined(clock)

    def joined(self, clock: Clock, **passes) -> None:
        """Passes of joints, a sweep where none is named; bodies are placed by all of their momentum, as points foresee."""
        if self.joints:
            for name, given in (passes or {"joined": (clock.k, clock.h)}).items():
                self.joints(name, given, self.rigid.contacts)

    def sweep(self, clock: Clock) -> None:
        """Sweeps over the contacts of bodies among themselves and with colliders, and over joints."""
        if self.trees:
            return self.trees.sweep(clock)
        self.form.launch(self.swept, self.steps(clock), [])
        self.joined(clock)

    def end(self, clock: Clock) -> None:
        """Bodies go where they go."""
        own = self.rigid.contacts
        if self.trees:
            self.trees.end(clock)
        else:
            self.joined(clock)
            self.form.launch(self.step[1], self.steps(clock), [])
            self.joined(clock, lined=clock.k + 1, loosed=(clock.k, clock.h))
        if clock.k + 1 == clock.substeps:
            own.keep()


def make_point_ties(touch, row, bodies):
    """`PointTies` of the points of a scene that are tied to bodies, or None."""
    model = touch.model
    if not any(body_ties(model.scene, body.path) for body in model.bodies):
        return None
    from wsim.physics.rigid.touch.point_ties import PointTies
    return PointTies(touch, row, bodies)
