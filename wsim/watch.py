"""Edges that have more than doubled under explicit steps, or are no number: an unstable step may have thrown them. `Simulation`
repeats the frame with another solver where the scene leaves it the choice, and warns where not. Whole frames of a march look at
their springs themselves (kernels/march.py)."""

import numpy as np
import warp as wp

from wsim.kernels import spring as kernels
from wsim.kernels.march import MOST
from wsim.model import Model, edge_lengths
from wsim.stage import RESIDUAL, Clock, Stage
from wsim.state import State


class Watch:
    """One stage, after a frame; none where nothing has edges."""

    def __init__(self, model: Model, state: State, status: wp.array):
        self.model, self.state, self.status, self.stages = model, state, status, []
        self.bodies = [(b, edge_lengths(b) > 0.0) for b in model.bodies if len(b.edges)]
        if not self.bodies:
            return
        ids = np.concatenate([b.edges[long] for b, long in self.bodies])
        self.edges = model.upload(model.shared(ids.astype(np.int32)), wp.vec2i)
        self.most = model.upload(self.longest(), model.real)
        self.stretched = kernels.stretched(model.real, model.module)
        self.stages.append(Stage("watch", "deform", self.look, 1, len(ids) * 24, "frame", f"{len(ids)} edges"))

    def longest(self, factor=lambda body: 1.0) -> np.ndarray:
        """MOST times the rest length of every edge; factor: of a body, one or for each edge, where muscles lengthen some."""
        return MOST * np.concatenate([(edge_lengths(b) * factor(b))[long] for b, long in self.bodies])

    def follow(self, factor=lambda body: 1.0) -> None:
        if self.stages:
            self.most.assign(self.longest(factor).astype(self.model.dtype))

    def look(self, clock: Clock) -> None:
        if len(self.most):
            self.model.launch(self.stretched, len(self.most), [self.edges, self.most, self.state.x], [self.status[RESIDUAL:]])
