"""What exists: plain data in SI units (m, kg, s, rad), NumPy only, one to one with what a USD stage can say.

A scene holds objects, each named by its prim path: cloths, spring nets, soft bodies, colliders, pins. Points are kept in
the object's own frame [m], beside a local-to-world `motion` in float64, so that nothing is lost far from the origin: float32
where they are given or authored so, as most of USD is, else float64. A save followed by a load gives the same, to float32.

    scene = Scene(gravity=(0, -9.81, 0))
    flag = scene.cloth("/flag", *shapes.sheet(1.0, 1.0, 32, 32), material=Fabric(stretch=500.0))
    scene.pin("/pins", flag, points=range(33))
    scene.sphere("/ball", 0.3, at=(0, -0.5, 0))
"""

from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from wsim.scene.bodies import CLOTH_MODELS, Cloth, Compared, Skin, Soft, Springs, array, reals, single
from wsim.scene.curve import Curve, Motion
from wsim.scene.solids import Box, Capsule, Cone, Cylinder, Plane, Sphere

__all__ = ["CLOTH_MODELS", "Box", "Capsule", "Cloth", "Collider", "Cone", "Cylinder", "Load", "Motion", "Pin", "Plane",
           "Problem", "Scene", "SceneError", "Shape", "Skin", "Soft", "Sphere", "Springs", "Surface", "Tie", "Varying"]


@dataclass(eq=False)
class Surface(Compared):
    """A triangle mesh. Closed: its inside is solid. Open: both sides keep `Collider.thickness` away."""

    points: np.ndarray                       # [m] own frame, (n, 3) float32
    counts: np.ndarray
    indices: np.ndarray
    poses: Curve | None = None               # points over time, values (keys, n, 3), for a deforming mesh

    def __post_init__(self):
        self.points = array(self.points, np.float32, -1, 3)
        self.counts, self.indices = array(self.counts, np.int32, -1), array(self.indices, np.int32, -1)


Shape = Plane | Sphere | Box | Capsule | Cylinder | Cone | Surface


@dataclass(eq=False)
class Collider(Compared):
    """A solid that pushes and is not pushed. `motion` is rigid: a scale has gone into the shape's sizes."""

    path: str
    shape: Shape
    motion: Motion = field(default_factory=Motion.still)
    static_friction: float = 0.5
    dynamic_friction: float = 0.5
    thickness: float | None = None           # [m] kept free around it, besides the cloth's half thickness; None: what hides
                                             # chords of the cloth's mesh, see `wsim.scene.check.chord`
    restitution: float = 0.0                 # part of the speed along its normal that a point leaves with, 0 to 1
    meets: bool = True                       # False, of a rigid body's: it has mass and touches nothing


@dataclass(eq=False)
class Pin(Compared):
    """Points of a body held to a frame, static or animated (USD: PhysicsAttachment, point to xform)."""

    path: str
    body: str                                # path of the cloth, spring net or soft body
    points: np.ndarray                       # indices in the author's order, (k,)
    target: str = ""                         # path of the Xform it hangs on; "": an Xform beside the pin
    motion: Motion = field(default_factory=Motion.still)   # target's frame to world, rigid, [m]
    places: np.ndarray | None = None         # [m] in the target's frame, (k, 3); None: where the points are at the start
    stiffness: float = inf                   # [N/m]; inf: hard
    damping: float = 0.0                     # [N s/m]

    def __post_init__(self):
        self.points = array(list(self.points) if isinstance(self.points, range) else self.points, np.int32, -1)
        self.places = reals(self.places, -1, 3)


@dataclass(eq=False)
class Tie(Compared):
    """Points that a body shares with a soft body (USD: PhysicsAttachment, point to point): a cloth laid on it, say."""

    path: str
    body: str                                # path of a cloth, spring net or soft body
    points: np.ndarray                       # indices in its author's order, (k,)
    other: str                               # path of a soft body; its points are where the shared ones are
    others: np.ndarray                       # (k,)

    def __post_init__(self):
        self.points, self.others = array(self.points, np.int32, -1), array(self.others, np.int32, -1)


@dataclass(eq=False)
class Load(Compared):
    """A force on points of a body, or a traction on triangles of a cloth or of the surface of a soft body, over time; it keeps
    its direction in the world, whatever the body does (a dead load; what turns with a surface is `Soft.pressure`)."""

    path: str
    body: str                                # path of the cloth, spring net or soft body
    curve: Curve                             # force [N] or traction [Pa], world, values (keys, 3), linear between keys
    points: np.ndarray | None = None         # of a force: indices in the author's order, (k,)
    weights: np.ndarray | None = None        # part of the force that each bears, (k,); None: 1/k, so that it is their sum
    triangles: np.ndarray | None = None      # of a traction: points of each, (m, 3); on their area at rest

    def __post_init__(self):
        self.points, self.triangles = array(self.points, np.int32, -1), array(self.triangles, np.int32, -1, 3)
        self.weights = array(self.weights, np.float32, -1)
        self.curve = Curve(self.curve.times, np.asarray(self.curve.values, np.float64))

    @property
    def name(self) -> str:
        return "force" if self.triangles is None else "traction"

    @property
    def parts(self) -> np.ndarray:
        """Of a force: the part that each of its points bears, (k,)."""
        assert self.points is not None
        k = len(self.points)
        return np.full(k, 1.0 / max(k, 1)) if self.weights is None else self.weights.astype(np.float64)


def over_time(value) -> Curve:
    """A vector (3,) as a curve that stays; a Curve as it is."""
    return value if isinstance(value, Curve) else Curve(np.zeros(1), np.asarray(value, np.float64)[None])


@dataclass(eq=False)
class Varying(Compared):
    """A live value that varies in time: what `Simulation.set` takes under that path and name, keys of a curve, linear between
    them. A frame has the value at its middle (`wsim.simulation.varying`)."""

    path: str                                # of a body or collider; "/": the whole scene
    name: str                                # gravity, wind, stretch, young ... (`wsim.scene.check.varying.LIVE`)
    curve: Curve                             # values (keys, ...) [SI]


@dataclass(eq=False)
class Scene(Compared):
    """Everything there is. Frame f is at time f / fps [s] after `start`; h = 1 / fps / substeps."""

    gravity: tuple[float, float, float] = (0.0, -9.81, 0.0)   # [m/s^2]
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)        # velocity of the air [m/s]
    air_density: float = 1.2                 # [kg/m^3]
    air_drag: float = 0.0                    # decay rate of every point's velocity [1/s]
    up: str = "Y"                            # "Y" or "Z"
    fps: float = 24.0                        # frames (time codes) a second
    start: float = 0.0                       # time code of the first frame (the initial state)
    frames: int = 96                         # frames to simulate
    substeps: int = 10
    iterations: int = 4                      # solver iterations a substep
    solver: str = "auto"                     # of the elastic forces; "auto": `wsim.simulation.choice` weighs cost against error
    integrator: str = "auto"                 # see `wsim.scene.integrator`; "auto": what suits the solver
    contact_width: float = 0.0               # [m] in which contacts are soft, see `wsim.physics.contact.barrier`; 0: hard
    error: float = 0.01                      # wanted RMS error of positions over the scene's size, for "auto"
    cloths: list[Cloth] = field(default_factory=list)
    springs: list[Springs] = field(default_factory=list)
    softs: list[Soft] = field(default_factory=list)
    colliders: list[Collider] = field(default_factory=list)
    pins: list[Pin] = field(default_factory=list)
    ties: list[Tie] = field(default_factory=list)
    loads: list[Load] = field(default_factory=list)
    varying: list[Varying] = field(default_factory=list)      # the fields above have the values of these at the start
    others: dict[str, list] = field(default_factory=dict)     # of methods without a list here, by class (`add`)
    source: str | None = field(default=None, compare=False)   # file it was loaded from
    notes: list["Problem"] = field(default_factory=list, compare=False)   # what the loader warned about
    variants: dict[str, dict[str, str]] = field(default_factory=dict, compare=False)   # {prim: {set: chosen}}

    def add(self, thing):
        """Adds an object of a method that has no list of its own here. Raises SceneError where no method owns its class."""
        from wsim.scene.methods import METHODS, owner
        name = type(thing).__name__
        if owner(name) is None:
            known = ", ".join(each for row in METHODS for each in row.owns) or "none"
            path = getattr(thing, "path", "/")
            raise SceneError(Problem(path, f"is a {name}, which no method simulates; there are: {known}"))
        self.others.setdefault(name, []).append(thing)
        return thing

    def things(self, name: str) -> list:
        """What `add` was given of a class, by its name."""
        return self.others.get(name, [])

    def cloth(self, path: str, points, counts, indices, **more) -> Cloth:
        """Adds a cloth; see `Cloth` for the fields."""
        self.cloths.append(Cloth(path, points, counts, indices, **more))
        return self.cloths[-1]

    def net(self, path: str, points, edges, stiffness, masses, **more) -> Springs:
        """Adds a spring net; see `Springs` for the fields."""
        self.springs.append(Springs(path, points, edges, stiffness, masses, **more))
        return self.springs[-1]

    def soft(self, path: str, points, tets, **more) -> Soft:
        """Adds a soft body; see `Soft` for the fields."""
        self.softs.append(Soft(path, points, tets, **more))
        return self.softs[-1]

    def collider(self, path: str, shape: Shape, at=(0.0, 0.0, 0.0), **more) -> Collider:
        """Adds a collider at a place [m], or with motion=Motion(...)."""
        more.setdefault("motion", Motion.at_place(at))
        self.colliders.append(Collider(path, shape, **more))
        return self.colliders[-1]

    def pin(self, path: str, body, points, **more) -> Pin:
        """Holds points (indices) of a cloth or spring net; see `Pin` for the fields."""
        self.pins.append(Pin(path, body if isinstance(body, str) else body.path, points, **more))
        return self.pins[-1]

    def tie(self, path: str, body, points, other, others) -> Tie:
        """Points (indices) of a body become points of a soft body, the first the first of `others`, and so on."""
        names = (b if isinstance(b, str) else b.path for b in (body, other))
        self.ties.append(Tie(path, next(names), points, next(names), others))
        return self.ties[-1]

    def force(self, path: str, body, points, force, weights=None) -> Load:
        """A force [N], (3,) or a Curve over time, on points (indices) of a body: their sum, or, with `weights`, that part of it
        on each (1 for each: all of it on every one)."""
        weights = None if weights is None else np.broadcast_to(np.asarray(weights, np.float32), np.shape(points)).copy()
        self.loads.append(Load(path, body if isinstance(body, str) else body.path, over_time(force), points, weights))
        return self.loads[-1]

    def traction(self, path: str, body, triangles, traction) -> Load:
        """A traction [Pa], (3,) or a Curve over time, on triangles (m, 3) of a cloth or of the surface of a soft body;
        `wsim.scene.nodal_loads.between` finds those between points."""
        self.loads.append(Load(path, body if isinstance(body, str) else body.path, over_time(traction), triangles=triangles))
        return self.loads[-1]

    def single(self) -> "Scene":
        """Doubles rounded to float32, for a run in float32: rest lengths are then those of the points that it begins with."""
        found: dict = {name: [single(thing) for thing in getattr(self, name)]
                       for name in ("cloths", "springs", "softs", "pins")}
        return replace(self, **found)  # type: ignore[arg-type]

    def bodies(self) -> list[Cloth | Springs | Soft]:
        """Everything that has points that move, in the order of the state's arrays."""
        return [*self.cloths, *self.springs, *self.softs]


@dataclass(frozen=True)
class Problem:
    """Something wrong with a scene: where, what was found, what is allowed and the mend."""

    path: str
    text: str
    fatal: bool = True

    def __str__(self) -> str:
        return f"{'error' if self.fatal else 'warning'}: {self.path}: {self.text}"


class SceneError(Exception):
    """A scene that cannot be run. `problems` lists everything found, each with its prim path."""

    def __init__(self, problems):
        self.problems = [problems] if isinstance(problems, Problem) else list(problems)
        super().__init__("\n".join(str(p) for p in self.problems))

