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
from wsim.kernels.math.real import types
from wsim.model import kernel_cache
from wsim.model.stage import Clock, Stage
from wsim.model.structs import filled
from wsim.physics.animation import skinning
from wsim.physics.animation.driven import placed
from wsim.physics.animation.objects import Follow, Skeleton
from wsim.physics.animation.skin import DrivenSkin, Skin
from wsim.physics.animation.tables import Tables

FIELDS = ("x", "e", "q", "o")


class Sampling:
    """Transforms of joints at some moments of a frame: tables of the device, and what they are made of."""

    def __init__(self, dressed: Dressed, moments: np.ndarray):
        """moments [s] in a frame, (times,)."""
        self.dressed, self.moments = dressed, moments
        device, count, tables = dressed.device, len(moments), dressed.tables
        self.times = wp.zeros(count, dtype=wp.float64, device=device)
        self.world = wp.zeros((count, tables.count), dtype=wp.mat44d, device=device)
        self.A = wp.zeros((count, tables.count), dtype=wp.types.matrix((3, 4), dressed.real), device=device)
        self.driven = filled(kernels.Driven, **dressed.columns)
        self.driven.back = wp.zeros((count, len(dressed.skeletons)), dtype=wp.mat44d, device=device)
        self.driven.part = wp.array(moments / dressed.dt, dtype=wp.float64, device=device)

    def begin(self, time: float) -> None:
        """The frame that begins at `time` [s]."""
        self.times.assign(time + self.moments)
        self.driven.bound = self.dressed.columns["bound"]
        still = not any(bones.motion.moves for bones in self.dressed.skeletons)
        at = [time] if still else time + self.moments
        back = np.array([[np.linalg.inv(placed(bones, t)) for bones in self.dressed.skeletons] for t in at])
        self.driven.back.assign(np.broadcast_to(back, (len(self.moments), *back.shape[1:])))

    def launch(self) -> None:
        d, t, how = self.dressed, self.dressed.tables, {"device": self.dressed.device}
        wp.launch(t.local, self.world.shape, [t.joints, self.times], [self.world], **how)
        for k, own in enumerate(d.levels):
            if k:
                level = t.levels[k - 1]
                wp.launch(t.compose, (len(self.moments), len(level)), [t.joints, level, self.world], [self.world], **how)
            if len(own):
                wp.launch(d.drive, (len(self.moments), len(own)), [self.driven, own, d.start, d.end], [self.world], **how)
        wp.launch(t.bones, self.world.shape, [t.joints, self.world], [self.A], **how)


class Hung:
    """A pin that follows a driven skeleton."""

    def __init__(self, dressed: Dressed, pin, kind: str, first: int):
        """pin: of `wsim.physics.motion.pins.Pins`; first: its column among the targets of its kind."""
        follow: Follow = pin.pin.follows
        skin, corners = follow.only_points()
        self.dressed, self.kind, self.bones, self.count = dressed, kind, skin.skeleton, len(pin.places)
        self.skin = Skin(dressed, skin, out=dressed.real)
        n = len(pin.pin.points)
        ends = np.concatenate([np.tile(np.arange(n)[:, None], 2), np.asarray(pin.ends).reshape(-1, 2)])

        def array(values, dtype):
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=dressed.device)
        self.table = filled(kernels.Hung, corner=array(corners.astype(np.int32), wp.vec3i),
                            place=array(follow.places, wp.vec3d), ends=array(ends.astype(np.int32), wp.vec2i),
                            origin=wp.vec3d(*pin.body.origin), first=first)
        self.x: Any = None

    def begin(self, time: float, moments: np.ndarray) -> None:
        d = self.dressed
        if self.x is None or len(self.x) != len(moments):
            shape = (len(moments), self.skin.point.shape[1])
            self.x = wp.zeros(shape, dtype=types(d.real).vec3, device=d.device)
            self.table.motion = wp.zeros(len(moments), dtype=wp.mat44d, device=d.device)
        M = np.array([self.bones.motion.at(time + t) for t in moments])
        self.table.motion.assign(M)
        self.skin.settle(time + moments, d.samplings[self.kind].A)

    def launch(self) -> None:
        d = self.dressed
        self.skin.launch(d.samplings[self.kind].A, self.x)
        wp.launch(d.hang, (len(self.x), self.count), [self.table, self.x], [d.pins.target[self.kind]], device=d.device)


class Dressed:
    """The stage of a frame that moves what follows driven skeletons, with the interface that `Skin` asks of `Bones`."""

    def __init__(self, bones, skeletons: list[Skeleton], bodies):
        """bones: `wsim.physics.animation.method.Bones`; bodies: the method of rigid bodies."""
        self.model, self.skeletons, self.rigid = bones.model, skeletons, bodies
        self.device, self.real = self.model.device, self.model.real
        self.tables = Tables(skeletons, self.device, self.real)
        self.meshes: list[DrivenSkin] = []
        self.hung: list[Hung] = []
        self.pins: Any = None
        self.samplings: dict[str, Sampling] = {}
        module = f"wsim_driven_{types(self.real).name}"
        self.drive, self.hang = kernels.drive(self.real, module), kernels.hang(self.real, module)
        kernel_cache.load(module, self.device)
        row = {body.path: k for k, (body, _) in enumerate(bodies.bodies)}
        self.own = [(d, s.joints.index(name), row[path]) for d, s in enumerate(skeletons) for name, path in s.bodies.items()]
        d, j, k = (np.array(column, np.int32) for column in zip(*self.own, strict=True))
        depth = np.concatenate([_depths(s) for s in skeletons])
        joint = self.tables.start[d] + j
        self.levels = [self._array(np.flatnonzero(depth[joint] == level).astype(np.int32), int)
                       for level in range(int(depth.max()) + 1)]
        self.columns = {"joint": self._array(joint, int), "skeleton": self._array(d, int), "body": self._array(k, int),
                        "origin": self._array(bodies.origin[k], wp.vec3d)}
        Where, part = kernels.bodies(self.real), bodies.part.arrays
        self.start = filled(Where, **{name: wp.clone(part[name]) for name in FIELDS})
        self.end = filled(Where, **{name: part[name] for name in FIELDS})
        self.axes: Any = None
        self.bind()

    def _array(self, values, dtype) -> wp.array:
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
            Y[:3, :3] = X[:3, :3] @ rotation.matrix(mass.axes)
            Y[:3, 3] = X[:3, :3] @ mass.center + X[:3, 3]
            W = skinning.worlds(bones.parents, skinning.locals_(bones, np.zeros(1)))[0, j]
            found.append(np.linalg.inv(Y) @ placed(bones, 0.0) @ W)
        self.columns["bound"] = self._array(found, wp.mat44d)

    def hold(self, pins) -> None:
        """Takes the pins that follow these skeletons."""
        self.pins = pins
        for kind, group in pins.groups.items() if pins else ():
            first = 0
            for p in group:
                if p.pin.follows is not None and p.pin.follows.skin.skeleton in self.skeletons:
                    self.hung.append(Hung(self, p, kind, first))
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
            if kind not in self.samplings or len(self.samplings[kind].moments) != len(moments):
                self.samplings[kind] = Sampling(self, moments)
            self.samplings[kind].begin(time)
        for skin in self.meshes:
            skin.settle(time + wanted["mesh"], self.samplings["mesh"].A)
        for hung in self.hung:
            hung.begin(time, wanted[hung.kind])

    def launch(self, clock: Clock) -> None:
        for sampling in self.samplings.values():
            sampling.launch()
        for skin in self.meshes:
            skin.track(self.samplings["mesh"].A)
        for hung in self.hung:
            hung.launch()


def _depths(bones: Skeleton) -> np.ndarray:
    """Levels of the joints, (joints,)."""
    found = np.zeros(len(bones.joints), int)
    for k, level in enumerate(skinning.levels(bones.parents)):
        found[level] = k
    return found
