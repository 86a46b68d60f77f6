"""Edges that are more than twice as long as at rest, or not finite, where a frame ends: an unstable step may have thrown them,
or the solver has not held them. `Simulation` repeats the frame of explicit steps with another solver where the scene leaves it
the choice, and warns else (`wsim.simulation.measure.exceeded`). Whole frames of a march look at their springs themselves
(kernels/motion/fast_paths/march_cpu.py).

The implicit midpoint solves for the middle of a step and goes on from there as far again: what tethers and strain limits
have projected in the middle it throws as far to the other side. Where that leaves such edges it gives way to backward Euler."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from wsim.kernels.cloth import spring as kernels
from wsim.model.model import Model, edge_lengths
from wsim.model.stage import LONG, STRETCHED, THROWN, Clock, Method, Ports, Remedy, Stage
from wsim.model.state import SimulationState
from wsim.model.status import FrameStatus
from wsim.physics.cloth.constraints import AT_REST
from wsim.physics.motion.stability import STRETCH

if TYPE_CHECKING:
    from wsim.physics.motion.explicit import Explicit
    from wsim.simulation.methods import Build


MOST = STRETCH         # length over rest length from which an edge is suspect, as kernels/motion/fast_paths/march_cpu.py has it


def build(b: Build) -> Watch | None:
    watch = Watch(b.model, b.state, b.status)
    if b.choice.integrator.beyond and any(r.hard for r in b.model.constraints):
        watch.thrown_by = b.clock
    return watch if watch.stages else None


def watch_explicit(explicit: Explicit, bears: float) -> Explicit:
    """The method, of which edges are looked at from what its steps bear (`wsim.physics.motion.stability.stable_stretch`)."""
    if bears < MOST:
        if explicit.watch is None:
            explicit.watch = Watch(explicit.model, explicit.state, explicit.status, explicit=True)
            explicit.stages += explicit.watch.stages
        explicit.watch.most = bears
        explicit.offers.edge_watch = explicit.watch
    return explicit


class Watch(Method):
    """One stage, after a frame; none where nothing has edges."""

    alike = True

    def __init__(self, model: Model, state: SimulationState, status: FrameStatus, explicit: bool = False):
        """explicit: the frame is in doubt, and not only reported."""
        super().__init__("watch")
        self.model, self.state, self.status, self.own = model, state, status, THROWN if explicit else LONG
        self.thrown_by: Clock | None = None            # of a midpoint whose middle is projected
        self.most = MOST
        self.factor = lambda body: 1.0
        self.offers = Ports(stretch_watch=self)
        self.bodies = [(b, edge_lengths(b) > 0.0) for b in model.bodies]
        counts = [int(long.sum()) for _, long in self.bodies]
        if not sum(counts):
            return
        status.reserve(self.own)
        status.reserve(STRETCHED, len(model.bodies))
        ids = np.concatenate([b.edges[long] for b, long in self.bodies])
        self.edges = model.upload(model.shared(ids.astype(np.int32)), wp.vec2i)
        self.rest = model.upload(self.longest(), model.real)
        self.first = model.upload(np.append(0, np.cumsum(counts)).astype(np.int32), int)
        self.stretched = kernels.overstretch_kernel(model.real, model.module)
        self.stages.append(Stage("watch", "deform", self.look, 1, len(ids) * 24, "frame", f"{len(ids)} edges"))

    def longest(self) -> np.ndarray:
        """Rest length of every edge [m]."""
        return np.concatenate([(edge_lengths(b) * self.factor(b))[long] for b, long in self.bodies])

    def follow(self, factor=None) -> None:
        """Rest lengths have changed; factor: of a body, one or for each edge, where muscles lengthen some."""
        self.factor = factor or self.factor
        if self.stages:
            self.rest.assign(self.longest().astype(self.model.dtype))

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        if name in AT_REST:
            self.follow()
        return False

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        if self.thrown_by is None or not self.thrown_by.integrator.beyond or not status.said(self.own)[0]:
            return []
        return [Remedy("give way", why="tethers or strain limits act while edges are more than twice as long as at rest")]

    def stretch_exceeds(self, most: float) -> bool:
        """True if an edge is longer than `most` times its rest length now, by what float32 has of positions."""
        found = wp.zeros(1 + len(self.bodies), dtype=int, device=self.model.device)
        given = [self.edges, self.rest, most, self.first, self.state.x, 0, 1]
        self.model.launch(self.stretched, len(self.rest), given, [found])
        return bool(found.numpy()[0])

    def look(self, clock: Clock) -> None:
        if len(self.rest):
            self.model.launch(self.stretched, len(self.rest),
                              [self.edges, self.rest, self.most, self.first, self.state.x, self.status.offset(self.own),
                               self.status.offset(STRETCHED)], [self.status.array])
