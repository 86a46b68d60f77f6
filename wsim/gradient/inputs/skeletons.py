"""Joint angles and weights of blend shapes as inputs of a recording, through skinning to the pins and the colliders that follow
a skeleton. See `wsim.gradient.inputs.by_name`.

    /World/Bones:turns       (keys, joints, 3) [rad], rotation vectors that are put behind the rotations of the keys
    /World/Bones:weights     (keys, shapes) [1], of blend shapes

Worlds share a skeleton; the gradient in one world is that of the points of that world.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from wsim.geometry import rotation
from wsim.gradient.inputs.base import RecordingInput
from wsim.scene.curve import Curve
from wsim.scene.methods import object_at_path
from wsim.scene.values.coverage import gradient_refusal


class SkeletonInput(RecordingInput):
    """A value of a skeleton that pins or colliders follow. Raises SceneError, by path, where nothing does."""

    shared = True

    def __init__(self, recording, name: str):
        super().__init__(recording, name)
        self.given = object_at_path(self.sim.scene, self.path)
        self.method = self.sim.plan.ports.bones
        self.pins = recording.parameters.pins
        self.followers = [p for group in (self.pins.groups.values() if self.pins else ()) for p in group
                          if p.pin.follows is not None and p.pin.follows.skin.skeleton is self.given]
        self.skins = [(c.path, c.shape.poses) for c in self.sim.scene.colliders
                      if getattr(getattr(c.shape, "poses", None), "skeleton", None) is self.given]
        if not self.followers and not self.skins:
            raise gradient_refusal("followed", self.path)
        for path, skin in [*((p.pin.path, p.pin.follows.skin) for p in self.followers), *self.skins]:
            self.check(path, skin)

    def check(self, path: str, skin) -> None:
        """Raises SceneError for what follows the skeleton and has no such derivative."""

    @property
    def bones(self):
        """The skeleton as it is now."""
        return self.method.skeletons[self.sim.scene.things("Skeleton").index(self.given)]

    def set_world_value(self, value: np.ndarray, world: int) -> None:
        bones = self.changed(value)
        self.method.give(self.bones, bones)
        for p in self.followers:
            p.motion.follow = replace(p.motion.follow, skin=replace(p.motion.follow.skin, skeleton=bones))
        if self.followers:
            self.pins.changed = True
            self.sim.graphs.forget("pins move otherwise")

    def changed(self, value: np.ndarray):
        """The skeleton with another value."""
        raise AssertionError(self.name)

    def pulled(self, gradient, world: int) -> tuple[np.ndarray, np.ndarray]:
        """Gradients by turns of the rotations that are, and by weights."""
        total = [*self.by_pins(gradient, world), *self.by_colliders(gradient, world)]
        return tuple(sum(column) for column in zip(*total, strict=True))  # type: ignore[return-value]

    def by_pins(self, gradient, world: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        from wsim.physics.animation.skinning_adjoint import attachment_gradients
        for kind, group in self.pins.groups.items() if self.pins else ():
            for p in (p for p in group if p in self.followers and p.body.world == world):
                found = gradient.targets(p.pin.path, world)
                times = self.times(kind == "hard")
                by = found.reshape(len(times), -1, 3)
                n = len(p.pin.points)
                own = by[:, :n].copy()
                for k, ends in enumerate(p.ends):                         # points between take half of both
                    own[:, ends] += 0.5 * by[:, n + k, None]
                yield attachment_gradients(p.motion.follow, times, own)

    def by_colliders(self, gradient, world: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        from wsim.physics.animation.skinning_adjoint import skinned_point_gradients
        r, clock, fps = self.recording, self.sim.plan.clock, self.sim.scene.fps
        for path, skin in self.skins:
            now = replace(skin, skeleton=self.bones)
            for frame in range(r.frames):
                by = gradient.touched(path).corners(path, world, frame)
                times = (r.start + frame) / fps + clock.dt * np.arange(len(by)) / (len(by) - 1)
                yield skinned_point_gradients(now, times, by)

    def times(self, hard: bool) -> np.ndarray:
        """Times of the rows of targets in the recording [s], those of its frames behind each other."""
        r, clock, fps = self.recording, self.sim.plan.clock, self.sim.scene.fps
        if not self.pins.moves:
            return np.array([r.start / fps])
        return np.concatenate([(r.start + f) / fps + clock.moments(hard) for f in range(r.frames)])


class JointTurnsInput(SkeletonInput):
    """Rotation vectors behind the rotations of the joints at the keys."""

    def check(self, path: str, skin) -> None:
        if any(shape.joint >= 0 for shape in skin.blends):
            raise gradient_refusal("corrective", path, bones=self.path)
        from wsim.physics.animation.skin import joints_stay_rigid
        if skin.method != "classicLinear" and not joints_stay_rigid(skin):
            raise gradient_refusal("scaled", path, bones=self.path)
        if self.given.translations is None:
            raise gradient_refusal("unanimated", self.path)

    def read_value(self, world: int = 0) -> np.ndarray:
        back = rotation.quat_conjugate(self.given.orientations)
        return rotation.quaternion_logarithm(rotation.quat_product(back, self.bones.orientations))

    def changed(self, value: np.ndarray):
        return replace(self.bones,
                       rotations=rotation.quat_product(self.given.orientations, rotation.quaternion_exponential(value)))

    def gradient(self, gradient, world: int, shape: tuple[int, ...]) -> np.ndarray:
        from wsim.physics.animation.skinning_adjoint import right_rotation_jacobian
        by = self.pulled(gradient, world)[0]
        return np.einsum("kjmi,kjm->kji", right_rotation_jacobian(self.read_value()), by).reshape(shape)

    def difference_scale(self) -> float:
        return 0.05


class BlendWeightsInput(SkeletonInput):
    """Weights of blend shapes at their keys."""

    def check(self, path: str, skin) -> None:
        if self.given.weights is None:
            raise gradient_refusal("shapes", self.path)

    def read_value(self, world: int = 0) -> np.ndarray:
        return np.array(self.bones.weights.values, np.float64)

    def changed(self, value: np.ndarray):
        return replace(self.bones, weights=Curve(self.bones.weights.times, value.copy()))

    def gradient(self, gradient, world: int, shape: tuple[int, ...]) -> np.ndarray:
        return self.pulled(gradient, world)[1].reshape(shape)

    def difference_scale(self) -> float:
        return 0.05
