"""Colliders of a scene: solids that push and are not pushed. Plain data in SI units, NumPy only; see `wsim.scene`."""

from dataclasses import dataclass, field

import numpy as np

from wsim.scene.bodies import Compared, array
from wsim.scene.curve import Curve, Motion

TURN = {"X": (1, 2, 0), "Y": (2, 0, 1), "Z": (0, 1, 2)}      # axes of a frame whose z is that axis: a rotation


@dataclass(frozen=True)
class Plane:
    """A half space: all on one side of a plane through the own origin is solid, without end.

    axis    "X", "Y" or "Z": the own axis that points out of the solid; None: the scene's up where `Scene.collider` places it
            by `at`, so that it is a floor, else "Z"
    """

    axis: str | None = None

    def __post_init__(self):
        if self.axis is not None and self.axis not in TURN:
            raise ValueError(f"axis is {self.axis!r}; allowed is 'X', 'Y', 'Z', or None for the scene's up")


@dataclass(frozen=True)
class Sphere:
    """A ball about the own origin.

    radius    [m]
    """

    radius: float


@dataclass(frozen=True)
class Box:
    """A box about the own origin.

    half    half of its edge lengths along x, y, z, (3,) [m]
    """

    half: tuple[float, float, float]


@dataclass(frozen=True)
class Capsule:
    """A cylinder with round caps, along own z.

    radius         [m]
    half_height    half the length of the straight part [m]
    """

    radius: float
    half_height: float


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along own z.

    radius         [m]
    half_height    half its height [m]
    """

    radius: float
    half_height: float


@dataclass(frozen=True)
class Cone:
    """A cone along own z, its apex at +half_height.

    radius         of its base at -half_height [m]
    half_height    half its height [m]
    """

    radius: float
    half_height: float


@dataclass(eq=False)
class Surface(Compared):
    """A triangle mesh. Closed: its inside is solid. Open: both sides keep `Collider.thickness` away.

    points     (n, 3) [m], own frame, float32
    counts     corners of each polygon, (faces,)
    indices    point of each corner, (sum of counts,)
    poses      of a deforming mesh: points over time, a Curve with values (keys, n, 3) [m]; None: it keeps its shape
    """

    points: np.ndarray
    counts: np.ndarray
    indices: np.ndarray
    poses: Curve | None = None

    def __post_init__(self):
        self.points = array(self.points, np.float32, -1, 3)
        self.counts, self.indices = array(self.counts, np.int32, -1), array(self.indices, np.int32, -1)


Shape = Plane | Sphere | Box | Capsule | Cylinder | Cone | Surface


def upright(shape: Shape, up: str) -> Shape:
    """A plane without an axis as one that faces `up` ("Y" or "Z"); any other shape as it is."""
    return Plane(up) if isinstance(shape, Plane) and shape.axis is None and up in TURN else shape


@dataclass(eq=False)
class Collider(Compared):
    """A solid that pushes and is not pushed.

    path                prim path
    shape               Plane, Sphere, Box, Capsule, Cylinder, Cone or Surface
    motion              own frame to world over time, rigid, lengths [m]; a scale belongs into the shape's sizes
    static_friction     coefficient of friction [1] up to which a contact sticks
    dynamic_friction    coefficient of friction of a contact that slides [1]
    thickness           kept free around it [m], besides half of the cloth's own; None: what hides the chords of the cloth's
                        mesh (`wsim.scene.check.chord`)
    restitution         share of the speed along its normal with which a point rebounds [1], 0 to 1

    A plane that faces X or Y becomes one that faces the z of a turned frame.
    """

    path: str
    shape: Shape
    motion: Motion = field(default_factory=Motion.still)
    static_friction: float = 0.5
    dynamic_friction: float = 0.5
    thickness: float | None = None
    restitution: float = 0.0

    def __post_init__(self):
        if isinstance(self.shape, Plane) and self.shape.axis is not None:
            turn = np.eye(4)
            turn[:3, :3] = np.eye(3)[:, TURN[self.shape.axis]]
            self.shape = Plane()
            if not np.array_equal(turn, np.eye(4)):
                self.motion = Motion(self.motion.times, self.motion.values @ turn)
