"""Edges that are more than twice as long as at rest, or not finite, where a frame ends: an unstable step may have thrown them,
or the solver has not held them. `Simulation` repeats the frame of explicit steps with another solver where the scene leaves it
the choice, and warns else (`wsim.simulation.measure.exceeded`). Whole frames of a march look at their springs themselves
(kernels/motion/march_cpu.py)."""

import numpy as np
import warp as wp

from wsim.kernels.cloth import spring as kernels
from wsim.model.model import Model, edge_lengths
from wsim.model.stage import EACH, LONG, RESIDUAL, Clock, Method, Stage
from wsim.model.state import State
from wsim.physics.cloth.constraints import AT_REST

MOST = 2.0             # length over rest length from which an edge is suspect, as kernels/motion/march_cpu.py has it


class Watch(Method):
    """One stage, after a frame; none where nothing has edges."""

    def __init__(self, model: Model, state: State, status: wp.array, explicit: bool = False):
        """explicit: the frame is in doubt, and not only reported."""
        super().__init__("watch")
        self.model, self.state, self.status, self.own = model, state, status, RESIDUAL if explicit else LONG
        self.factor = lambda body: 1.0
        self.bodies = [(b, edge_lengths(b) > 0.0) for b in model.bodies]
        counts = [int(long.sum()) for _, long in self.bodies]
        if not sum(counts):
            return
        ids = np.concatenate([b.edges[long] for b, long in self.bodies])
        self.edges = model.upload(model.shared(ids.astype(np.int32)), wp.vec2i)
        self.rest = model.upload(self.longest(), model.real)
        self.first = model.upload(np.append(0, np.cumsum(counts)).astype(np.int32), int)
        self.stretched = kernels.stretched(model.real, model.module)
        self.stages.append(Stage("watch", "deform", self.look, 1, len(ids) * 24, "frame", f"{len(ids)} edges"))

    def longest(self) -> np.ndarray:
        """Rest length of every edge [m]."""
        return np.concatenate([(edge_lengths(b) * self.factor(b))[long] for b, long in self.bodies])

    def follow(self, factor=None) -> None:
        """Rest lengths have changed; factor: of a body, one or for each edge, where muscles lengthen some."""
        self.factor = factor or self.factor
        if self.stages:
            self.rest.assign(self.longest().astype(self.model.dtype))

    def set(self, path: str, name: str, value, world: int | None = None) -> bool:
        if name in AT_REST:
            self.follow()
        return False

    def look(self, clock: Clock) -> None:
        if len(self.rest):
            self.model.launch(self.stretched, len(self.rest), [self.edges, self.rest, MOST, self.first, self.state.x, self.own,
                                                               EACH], [self.status])
