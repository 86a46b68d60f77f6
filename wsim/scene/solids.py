"""Colliders of a scene, and their shapes: a dataclass each. A table has a row (`ShapeRow`) for each convex shape: its signed
distance on device and host, its bounding ball, its curvature, its USD types, how it takes a scale, and its triangles.
Lengths in [m]; round shapes lie along their own z, the origin in the middle. NumPy only.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from math import hypot, inf
from typing import Any

import numpy as np

from wsim.geometry import primitives
from wsim.scene.bodies import ArrayDataclass, SizedShape
from wsim.scene.curve import Motion
from wsim.scene.values.arrays import contiguous_array, polygon_corners

APPROXIMATIONS = ("none", "meshSimplification", "sdf", "convexHull", "convexDecomposition", "boundingCube", "boundingSphere")
SAME = 1e-6                # relative difference of scales that counts as none
FLOOR = 10.0               # [m] edge of a plane as it is written, half of it as the viewer draws it
Numbers = tuple[float, ...]
TURN = {"X": (1, 2, 0), "Y": (2, 0, 1), "Z": (0, 1, 2)}      # axes of a frame whose z is that axis: a rotation


@dataclass(frozen=True)
class Plane:
    """A half space: all on one side of a plane through the own origin, as in `scene.collider("/floor", Plane())`.

    axis    own axis out of the solid, "X", "Y" or "Z"; None: the scene's up where `Scene.collider` places it by `at`, else "Z"
    """

    axis: str | None = None

    def __post_init__(self):
        if self.axis is not None and self.axis not in TURN:
            raise ValueError(f"axis is {self.axis!r}; allowed is 'X', 'Y', 'Z', or None for the scene's up")


@dataclass(frozen=True)
class Sphere(SizedShape):
    """A ball about the own origin, as in `scene.collider("/ball", Sphere(0.2), at=(0, 1, 0))`.

    radius    [m]
    """

    radius: float


@dataclass(frozen=True)
class Box(SizedShape):
    """A box about the own origin, as in `scene.collider("/table", Box((0.5, 0.02, 0.3)), at=(0, 0.7, 0))`.

    half    half of its edge lengths along x, y, z, (3,) [m]
    """

    half: tuple[float, float, float]


@dataclass(frozen=True)
class Capsule(SizedShape):
    """A cylinder with round caps, along own z, as in `scene.body("/pill", Capsule(0.05, 0.1), at=(0, 1, 0))`.

    radius         [m]
    half_height    half the length of the straight part [m]
    """

    radius: float
    half_height: float


@dataclass(frozen=True)
class Cylinder(SizedShape):
    """A cylinder along own z, as in `scene.body("/wheel", Cylinder(0.3, 0.05), at=(0, 0.3, 0))`.

    radius         [m]
    half_height    half its height [m]
    """

    radius: float
    half_height: float


@dataclass(frozen=True)
class Cone(SizedShape):
    """A cone along own z, its apex at +half_height, as in `scene.collider("/cone", Cone(0.1, 0.2))`.

    radius         of its base at -half_height [m]
    half_height    half its height [m]
    """

    radius: float
    half_height: float


@dataclass(eq=False)
class Surface(ArrayDataclass):
    """A triangle mesh, as in `scene.collider("/torso", Surface(*shapes.torso()))`. Closed: its inside is solid. Open: both
    sides keep `Collider.thickness` away.

    points     (n, 3) [m], own frame, float32
    counts     corners of each polygon, (faces,); or, without indices, the corners of triangles (t, 3) or quads (t, 4)
    indices    point of each corner, (sum of counts,)
    poses      of a deforming mesh: a Curve of points (keys, n, 3) [m], or a `Skinned` (wsim/physics/animation); None: none
    """

    points: np.ndarray
    counts: np.ndarray
    indices: Any = None
    poses: Any = None

    def __post_init__(self):
        self.points = contiguous_array(self.points, np.float32, -1, 3)
        self.counts, self.indices = polygon_corners("Surface", self.counts, self.indices)


Shape = Plane | Sphere | Box | Capsule | Cylinder | Cone | Surface


def upright_plane(shape: Shape, up: str) -> Shape:
    """A plane without an axis as one that faces `up` ("Y" or "Z"); any other shape as it is."""
    return Plane(up) if isinstance(shape, Plane) and shape.axis is None and up in TURN else shape


def turn_plane(shape: Any, motion: Motion) -> tuple[Any, Motion]:
    """A plane with an axis as one of axis Z, and its motion with the frame that turns with it; any other shape as it is."""
    if not isinstance(shape, Plane) or shape.axis is None:
        return shape, motion
    from wsim.scene.curve import then
    return Plane(), motion if shape.axis == "Z" else then(motion, np.eye(4)[:, [*TURN[shape.axis], 3]])


@dataclass(eq=False)
class Collider(ArrayDataclass):
    """A solid that pushes and is not pushed, as in `scene.collider("/floor", Plane(), dynamic_friction=0.2)`.

    path                prim path
    shape               Plane (of axis X or Y: one of axis Z in a turned frame), Sphere, Box, Capsule, Cylinder, Cone, Surface
    motion              own frame to world over time, rigid, lengths [m]; a scale belongs into the shape's sizes
    static_friction     coefficient of friction [1] up to which a contact sticks; dynamic_friction: of one that slides [1]
    thickness           kept free around it [m], besides half of the cloth's own; None: what hides chords, see wsim/scene/check/
    restitution         share of the speed along its normal with which a point rebounds [1], 0 to 1
    meets               False, of a rigid body's: it has mass and touches nothing
    approximation       of a Surface: one of APPROXIMATIONS, as which rigid bodies meet it (points meet the mesh itself)
    solref, solimp      of MuJoCo's contacts (`Scene.contact_model`): time constant [s], damping ratio; impedance at no depth,
                        impedance at a width, that width [m], midpoint, power
    """

    path: str
    shape: Shape
    motion: Motion = field(default_factory=Motion.still)
    static_friction: float = 0.5
    dynamic_friction: float = 0.5
    thickness: float | None = None
    restitution: float = 0.0
    meets: bool = True
    approximation: str = "none"
    solref: tuple[float, ...] = (0.02, 1.0)
    solimp: tuple[float, ...] = (0.9, 0.95, 0.001, 0.5, 2.0)

    def __post_init__(self):
        self.shape, self.motion = turn_plane(self.shape, self.motion)


@dataclass(frozen=True)
class ShapeRow:
    """kind      its name, as kernels and messages have it          shape    its dataclass, of at most three lengths
    ball      (shape) -> radius of the ball about its origin that holds it [m]; inf: it has no end
    curvature (shape) -> least radius of what bends outward and is no edge [m]; inf where all is flat
    distance  (shape, q (n, 3)) -> signed distance (n,) [m], exact inside, a bound from below outside
    usd       {prim type or applied API: names of its lengths}
    written   prim type, and APIs to apply
    read      (lengths in that order) -> parameters, of which the shape is `scaled` and drawn; they may be more than it has
    scaled    (parameters, scale (3,)) -> the shape; None where it is none of this kind, and collides as a mesh
    outline   (parameters, sides) -> points (n, 3), triangles (t, 3)
    write     (shape) -> lengths by name [m]
    given     (shape) -> parameters          vanishing     fields that may be 0
    stretch   (shape) -> scale op [m] that is written, of which the lengths (here without unit) are multiples; None: none
    formula   "module:function" of the device: (size, q) -> (phi, n), generic, phi convex in q; "": it is in
              kernels/contact/collider/shape.py"""

    kind: str
    shape: type
    ball: Callable[[Any], float]
    curvature: Callable[[Any], float]
    distance: Callable[[Any, np.ndarray], np.ndarray]
    usd: Mapping[str, tuple[str, ...]]
    written: tuple[str, ...]
    read: Callable[..., Numbers]
    scaled: Callable[[Numbers, np.ndarray], Any]
    outline: Callable[[Numbers, int], primitives.Outline]
    write: Callable[[Any], dict[str, float]]
    given: Callable[[Any], Numbers]
    vanishing: tuple[str, ...] = ()
    stretch: Callable[[Any], Numbers] | None = None
    formula: str = ""

    def named(self, shape: Any) -> dict[str, Any]:
        """Fields of the dataclass that are lengths [m]; an axis is none."""
        return {f.name: getattr(shape, f.name) for f in fields(shape) if f.name != "axis"}

    def lengths(self, shape: Any) -> list[float]:
        """All lengths that the dataclass has [m]."""
        return [float(v) for value in self.named(shape).values() for v in np.atleast_1d(value)]

    def size(self, shape: Any) -> tuple[float, float, float]:
        """Sizes as the device has them: `lengths`, filled up."""
        if len(found := self.lengths(shape)) > 3:
            raise ValueError(f"shape {self.kind} has {len(found)} lengths; the device holds three: make the rest constants")
        x, y, z = (*found, 0.0, 0.0, 0.0)[:3]
        return x, y, z


def shape_row(shape: Any) -> ShapeRow:
    """Row of a shape. Raises KeyError where there is none."""
    found = next((each for each in SOLIDS if each.shape is type(shape)), None)
    if found is None:
        raise KeyError(f"no shape of colliders is a {type(shape).__name__}; there are "
                       f"{', '.join(each.shape.__name__ for each in SOLIDS)} and Surface")
    return found


def claiming_shape_row(names) -> tuple[ShapeRow, str] | None:
    """Row that reads prims of one of these applied APIs or types, the first that one does, and that name."""
    return next(((each, name) for name in names for each in reversed(SOLIDS) if name in each.usd), None)


def is_uniform_scale(scale: np.ndarray, axes: tuple[int, ...]) -> bool:
    """True if a scale is the same along these axes."""
    return all(abs(abs(scale[0]) - abs(scale[k])) <= SAME * abs(scale[0]) for k in axes)


def _to_cylinder(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.hypot(q[:, 0], q[:, 1]), q[:, 2]


def _tapered_dimensions(lengths: Numbers) -> Numbers:
    """(bottom, top, half) of (radius, height) or (bottom, top, height)."""
    return lengths[0], lengths[-2], lengths[-1] / 2.0


def _round_shape_scaler(make: type, axes: tuple[int, ...]) -> Callable[[Numbers, np.ndarray], Any]:
    def scale_round_shape(p: Numbers, scale: np.ndarray):
        made = make(float(p[0] * abs(scale[0])), float(p[2] * abs(scale[2])))
        return made if p[0] == p[1] and is_uniform_scale(scale, axes) else None
    return scale_round_shape


def _radius_and_height(shape: Any) -> dict[str, float]:
    return {"radius": shape.radius, "height": 2.0 * shape.half_height}


def _cone_distance(c: Cone, q: np.ndarray) -> np.ndarray:
    H, R, (rho, z) = c.half_height, c.radius, _to_cylinder(q)
    return np.maximum((2.0 * H * (rho - R) + R * (z + H)) / np.hypot(R, 2.0 * H), -H - z)


def _capsule_distance(c: Capsule, q: np.ndarray) -> np.ndarray:
    rho, z = _to_cylinder(q)
    return np.hypot(rho, np.maximum(np.abs(z) - c.half_height, 0.0)) - c.radius


def _cylinder_distance(c: Cylinder, q: np.ndarray) -> np.ndarray:
    rho, z = _to_cylinder(q)
    return np.maximum(rho - c.radius, np.abs(z) - c.half_height)


ROUND, ENDS = ("radius", "height"), ("radiusBottom", "radiusTop", "height")
SOLIDS: list[ShapeRow] = [
    ShapeRow("plane", Plane, ball=lambda p: inf, curvature=lambda p: inf, distance=lambda p, q: q[:, 2],
             usd={"Plane": ()}, written=("Plane",), read=lambda: (), scaled=lambda p, scale: Plane(),
             outline=lambda p, sides: primitives.plate_outline(FLOOR, FLOOR), write=lambda p: {"width": FLOOR, "length": FLOOR},
             given=lambda p: ()),
    ShapeRow("sphere", Sphere, ball=lambda s: float(s.radius), curvature=lambda s: s.radius, read=lambda r: (r,),
             distance=lambda s, q: np.linalg.norm(q, axis=1) - s.radius, usd={"Sphere": ("radius",)}, written=("Sphere",),
             scaled=lambda p, scale: Sphere(float(p[0] * abs(scale[0]))) if is_uniform_scale(scale, (1, 2)) else None,
             outline=lambda p, sides: primitives.sphere_outline(p[0], sides), write=lambda s: {"radius": s.radius},
             given=lambda s: (s.radius,)),
    ShapeRow("box", Box, ball=lambda b: float(np.linalg.norm([float(v) for v in b.half])), curvature=lambda b: inf,
             distance=lambda b, q: (np.abs(q) - np.asarray(b.half)).max(axis=1), usd={"Cube": ("size",)}, written=("Cube",),
             read=lambda size: (size / 2.0,) * 3, scaled=lambda p,
             scale: Box((float(p[0] * abs(scale[0])), float(p[1] * abs(scale[1])), float(p[2] * abs(scale[2])))),
             outline=lambda p, sides: primitives.box_outline(p), write=lambda b: {"size": 2.0}, given=lambda b: tuple(b.half),
             stretch=lambda b: b.half),
    ShapeRow("capsule", Capsule, ball=lambda c: float(c.radius) + float(c.half_height),
             curvature=lambda c: c.radius, distance=_capsule_distance, usd={"Capsule": ROUND, "Capsule_1": ENDS},
             written=("Capsule",), read=lambda *sizes: _tapered_dimensions(sizes), scaled=_round_shape_scaler(Capsule, (1, 2)),
             outline=lambda p, sides: primitives.capsule_outline(p[0], p[1], p[2], sides), write=_radius_and_height,
             given=lambda c: (c.radius, c.radius, c.half_height), vanishing=("half_height",)),
    ShapeRow("cylinder", Cylinder, ball=lambda c: hypot(c.radius, c.half_height), curvature=lambda c: c.radius,
             distance=_cylinder_distance, usd={"Cylinder": ROUND, "Cylinder_1": ENDS}, written=("Cylinder",),
             read=lambda *lengths: _tapered_dimensions(lengths), scaled=_round_shape_scaler(Cylinder, (1,)),
             outline=lambda p, sides: primitives.cylinder_outline(p[0], p[1], p[2], sides), write=_radius_and_height,
             given=lambda c: (c.radius, c.radius, c.half_height)),
    ShapeRow("cone", Cone, ball=lambda c: hypot(c.radius, c.half_height), distance=_cone_distance, written=("Cone",),
             usd={"Cone": ROUND}, curvature=lambda c: 0.25 * c.radius * hypot(c.radius, 2.0 * c.half_height) / c.half_height,
             read=lambda radius, height: (radius, 0.0, height / 2.0),
             scaled=lambda p, scale: (Cone(float(p[0] * abs(scale[0])), float(p[2] * abs(scale[2])))
                                      if is_uniform_scale(scale, (1,)) and scale[2] > 0 else None),
             outline=lambda p, sides: primitives.cylinder_outline(p[0], p[1], p[2], sides), write=_radius_and_height,
             given=lambda c: (c.radius, 0.0, c.half_height)),]
