"""Blend shapes of a mesh on the device: offsets by point, weights by time (kernels/animation/blend.py)."""

from typing import Any

import numpy as np
import warp as wp

from wsim.geometry import rotation
from wsim.kernels.animation import blend
from wsim.kernels.animation import skin as kernels
from wsim.kernels.math.real import types
from wsim.physics.animation.objects import Skinned
from wsim.physics.animation.tables import JointSampling, JointTables


class BlendShapeTables:
    """Tables of the shapes of one mesh, and the points that they make of bound ones."""

    def __init__(self, tables: JointTables, skin: Skinned, first: int, module: str):
        """first: joint of the skeleton among all joints."""
        self.tables, self.first_joint, self.device, real = tables, first, tables.device, tables.real
        dtype = np.float32 if real is wp.float32 else np.float64
        self.kernel, self.weigh, self.real = (kernels.blend_shape_kernel(real, module), blend.shape_weight_kernel(real, module),
                                              real)
        owner, part, offset = [], [], []                 # type: list[np.ndarray], list[np.ndarray], list[np.ndarray]
        self.count = 0
        for shape in skin.blends:
            for k in range(len(shape.knots)):
                owner.append(shape.points)
                part.append(np.full(len(shape.points), self.count + k))
                offset.append(shape.offsets[k] @ skin.geom[:3, :3].T)
            self.count += len(shape.knots)
        points = np.concatenate(owner)
        order = np.argsort(points, kind="stable")
        self.first = self._array(np.searchsorted(points[order], np.arange(len(skin.points) + 1)).astype(np.int32), int)
        self.part = self._array(np.concatenate(part)[order].astype(np.int32), int)
        self.offset = self._array(np.concatenate(offset)[order].astype(dtype), types(real).vec3)
        self.out: Any = None
        self.give(skin)

    def _array(self, values, dtype) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)

    def give(self, skin: Skinned) -> None:
        """Uploads what the weights are made of."""
        bones, shapes, b = skin.skeleton, skin.blends, blend.BlendShapeTable()
        every = [np.concatenate([[0.0], shape.knots]) for shape in shapes]
        order = [np.argsort(knots, kind="stable") for knots in every]
        before = np.cumsum([0, *(len(shape.knots) for shape in shapes)])
        b.first = self._array(np.cumsum([0, *map(len, every)]).astype(np.int32), int)
        b.knot = self._array(np.concatenate([knots[own] for knots, own in zip(every, order, strict=True)]), wp.float64)
        b.part = self._array(np.concatenate([np.where(own > 0, own - 1 + first, -1) for own, first in
                                             zip(order, before, strict=False)]).astype(np.int32), int)
        curve = bones.weights
        known = [curve is not None and shape.name in bones.shapes for shape in shapes]
        b.joint = self._array(np.array([shape.joint + self.first_joint if shape.joint >= 0 else
                                        blend.ANIMATED if own else blend.NONE
                                        for shape, own in zip(shapes, known, strict=True)], np.int32), int)
        b.turns = self._array(np.array([shape.joint >= 0 and bones.translations is not None and bones.animated[shape.joint]
                                        for shape in shapes], np.int32), int)
        rest = [bones.rest[max(shape.joint, 0), :3, :3] for shape in shapes]
        b.still = self._array(rotation.matrix_quat(rotation.polar_decomposition(np.array(rest))[0]), wp.quatd)
        b.target = self._array(rotation.unit_quat(np.array([shape.rotation for shape in shapes], np.float64)), wp.quatd)
        b.width = self._array(np.array([shape.width for shape in shapes], np.float64), wp.float64)
        b.column = self._array(np.array([bones.shapes.index(shape.name) if own else 0
                                         for shape, own in zip(shapes, known, strict=True)], np.int32), int)
        b.time = self._array(np.zeros(1) if curve is None else curve.times, wp.float64)
        b.value = wp.array(np.zeros((1, 1)) if curve is None else np.asarray(curve.values, np.float64), dtype=wp.float64,
                           device=self.device)
        self.blends, self.shapes = b, len(shapes)

    def launches(self, sampling: JointSampling, point: wp.array) -> list[tuple]:
        """Launches of bound points with their offsets into `out`, (moments, n): (kernel, dim, inputs, outputs) each."""
        n, t = len(sampling.moments), types(self.real)
        self.out = wp.empty((n, point.shape[1]), dtype=point.dtype, device=self.device)
        weight = wp.empty((n, self.count), dtype=t.scalar, device=self.device)
        given = [self.tables.joints, self.blends, sampling.start, sampling.moment]
        return [(self.weigh, (n, self.shapes), given, [weight]),
                (self.kernel, self.out.shape, [point, self.first, self.part, self.offset, weight], [self.out])]
