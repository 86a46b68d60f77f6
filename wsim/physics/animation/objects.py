"""Skeletons and what follows them: joint trees with an animation, skinned points, points that are pinned to them. NumPy only.

    bones = scene.add(Skeleton("/man/bones", ("hip", "hip/knee"), bind, times=..., translations=..., rotations=..., scales=...))
    skin = Skinned(bones, points, joints, weights)
    scene.collider("/man/body", Surface(skin.at(0.0), counts, indices, poses=skin), motion=bones.motion)

Matrices act on columns; quaternions are (x, y, z, w). Formulas: `wsim.physics.animation.skinning`.
"""

from dataclasses import dataclass, field, replace
from math import pi
from typing import Any

import numpy as np

from wsim.geometry import rotation
from wsim.physics.animation import skinning
from wsim.scene.bodies import ArrayDataclass
from wsim.scene.curve import Curve, Motion
from wsim.scene.values.arrays import contiguous_array, real_array

LOOSE = 1e-4           # by which weights of a point may sum to something else than 1 before they are normalised
LINEAR, DUAL = "classicLinear", "dualQuaternion"


def parent_joint_indices(joints) -> np.ndarray:
    """Parent of each joint, (joints,), -1 of a root, by names that are paths, as USD has them: the nearest that there is."""
    number = {name: k for k, name in enumerate(joints)}
    found = []
    for name in joints:
        above = name
        while "/" in above:
            above = above.rsplit("/", 1)[0]
            if above in number:
                break
        found.append(number.get(above, -1) if above != name else -1)
    return np.array(found, np.int32)


def _matrices_or_identity(value, n: int) -> np.ndarray:
    return np.tile(np.eye(4), (n, 1, 1)) if value is None else np.ascontiguousarray(value, np.float64).reshape(-1, 4, 4)


@dataclass(eq=False)
class Skeleton(ArrayDataclass):
    """A tree of joints and how they move (USD: Skeleton, SkelAnimation). Keys are linear in between, rotations turn at constant
    speed about a fixed axis; before the first and after the last they are held. As in
    `scene.add(Skeleton("/rig", ("hip", "hip/knee"), bind=np.tile(np.eye(4), (2, 1, 1))))`.

    path            prim path
    joints          names, (joints,): paths such as "hip/knee"
    bind            where joints were when meshes were bound to them, (joints, 4, 4) [m], in the skeleton's space
    rest            from its parent's space, of a joint that is not animated, (joints, 4, 4) [m]; None: as it was bound
    parents         (joints,), -1 of a root; None: by the names
    times           of keys [s], (keys,), increasing
    translations    (keys, joints, 3) [m]; None: no joint is animated
    rotations       (keys, joints, 4), unit quaternions (x, y, z, w)
    scales          (keys, joints, 3) [1]
    animated        whether a joint is, (joints,) bool; None: all, where there are translations
    motion          its space to world over time, rigid, lengths [m]
    stretch         (3, 3) [1], of skinned points before motion; None: 1
    shapes          names of blend shapes with a weight over time
    weights         Curve of values (keys, shapes) [1]; None: there are none
    bodies          joints that rigid bodies drive: {joint: prim path of a Body}
    """

    path: str
    joints: tuple[str, ...]
    bind: np.ndarray
    rest: Any = None
    parents: Any = None
    times: np.ndarray = field(default_factory=lambda: np.zeros(1))
    translations: Any = None
    rotations: Any = None
    scales: Any = None
    animated: Any = None
    motion: Motion = field(default_factory=Motion.still)
    stretch: Any = None
    shapes: tuple[str, ...] = ()
    weights: Curve | None = None
    bodies: dict[str, str] = field(default_factory=dict)

    def __post_init__(self):
        n = len(self.joints)
        self.joints, self.shapes = tuple(self.joints), tuple(self.shapes)
        self.bind = _matrices_or_identity(self.bind, n)
        self.parents = parent_joint_indices(self.joints) if self.parents is None else contiguous_array(self.parents, np.int32,
                                                                                                       -1)
        self.times = np.atleast_1d(np.asarray(self.times, np.float64))
        keys = len(self.times)
        given = self.translations is not None
        if given:
            self.translations = real_array(self.translations, keys, -1, 3)
            self.rotations = (np.tile([0.0, 0.0, 0.0, 1.0], (keys, n, 1)) if self.rotations is None
                              else real_array(self.rotations, keys, -1, 4))
            self.scales = np.ones((keys, n, 3)) if self.scales is None else real_array(self.scales, keys, -1, 3)
        self.animated = np.full(n, given) if self.animated is None else contiguous_array(self.animated, bool, -1)
        if self.rest is None:
            self.rest = skinning.parent_space_transforms(self.bind,
                                                         self.parents) if len(self.bind) == len(self.parents) else self.bind
        self.rest = _matrices_or_identity(self.rest, n)

    @property
    def orientations(self) -> np.ndarray:
        """Rotations of length 1, (keys, joints, 4)."""
        return rotation.unit_quat(self.rotations)

    @property
    def moves(self) -> bool:
        """True if joints or blend shapes do, or may."""
        return len(self.times) > 1 or bool(self.bodies) or (self.weights is not None and self.weights.moves)

    def later(self, delay: float) -> "Skeleton":
        """The same animation, begun `delay` [s] later."""
        weights = None if self.weights is None else self.weights.later(delay)
        motion: Any = self.motion.later(delay)
        return replace(self, times=self.times + delay, motion=motion, weights=weights)

    def joint_motion(self, joint: str) -> Motion:
        """Frame of an animated joint in the world, rigid [m], exact at the keys of the animation, as in
        `rods.pin("/roots", points, motion=skeleton.joint_motion("hip/head"))`. Raises ValueError for a joint that is none of
        `joints`, or that rigid bodies drive."""
        if joint not in self.joints:
            raise ValueError(f"{self.path}: there is no joint {joint!r}; there are {', '.join(self.joints)}")
        if self.bodies:
            raise ValueError(f"{self.path}: rigid bodies drive its joints, so that their motion is not known before the run")
        times = np.union1d(self.times, self.motion.times)
        world = skinning.skeleton_space_transforms(self.parents,
                                                   skinning.local_joint_transforms(self, times))[:, self.joints.index(joint)]
        if self.stretch is not None:
            world[:, :3] = self.stretch @ world[:, :3]
        world = np.stack([self.motion.at(t) for t in times]) @ world
        world[:, :3, :3] = rotation.polar_decomposition(world[:, :3, :3])[0]
        return Motion(times, world)


@dataclass(eq=False)
class BlendShape(ArrayDataclass):
    """Offsets of some points of a mesh, at a weight of 1 and at weights between (USD: BlendShape, inbetweens).

    name        as the skeleton's `shapes` have it
    points      numbers of the points that it moves, (k,)
    knots       weights at which offsets are given, increasing, 1 among them; at 0 there are none
    offsets     (knots, k, 3) [m], in the mesh's space
    joint       of a corrective shape: number of the joint that drives it; -1: none, the animation does
    rotation    the joint's rotation from its parent's space at which the weight is 1, (x, y, z, w)
    width       angle from there at which the weight is 0 [rad]; between, 1 - angle / width, smoothed
    """

    name: str
    points: np.ndarray
    offsets: np.ndarray
    knots: np.ndarray = field(default_factory=lambda: np.ones(1))
    joint: int = -1
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    width: float = pi

    def __post_init__(self):
        self.points, self.knots = contiguous_array(self.points, np.int32, -1), contiguous_array(self.knots, np.float64, -1)
        self.offsets = real_array(self.offsets, len(self.knots), -1, 3)


@dataclass(eq=False)
class Skinned(ArrayDataclass):
    """Points that follow the joints of a skeleton; `Surface.poses` of a mesh collider, in the skeleton's space.

    skeleton    `Skeleton` of the same scene
    points      where they are bound, (n, 3) [m], in the mesh's space
    joints      numbers of the joints that move each, (n, m)
    weights     their parts, (n, m) [1], which sum to 1
    geom        the mesh's space to the skeleton's when it was bound, (4, 4) [m]
    method      "classicLinear" (linear blend) or "dualQuaternion"
    blends      list of `BlendShape`, added before
    """

    skeleton: Skeleton
    points: np.ndarray
    joints: np.ndarray
    weights: np.ndarray
    geom: np.ndarray = field(default_factory=lambda: np.eye(4))
    method: str = LINEAR
    blends: list[BlendShape] = field(default_factory=list)

    def __post_init__(self):
        self.points = real_array(self.points, -1, 3)
        n = max(len(self.points), 1)
        self.joints = contiguous_array(self.joints, np.int32, n, -1)
        self.weights = real_array(self.weights, n, -1)
        self.geom = contiguous_array(self.geom, np.float64, 4, 4)

    @property
    def parts(self) -> np.ndarray:
        """Weights (n, m), normalised where they sum to something else than 1 by more than LOOSE."""
        sums = self.weights.sum(axis=1, keepdims=True)
        return np.where(np.abs(sums - 1.0) > LOOSE, self.weights / np.where(sums > 0.0, sums, 1.0), self.weights)

    @property
    def times(self) -> np.ndarray:
        """Keys of the joints and of the blend shapes [s]."""
        weights = self.skeleton.weights
        return self.skeleton.times if weights is None else np.union1d(self.skeleton.times, weights.times)

    @property
    def moves(self) -> bool:
        return self.skeleton.moves

    @property
    def values(self) -> np.ndarray:
        """Points at the keys, (keys, n, 3) [m]."""
        return self.over(self.times)

    def at(self, t: float) -> np.ndarray:
        """Points at time t [s], (n, 3) [m], float64."""
        return self.over(np.array([t]))[0]

    def over(self, times: np.ndarray) -> np.ndarray:
        """Points at some times [s], (times, n, 3) [m], in the skeleton's space."""
        times = np.asarray(times, np.float64)
        return skinning.skin_points(self, skinning.skinning_transforms(self.skeleton, times), times)

    def only(self, points: np.ndarray) -> "Skinned":
        """Some of the points alone, in the order of their numbers (k,)."""
        points = np.asarray(points)
        blends = []
        for shape in self.blends:
            place = {p: k for k, p in enumerate(shape.points.tolist())}
            here = [(i, place[p]) for i, p in enumerate(points.tolist()) if p in place]
            if here:
                own, of = (np.array(column) for column in zip(*here, strict=True))
                blends.append(replace(shape, points=own, offsets=shape.offsets[:, of]))
        return replace(self, points=self.points[points], joints=self.joints[points], weights=self.weights[points],
                       blends=blends)


@dataclass(eq=False)
class Follow(ArrayDataclass):
    """Places on skinned points that a pin holds points at (USD: PhysicsAttachment, point to face or to point).

        place = u x0 + v x1 + (1 - u - v) x2 + h n        of a triangle x0, x1, x2 with the unit normal n

    skin        the mesh's `Skinned`
    corners     points of the triangle of each place, (k, 3); three times one: that point
    places      u, v [1] and h [m], (k, 3)
    faces       of USD: numbers of faces, (k,); None: places are at points
    """

    skin: Skinned
    corners: np.ndarray
    places: np.ndarray
    faces: np.ndarray | None = None

    def __post_init__(self):
        self.corners, self.places = contiguous_array(self.corners, np.int32, -1, 3), real_array(self.places, -1, 3)
        self.faces = contiguous_array(self.faces, np.int32, -1)

    @property
    def moves(self) -> bool:
        return self.skin.moves or self.skin.skeleton.motion.moves

    @staticmethod
    def at_points(skin: Skinned, points) -> "Follow":
        """The places at some of the skinned points, by their numbers (k,)."""
        points = np.asarray(points, np.int32)
        return Follow(skin, np.repeat(points[:, None], 3, axis=1), np.tile([1.0, 0.0, 0.0], (len(points), 1)))

    @staticmethod
    def near(skin: Skinned, triangles: np.ndarray, places: np.ndarray, faces=None) -> "Follow":
        """The places at world places (k, 3) [m], each as it lies over the nearest triangle at the start. triangles: (t, 3);
        faces: their numbers in the mesh, if they are not 0, 1, 2 ..."""
        x = skin.skeleton.motion.points(skin.at(0.0))
        chosen = skinning.nearest_triangles(x[triangles], np.asarray(places, np.float64).reshape(-1, 3)).astype(np.int32)
        return Follow.over_triangles(skin, np.asarray(triangles, np.int32)[chosen], places,
                                     chosen if faces is None else np.asarray(faces)[chosen])

    @staticmethod
    def over_triangles(skin: Skinned, corners: np.ndarray, places: np.ndarray, faces: np.ndarray) -> "Follow":
        """The places at world places (k, 3) [m], each as it lies over its triangle (k, 3) of the mesh at the start."""
        x = skin.skeleton.motion.points(skin.at(0.0))
        return Follow(skin, corners, skinning.triangle_coordinates(x[corners], np.asarray(places, np.float64)), faces)

    def only_points(self) -> tuple[Skinned, np.ndarray]:
        """The skinned points that matter, and the corners among them."""
        points, corners = np.unique(self.corners, return_inverse=True)
        return self.skin.only(points), corners.reshape(-1, 3)

    def over(self, times: np.ndarray) -> np.ndarray:
        """World places at some times [s], (times, k, 3) [m]."""
        return self.frames(times)[..., :3, 3]

    def frames(self, times: np.ndarray) -> np.ndarray:
        """World frames at some times [s], (times, k, 4, 4) [m]: their origins are the places; x goes along the first edge of a
        place's triangle and z along its normal. At a point, which has no triangle, they are turned as the skeleton is."""
        skin, corners = self.only_points()
        x = skin.over(times)[:, corners]
        found = np.tile(np.eye(4), (*x.shape[:2], 1, 1))
        found[..., :3, :3] = skinning.triangle_axes(x)
        found[..., :3, 3] = skinning.points_over_triangles(x, self.places)
        return self.skin.skeleton.motion.sampled(times)[:, None] @ found
