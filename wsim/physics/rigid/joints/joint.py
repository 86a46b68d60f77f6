"""Joints of a scene: plain data in SI units, NumPy only. Every kind of UsdPhysics is one table.

A joint has a frame on each of two bodies. Where frame 1 stands in frame 0 is said by six coordinates, and a seventh:

    transX transY transZ    shift along the axes of frame 0 [m]
    rotX rotY rotZ          twist about x, then the swing, a rotation vector across x [rad] (kernels/rigid/joint/coordinates.py)
    distance                between the origins of both frames [m]

`limits` says between which values one stays: what is not there is free, (0, 0) is locked. So a fixed joint has all six locked,
a revolute one all but rotX, a prismatic one all but transX, a spherical one the three shifts, and a cone.
"""

from dataclasses import dataclass, field, replace
from math import inf
from typing import Any

import numpy as np

from wsim.geometry import rotation
from wsim.physics.rigid.objects import Body, vector3_or_none
from wsim.scene import Problem, SceneError
from wsim.scene.bodies import ArrayDataclass
from wsim.scene.curve import Motion
from wsim.scene.solids import Collider

SHIFTS, TURNS = ("transX", "transY", "transZ"), ("rotX", "rotY", "rotZ")
AXES = (*SHIFTS, *TURNS)
DISTANCE = "distance"
LIVE = ("stiffness", "damping", "target")             # of drives, with derivatives
PASSIVE = ("armature", "friction")
LOCKED = (0.0, 0.0)


@dataclass(frozen=True)
class Drive:
    """A spring and damper on one coordinate g: F = stiffness (target - g) + damping (speed - g').

    stiffness      [N/m], [N m/rad]; of an acceleration [1/s^2]
    damping        [N s/m], [N m s/rad]; of an acceleration [1/s]
    target         [m], [rad]
    speed          [m/s], [rad/s]
    most           size of the force [N] or torque [N m], at most
    acceleration   True: F is per mass, or moment of inertia, that the coordinate moves
    """

    stiffness: float = 0.0
    damping: float = 0.0
    target: float = 0.0
    speed: float = 0.0
    most: float = inf
    acceleration: bool = False


@dataclass(frozen=True)
class Mimic:
    """A coordinate that follows that of another joint: g = sum_k coefficients[k] g_leader^k.

    leader         prim path of a joint with one free coordinate
    coefficients   up to five [m or rad per m^k or rad^k]: offset, ratio, ...
    """

    leader: str
    coefficients: tuple[float, ...] = (0.0, 1.0)


@dataclass(eq=False)
class Joint(ArrayDataclass):
    """A joint between two bodies, or a body and the world, as in
    `scene.joint("revolute", "/hinge", None, scene.body("/door", Box((0.4, 1, 0.02))), at=(-0.4, 0, 0), axis=(0, 1, 0))`.

    path       prim path
    body0      prim path of the body of frame 0; "": the world, or what `motion` says
    body1      of frame 1
    at0        origin of frame 0 in the frame of its body (3,) [m]
    turn0      quaternion (x, y, z, w) [1] from frame 0 to the frame of its body
    at1        origin of frame 1 in the frame of its body (3,) [m]
    turn1      quaternion (x, y, z, w) [1] from frame 1 to the frame of its body
    limits     {name of a coordinate: (lowest, highest)} [m], [rad]
    drives     {name of a coordinate: `Drive`}
    cone       half angles [rad] of the swing about y and z; inf: free; None: no cone
    armature   {name of a coordinate: inertia of a rotor that turns with it [kg], [kg m^2]}; a number: of all free ones
    friction   {name of a coordinate: dry friction [N], [N m]}; a number: of all free ones
    mimics     {name of a coordinate: `Mimic`}
    hinges     {name of a turn: point (3,) [m] from at1 along the axes of frame 1}: its turns are hinges about these points, one
               behind the other, rotZ first and rotX last. Empty: they turn about one point, and three are a ball
    collides   whether its two bodies touch each other
    enabled    whether it acts
    force      [N] over which it breaks
    torque     [N m] over which it breaks
    motion     frame to world over time [m], rigid, of the side that is no dynamic body
    still      prim path of that side; "": the world
    """

    path: str
    body0: str = ""
    body1: str = ""
    at0: np.ndarray = field(default_factory=lambda: np.zeros(3))
    turn0: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))
    at1: np.ndarray = field(default_factory=lambda: np.zeros(3))
    turn1: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)
    drives: dict[str, Drive] = field(default_factory=dict)
    cone: tuple[float, float] | None = None
    armature: dict[str, float] = field(default_factory=dict)
    friction: dict[str, float] = field(default_factory=dict)
    mimics: dict[str, Mimic] = field(default_factory=dict)
    hinges: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    collides: bool = False
    enabled: bool = True
    force: float = inf
    torque: float = inf
    motion: Motion = field(default_factory=Motion.still)
    still: str = field(default="", compare=False)

    def __post_init__(self):
        for name in ("at0", "at1"):
            setattr(self, name, vector3_or_none(getattr(self, name)))
        for name in ("turn0", "turn1"):
            setattr(self, name, np.array(getattr(self, name), np.float64).reshape(4))
        self.limits = {name: (float(low), float(high)) for name, (low, high) in self.limits.items()}
        for name in PASSIVE:
            given = getattr(self, name)
            if not isinstance(given, dict):
                setattr(self, name, {axis: float(given) for axis in self.free()} if given else {})

    def free(self) -> list[str]:
        """Coordinates that can move, without the distance."""
        return [name for name in AXES if not self.locked(name)]

    def driven(self) -> list[str]:
        """Coordinates that have a drive, in their order."""
        return [name for name in (*AXES, DISTANCE) if name in self.drives]

    def taken(self, name: str) -> float | np.ndarray | None:
        """stiffness, damping, target or speed of its drives, in the order of `driven`: a number where there is one;
        None: no drive."""
        found = np.array([getattr(self.drives[axis], name) for axis in self.driven()])
        return float(found[0]) if len(found) == 1 else found if len(found) else None

    def given(self, name: str, value) -> "Joint":
        """A copy with another stiffness, damping or target of its drives."""
        each: list[Any] = np.broadcast_to(np.asarray(value, np.float64), len(self.drives)).tolist()
        new = {axis: replace(self.drives[axis], **{name: v}) for axis, v in zip(self.driven(), each, strict=True)}
        return replace(self, drives=new)

    def locked(self, name: str) -> bool:
        """Whether a coordinate cannot move."""
        return name in self.limits and self.limits[name][0] >= self.limits[name][1]


Jointed = Body | Collider | None            # what a joint may join; None: the world


def locked_limits_except(*but: str) -> dict[str, tuple[float, float]]:
    """Limits that lock every shift and turn but those named."""
    return {name: LOCKED for name in AXES if name not in but}


def joint_between(path: str, body0: Jointed, body1: Jointed, at=(0.0, 0.0, 0.0),
                  axis=(1.0, 0.0, 0.0), **more) -> Joint:
    """A joint of two bodies as they stand, None for the world, or of a body and a collider, with whose motion it goes. Its
    frames agree, at a place `at` (3,) [m] of the world, with x along `axis`. more: fields of `Joint`."""
    x = _unit_axis(path, axis)
    y = np.cross(np.eye(3)[np.argmin(np.abs(x))], x)
    y /= np.linalg.norm(y)
    q = rotation.matrix_quat(np.stack([x, y, np.cross(x, y)], axis=1))
    if np.array_equal(x, (1.0, 0.0, 0.0)):
        q = np.array([0.0, 0.0, 0.0, 1.0])
    for k, body in enumerate((body0, body1)):
        M = np.eye(4) if body is None else body.motion.at(0.0)
        R = M[:3, :3]
        if isinstance(body, Collider):
            more |= {"motion": body.motion, "still": body.path}
        more[f"body{k}"] = "" if body is None or isinstance(body, Collider) else body.path
        more[f"at{k}"] = R.T @ (np.asarray(at, np.float64) - M[:3, 3])
        more[f"turn{k}"] = rotation.quat_product(rotation.quat_conjugate(rotation.matrix_quat(R)), q)
    return Joint(path, **more)


def _unit_axis(path: str, axis) -> np.ndarray:
    """The axis with length 1 (3,). Raises SceneError for what has no direction."""
    try:
        given = np.asarray(axis, np.float64)
    except (TypeError, ValueError):
        given = np.zeros(0)
    if given.shape != (3,) or not 0.0 < np.linalg.norm(given) < inf:
        raise SceneError(Problem(path, f"axis is {axis!r:.60}; allowed: three finite numbers, not all 0; fix: give one in the "
                                       "axes of the world, such as (0, 0, 1)"))
    return given / np.linalg.norm(given)


def fixed_joint(path: str, body0: Jointed, body1: Jointed, **more) -> Joint:
    """Neither shift nor turn; see `joint_between`."""
    return joint_between(path, body0, body1, limits=locked_limits_except(), **more)


def revolute_joint(path: str, body0: Jointed, body1: Jointed, low: float = -inf, high: float = inf, **more) -> Joint:
    """A turn about `axis` alone, between angles [rad]; see `joint_between`."""
    limits = locked_limits_except("rotX") | _limits_or_none("rotX", low, high)
    return joint_between(path, body0, body1, limits=limits, **more)


def prismatic_joint(path: str, body0: Jointed, body1: Jointed, low: float = -inf, high: float = inf, **more) -> Joint:
    """A shift along `axis` alone, between lengths [m]; see `joint_between`."""
    limits = locked_limits_except("transX") | _limits_or_none("transX", low, high)
    return joint_between(path, body0, body1, limits=limits, **more)


def spherical_joint(path: str, body0: Jointed, body1: Jointed, **more) -> Joint:
    """Turns alone, `axis` within a `cone` where that is given; see `joint_between`."""
    return joint_between(path, body0, body1, limits=locked_limits_except(*TURNS), **more)


def _limits_or_none(name: str, low: float, high: float) -> dict[str, tuple[float, float]]:
    return {name: (low, high)} if low > -inf or high < inf else {}


# by name, for scenes
KINDS = {"fixed": fixed_joint, "revolute": revolute_joint, "prismatic": prismatic_joint, "spherical": spherical_joint}


def joint_of_kind(kind: str, path: str, body0: Jointed, body1: Jointed, **more) -> Joint:
    """A joint of KINDS. Raises SceneError for another kind."""
    if kind not in KINDS:
        allowed = f"{', '.join(KINDS)}; for any other, scene.add(wsim.Joint(...))"
        raise SceneError(Problem(path, f"kind is {kind!r}; allowed is one of {allowed}"))
    return KINDS[kind](path, body0, body1, **more)
