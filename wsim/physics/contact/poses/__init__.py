"""Collider poses of a frame: the columns pose, step, ball, stride of the table of rows, at its substeps.

Few moving colliders, and those whose meshes deform, are evaluated on the host (`Rows.poses`) and uploaded. Many, and on a GPU
all in frames of many substeps, are evaluated on the device (kernels/animation/motion.py; of other kinds than linear keys, or in
stacks, kernels/animation/track.py; then kernels/animation/collider.py) from keys that were uploaded once, or when a motion was
set. Both in float64, rounded once at the end. What does not move stays as it was uploaded.
"""

from typing import Any

import numpy as np
import warp as wp

from wsim.geometry.rotation import axis_angle, polar
from wsim.kernels.math.real import types
from wsim.physics.contact.colliders import Rows
from wsim.scene.curve import Motion

# Moving colliders that the host evaluates. The device differs in the last bits of float64, so that scenes of few keep theirs.
# Measured on one core at 10 substeps: the host takes 0.35 ms and 0.2 ms for each (4: 1.2 ms), the device 0.04 ms for 4.
HOST_MOST = 4
# Substeps of a frame on a GPU from which it evaluates any: of two at 300 substeps the host takes 1.4 ms, kernels 0.14 on a CPU
LONG = 100


def keys(motion: Motion) -> tuple[np.ndarray, ...]:
    """Columns of `wsim.kernels.animation.motion.Keys` behind the first, of one motion."""
    whole = motion.values[:, :3, :3]
    R, S = polar(whole)
    axis, angle = axis_angle(np.swapaxes(R[:-1], 1, 2) @ R[1:])
    return (motion.times, motion.values[:, :3, 3], whole, R, S, np.concatenate([axis, [[1.0, 0.0, 0.0]]]),
            np.append(angle, 0.0))


class Poses:
    """Poses of the rows of a table (`wsim.kernels.contact.project.tables`), whose four columns it owns."""

    few: np.ndarray                      # distinct colliders that the host evaluates before each frame
    many: np.ndarray                     # and the device: by linear keys
    tracks: np.ndarray                   # and of other kinds

    def __init__(self, rows: Rows, table, device, real):
        self.rows, self.table, self.device, self.real = rows, table, device, real
        self.dtype = np.float32 if real is wp.float32 else np.float64
        self.found: tuple[np.ndarray, ...] = ()          # of the host: pose, step, ball, stride
        self.loaded: dict[str, Any] = {}                 # `Device`s, once there are many

    def frame(self, substeps: int) -> None:
        """Room for so many substeps; what was there is lost."""
        t, c, n = types(self.real), self.table, max(len(self.rows.collider), 1)

        def zeros(length, dtype):
            return wp.zeros((length, n), dtype=dtype, device=self.device)
        c.pose, c.step = zeros(substeps + 1, t.transform), zeros(substeps, t.transform)
        c.ball, c.stride = zeros(substeps, t.vec4), zeros(substeps, t.scalar)
        self.found = tuple(array.numpy() for array in (c.pose, c.step, c.ball, c.stride))     # on a CPU the arrays themselves

    def place(self, time: float, dt: float, gap: np.ndarray, changed: bool) -> None:
        """Places the rows in the frame of dt [s] that starts at `time` [s]. gap: distance that rows keep [m]; changed: since
        the last frame."""
        rows = self.rows
        if len(rows.collider) == 0:
            return
        if changed:
            moving = np.array([c.motion.moves for c in rows.colliders])
            forming = np.array([m is not None and m.moves for m in rows.meshes])
            known = np.array([type(c.motion) is Motion or c.motion.kind == "stack" for c in rows.colliders])
            plain = np.array([c.motion.plain for c in rows.colliders])
            self.many, self.tracks = (np.flatnonzero(moving & ~forming & known & own) for own in (plain, ~plain))
            few = moving | forming
            most = 0 if self.device.is_cuda and self.table.ball.shape[0] >= LONG else HOST_MOST
            if len(self.many) <= most:
                self.many = self.many[:0]
            if len(self.tracks) <= most:
                self.tracks = self.tracks[:0]
            few[self.many] = few[self.tracks] = False
            self.few = np.flatnonzero(few)
        number = np.setdiff1d(np.arange(len(rows.colliders)), [*self.many, *self.tracks]) if changed else self.few
        if len(number):
            self._upload(number, time + dt * np.arange(self.table.pose.shape[0]) / self.table.ball.shape[0], gap)
        for name, many in (("keys", self.many), ("tracks", self.tracks)):
            if len(many):
                self._evaluate(name, many, time, dt, gap if changed else None)

    def _upload(self, number: np.ndarray, times: np.ndarray, gap: np.ndarray) -> None:
        """Of the distinct colliders of these numbers, on the host."""
        c, rows = self.table, self.rows
        own = np.flatnonzero(np.isin(rows.collider, number))
        pose, step, ball = rows.poses(times, number)
        stride = np.zeros(ball.shape[:2])
        for k in number:
            mesh = rows.meshes[k]
            if mesh is not None and mesh.moves:
                stride[:, rows.collider[own] == k] = mesh.upload(times)[:, None]
        ball[..., 3] += stride + gap[own]                # the kernel adds what belongs to the point
        columns = (c.pose, c.step, c.ball, c.stride)
        for array, every, values in zip(columns, self.found, (pose, step, ball, stride), strict=True):
            every[:, own] = values
            if self.device.is_cuda:
                array.assign(every)
        for k in number:
            mesh = rows.meshes[k]
            if mesh is not None and mesh.moves and "skin" in mesh.device:
                mesh.device["skin"].widen(c, np.flatnonzero(rows.collider == k))

    def _evaluate(self, name: str, many: np.ndarray, time: float, dt: float, gap: np.ndarray | None) -> None:
        """Of `many`, on the device. gap: where something changed."""
        if name not in self.loaded:
            self.loaded[name] = Device(name, self.table, self.device, self.real)
        if gap is not None:
            self.loaded[name].take(self.rows, many, gap)
        self.loaded[name].launch(time, dt)


class Device:
    """Tables and kernels of colliders that the device evaluates; compiled when there are some. source: "keys" or "tracks"."""

    def __init__(self, source: str, table, device, real):
        from wsim.kernels.animation import collider
        from wsim.model import kernel_cache
        self.table, self.device, module = table, device, f"wsim_poses_{types(real).name}"
        if source == "tracks":
            from wsim.physics.contact.poses.tracks import Tracks
            module = f"wsim_tracks_{types(real).name}"
            self.source: Any = Tracks(device)
        else:
            self.source = Linear(device, module)
        self.movers, self.place = collider.Movers(), collider.place(real, module)
        kernel_cache.load(module, device)

    def take(self, rows: Rows, many: np.ndarray, gap: np.ndarray) -> None:
        """Uploads motions and rows of the distinct colliders `many`; gap: of all rows [m]."""
        def array(values, dtype):
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)
        m = self.movers
        self.source.take([rows.colliders[k].motion for k in many])
        own = np.flatnonzero(np.isin(rows.collider, many))
        of, center = rows.collider[own], rows.centers()
        m.row, m.motion = array(own.astype(np.int32), int), array(np.searchsorted(many, of).astype(np.int32), int)
        m.origin, m.gap = array(rows.origin[own], wp.vec3d), array(gap[own], wp.float64)
        m.ball = array(np.concatenate([center, rows.radius[:, None]], axis=1)[of], wp.vec4d)
        shape = (len(many), self.table.pose.shape[0])
        self.A = wp.zeros(shape, dtype=wp.mat33d, device=self.device)
        self.p = wp.zeros(shape, dtype=wp.vec3d, device=self.device)

    def launch(self, time: float, dt: float) -> None:
        self.source.launch(self.A, self.p, time, dt)
        c = self.table
        wp.launch(self.place, (len(self.movers.row), self.A.shape[1]), [self.movers, self.A, self.p], [c.pose, c.step, c.ball],
                  device=self.device)


class Linear:
    """Keys of plain motions on the device, and the kernel that samples them."""

    def __init__(self, device, module):
        from wsim.kernels.animation import motion
        self.device, self.keys, self.sample = device, motion.Keys(), motion.sample(module)
        self.known: dict[int, tuple[Motion, tuple]] = {}

    def take(self, motions: list[Motion]) -> None:
        """Uploads them; what was there before is not worked out again."""
        def array(values, dtype):
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)
        for number, motion in enumerate(motions):
            if number not in self.known or self.known[number][0] is not motion:
                self.known[number] = motion, keys(motion)
        each, k = [self.known[number][1] for number in range(len(motions))], self.keys
        k.first = array(np.concatenate([[0], np.cumsum([len(own[0]) for own in each])]).astype(np.int32), int)
        columns = [np.concatenate(column) for column in zip(*each, strict=True)]
        k.time, k.angle = array(columns[0], wp.float64), array(columns[6], wp.float64)
        k.place, k.axis = array(columns[1], wp.vec3d), array(columns[5], wp.vec3d)
        k.whole, k.turned, k.stretch = (array(column, wp.mat33d) for column in columns[2:5])

    def launch(self, A: wp.array, p: wp.array, time: float, dt: float) -> None:
        wp.launch(self.sample, A.shape, [self.keys, time, dt], [A, p], device=self.device)
