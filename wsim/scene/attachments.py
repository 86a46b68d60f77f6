"""What holds, ties or loads the points of bodies, and live values that vary in time: plain data in SI units, NumPy only."""

from dataclasses import dataclass, field
from math import inf
from typing import Any

import numpy as np

from wsim.scene.bodies import ArrayDataclass
from wsim.scene.check.problem import Problem, SceneError
from wsim.scene.curve import Curve, Motion
from wsim.scene.methods import method_file
from wsim.scene.solids import Collider, Surface
from wsim.scene.values.arrays import contiguous_array, demand_kind, real_array


@dataclass(eq=False)
class Pin(ArrayDataclass):
    """Points of a body held to a frame, still or animated (USD: PhysicsAttachment, point to xform), as in
    `scene.pin("/pins", flag, range(9))`.

    path        prim path
    body        prim path of the cloth, spring net, soft body, rods or material points
    points      indices of its points, (k,), in the author's order, counted from 0
    target      prim path of the Xform that holds them; "": an Xform beside the pin
    motion      the target's frame to world over time, rigid, lengths [m]
    places      where they are held, (k, 3) [m] in the target's frame; None: where the points start
    stiffness   [N/m]; inf: hard, the points follow exactly
    damping     [N s/m], of a soft pin
    follows     a `Follow`, places on a mesh that joints move, instead of motion and places
    """

    path: str
    body: str
    points: np.ndarray
    target: str = ""
    motion: Motion = field(default_factory=Motion.still)
    places: np.ndarray | None = None
    stiffness: float = inf
    damping: float = 0.0
    follows: Any = None

    def __post_init__(self):
        demand_kind(self.path, "motion", self.motion, Motion, "Motion.through(times, places)")
        if self.points is None:
            raise ValueError("points is None; allowed are numbers of points, such as [0, 1]")
        self.points = contiguous_array(list(self.points) if isinstance(self.points, range) else self.points, np.int32, -1)
        self.places = real_array(self.places, -1, 3)


def pin_onto_collider(pin: Pin, body: Any, collider: Collider) -> Pin:
    """The pin, so that its points of a body go along with a collider from where they start: with its frame, or, on a mesh that
    a skeleton moves, each with the face nearest to it. Raises SceneError where that has no sense."""
    given = {"target": bool(pin.target), "places": pin.places is not None, "follows": pin.follows is not None,
             "motion": pin.motion.moves}
    if any(given.values()):
        said = f"has {max(given, key=given.__getitem__)}, beside onto={collider.path}, which says where it goes; fix: give one"
        raise SceneError(Problem(pin.path, said))
    if not isinstance(collider.shape, Surface) or collider.shape.poses is None:
        pin.target, pin.motion = collider.path, collider.motion
        return pin
    skin, surface = collider.shape.poses, collider.shape
    if not hasattr(skin, "skeleton"):
        raise SceneError(Problem(pin.path, f"holds points at {collider.path}, whose points are animated; allowed are meshes "
                                 "that a skeleton or a motion moves; fix: skin it, or give the pin motion=..."))
    if body.noun == "rods":
        raise SceneError(Problem(pin.path, f"holds points of {body.path} at skin, which turns with them; fix: "
                                 "rods.pin_roots(path, collider), which clamps the first two of each strand"))
    if ((pin.points < 0) | (pin.points >= body.point_count)).any():
        raise SceneError(Problem(pin.path, f"holds points {pin.points.min()} to {pin.points.max()} of {body.path}; allowed is "
                                 f"0 to {body.point_count - 1}"))
    from wsim.geometry.topology import first_face_corners

    x = body.placed_points()[pin.points]
    pin.follows = method_file("Skeleton", "objects").Follow.near(skin, first_face_corners(surface.counts, surface.indices), x)
    pin.target = collider.path
    return pin


@dataclass(eq=False)
class Tie(ArrayDataclass):
    """Points that a body shares with a soft body (USD: PhysicsAttachment, point to point): a cloth laid on it, say, as in
    `scene.tie("/tie", flag, [0, 1], jelly, [4, 5])`. Or points that a rigid body holds, and that pull at it (point to xform):
    `scene.tie("/knot", rope, [0], weight)`.

    path        prim path
    body        prim path of a cloth, spring net or soft body; with a rigid body also of rods
    points      indices of its points, (k,)
    other       prim path of a soft body; its points are where the shared ones are. Or of a rigid body
    others      indices of the points of `other`, (k,), in the same order; None: it is a rigid body
    places      on a rigid body: where points are held, in its frame, (k, 3) [m]; None: where they are at the start
    """

    path: str
    body: str
    points: np.ndarray
    other: str
    others: np.ndarray | None = None
    places: np.ndarray | None = None

    def __post_init__(self):
        self.points, self.others = contiguous_array(self.points, np.int32, -1), contiguous_array(self.others, np.int32, -1)
        self.places = real_array(self.places, -1, 3)


def body_ties(scene, path: str | None = None) -> list[Tie]:
    """Ties to rigid bodies, of the points of an object (None: of all)."""
    return [tie for tie in scene.ties if tie.others is None and path in (None, tie.body)]


def tie_places(tie: Tie, source, body) -> np.ndarray:
    """Places in the frame of a rigid body (k, 3) [m] at which it holds the points of a tie; source: the object of these."""
    if tie.places is not None:
        return np.asarray(tie.places, np.float64)
    M = body.motion.at(0.0)
    return (source.motion.points(source.points, 0.0)[tie.points] - M[:3, 3]) @ M[:3, :3]


@dataclass(eq=False)
class Load(ArrayDataclass):
    """A force on points of a body, or a traction on triangles, over time, as in `scene.force("/pull", flag, [8], (0, 0, 2.0))`.
    Dead: its direction stays (`Soft.pressure` turns).

    path        prim path
    body        prim path of the cloth, spring net, soft body, rods or material points; the last two take forces alone
    curve       force [N] or traction [Pa], world, values (keys, 3), linear between keys
    points      of a force: indices of the points, (k,)
    weights     of a force: share of it that each point bears, (k,) [1]; None: 1/k, so that it is their sum
    triangles   of a traction: points of each triangle, (m, 3); it acts on their area at rest
    """

    path: str
    body: str
    curve: Curve
    points: np.ndarray | None = None
    weights: np.ndarray | None = None
    triangles: np.ndarray | None = None

    def __post_init__(self):
        self.points, self.triangles = (contiguous_array(self.points, np.int32, -1),
                                       contiguous_array(self.triangles, np.int32, -1, 3))
        self.weights = contiguous_array(self.weights, np.float32, -1)
        self.curve = self.curve.replaced(np.asarray(self.curve.values, np.float64))

    @property
    def name(self) -> str:
        """Kind of load, as live values are named: "force" or "traction"."""
        return "force" if self.triangles is None else "traction"

    @property
    def parts(self) -> np.ndarray:
        """Part of a force that each of its points bears [1], (k,)."""
        assert self.points is not None
        k = len(self.points)
        return np.full(k, 1.0 / max(k, 1)) if self.weights is None else self.weights.astype(np.float64)


def as_curve_over_time(value) -> Curve:
    """A vector (3,) as a curve that stays; a Curve as it is."""
    return value if isinstance(value, Curve) else Curve(np.zeros(1), np.asarray(value, np.float64)[None])


@dataclass(eq=False)
class Varying(ArrayDataclass):
    """A live value that varies in time, linear between keys. A frame uses the value at its middle (`wsim.simulation.varying`).

    path        prim path of a body or collider; "/": the whole scene
    name        as `Simulation.set` takes it: gravity, wind, stretch, young ... (`wsim.scene.values.table`)
    curve       values (keys, ...), in the SI unit of that name [m, kg, s]
    """

    path: str
    name: str
    curve: Curve
