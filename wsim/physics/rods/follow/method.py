"""Followers on the device: once a frame, one launch carries the points of all of them (kernels/rods/follow.py)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from wsim.kernels.rods.follow import BoundPoints, carried_point_kernel
from wsim.model.stage import Clock, Method, Stage
from wsim.model.structs import fill_struct
from wsim.physics.rods.follow.binding import GUIDES, bind_followers
from wsim.scene.samples import PointSample, Sample

if TYPE_CHECKING:
    from wsim.simulation.methods import Build

MODULE, THREADS = "wsim_rods_follow", 128


def build(b: Build) -> Method:
    return FollowerMethod(b)


def signature(b) -> list:
    return []                                            # its kernel stands in a module of its own


class FollowerMethod(Method):
    """Points of all followers of all worlds, in rows."""

    def __init__(self, b: Build):
        super().__init__("follow")
        self.model, self.rods = b.model, b.ports.rods
        table, device, row = self.rods.table, b.model.device, 0
        parts, self.rows, start = [], [], []
        for followers in b.scene.things("Followers"):
            of = {world: own for own, (rods, world) in zip(table.own, table.pairs, strict=True)
                  if rods.path == followers.guides}
            edge, weight, place = bind_followers(followers, table, of[0])
            missing = 2 * GUIDES - edge.shape[1]
            pad = ((0, 0), (0, missing))
            for world, own in of.items():
                parts.append((np.pad(edge + own.start - of[0].start, pad, "edge"), np.pad(weight, pad),
                              np.pad(place, (*pad, (0, 0)))))
                start.append(followers.motion.points(followers.points, 0.0))
                self.rows.append((followers.path, world, slice(row, row := row + len(edge))))
        edge, weight, place = (np.concatenate(each) for each in zip(*parts, strict=True))
        self.bound = fill_struct(BoundPoints, edge=wp.array(edge.astype(np.int32), dtype=int, device=device),
                                 weight=wp.array(weight, dtype=wp.float64, device=device),
                                 place=wp.array(place, dtype=wp.vec3d, device=device),
                                 rest=wp.zeros(row, dtype=wp.vec3d, device=device))
        self.x, self.v = (wp.zeros(row, dtype=wp.vec3d, device=device) for _ in range(2))
        self.kernel, b.model.modules[MODULE] = carried_point_kernel(MODULE), THREADS
        self.stages.append(Stage("follow", "deform", self.carry, 1, row * 2 * GUIDES * 150, "frame",
                                 f"{row} points of hairs that follow guides"))
        self.start, self.begun = np.concatenate(start), False

    def carry(self, clock: Clock) -> None:
        self._launch(self.rods.moving())

    def _launch(self, motion) -> None:
        wp.launch(self.kernel, len(self.x), [self.rods.strands, motion, self.bound], [self.x, self.v],
                  device=self.model.device, block_dim=THREADS)

    def before_frame(self, time: float, clock: Clock | None) -> None:
        """Once: what rounding takes from points at the start, where they are those that were authored."""
        if self.begun:
            return
        self.begun, motion, table = True, self.rods.moving(), self.rods.table
        motion.x, motion.d = (wp.array(values, dtype=wp.vec3d, device=self.model.device) for values in (table.x, table.d))
        self._launch(motion)
        self.bound.rest.assign(self.start - self.x.numpy())
        self._launch(self.rods.moving())

    def samples(self, world: int = 0) -> list[Sample]:
        self.before_frame(0.0, None)
        x, v = self.x.numpy(), self.v.numpy()
        return [PointSample(path, x[rows], v[rows]) for path, of, rows in self.rows if of == world]
