"""Surfaces that may touch each other and themselves, as tables on a device (kernels/selfcontact/pairs.py)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.geometry import topology
from wsim.kernels.math.real import types
from wsim.kernels.selfcontact import pairs as kernels
from wsim.model.structs import filled

if TYPE_CHECKING:
    from wsim.model.model import Body, Model

SOFT = 0.1             # thickness of the skin of a soft body over its mean edge: none is authored
TUBE = 0.75            # radius of tubes over the largest thickness; smaller: more searches, larger: more pairs
TUBE_EDGE = 0.1        # and over the mean edge, if that is more
WRITTEN = 1.05 * 2.0 ** -24              # bound of the rounding of a vector to float32 over its length, and a margin
ULP = {np.float32: 2.0 ** -24, np.float64: 2.0 ** -53}


def touching(model: Model) -> list[Body]:
    """Bodies of all worlds that touch themselves and each other."""
    return [b for b in model.bodies if getattr(b.source, "self_collision", False)]


class Surfaces:
    """data: struct of the tables. triangles, edges: places; world: of each point."""

    def __init__(self, model: Model, w: wp.array):
        """w: inverse masses [1/kg] of all points."""
        self.bodies = touching(model)
        self.triangles = model.shared(np.concatenate([b.triangles for b in self.bodies])).astype(np.int32)
        self.edges = topology.edges(self.triangles).astype(np.int32)
        self.points = np.unique(self.triangles).astype(np.int32)
        self.base = self.bodies[0].origin
        self.world = np.repeat([b.world for b in model.bodies], [b.count for b in model.bodies]).astype(np.int32)
        self.reach, self.edge = self._reach(model)
        self.thickness = 2.0 * float(self.reach[self.points].max())
        self.beta = max(TUBE * self.thickness, TUBE_EDGE * self.edge)
        self.data = self._upload(model, w)

    def _reach(self, model: Model) -> tuple[np.ndarray, float]:
        """Half thickness of every point [m], and the mean edge at rest [m]."""
        reach, lengths = np.zeros(model.points), []
        for b in self.bodies:
            ends = b.rest[topology.edges(b.triangles) - b.first]
            lengths.append(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))
            reach[b.first:b.last] = np.where(b.reach > 0.0, b.reach, 0.5 * SOFT * lengths[-1].mean())
        return reach, float(np.concatenate(lengths).mean())

    def _upload(self, model: Model, w: wp.array) -> Any:
        t, each = types(model.real), [b.count for b in model.bodies]
        frames = [b.source.motion.at(0.0) for b in model.bodies]
        by_body = {"shift": [b.origin - self.base for b in model.bodies],
                   "far": [b.origin - m[:3, 3] for b, m in zip(model.bodies, frames, strict=True)]}
        unit = [WRITTEN * np.linalg.cond(m[:3, :3]) for m in frames]
        tied = model.alias is not None
        rest = np.concatenate([b.places + b.origin - self.base if tied else b.rest for b in model.bodies])
        friction = np.repeat([b.friction for b in model.bodies], each, axis=0)
        return filled(
            kernels.surfaces(model.real), w=w, point=model.upload(self.points, int),
            triangle=model.upload(self.triangles, wp.vec3i), edge=model.upload(self.edges, wp.vec2i),
            unit=model.upload(np.repeat(unit, each).astype(model.dtype), t.scalar),
            reach=model.upload(self.reach.astype(model.dtype), t.scalar),
            friction=model.upload(friction.astype(model.dtype), t.vec2), rest=model.upload(rest.astype(model.dtype), t.vec3),
            body=model.upload(np.repeat([b.number for b in model.bodies], each).astype(np.int32), int),
            world=model.upload(self.world, int), beta=self.beta, radius=2.01 * self.beta, tied=int(tied), ulp=ULP[model.dtype],
            **{k: model.upload(np.repeat(np.array(v, model.dtype), each, axis=0), t.vec3) for k, v in by_body.items()})

    def start(self, model: Model) -> np.ndarray:
        """Where all points begin, from the origin that surfaces share [m], (points, 3)."""
        return np.concatenate([b.places + (b.origin - self.base) for b in model.bodies])
