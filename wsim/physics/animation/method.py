"""Skeletons on the device: joints of all of them in one table, evaluated at the substeps of a frame before it begins (phase
pose), and the meshes that they move, which contacts search. Kernels: kernels/animation/skeleton.py, kernels/animation/skin.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.animation import skeleton as kernels
from wsim.kernels.math.real import types
from wsim.model import kernel_cache
from wsim.model.stage import Clock, Method, Methods
from wsim.physics.animation import skinning
from wsim.physics.animation.objects import Skeleton, Skinned
from wsim.physics.animation.skin import Skin
from wsim.scene.samples import Sample

if TYPE_CHECKING:
    from wsim.simulation.methods import Build


def build(b: Build) -> Method:
    return Bones(b.model, b.scene.things("Skeleton"))


def signature(b: Build) -> list:
    return []                                            # kernels stand in modules of their own


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


class Bones(Method):
    """All skeletons of a scene, which worlds share."""

    def __init__(self, model, skeletons: list[Skeleton]):
        super().__init__("bones")
        self.model, self.skeletons = model, list(skeletons)
        self.tables = Tables(self.skeletons, model.device, model.real)
        self.skins: list[Skin] = []
        self.at: tuple | None = None
        self.A: Any = None
        self.driven = [bones for bones in skeletons if bones.bodies]
        self.now = 0.0                                   # [s] where the last frame ended
        self.bodies: Any = None                          # the method of rigid bodies, where they drive joints
        self.offers = {"bones": self}

    def meet(self, others: Methods) -> None:
        self.bodies = others.find("bodies")
        contacts = others.find("contacts")
        for mesh in contacts.meshes.values() if contacts else ():
            if isinstance(mesh.surface.poses, Skinned):
                skin = Skin(self, mesh.surface.poses, mesh)
                self.skins.append(skin)
                mesh.device["skin"] = skin

    def before_frame(self, time: float, clock: Clock) -> None:
        self.now = time + clock.dt

    def resumed(self, time: float) -> None:
        self.now = time + 1.0 / self.model.scene.fps

    def samples(self, world: int = 0) -> list[Sample]:
        """Joints of skeletons that bodies drive."""
        if not self.driven:
            return []
        from wsim.physics.animation.driven import sample
        poses = self.bodies.poses()
        moved = {body.path: poses[k] @ np.linalg.inv(body.motion.at(0.0))
                 for k, (body, of) in enumerate(self.bodies.bodies) if of == world}
        return [sample(bones, moved, self.now) for bones in self.driven]

    def give(self, old: Skeleton, new: Skeleton) -> None:
        """Puts a skeleton in the place of another one with the same joints and keys, from the next frame on."""
        self.skeletons[[bones is old for bones in self.skeletons].index(True)] = new
        self.tables.keys()
        self.at = None
        for skin in self.skins:
            if skin.skin.skeleton is old:
                skin.give(new)

    def transforms(self, times: np.ndarray) -> wp.array:
        """A of all joints at some times [s], (times, joints), in the precision of the run. Once a frame, for all meshes."""
        key = tuple(times)
        if key != self.at:
            world = self.tables.evaluate(times)
            real = self.model.real
            if self.A is None or self.A.shape != world.shape:
                self.A = wp.zeros(world.shape, dtype=wp.types.matrix((3, 4), real), device=self.model.device)
            wp.launch(self.tables.bones, world.shape, [self.tables.joints, world], [self.A], device=self.model.device)
            self.at = key
        return self.A
