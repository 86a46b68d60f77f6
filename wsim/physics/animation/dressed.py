"""Followers of skeletons that rigid bodies drive: meshes that collide, and pins, within the frame in which the bodies go.

Bodies take their frame first (phase pose). Then joints go with them from where they were to where they are, as an animation
with keys at frames would have it: what a result says of the joints, played back, moves cloth alike. What follows the skeleton
meets cloth and soft bodies in the stead of the bodies that drive it, and is not pushed by them. Of one world.

Kernels: kernels/animation/driven.py, kernels/animation/skeleton.py, kernels/animation/skin.py.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from wsim.geometry import rotation
from wsim.kernels.animation import driven as kernels
from wsim.kernels.animation.motion import motion_sample_kernel as linear_sample
from wsim.kernels.math.real import types
from wsim.model import kernel_cache
from wsim.model.launches import LaunchList
from wsim.model.stage import Clock, Stage
from wsim.model.structs import fill_struct
from wsim.physics.animation import skinning
from wsim.physics.animation.driven import skeleton_to_world
from wsim.physics.animation.hung import FollowingPinTables
from wsim.physics.animation.objects import Skeleton
from wsim.physics.animation.skin import DrivenSkin
from wsim.physics.animation.tables import JointSampling, JointTables
from wsim.physics.contact.poses.sampled import SampledMotions

FIELDS = ("x", "e", "q", "o")


class DrivenSampling(JointSampling):
    """Transforms of joints at some moments of a frame, of which bodies drive some: tables of the device, and what they are made
    of."""

    def __init__(self, dressed: DrivenFollowers, moments: np.ndarray):
        """moments [s] in a frame, (times,)."""
        super().__init__(dressed.tables, moments)
        self.dressed, bones = dressed, dressed.skeletons
        self.motions = SampledMotions(dressed.device, dressed.module)
        self.motions.take([each.motion for each in bones], moments)
        stretch = [np.eye(3) if each.stretch is None else each.stretch for each in bones]
        self.driven = fill_struct(kernels.DrivenJoints, **dressed.columns, A=self.motions.A, p=self.motions.p,
                                  motion=dressed.array(self.motions.row, int), stretch=dressed.array(stretch, wp.mat33d),
                                  part=dressed.array(moments / dressed.dt, wp.float64))
        self.before = LaunchList(dressed.device, self.motions.launches())

    def begin(self, time: float) -> None:
        """The frame that begins at `time` [s]."""
        super().begin(time)
        self.motions.begin(time)
        self.before.launch()

    def launch(self) -> None:
        d, t, how = self.dressed, self.tables, {"device": self.dressed.device}
        wp.launch(t.local, self.world.shape, [t.joints, self.start, self.moment], [self.world], **how)
        for k, own in enumerate(d.levels):
            if k:
                level = t.levels[k - 1]
                wp.launch(t.compose, (len(self.moments), len(level)), [t.joints, level, self.world], [self.world], **how)
            if len(own):
                wp.launch(d.drive, (len(self.moments), len(own)), [self.driven, own, d.start, d.end], [self.world], **how)
        wp.launch(t.bones, self.world.shape, [t.joints, self.world], [self.A], **how)


class DrivenFollowingPin(FollowingPinTables):
    """A pin that follows a driven skeleton."""

    def __init__(self, dressed: DrivenFollowers, pin, kind: str, first: int):
        """pin: of `wsim.physics.motion.pins.Pins`; first: its column among the targets of its kind."""
        super().__init__(dressed.tables, pin, first)
        self.dressed, self.kind = dressed, kind
        self.list: list[tuple] = []
        self.made: Any = None                            # what `list` was made for

    def settle(self, sampling: DrivenSampling) -> None:
        if self.made is not sampling:
            self.made = sampling
            self.list = self.launches(sampling, sampling.motions)

    def launch(self) -> None:
        for kernel, dim, inputs, outputs in self.list:
            wp.launch(kernel, dim, inputs, outputs, device=self.dressed.device)
        wp.launch(self.dressed.hang, (len(self.x), self.count), [self.table, self.x], [self.dressed.pins.target[self.kind]],
                  device=self.dressed.device)


class DrivenFollowers:
    """The stage of a frame that moves what follows driven skeletons, and whose tables it keeps."""

    def __init__(self, bones, skeletons: list[Skeleton], bodies):
        """bones: `wsim.physics.animation.method.SkeletonMethod`; bodies: the method of rigid bodies."""
        self.model, self.skeletons, self.rigid = bones.model, skeletons, bodies
        self.device, self.real = self.model.device, self.model.real
        self.tables = JointTables(skeletons, self.device, self.real)
        self.meshes: list[DrivenSkin] = []
        self.hung: list[DrivenFollowingPin] = []
        self.pins: Any = None
        self.samplings: dict[str, DrivenSampling] = {}
        self.module = module = f"wsim_driven_{types(self.real).name}"
        self.drive, self.hang = (kernels.driven_joint_kernel(self.real, module),
                                 kernels.hung_pin_kernel(self.real, self.real, module))
        linear_sample(module)
        kernel_cache.load_kernel_module(module, self.device)
        row = {body.path: k for k, (body, _) in enumerate(bodies.bodies)}
        self.own = [(d, s.joints.index(name), row[path]) for d, s in enumerate(skeletons) for name, path in s.bodies.items()]
        d, j, k = (np.array(column, np.int32) for column in zip(*self.own, strict=True))
        depth = np.concatenate([_joint_tree_levels(s) for s in skeletons])
        joint = self.tables.start[d] + j
        self.levels = [self.array(np.flatnonzero(depth[joint] == level).astype(np.int32), int)
                       for level in range(int(depth.max()) + 1)]
        self.columns = {"joint": self.array(joint, int), "skeleton": self.array(d, int), "body": self.array(k, int),
                        "origin": self.array(bodies.origin[k], wp.vec3d)}
        Where, part = kernels.body_pose_type(self.real), bodies.part.arrays
        self.start = fill_struct(Where, **{name: wp.clone(part[name]) for name in FIELDS})
        self.end = fill_struct(Where, **{name: part[name] for name in FIELDS})
        self.axes: Any = None
        self.bind()

    def array(self, values, dtype) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)

    def bind(self) -> None:
        """C of the driven joints; anew where a live inertia has turned the principal axes of a body."""
        axes = np.array([m.axes for m in self.rigid.masses])
        if self.axes is not None and (axes == self.axes).all():
            return
        self.axes, found = axes, []
        for d, j, k in self.own:
            bones, (body, _), mass = self.skeletons[d], self.rigid.bodies[k], self.rigid.masses[k]
            X = body.motion.at(0.0)
            Y = np.eye(4)
            Y[:3, :3] = X[:3, :3] @ rotation.quaternion_to_matrix(mass.axes)
            Y[:3, 3] = X[:3, :3] @ mass.center + X[:3, 3]
            W = skinning.skeleton_space_transforms(bones.parents, skinning.local_joint_transforms(bones, np.zeros(1)))[0, j]
            found.append(np.linalg.inv(Y) @ skeleton_to_world(bones, 0.0) @ W)
        if "bound" in self.columns:
            self.columns["bound"].assign(np.array(found))
        else:
            self.columns["bound"] = self.array(found, wp.mat44d)

    def hold(self, pins) -> None:
        """Takes the pins that follow these skeletons."""
        self.pins = pins
        for kind, group in pins.groups.items() if pins else ():
            first = 0
            for p in group:
                if p.pin.follows is not None and p.pin.follows.skin.skeleton in self.skeletons:
                    self.hung.append(DrivenFollowingPin(self, p, kind, first))
                    pins.driven.append(p)
                first += len(p.places)

    def stage(self) -> Stage:
        count = sum(skin.point.shape[1] for skin in self.meshes)
        launches = (2 + 2 * len(self.levels)) * (1 + bool(self.hung)) + 4 * len(self.meshes) + 2 * len(self.hung)
        return Stage("driven skeletons", "pose", self.launch, launches, 60 * count, "frame",
                     f"{len(self.own)} joints, {len(self.meshes)} meshes, {len(self.hung)} pins")

    def before_frame(self, time: float, clock: Clock) -> None:
        self.dt = clock.dt
        self.bind()
        for name in FIELDS:
            wp.copy(getattr(self.start, name), getattr(self.end, name))
        wanted = {"mesh": np.arange(clock.substeps + 1) * clock.h} if self.meshes else {}
        wanted |= {hung.kind: clock.moments(hung.kind == "hard") for hung in self.hung}
        for kind, moments in wanted.items():
            if kind not in self.samplings or not np.array_equal(self.samplings[kind].moments, moments):
                self.samplings[kind] = DrivenSampling(self, moments)
            self.samplings[kind].begin(time)
        for skin in self.meshes:
            skin.settle(self.samplings["mesh"])
        for hung in self.hung:
            hung.settle(self.samplings[hung.kind])

    def launch(self, clock: Clock) -> None:
        for sampling in self.samplings.values():
            sampling.launch()
        for skin in self.meshes:
            skin.track()
        for hung in self.hung:
            hung.launch()


def _joint_tree_levels(bones: Skeleton) -> np.ndarray:
    """Levels of the joints, (joints,)."""
    found = np.zeros(len(bones.joints), int)
    for k, level in enumerate(skinning.joints_by_depth(bones.parents)):
        found[level] = k
    return found
