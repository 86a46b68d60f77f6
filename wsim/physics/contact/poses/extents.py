"""How far the points of a mesh that deforms are and go in each substep, in the table of colliders; and meshes whose points have
keys. Kernels: kernels/animation/skin.py."""

import numpy as np
import warp as wp

from wsim.kernels.animation import skin as kernels
from wsim.kernels.math.real import types
from wsim.model import kernel_cache
from wsim.model.launches import LaunchList


def are_identical_objects(a: tuple, b: tuple) -> bool:
    """True if two tuples hold the very same things."""
    return len(a) == len(b) and all(x is y for x, y in zip(a, b, strict=True))


class DeformedMeshExtents:
    """Bounding balls and strides of the rows of one mesh, from its track of a frame."""

    def __init__(self, mesh, real, device, module: str):
        """module: which its kernels join."""
        self.mesh, self.real, self.device = mesh, real, device
        self.extents, self.wider = kernels.skin_extent_kernel(module), kernels.skin_ball_kernel(real, module)
        self.center = wp.vec3f(*np.asarray(mesh.center, np.float32).tolist())

    def launches(self, track: wp.array, table, rows: np.ndarray) -> list[tuple]:
        """Launches that measure a track and widen rows of the table: (kernel, dim, inputs, outputs) each."""
        k, row = track.shape[0] - 1, wp.array(np.asarray(rows, np.int32), dtype=int, device=self.device)
        self.far, self.way = (wp.zeros(k, dtype=float, device=self.device) for _ in range(2))
        return [(self.extents, (k, track.shape[1]), [track, self.center], [self.far, self.way]),
                (self.wider, (k, len(row)), [row, self.far, self.way, self.real(self.mesh.radius), table.ball],
                 [table.ball, table.stride])]

    def clear(self) -> None:
        """Zeros what is measured: maxima."""
        self.far.zero_(), self.way.zero_()


class KeyedMesh:
    """Device tables of a mesh whose points have keys, straight between them (a `Curve`); others are evaluated on the host."""

    def __init__(self, mesh, real, device):
        self.mesh, self.device, module = mesh, device, f"wsim_keyed_{types(real).name}"
        self.extents, self.blend = DeformedMeshExtents(mesh, real, device, module), kernels.point_key_kernel(module)
        self.made: tuple = ()                            # what `sequence` was made for
        self.start, curve = wp.zeros(1, dtype=wp.float64, device=device), mesh.surface.poses
        self.plain = curve.plain
        if self.plain:
            self.time = wp.array(curve.times, dtype=wp.float64, device=device)
            self.value = wp.array(np.asarray(curve.values, np.float32), dtype=wp.vec3f, device=device)
        kernel_cache.load_kernel_module(module, device)

    def frame(self, time: float, dt: float, table, rows: np.ndarray) -> None:
        """As `wsim.physics.animation.skin.SkinnedMeshTables.frame`."""
        track, k = self.mesh.device["track"], table.ball.shape[0]
        moments = dt * np.arange(k + 1) / k
        if not are_identical_objects(self.made, now := (track, table.ball)):
            self.made = now
            moment = wp.array(moments, dtype=wp.float64, device=self.device)
            blend = [(self.blend, track.shape, [self.time, self.value, self.start, moment], [track])] * self.plain
            self.sequence = LaunchList(self.device, [*blend, *self.extents.launches(track, table, rows)])
        self.start.fill_(time)
        if not self.plain:
            track.assign(np.stack([self.mesh.surface.poses.at(t) for t in time + moments]).astype(np.float32))
        self.extents.clear()
        self.sequence.launch()
