"""Pins that follow skinned meshes, on the device: their targets at the moments of a frame (kernels/animation/driven.py)."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.animation import driven
from wsim.kernels.math.real import types
from wsim.model import kernel_cache
from wsim.model.structs import fill_struct
from wsim.physics.animation.skin import SkinnedMeshTables
from wsim.physics.animation.tables import JointSampling, JointTables
from wsim.physics.contact.poses.sampled import SampledMotions


class FollowingPinTables:
    """Tables of a pin that follows a skinned mesh."""

    def __init__(self, tables: JointTables, pin, first: int, number: int = 0):
        """pin: of `wsim.physics.motion.pins.Pins`; first: its column among the targets of its kind; number: among speeds."""
        follow = pin.motion.follow
        skin, corners = follow.only_points()
        self.bones, self.count, self.real, self.device = skin.skeleton, len(pin.places), tables.real, tables.device
        self.skin = SkinnedMeshTables(tables, skin, out=tables.real)
        n = len(pin.pin.points)
        ends = np.concatenate([np.tile(np.arange(n)[:, None], 2), np.asarray(pin.ends).reshape(-1, 2)])

        def upload_pin_table(values, dtype):
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=tables.device)
        self.table = fill_struct(driven.HungPoints, corner=upload_pin_table(corners.astype(np.int32), wp.vec3i),
                                 place=upload_pin_table(follow.places, wp.vec3d),
                                 ends=upload_pin_table(ends.astype(np.int32), wp.vec2i),
                                 origin=wp.vec3d(*pin.body.origin), first=first, pin=number)
        self.x: Any = None

    def launches(self, sampling: JointSampling, motions: SampledMotions) -> list[tuple]:
        """Launches of the skinned points into `x`. motions: of the skeletons of the tables, at the same moments."""
        t = self.table
        self.x = wp.zeros((len(sampling.moments), self.skin.point.shape[1]), dtype=types(self.real).vec3, device=self.device)
        t.motion = int(motions.row[sampling.tables.skeletons.index(self.bones)])
        t.A, t.p = motions.A, motions.p
        return self.skin.launches(sampling, self.x)


class FollowingPins:
    """Pins that follow skinned meshes by curves, in float64."""

    def __init__(self, pins: list[tuple], moments: np.ndarray, device):
        """pins: (pin, its first column among the targets, its number among the speeds) each; moments [s] in a frame."""
        bones: list = []
        for p, _, _ in pins:
            skeleton = p.motion.follow.skin.skeleton
            bones += [skeleton] * (not any(skeleton is other for other in bones))
        tables = JointTables(bones, device, wp.float64)
        self.each = [FollowingPinTables(tables, *row) for row in pins]
        self.sampling, self.motions = JointSampling(tables, moments), SampledMotions(device, "wsim_skeleton_motions")
        self.motions.take([skeleton.motion for skeleton in bones], moments)
        kernel_cache.load_kernel_module("wsim_skeleton_motions", device)

    def launches(self, dt: float, target: wp.array, speed: wp.array | None) -> list[tuple]:
        """Launches of targets, and of greatest speeds, in frames of dt [s]: (kernel, dim, inputs, outputs) each."""
        real = wp.float32 if target.dtype is wp.vec3f else wp.float64
        module = f"wsim_hung_{types(real).name}"
        hang, pull = driven.hung_pin_kernel(wp.float64, real, module), driven.hung_pull_kernel(wp.float64, module)
        kernel_cache.load_kernel_module(module, target.device)
        found = [*self.sampling.launches(), *self.motions.launches()]
        for hung in self.each:
            found += [*hung.launches(self.sampling, self.motions),
                      (hang, (target.shape[0], hung.count), [hung.table, hung.x], [target])]
            found += [(pull, hung.count, [hung.table, hung.x, dt], [speed])] * (speed is not None)
        return found

    def begin(self, time: float) -> None:
        """Sets when the frame begins [s]."""
        self.sampling.begin(time)
        self.motions.begin(time)
