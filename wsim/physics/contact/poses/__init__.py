"""Collider poses of a frame: the columns pose, step, ball, stride of the table of rows, at its substeps.

The device evaluates them before the frame, for all substeps (kernels/animation/motion.py; of other kinds than linear keys, or
in stacks, kernels/animation/track.py; then kernels/animation/collider.py), from keys that were uploaded once, or when a motion
was set. In float64, rounded once at the end. What does not move stays as it was uploaded. Motions that are no keys (those that
`wsim.gradient` shifts) are evaluated on the host (`ColliderRowTable.poses`).
"""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.model.launches import LaunchList
from wsim.physics.contact.colliders import ColliderRowTable

HOST_MOST = 0          # moving colliders that the host evaluates: tests compare both


class ColliderPoses:
    """Poses of the rows of a table (`wsim.kernels.contact.project.contact_tables`), whose four columns it owns."""

    few: np.ndarray                      # distinct colliders that the host evaluates before each frame
    many: np.ndarray                     # and the device
    forming: list                        # meshes that deform, and their rows

    def __init__(self, rows: ColliderRowTable, table, device, real):
        self.rows, self.table, self.device, self.real = rows, table, device, real
        self.dtype = np.float32 if real is wp.float32 else np.float64
        self.found: tuple[np.ndarray, ...] = ()          # of the host: pose, step, ball, stride
        self.device_rows: Any = None                     # `DeviceColliderRows`, once there are some

    def frame(self, substeps: int) -> None:
        """Room for so many substeps; what was there is lost."""
        t, c, n = types(self.real), self.table, max(len(self.rows.collider), 1)

        def zeros_for_poses(length, dtype):
            return wp.zeros((length, n), dtype=dtype, device=self.device)
        c.of.pose, c.of.step = zeros_for_poses(substeps + 1, t.transform), zeros_for_poses(substeps, t.transform)
        c.ball, c.stride = zeros_for_poses(substeps, t.vec4), zeros_for_poses(substeps, t.scalar)
        columns = c.of.pose, c.of.step, c.ball, c.stride
        self.found = tuple(array.numpy() for array in columns)           # on a CPU the arrays themselves

    def place(self, time: float, dt: float, gap: np.ndarray, changed: bool) -> None:
        """Places the rows in the frame of dt [s] that starts at `time` [s]. gap: distance that rows keep [m]; changed: since
        the last frame."""
        rows = self.rows
        if len(rows.collider) == 0:
            return
        if changed:
            self._split_host_and_device()
        number = np.setdiff1d(np.arange(len(rows.colliders)), self.many) if changed else self.few
        if len(number):
            self._upload(number, time + dt * np.arange(self.table.of.pose.shape[0]) / self.table.ball.shape[0], gap)
        if len(self.many):
            if self.device_rows is None:
                self.device_rows = DeviceColliderRows(self.table, self.device, self.real)
            if changed:
                self.device_rows.take(rows, self.many, gap, dt)
            self.device_rows.launch(time)
        for mesh, own in self.forming:
            if "skin" not in mesh.device:
                from wsim.physics.contact.poses.extents import KeyedMesh
                mesh.device["skin"] = KeyedMesh(mesh, self.real, self.device)
            mesh.device["skin"].frame(time, dt, self.table, own)

    def _split_host_and_device(self) -> None:
        """Divides the distinct colliders between the device and the host."""
        rows = self.rows
        forming = np.array([m is not None and m.moves for m in rows.meshes])
        moving = np.array([c.motion.moves for c in rows.colliders]) | forming
        own = np.array([c.motion.by_keys for c in rows.colliders]) & moving
        self.many = np.flatnonzero(own) if own.sum() > HOST_MOST else np.zeros(0, np.int64)
        moving[self.many] = False
        self.few = np.flatnonzero(moving)
        self.forming = [(rows.meshes[k], np.flatnonzero(rows.collider == k)) for k in np.flatnonzero(forming)]

    def on_host(self) -> dict[str, list[str]]:
        """What the host evaluates before every frame: motions that are no curves, meshes by curves that are not straight."""
        each = list(zip(self.rows.colliders, self.rows.meshes, strict=True))
        return {"poses": [c.path for c, _ in each if c.motion.moves and not c.motion.by_keys],
                "points": [c.path for c, mesh in each
                           if mesh is not None and mesh.moves and not getattr(mesh.surface.poses, "plain", True)]}

    def _upload(self, number: np.ndarray, times: np.ndarray, gap: np.ndarray) -> None:
        """Of the distinct colliders of these numbers, on the host."""
        c, rows = self.table, self.rows
        own = np.flatnonzero(np.isin(rows.collider, number))
        pose, step, ball = rows.poses(times, number)
        ball[..., 3] += gap[own]                         # the kernel adds what belongs to the point
        columns = (c.of.pose, c.of.step, c.ball, c.stride)
        for array, every, values in zip(columns, self.found, (pose, step, ball, np.zeros(ball.shape[:2])), strict=True):
            every[:, own] = values
            if self.device.is_cuda:
                array.assign(every)


class DeviceColliderRows:
    """Tables and kernels of colliders that the device evaluates."""

    def __init__(self, table, device, real):
        from wsim.kernels.animation import collider
        from wsim.model import kernel_cache
        from wsim.physics.contact.poses.sampled import SampledMotions
        module = f"wsim_poses_{types(real).name}"
        self.table, self.device, self.sampled = table, device, SampledMotions(device, module)
        self.movers, self.place = collider.MovingColliders(), collider.collider_pose_kernel(real, module)
        kernel_cache.load_kernel_module(module, device)

    def take(self, rows: ColliderRowTable, many: np.ndarray, gap: np.ndarray, dt: float) -> None:
        """Uploads motions and rows of the distinct colliders `many`; gap: of all rows [m]; dt: of a frame [s]."""
        def upload_row_column(values, dtype):
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)
        m, c, substeps = self.movers, self.table, self.table.ball.shape[0]
        self.sampled.take([rows.colliders[k].motion for k in many], dt * np.arange(substeps + 1) / substeps)
        own = np.flatnonzero(np.isin(rows.collider, many))
        of, center = rows.collider[own], rows.centers()
        m.row, m.motion = (upload_row_column(own.astype(np.int32), int),
                           upload_row_column(self.sampled.row[np.searchsorted(many, of)], int))
        m.origin, m.gap = upload_row_column(rows.origin[own], wp.vec3d), upload_row_column(gap[own], wp.float64)
        m.ball = upload_row_column(np.concatenate([center, rows.radius[:, None]], axis=1)[of], wp.vec4d)
        self.sequence = LaunchList(self.device, [*self.sampled.launches(), (
            self.place, (len(own), substeps + 1), [m, self.sampled.A, self.sampled.p], [c.of.pose, c.of.step, c.ball])])

    def launch(self, time: float) -> None:
        self.sampled.begin(time)
        self.sequence.launch()
