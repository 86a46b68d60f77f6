"""Tables of joints on a device and their evaluation at moments of a frame. Kernels: kernels/animation/skeleton.py."""

import numpy as np
import warp as wp

from wsim.kernels.animation import skeleton as kernels
from wsim.kernels.math.real import types
from wsim.model import kernel_cache
from wsim.physics.animation import skinning
from wsim.physics.animation.objects import Skeleton


class JointTables:
    """Joints of skeletons on a device, and their transforms at some times."""

    def __init__(self, skeletons: list[Skeleton], device, real):
        self.skeletons, self.device, self.real = skeletons, device, real
        module = f"wsim_skeleton_{types(real).name}"
        self.local, self.compose, self.bones = (kernels.local_joint_kernel(module), kernels.joint_compose_kernel(module),
                                                kernels.skin_matrix_kernel(real, module))
        counts = [len(s.joints) for s in skeletons]
        self.start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        self.joints, self.count = kernels.SkeletonJoints(), int(self.start[-1])
        self.entries = np.concatenate([[0], np.cumsum([len(s.times) * n for s, n in zip(skeletons, counts, strict=True)])])
        each = [skinning.joints_by_depth(s.parents) for s in skeletons]
        self.levels = [self._array(np.concatenate([first + own[k] for own, first in zip(each, self.start, strict=False)
                                                   if k < len(own)]), int) for k in range(1, max(map(len, each)))]
        self._constants(counts)
        self.keys()
        kernel_cache.load_kernel_module(module, device)

    def _array(self, values, dtype) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)

    def _constants(self, counts: list[int]) -> None:
        j, own = self.joints, self.skeletons
        each = list(zip(own, self.start.tolist(), strict=False))
        above = [np.where(s.parents < 0, -1, s.parents + a) for s, a in each]
        j.parent = self._array(np.concatenate(above).astype(np.int32), int)
        j.skeleton = self._array(np.repeat(np.arange(len(own), dtype=np.int32), counts), int)
        j.animated = self._array(np.concatenate([s.animated for s in own]).astype(np.int32), int)
        j.entry = self._array(np.concatenate([e + np.arange(n) for e, n in zip(self.entries, counts, strict=False)]
                                             ).astype(np.int32), int)
        j.width = self._array(np.repeat(np.array(counts, np.int32), counts), int)
        j.rest = self._array(np.concatenate([s.rest for s in own]), wp.mat44d)
        j.unbind = self._array(np.concatenate([np.linalg.inv(s.bind) for s in own]), wp.mat44d)
        j.first = self._array(np.concatenate([[0], np.cumsum([len(s.times) for s in own])]).astype(np.int32), int)
        j.time = self._array(np.concatenate([s.times for s in own]), wp.float64)

    def keys(self) -> None:
        """Uploads the keys of all joints."""
        T, Q, S = [], [], []
        for s in self.skeletons:
            still = s.translations is None
            shape = len(s.times) * len(s.joints)
            T.append(np.zeros((shape, 3)) if still else s.translations.reshape(-1, 3))
            Q.append(np.tile([0.0, 0.0, 0.0, 1.0], (shape, 1)) if still else s.orientations.reshape(-1, 4))
            S.append(np.ones((shape, 3)) if still else s.scales.reshape(-1, 3))
        j = self.joints
        j.place, j.scale = self._array(np.concatenate(T), wp.vec3d), self._array(np.concatenate(S), wp.vec3d)
        j.turn = self._array(np.concatenate(Q), wp.quatd)


class JointSampling:
    """Transforms of the joints of some tables at moments of a frame: W and A, (moments, joints)."""

    def __init__(self, tables: JointTables, moments: np.ndarray):
        """moments [s] in a frame, (moments,)."""
        self.tables, self.moments, device = tables, moments, tables.device
        shape = len(moments), tables.count
        self.start = wp.zeros(1, dtype=wp.float64, device=device)
        self.moment = wp.array(np.ascontiguousarray(moments, np.float64), dtype=wp.float64, device=device)
        self.world = wp.zeros(shape, dtype=wp.mat44d, device=device)
        self.A = wp.zeros(shape, dtype=wp.types.matrix((3, 4), tables.real), device=device)

    def begin(self, time: float) -> None:
        """Sets when the frame begins [s]."""
        self.start.fill_(time)

    def launches(self) -> list[tuple]:
        """Launches that evaluate all joints: (kernel, dim, inputs, outputs) each."""
        t, world = self.tables, self.world
        return [(t.local, world.shape, [t.joints, self.start, self.moment], [world]),
                *((t.compose, (len(world), len(level)), [t.joints, level, world], [world]) for level in t.levels),
                (t.bones, world.shape, [t.joints, world], [self.A])]
