"""Tables of joints on a device and their evaluation at some times. Kernels: kernels/animation/skeleton.py."""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.animation import skeleton as kernels
from wsim.kernels.math.real import types
from wsim.model import kernel_cache
from wsim.physics.animation import skinning
from wsim.physics.animation.objects import Skeleton


class Tables:
    """Joints of skeletons on a device, and their transforms at some times."""

    def __init__(self, skeletons: list[Skeleton], device, real):
        self.skeletons, self.device = skeletons, device
        module = f"wsim_skeleton_{types(real).name}"
        self.local, self.compose, self.bones = kernels.local(module), kernels.compose(module), kernels.bones(real, module)
        counts = [len(s.joints) for s in skeletons]
        self.start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        self.joints, self.count = kernels.Joints(), int(self.start[-1])
        self.entries = np.concatenate([[0], np.cumsum([len(s.times) * n for s, n in zip(skeletons, counts, strict=True)])])
        each = [skinning.levels(s.parents) for s in skeletons]
        self.levels = [self._array(np.concatenate([first + own[k] for own, first in zip(each, self.start, strict=False)
                                                   if k < len(own)]), int) for k in range(1, max(map(len, each)))]
        self._constants(counts)
        self.keys()
        self.times: wp.array | None = None
        self.world: Any = None
        kernel_cache.load(module, device)

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

    def evaluate(self, times: np.ndarray) -> wp.array:
        """W of all joints at some times [s], (times, joints) mat44d in each skeleton's space."""
        if self.times is None or len(self.times) != len(times):
            self.times = wp.zeros(len(times), dtype=wp.float64, device=self.device)
            self.world = wp.zeros((len(times), self.count), dtype=wp.mat44d, device=self.device)
        self.times.assign(np.asarray(times, np.float64))
        how = {"device": self.device}
        wp.launch(self.local, self.world.shape, [self.joints, self.times], [self.world], **how)
        for level in self.levels:
            wp.launch(self.compose, (len(times), len(level)), [self.joints, level, self.world], [self.world], **how)
        return self.world
