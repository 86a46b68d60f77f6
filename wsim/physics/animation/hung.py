"""Pins that follow skinned meshes, on the device: their targets at the moments of a frame (kernels/animation/driven.py)."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.animation import driven
from wsim.kernels.math.real import types
from wsim.model import kernel_cache
from wsim.model.structs import filled
from wsim.physics.animation.skin import Skin
from wsim.physics.animation.tables import Sampling, Tables
from wsim.physics.contact.poses.sampled import Sampled


class Hung:
    """Tables of a pin that follows a skinned mesh."""

    def __init__(self, tables: Tables, pin, first: int, number: int = 0):
        """pin: of `wsim.physics.motion.pins.Pins`; first: its column among the targets of its kind; number: among speeds."""
        follow = pin.motion.follow
        skin, corners = follow.only_points()
        self.bones, self.count, self.real, self.device = skin.skeleton, len(pin.places), tables.real, tables.device
        self.skin = Skin(tables, skin, out=tables.real)
        n = len(pin.pin.points)
        ends = np.concatenate([np.tile(np.arange(n)[:, None], 2), np.asarray(pin.ends).reshape(-1, 2)])

        def array(values, dtype):
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=tables.device)
        self.table = filled(driven.Hung, corner=array(corners.astype(np.int32), wp.vec3i),
                            place=array(follow.places, wp.vec3d), ends=array(ends.astype(np.int32), wp.vec2i),
                            origin=wp.vec3d(*pin.body.origin), first=first, pin=number)
        self.x: Any = None

    def launches(self, sampling: Sampling, motions: Sampled) -> list[tuple]:
        """Launches of the skinned points into `x`. motions: of the skeletons of the tables, at the same moments."""
        t = self.table
        self.x = wp.zeros((len(sampling.moments), self.skin.point.shape[1]), dtype=types(self.real).vec3, device=self.device)
        t.motion = int(motions.row[sampling.tables.skeletons.index(self.bones)])
        t.A, t.p = motions.A, motions.p
        return self.skin.launches(sampling, self.x)


class Followers:
    """Pins that follow skinned meshes by curves, in float64."""

    def __init__(self, pins: list[tuple], moments: np.ndarray, device):
        """pins: (pin, its first column among the targets, its number among the speeds) each; moments [s] in a frame."""
        bones: list = []
        for p, _, _ in pins:
            skeleton = p.motion.follow.skin.skeleton
            bones += [skeleton] * (not any(skeleton is other for other in bones))
        tables = Tables(bones, device, wp.float64)
        self.each = [Hung(tables, *row) for row in pins]
        self.sampling, self.motions = Sampling(tables, moments), Sampled(device, "wsim_skeleton_motions")
        self.motions.take([skeleton.motion for skeleton in bones], moments)
        kernel_cache.load("wsim_skeleton_motions", device)

    def launches(self, dt: float, target: wp.array, speed: wp.array | None) -> list[tuple]:
        """Launches of targets, and of greatest speeds, in frames of dt [s]: (kernel, dim, inputs, outputs) each."""
        real = wp.float32 if target.dtype is wp.vec3f else wp.float64
        module = f"wsim_hung_{types(real).name}"
        hang, pull = driven.hang(wp.float64, real, module), driven.pull(wp.float64, module)
        kernel_cache.load(module, target.device)
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
