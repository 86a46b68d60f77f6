"""A mesh that joints move, on the device: its points at the substeps of a frame, and how far they go."""

from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.animation import skin as kernels
from wsim.kernels.math.real import types
from wsim.model import kernel_cache
from wsim.physics.animation import skinning
from wsim.physics.animation.objects import LINEAR, Skinned

RIGID = 1e-6           # how far axes of a transform may be from orthonormal that counts as rigid


def rigid(skin: Skinned) -> bool:
    """True if no joint of the skeleton is ever scaled or sheared."""
    bones = skin.skeleton
    scales = np.ones(1) if bones.scales is None else bones.scales
    whole = np.concatenate([bones.rest, bones.bind])[:, :3, :3]
    off = np.abs(np.swapaxes(whole, 1, 2) @ whole - np.eye(3)).max(initial=0.0)
    straight = off < RIGID and (np.linalg.det(whole) > 0.0).all()
    return bool(np.abs(scales - 1.0).max() < RIGID and straight)


class Shapes:
    """Blend shapes of a mesh: offsets by point, weights by time."""

    def __init__(self, skin: Skinned, real, module, device):
        self.skin, self.device, self.real, self.dtype = skin, device, real, np.float32 if real is wp.float32 else np.float64
        self.kernel, t = kernels.shapes(real, module), types(real)
        self.out: Any = None
        owner, part, offset, count = [], [], [], 0
        for shape in skin.blends:
            for k in range(len(shape.knots)):
                owner.append(shape.points)
                part.append(np.full(len(shape.points), count + k))
                offset.append(shape.offsets[k] @ skin.geom[:3, :3].T)
            count += len(shape.knots)
        points = np.concatenate(owner)
        order = np.argsort(points, kind="stable")
        first = np.searchsorted(points[order], np.arange(len(skin.points) + 1))
        self.first, self.part = (wp.array(v.astype(np.int32), dtype=int, device=device)
                                 for v in (first, np.concatenate(part)[order]))
        self.offset = wp.array(np.concatenate(offset)[order].astype(self.dtype), dtype=t.vec3, device=device)

    def over(self, point: wp.array, times: np.ndarray) -> wp.array:
        """Bound points with their offsets, (times, n)."""
        weights = np.concatenate([skinning.part_weights(s, skinning.shape_weights(self.skin, s, times))
                                  for s in self.skin.blends], axis=1)
        weight = wp.array(weights.astype(self.dtype), dtype=self.real, device=self.device)
        if self.out is None or len(self.out) != len(times):
            self.out = wp.empty((len(times), point.shape[1]), dtype=point.dtype, device=self.device)
        wp.launch(self.kernel, self.out.shape, [point, self.first, self.part, self.offset, weight], [self.out],
                  device=self.device)
        return self.out


class Skin:
    """Device tables of one mesh. `upload` and `widen` are what `wsim.physics.contact` calls for a mesh of its kind."""

    def __init__(self, bones, skin: Skinned, mesh=None, out=wp.float32):
        """bones: `wsim.physics.animation.method.Bones`; out: precision of the points that it writes."""
        self.bones, self.skin, self.mesh, self.out = bones, skin, mesh, out
        model = bones.model
        real, device, m = model.real, model.device, skin.joints.shape[1]
        self.real, self.device = real, device
        self.linear, self.rigid = skin.method == LINEAR, rigid(skin)
        own = m if m <= kernels.UNROLLED else 0
        stretched = skin.skeleton.stretch is not None
        form = f"linear_{own}_{stretched}" if self.linear else f"dual_{own}_{self.rigid}_{stretched}"
        module = f"wsim_skin_{types(real).name}_{types(out).name}_{form}{'_shapes' * bool(skin.blends)}"
        dtype = np.float32 if real is wp.float32 else np.float64
        self.table = kernels.skins(real)()
        self.table.first = int(bones.tables.start[[s is skin.skeleton for s in bones.skeletons].index(True)])
        joints, weights = skin.joints, skin.parts
        if not self.linear:                                            # the largest first
            order = np.argsort(-weights, axis=1, kind="stable")
            joints, weights = (np.take_along_axis(column, order, axis=1) for column in (joints, weights))
        self.table.joint = wp.array(joints.T.astype(np.uint16).ravel(), dtype=wp.uint16, device=device)
        self.table.weight = wp.array(weights.T.astype(dtype).ravel(), dtype=real, device=device)
        self.table.influences = m
        self.table.stretch = types(real).mat33(*(skin.skeleton.stretch if stretched else np.eye(3)).ravel().tolist())
        self.point = wp.array(skinning.bound(skin).astype(dtype)[None], dtype=types(real).vec3, device=device)
        self.kernel: Any = (kernels.linear(real, out, own, stretched, module) if self.linear
                            else kernels.dual(real, out, own, self.rigid, stretched, module))
        self.part = None if self.linear else kernels.parted(real, self.rigid, module)
        self.shapes = Shapes(skin, real, module, device) if skin.blends else None
        self.duals: Any = None
        self.shaped: Any = None
        self.far: Any = None
        if mesh is not None:
            self.extents, self.wider = kernels.extents(module), kernels.widen(real, module)
            self.center = wp.vec3f(*np.asarray(mesh.center, np.float32).tolist())
        kernel_cache.load(module, device)

    def give(self, skeleton) -> None:
        """Another skeleton with the same joints, bound as before: its shapes follow the weights of that one."""
        self.skin = replace(self.skin, skeleton=skeleton)
        if self.shapes:
            self.shapes.skin = self.skin

    def points(self, times: np.ndarray, out: wp.array) -> None:
        """Launches the points at some times [s] into `out`, (times, n)."""
        A = self.bones.transforms(times)
        self.settle(times, A)
        self.launch(A, out)

    def settle(self, times: np.ndarray, A: wp.array) -> None:
        """Inputs that are known before A is: points with their blend shapes, and room, at some times [s]."""
        self.shaped = self.shapes.over(self.point, times) if self.shapes else self.point
        if not self.linear:
            self.duals = self._duals(A)

    def launch(self, A: wp.array, out: wp.array) -> None:
        """Launches the points at the times that are settled into `out`, (times, n); may be captured."""
        if not self.linear:
            wp.launch(self.part, A.shape, [A], [self.duals], device=self.device)
        given = A if self.linear else self.duals
        wp.launch(self.kernel, out.shape, [self.table, self.shaped, given], [out], device=self.device)

    def _duals(self, A: wp.array):
        if self.duals is not None and self.duals.turn.shape == A.shape:
            return self.duals
        t, found = types(self.real), kernels.duals(self.real)()
        found.turn, found.shift = (wp.zeros(A.shape, dtype=t.quat, device=self.device) for _ in range(2))
        found.stretch = wp.zeros(A.shape, dtype=t.mat33, device=self.device)
        return found

    def upload(self, times: np.ndarray) -> None:
        """The mesh's track of a frame."""
        track = self.mesh.device["track"]
        self.points(times, track)
        self.measure(track)

    def measure(self, track: wp.array) -> None:
        """How far its points are and go in each substep."""
        k = track.shape[0] - 1
        if self.far is None or len(self.far) != k:
            self.far, self.way = (wp.zeros(k, dtype=float, device=self.device) for _ in range(2))
        self.far.zero_(), self.way.zero_()
        wp.launch(self.extents, (k, track.shape[1]), [track, self.center], [self.far, self.way], device=self.device)

    def widen(self, table, rows: np.ndarray) -> None:
        """Bounding balls and strides of its rows in the table of colliders, (rows,)."""
        self.spread(table, wp.array(np.asarray(rows, np.int32), dtype=int, device=self.device))

    def spread(self, table, row: wp.array) -> None:
        wp.launch(self.wider, (len(self.far), len(row)), [row, self.far, self.way, self.real(self.mesh.radius), table.ball],
                  [table.ball, table.stride], device=self.device)


class DrivenSkin(Skin):
    """A mesh whose joints bodies drive: its track is launched within the frame, when these have gone."""

    def upload(self, times: np.ndarray) -> None:
        pass

    def widen(self, table, rows: np.ndarray) -> None:
        self.ball_of, self.rows = table, wp.array(np.asarray(rows, np.int32), dtype=int, device=self.device)
        track = self.mesh.device["track"]
        if self.far is None or len(self.far) != track.shape[0] - 1:                     # a capture takes no memory
            self.measure(track)

    def track(self, A: wp.array) -> None:
        """Launches the track of the frame, bounding balls and strides."""
        track = self.mesh.device["track"]
        self.launch(A, track)
        self.measure(track)
        self.spread(self.ball_of, self.rows)
