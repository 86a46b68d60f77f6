"""Skeletons on the device: joints of all of them in one table, evaluated at the substeps of a frame before it begins (phase
pose), and the meshes that they move, which contacts search. Kernels: kernels/animation/skeleton.py, kernels/animation/skin.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.model.launches import LaunchList
from wsim.model.stage import Clock, Method, Methods, Ports
from wsim.physics.animation.objects import Skeleton, Skinned
from wsim.physics.animation.skin import DrivenSkin, SkinnedMeshTables
from wsim.physics.animation.tables import JointSampling, JointTables
from wsim.scene import Problem, SceneError
from wsim.scene.methods import paths_following
from wsim.scene.samples import Sample
from wsim.scene.values.coverage import gradient_refusal

if TYPE_CHECKING:
    from wsim.simulation.methods import Build


def build(b: Build) -> Method:
    """Raises SceneError where several worlds, or gradients, are wanted of what follows skeletons that bodies drive."""
    driven = [bones for bones in b.scene.things("Skeleton") if bones.bodies and paths_following(b.scene, bones)]
    for bones in driven:
        if b.model.gradients:
            raise gradient_refusal("dressed", bones.path)
        if b.model.worlds > 1:
            raise SceneError(Problem(bones.path, "rigid bodies drive what others follow, and there are "
                                     f"{b.model.worlds} worlds, which share their meshes; run a world at a time"))
    return SkeletonMethod(b.model, b.scene.things("Skeleton"), driven)


def signature(b: Build) -> list:
    return []                                            # kernels stand in modules of their own


class SkeletonMethod(Method):
    """All skeletons of a scene, which worlds share."""

    def __init__(self, model, skeletons: list[Skeleton], dressed: Sequence[Skeleton] = ()):
        """dressed: those that bodies drive and something follows."""
        super().__init__("bones")
        self.model, self.skeletons = model, list(skeletons)
        self.tables = JointTables(self.skeletons, model.device, model.real)
        self.skins: list[SkinnedMeshTables] = []
        self.samplings: dict[tuple, tuple] = {}          # of the substeps of a frame, and their launches
        self.at: tuple | None = None
        self.driven = [bones for bones in skeletons if bones.bodies]
        self.followed = list(dressed)
        self.dressed: Any = None                         # `wsim.physics.animation.dressed.DrivenFollowers`
        self.now = 0.0                                   # [s] where the last frame ended
        self.bodies: Any = None                          # the method of rigid bodies, where they drive joints
        self.offers = Ports(bones=self)

    def connect_ports(self, others: Methods) -> None:
        self.bodies = others.ports.bodies
        contacts = others.ports.contacts
        if self.followed:
            from wsim.physics.animation.dressed import DrivenFollowers
            self.dressed = DrivenFollowers(self, self.followed, self.bodies)
            self.dressed.hold(others.ports.pins)
        for mesh in contacts.meshes.values() if contacts else ():
            if isinstance(mesh.surface.poses, Skinned):
                driven = any(mesh.surface.poses.skeleton is bones for bones in self.followed)
                of = self.dressed if driven else self
                skin = (DrivenSkin if driven else SkinnedMeshTables)(of.tables, mesh.surface.poses, mesh, of)
                (self.dressed.meshes if driven else self.skins).append(skin)
                mesh.device["skin"] = skin
        if self.dressed:
            self.stages = [self.dressed.stage()]

    def before_frame(self, time: float, clock: Clock) -> None:
        self.now = time + clock.dt
        if self.dressed:
            self.dressed.before_frame(time, clock)

    def resume_run(self, time: float) -> None:
        self.now = time + 1.0 / self.model.scene.fps

    def samples(self, world: int = 0) -> list[Sample]:
        """Joints of skeletons that bodies drive."""
        if not self.driven:
            return []
        from wsim.physics.animation.driven import driven_joint_sample
        poses = self.bodies.poses()
        moved = {body.path: poses[k] @ np.linalg.inv(body.motion.at(0.0))
                 for k, (body, of) in enumerate(self.bodies.bodies) if of == world}
        return [driven_joint_sample(bones, moved, self.now) for bones in self.driven]

    def give(self, old: Skeleton, new: Skeleton) -> None:
        """Puts a skeleton in the place of another one with the same joints and keys, from the next frame on."""
        self.skeletons[[bones is old for bones in self.skeletons].index(True)] = new
        self.tables.keys()
        self.samplings.clear()
        self.at = None
        for skin in self.skins:
            if skin.skin.skeleton is old:
                skin.give(new)

    def sampled(self, time: float, dt: float, substeps: int) -> JointSampling:
        """Joints at the substeps of the frame of dt [s] that starts at `time` [s]. Once a frame, for all meshes."""
        if (key := (dt, substeps)) not in self.samplings:
            sampling = JointSampling(self.tables, dt * np.arange(substeps + 1) / substeps)
            self.samplings[key] = sampling, LaunchList(self.model.device, sampling.launches())
        sampling, sequence = self.samplings[key]
        if (time, key) != self.at:
            sampling.begin(time)
            sequence.launch()
            self.at = time, key
        return sampling
