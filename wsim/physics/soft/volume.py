"""Soft bodies of the corotational law that lose volume which it does not resist (kernels/soft/volume.py), as each frame ends: a
warning of each, with the law that does. None where that law would lose as much: a third or more must be this one's."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from wsim.kernels.soft import volume
from wsim.model.model import Model
from wsim.model.stage import Clock, Method, Stage
from wsim.model.status import FrameStatus
from wsim.physics.soft.fem import Tetrahedra

if TYPE_CHECKING:
    from wsim.model.state import SimulationState
    from wsim.simulation.methods import Build

LOST = "volume lost, by region"          # status words, 1e-4: by this law, by the other
MOST = 0.02                              # of a body's volume, that is lost beyond what the other law loses, without a word
LANES, SHARE = 1024, 64                  # threads of a body at most; tets of each, about


def build(b: Build) -> VolumeWatch | None:
    tables = [t for t in b.ports.tet_tables if getattr(t, "material", "") == "corotational"]
    return VolumeWatch(b.model, b.state, b.status, tables) if tables else None


class VolumeWatch(Method):
    """One stage, after a frame."""

    def __init__(self, model: Model, state: SimulationState, status: FrameStatus, tables: list[Tetrahedra]):
        super().__init__("volume")
        self.model, self.state, self.status = model, state, status
        self.bodies = [p.body for t in tables for p in t.parts]
        status.reserve(LOST, 2 * len(self.bodies))
        self.tables, begin = [], 0
        for t in tables:
            counts = [len(p.rows) for p in t.parts]
            lanes = max(1, min(LANES, max(counts) // SHARE))
            first = model.upload(np.r_[0, np.cumsum(counts)].astype(np.int32), int)
            kernel = volume.volume_change_kernel(t.ids.shape[1], model.real, model.module)
            part = wp.zeros(len(counts) * lanes, dtype=wp.vec3d, device=model.device)
            self.tables.append((t, kernel, first, lanes, part, begin))
            begin += len(counts)
        self.sum = volume.lost_volume_kernel(model.real, model.module)
        size = sum(t.size for t in tables)
        self.stages.append(Stage("volume", "deform", self.look, 2 * len(tables), size * 100, "frame", f"{size} tets"))

    def look(self, clock: Clock) -> None:
        launch, state = self.model.launch, self.state
        for t, kernel, first, lanes, part, begin in self.tables:
            launch(kernel, len(part), [t.data, first, lanes, state.x, state.e], [part])
            launch(self.sum, len(t.parts), [part, lanes, self.status.offset(LOST) + 2 * begin], [self.status.array])

    def frame_warnings(self, status: FrameStatus) -> list[tuple[tuple, float, str]]:
        lost, other = status.said(LOST).reshape(-1, 2).T
        found = []
        for k in np.flatnonzero((lost - other > 1e4 * MOST) & (3 * (lost - other) > lost)):
            body = self.bodies[k]
            where = body.path + f" (world {body.world})" * (self.model.worlds > 1)
            found.append(((LOST, where), float(lost[k]) / 100.0,
                          f"{where} lost {{worst}} % of its volume, which the corotational law does not resist; give its "
                          "material wsim:elasticModel = \"neo_hookean\", which keeps volume"))
        return found
