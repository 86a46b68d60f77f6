"""Bodies of a scene as everybody asks them: what has points that move. Plain data in SI units, NumPy only; see `wsim.scene`.

Methods own the classes: `wsim.physics.cloth.objects`, `wsim.physics.cloth.nets.objects`, `wsim.physics.soft.objects`.
"""

from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from functools import wraps
from math import inf, isfinite
from typing import Any

import numpy as np

from wsim.scene.curve import Curve, Motion
from wsim.scene.values.arrays import WrongArray

NO_AIR = {"drag": 0.0, "lift": 0.0, "normal_drag": 0.0}


class SizedShape:
    """A dataclass of lengths. Raises ValueError where one is not as many numbers as its type says."""

    def __post_init__(self):
        for f in fields(self):                                            # type: ignore[arg-type]
            value, three = getattr(self, f.name), "tuple" in str(f.type)
            if np.shape(value) != ((3,) if three else ()):
                allowed = "are three lengths" if three else "is one length"
                raise ValueError(f"{type(self).__name__}: {f.name} is {value}; allowed {allowed} [m]")


def body_in_single_precision(thing):
    """A body or pin with its doubles rounded to float32, itself where it has none."""
    values = {f.name: getattr(thing, f.name) for f in fields(thing)}
    doubles = {name: v.astype(np.float32) for name, v in values.items() if isinstance(v, np.ndarray) and v.dtype == np.float64}
    return replace(thing, **doubles) if doubles else thing


class DefaultCount(int):
    """A count that nobody named, as a default is: `auto` may put another in its place."""


class ArrayDataclass:
    """Dataclasses with arrays, equal when every field is: doubles and what a file holds of them, float32, are. Setting a name
    that is no field raises AttributeError. A ValueError of `__post_init__` names the path, where there is one."""

    def __init_subclass__(cls, **more):
        super().__init_subclass__(**more)
        if check := vars(cls).get("__post_init__"):
            @wraps(check)
            def check_with_path(self):
                try:
                    check(self)
                except ValueError as error:
                    path = getattr(self, "path", "")
                    if not isinstance(path, str) or not path or str(error).startswith(path):
                        raise
                    wrong = error.value if isinstance(error, WrongArray) else self
                    name = next((f"{f.name}: " for f in fields(self) if getattr(self, f.name) is wrong), "")
                    raise ValueError(f"{path}: {name}{error}") from error.__cause__
            cls.__post_init__ = check_with_path                                 # type: ignore[attr-defined]

    def __setattr__(self, name: str, value) -> None:
        own = isinstance(getattr(type(self), name, None), property)
        if not (name.startswith("_") or own or name in vars(type(self))["__dataclass_fields__"]):
            known = [*vars(type(self))["__dataclass_fields__"]]
            close = get_close_matches(name, known, 1)
            raise AttributeError(f"{type(self).__name__} has no {name}; "
                                 + (f"did you mean {close[0]}?" if close else f"it has {', '.join(known)}"))
        object.__setattr__(self, name, value)

    def __eq__(self, other):
        return type(self) is type(other) and all(
            equal_values(getattr(self, f.name), getattr(other, f.name))
            for f in fields(self) if f.compare)  # type: ignore[arg-type]


def equal_values(a, b) -> bool:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        if a is None or b is None:
            return False
        a, b = np.asarray(a), np.asarray(b)
        narrow = np.float32 if {a.dtype, b.dtype} == {np.dtype(np.float32), np.dtype(np.float64)} else None
        return np.array_equal(a.astype(narrow or a.dtype), b.astype(narrow or b.dtype))
    if isinstance(a, (list, tuple)) and isinstance(b, (list, tuple)):
        return len(a) == len(b) and all(equal_values(x, y) for x, y in zip(a, b, strict=True))
    return bool(a == b)


@dataclass
class BodyGeometry:
    """What a body is made of at rest, by the author's points: what a `wsim.model.model.Model` is built from."""

    rest: np.ndarray                         # [m], (n, 3)
    masses: np.ndarray                       # [kg], (n,)
    reach: np.ndarray                        # half thickness [m], (n,)
    particle: np.ndarray                     # of each point, (n,): points that are welded are one
    triangles: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.int32))
    polygon: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))           # author's, of each triangle
    edges: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int32))        # none: those of the triangles
    tets: np.ndarray = field(default_factory=lambda: np.zeros((0, 4), np.int32))
    idle: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))              # points that nothing holds
    ends: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int32))         # of middles, which follow the points


class PointObject(ArrayDataclass):
    """What has points that can be held, loaded and dragged, whatever method moves them.

    noun            word for such an object; plural: it is many
    refused         {"pin", "load", "tie" or "drag": why it takes none, in words}
    mesh_fields     names of the fields that say which of its points is which
    is_sheet        True: its triangles bend, and have air on both sides
    is_net          True: springs join its points, each with numbers of its own
    is_solid        True: tetrahedra fill it
    is_cluster      True: shape matching holds its points together
    is_particles    True: nothing but constraints that are found as it moves joins its points
    """

    noun = "body"
    refused: dict[str, str] = {}         # noqa: RUF012  (nobody changes it)
    mesh_fields: tuple[str, ...] = ()
    plural = is_sheet = is_net = is_solid = is_cluster = is_particles = False

    path: str
    points: Any
    motion: Motion

    def placed_points(self) -> np.ndarray:
        """Places of its points in the world as the scene starts [m], (n, 3)."""
        return self.motion.points(self.points, 0.0)

    @property
    def point_count(self) -> int:
        """Number of its points."""
        return len(self.points)

    @property
    def has_surface(self) -> bool:
        """True if it has triangles: tractions act on them, and it is a wall for air and liquids."""
        return self.is_sheet or self.is_solid


class Deformable(PointObject):
    """What bodies of points answer, whatever they are made of: contacts, solvers, results and pictures ask this, and no class.
    A class gives fields, or other values, where it differs. model: in-plane elasticity, of what has several.
    collides_as_grains: its points are balls of their reach, which touch those of others and each other.
    meets_as_balls: its points touch others as balls of their reach, and surfaces that collide as points beside triangles.
    is_fluid: constraints keep the density of its points. is_rigid_cluster: its clusters are rigid.
    rolling_friction: of balls that turn [1]; None: they do not. rolling_was_chosen: nobody gave it."""

    model = ""
    self_collision = tethers = quadratic = collides_as_grains = is_fluid = meets_as_balls = is_rigid_cluster = False
    pressure = lift = weld = 0.0
    drag: float | None = 0.0
    rolling_friction: float | None = None
    rolling_was_chosen = False
    actuation: Curve | None = None
    skins: list = []                     # noqa: RUF012
    rest_points: np.ndarray | None = None
    lengths: np.ndarray | None = None
    mass: float | None = None

    points: np.ndarray
    velocities: np.ndarray | None
    masses: np.ndarray | None

    @property
    def materials(self) -> list:
        """Its materials; none where it has numbers of its own."""
        return []

    @property
    def air(self) -> dict[str, float]:
        """Coefficients that count: drag [1], lift [1], normal_drag [kg/(m^2 s)]."""
        return NO_AIR

    @property
    def feels_air(self) -> bool:
        """True if a coefficient of the air is not 0."""
        return any(self.air.values())

    @property
    def friction(self) -> tuple[float, float]:
        """Coefficients of friction [1], static and dynamic."""
        holder: Any = self.materials[0] if self.materials else self
        return holder.static_friction, holder.dynamic_friction

    @property
    def damping_time(self) -> float:
        """Relaxation time of the elastic forces [s], the longest of its materials."""
        return max((m.damping for m in self.materials), default=getattr(self, "damping", 0.0))

    @property
    def loses_energy(self) -> bool:
        """True if it damps, flows, has limits or tethers, or works by itself: air, pressure, muscles."""
        bounds = [getattr(m, name, inf) for m in self.materials for name in ("strain_limit", "yield_strain")]
        works = self.damping_time or self.feels_air or self.tethers or self.actuation or self.pressure
        return bool(works) or any(map(isfinite, bounds))

    def material_number(self, name: str, absent: float = 0.0) -> float:
        """A number of its one material; `absent` where that has none of that name."""
        return getattr(self.materials[0], name, absent) if self.materials else absent

    def is_counted_anew(self, scene: Any) -> bool:
        """True if results hold it as particles, of another number each frame."""
        return False

    def run_bytes(self) -> float:
        """Memory [bytes] that a `body_of_run` takes in float32, where that may be more than there is; else 0."""
        return 0.0

    def body_of_run(self, scene: Any) -> "Deformable":
        """The body as a run of a scene has it: with all points that come while its frames run."""
        return self

    def rest_places(self) -> np.ndarray:
        """Shape without strain in the world [m], (n, 3)."""
        return self.motion.points(self.points if self.rest_points is None else self.rest_points, 0.0)

    def geometry(self, places: np.ndarray) -> BodyGeometry:
        """What it is made of; places (n, 3) [m]: where its points are in the world at the start. Here: points alone."""
        n = len(places)
        masses = np.broadcast_to(np.asarray(self.masses, np.float64), n)
        return BodyGeometry(places - places.mean(axis=0), masses, np.zeros(n), np.arange(n))

    def masses_at_rest(self, rest: np.ndarray) -> np.ndarray | None:
        """Mass of each point [kg], (n,), where it has that shape (n, 3) [m]; None where masses follow no shape."""
        return None

    def surface_faces(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of each face of its surface, (faces,), and their points, (sum,)."""
        return np.zeros(0, np.int32), np.zeros(0, np.int32)

    def surface_triangles(self) -> np.ndarray:
        """Points of the triangles of its surface, (t, 3)."""
        return np.zeros((0, 3), np.int32)

    def held_points(self) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of points that hold each other, (m, 2), and all points that something holds, (k,), more than once or not."""
        return np.zeros((0, 2), np.int32), np.zeros(0, np.int32)

    def least_reach(self) -> float:
        """The least distance [m] that its own points keep."""
        return 0.0

    def stiffness_at_point(self) -> float:
        """Stiffness that a point of it feels [N/m], of a soft pin that is painted."""
        return 1.0

    def kernel_traits(self) -> set[tuple]:
        """What of it decides which kernels a scene needs: see `wsim.simulation.methods.kernel_signature`."""
        return set()


def bodies_sampled_by_point(scene: Any) -> list[Deformable]:
    """Bodies of points of which a result holds the same points in each frame."""
    return [body for body in scene.bodies() if not body.is_counted_anew(scene)]


def scene_of_run(scene: Any) -> Any:
    """The scene with all points that come while its frames run; itself where none come."""
    own = {name: [thing.body_of_run(scene) for thing in things] for name, things in scene.objects.items()
           if things and isinstance(things[0], Deformable)}
    same = all(new is old for name, things in own.items() for new, old in zip(things, scene.objects[name], strict=True))
    return scene if same else replace(scene, objects=scene.objects | own)
