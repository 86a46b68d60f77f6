"""A mesh that joints move, on the device: its points at the substeps of a frame, and how far they go."""

from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.animation import skin as kernels
from wsim.kernels.math.real import types
from wsim.model import kernel_cache
from wsim.model.launches import LaunchList
from wsim.physics.animation import skinning
from wsim.physics.animation.objects import LINEAR, Skinned
from wsim.physics.animation.tables import JointSampling, JointTables
from wsim.physics.contact.poses.extents import DeformedMeshExtents, are_identical_objects

RIGID = 1e-6           # how far axes of a transform may be from orthonormal that counts as rigid


def joints_stay_rigid(skin: Skinned) -> bool:
    """True if no joint of the skeleton is ever scaled or sheared."""
    bones = skin.skeleton
    scales = np.ones(1) if bones.scales is None else bones.scales
    whole = np.concatenate([bones.rest, bones.bind])[:, :3, :3]
    off = np.abs(np.swapaxes(whole, 1, 2) @ whole - np.eye(3)).max(initial=0.0)
    straight = off < RIGID and (np.linalg.det(whole) > 0.0).all()
    return bool(np.abs(scales - 1.0).max() < RIGID and straight)


class SkinnedMeshTables:
    """Device tables of one mesh. `frame` is what `wsim.physics.contact` calls for a mesh of its kind."""

    def __init__(self, tables: JointTables, skin: Skinned, mesh=None, bones=None, out=wp.float32):
        """bones: `wsim.physics.animation.method.SkeletonMethod` of a mesh that contacts search; out: precision of the points
        that it writes."""
        self.tables, self.skin, self.mesh, self.bones = tables, skin, mesh, bones
        real, device, m = tables.real, tables.device, skin.joints.shape[1]
        self.real, self.device = real, device
        self.linear, self.rigid = skin.method == LINEAR, joints_stay_rigid(skin)
        own = m if m <= kernels.UNROLLED else 0
        stretched = skin.skeleton.stretch is not None
        form = f"linear_{own}_{stretched}" if self.linear else f"dual_{own}_{self.rigid}_{stretched}"
        module = f"wsim_skin_{types(real).name}_{types(out).name}_{form}{'_shapes' * bool(skin.blends)}"
        dtype = np.float32 if real is wp.float32 else np.float64
        self.table = kernels.skin_table_type(real)()
        self.first = int(tables.start[[s is skin.skeleton for s in tables.skeletons].index(True)])
        self.table.first = self.first
        joints, weights = skin.joints, skin.parts
        if not self.linear:                                            # the largest first
            order = np.argsort(-weights, axis=1, kind="stable")
            joints, weights = (np.take_along_axis(column, order, axis=1) for column in (joints, weights))
        self.table.joint = wp.array(joints.T.astype(np.uint16).ravel(), dtype=wp.uint16, device=device)
        self.table.weight = wp.array(weights.T.astype(dtype).ravel(), dtype=real, device=device)
        self.table.influences = m
        self.table.stretch = types(real).mat33(*(skin.skeleton.stretch if stretched else np.eye(3)).ravel().tolist())
        self.point = wp.array(skinning.bind_space_points(skin).astype(dtype)[None], dtype=types(real).vec3, device=device)
        self.kernel: Any = (kernels.linear_blend_kernel(real, out, own, stretched, module) if self.linear
                            else kernels.dual_blend_kernel(real, out, own, self.rigid, stretched, module))
        self.part = None if self.linear else kernels.joint_part_kernel(real, self.rigid, module)
        self.shapes: Any = None
        if skin.blends:
            from wsim.physics.animation.shapes import BlendShapeTables
            self.shapes = BlendShapeTables(tables, skin, self.first, module)
        self.extents: Any = DeformedMeshExtents(mesh, real, device, module) if mesh is not None else None
        self.made: tuple = ()                            # what `sequence` and `list` were made for
        kernel_cache.load_kernel_module(module, device)

    def give(self, skeleton) -> None:
        """Another skeleton with the same joints, bound as before: its shapes follow the weights of that one."""
        self.skin, self.made = replace(self.skin, skeleton=skeleton), ()
        if self.shapes:
            self.shapes.give(self.skin)

    def launches(self, sampling: JointSampling, out: wp.array) -> list[tuple]:
        """Launches of the points at the moments of a sampling into `out`, (moments, n): (kernel, dim, inputs, outputs) each."""
        found, point, given = [], self.point, sampling.A         # type: list[tuple], Any, Any
        if self.shapes:
            found += self.shapes.launches(sampling, point)
            point = self.shapes.out
        if not self.linear:
            given = self._allocate_dual_quaternions(sampling.A.shape)
            found.append((self.part, sampling.A.shape, [sampling.A], [given]))
        return [*found, (self.kernel, out.shape, [self.table, point, given], [out])]

    def _allocate_dual_quaternions(self, shape: tuple[int, ...]):
        t, found = types(self.real), kernels.dual_type(self.real)()
        found.turn, found.shift = (wp.zeros(shape, dtype=t.quat, device=self.device) for _ in range(2))
        found.stretch = wp.zeros(shape, dtype=t.mat33, device=self.device)
        return found

    def frame(self, time: float, dt: float, table, rows: np.ndarray) -> None:
        """The mesh's track in the frame of dt [s] that starts at `time` [s], and bounding balls and strides of its rows in the
        table of colliders."""
        sampling, track = self.bones.sampled(time, dt, table.ball.shape[0]), self.mesh.device["track"]
        if not are_identical_objects(self.made, now := (sampling, track, table.ball)):
            self.made = now
            self.sequence = LaunchList(self.device, [*self.launches(sampling, track),
                                                     *self.extents.launches(track, table, rows)])
        self.extents.clear()
        self.sequence.launch()


class DrivenSkin(SkinnedMeshTables):
    """A mesh whose joints bodies drive: its track is launched within the frame, when these have gone."""

    of: Any = None                                       # table of colliders, and its rows there
    sampling: Any = None
    rows: Any = None

    def frame(self, time: float, dt: float, table, rows: np.ndarray) -> None:
        self.of, self.rows = table, rows
        self.settle(self.sampling)

    def settle(self, sampling: JointSampling | None) -> None:
        """Makes room, and ready what `track` launches: a capture takes no memory."""
        self.sampling, track = sampling, self.mesh.device["track"]
        now = sampling, track, self.of and self.of.ball
        if sampling is not None and self.of is not None and not are_identical_objects(self.made, now):
            self.made = now
            self.list = [*self.launches(sampling, track), *self.extents.launches(track, self.of, self.rows)]

    def track(self) -> None:
        """Launches the track of the frame, bounding balls and strides."""
        self.extents.clear()
        for kernel, dim, inputs, outputs in self.list:
            wp.launch(kernel, dim, inputs, outputs, device=self.device)
