"""Motions on the device at the moments of a frame: by linear keys (kernels/animation/motion.py), and of any other kind
(kernels/animation/track.py)."""

from typing import Any

import numpy as np
import warp as wp

from wsim.geometry.rotation import axis_angle, polar_decomposition
from wsim.scene.curve import Motion


def linear_key_columns(motion: Motion) -> tuple[np.ndarray, ...]:
    """Columns of `wsim.kernels.animation.motion.MotionKeys` behind the first, of one motion."""
    whole = motion.values[:, :3, :3]
    R, S = polar_decomposition(whole)
    axis, angle = axis_angle(np.swapaxes(R[:-1], 1, 2) @ R[1:])
    return (motion.times, motion.values[:, :3, 3], whole, R, S, np.concatenate([axis, [[1.0, 0.0, 0.0]]]),
            np.append(angle, 0.0))


class LinearMotions:
    """Keys of plain motions on the device, and the kernel that samples them."""

    def __init__(self, device, module):
        from wsim.kernels.animation import motion
        self.device, self.keys, self.sample = device, motion.MotionKeys(), motion.motion_sample_kernel(module)
        self.known: dict[int, tuple[Motion, tuple]] = {}

    def take(self, motions: list[Motion]) -> None:
        """Uploads them; what was there before is not worked out again."""
        def upload_key_column(values, dtype):
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)
        for number, motion in enumerate(motions):
            if number not in self.known or self.known[number][0] is not motion:
                self.known[number] = motion, linear_key_columns(motion)
        each, k = [self.known[number][1] for number in range(len(motions))], self.keys
        k.first = upload_key_column(np.concatenate([[0], np.cumsum([len(own[0]) for own in each])]).astype(np.int32), int)
        columns = [np.concatenate(column) for column in zip(*each, strict=True)]
        k.time, k.angle = upload_key_column(columns[0], wp.float64), upload_key_column(columns[6], wp.float64)
        k.place, k.axis = upload_key_column(columns[1], wp.vec3d), upload_key_column(columns[5], wp.vec3d)
        k.whole, k.turned, k.stretch = (upload_key_column(column, wp.mat33d) for column in columns[2:5])

    def tables(self) -> list:
        return [self.keys]


class SampledMotions:
    """Linear parts A and places p [m] of motions at moments of a frame, (motions, moments); `row` is where each stands."""

    def __init__(self, device, module: str):
        """module: of the kernel for linear keys."""
        self.device, self.linear = device, LinearMotions(device, module)
        self.tracks: Any = None
        self.start = wp.zeros(1, dtype=wp.float64, device=device)

    def take(self, motions: list[Motion], moments: np.ndarray) -> None:
        """Uploads motions, and moments [s] in a frame; makes room for what they become."""
        plain = np.array([m.plain for m in motions], bool)
        order = np.argsort(~plain, kind="stable")
        self.row = np.argsort(order, kind="stable").astype(np.int32)
        self.moment = wp.array(np.ascontiguousarray(moments, np.float64), dtype=wp.float64, device=self.device)
        shape, self.split = (len(motions), len(moments)), int(plain.sum())
        self.A = wp.zeros(shape, dtype=wp.mat33d, device=self.device)
        self.p = wp.zeros(shape, dtype=wp.vec3d, device=self.device)
        if self.split:
            self.linear.take([motions[k] for k in order[:self.split]])
        if self.split < len(motions):
            if self.tracks is None:
                from wsim.physics.contact.poses.tracks import MotionTracks
                self.tracks = MotionTracks(self.device)
            self.tracks.take([motions[k] for k in order[self.split:]])

    def launches(self) -> list[tuple]:
        """Launches that evaluate all of them: (kernel, dim, inputs, outputs) each."""
        parts = [(self.linear, slice(0, self.split))] * bool(self.split)
        parts += [(self.tracks, slice(self.split, None))] * (self.split < len(self.A))
        return [(of.sample, (A := self.A[own]).shape, [*of.tables(), self.start, self.moment], [A, self.p[own]])
                for of, own in parts]

    def begin(self, time: float) -> None:
        """Sets when the frame begins [s]."""
        self.start.fill_(time)
