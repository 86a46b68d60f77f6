"""Bodies of a scene: what has points that move. Plain data in SI units, NumPy only; see `wsim.scene`."""

from dataclasses import dataclass, field, fields, replace

import numpy as np

from wsim.scene.curve import Curve, Motion
from wsim.scene.fabric import Fabric
from wsim.scene.solid import Bulk

CLOTH_MODELS = ("membrane", "springs")


def array(value, dtype, *shape):
    """value as a contiguous array of that dtype and shape (-1: any); None stays None."""
    return None if value is None else np.ascontiguousarray(value, dtype).reshape(shape)


def reals(value, *shape):
    """value as a contiguous array of that shape, float32 where it is float32, as files hold it, else float64: nobody's doubles
    are rounded. None stays None."""
    if value is None:
        return None
    kept = np.asarray(value)
    if kept.dtype in (np.float16, np.float32):
        return array(kept, np.float32, *shape)
    return np.array(kept, np.float64, order="C").reshape(shape)              # apart from the caller's


def single(thing):
    """A body or pin with its doubles rounded to float32, itself where it has none."""
    values = {f.name: getattr(thing, f.name) for f in fields(thing)}
    doubles = {name: v.astype(np.float32) for name, v in values.items() if isinstance(v, np.ndarray) and v.dtype == np.float64}
    return replace(thing, **doubles) if doubles else thing


class Compared:
    """Dataclasses with arrays, equal when every field is: doubles and what a file holds of them, float32, are."""

    def __eq__(self, other):
        return type(self) is type(other) and all(
            same(getattr(self, f.name), getattr(other, f.name))
            for f in fields(self) if f.compare)  # type: ignore[arg-type]


def same(a, b) -> bool:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        if a is None or b is None:
            return False
        a, b = np.asarray(a), np.asarray(b)
        narrow = np.float32 if {a.dtype, b.dtype} == {np.dtype(np.float32), np.dtype(np.float64)} else None
        return np.array_equal(a.astype(narrow or a.dtype), b.astype(narrow or b.dtype))
    if isinstance(a, (list, tuple)) and isinstance(b, (list, tuple)):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    return bool(a == b)


@dataclass(eq=False)
class Cloth(Compared):
    """A surface that deforms. Polygons as authored; they are cut into triangles by `wsim.geometry.topology`."""

    path: str
    points: np.ndarray                       # [m] own frame, (n, 3), float32 or float64
    counts: np.ndarray                       # corners of each polygon, (faces,)
    indices: np.ndarray                      # point of each corner, (sum of counts,)
    material: Fabric = field(default_factory=Fabric)
    motion: Motion = field(default_factory=Motion.still)   # own frame to world, [m]
    velocities: np.ndarray | None = None     # [m/s] own frame, (n, 3); None: at rest
    rest_points: np.ndarray | None = None    # [m] own frame, (n, 3); None: points
    masses: np.ndarray | None = None         # [kg] of each point, (n,); None: material density
    mass: float | None = None                # [kg] of the whole cloth; used where masses is None
    thicknesses: np.ndarray | None = None    # [m] of each point, (n,); None: material thickness
    model: str = "membrane"                  # in-plane elasticity: "membrane" (triangle strain) or "springs" (edges)
    flat: bool = True                        # rest angles are flat; False: those of the rest shape
    weld: float = 0.0                        # points closer than this [m] are one particle (seams); 0: none
    tethers: bool = False                    # long-range attachments to the nearest pin
    drag: float = 0.0                        # aerodynamic drag coefficient (against the relative wind)
    lift: float = 0.0                        # aerodynamic lift coefficient (across the relative wind)

    def __post_init__(self):
        self.points = reals(self.points, -1, 3)
        self.counts, self.indices = array(self.counts, np.int32, -1), array(self.indices, np.int32, -1)
        self.velocities = reals(self.velocities, -1, 3)
        self.rest_points = reals(self.rest_points, -1, 3)
        self.masses, self.thicknesses = reals(self.masses, -1), reals(self.thicknesses, -1)


@dataclass(eq=False)
class Springs(Compared):
    """A net of linear springs between own points. With `actuation` some are muscles: their rest length is multiplied by the
    factor of their group, which changes over time."""

    path: str
    points: np.ndarray                       # [m] own frame, (n, 3), float32 or float64
    edges: np.ndarray                        # points of each spring, (m, 2)
    stiffness: np.ndarray                    # [N/m], (m,) or (1,) for all
    masses: np.ndarray                       # [kg], (n,) or (1,) for all
    lengths: np.ndarray | None = None        # rest lengths [m], (m,); None: those of points
    damping: float = 0.0                     # relaxation time [s]
    radius: float = 0.0                      # distance that colliders keep [m]
    motion: Motion = field(default_factory=Motion.still)
    velocities: np.ndarray | None = None     # [m/s], (n, 3)
    static_friction: float = 0.5
    dynamic_friction: float = 0.5
    actuation: Curve | None = None           # factors of rest lengths, values (keys, groups), > 0; linear between keys
    muscles: np.ndarray | None = None        # group of each spring, (m,), -1: passive; None: all are of group 0

    def __post_init__(self):
        self.muscles = array(self.muscles, np.int32, -1)
        if self.actuation is not None:
            values = np.asarray(self.actuation.values, np.float64)
            self.actuation = Curve(self.actuation.times, values.reshape(len(values), -1))
        self.points, self.edges = reals(self.points, -1, 3), array(self.edges, np.int32, -1, 2)
        self.stiffness, self.masses = reals(self.stiffness, -1), reals(self.masses, -1)
        self.lengths, self.velocities = reals(self.lengths, -1), reals(self.velocities, -1, 3)


@dataclass(eq=False)
class Skin(Compared):
    """A mesh that is only seen: each point follows the tet of its soft body that it lies in (USD: a Mesh of the body)."""

    path: str
    points: np.ndarray                       # [m] the soft body's own frame, where its rest (bind) pose is, (m, 3) float32
    counts: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))     # corners of each polygon; to save it
    indices: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))    # point of each corner

    def __post_init__(self):
        self.points = array(self.points, np.float32, -1, 3)
        self.counts, self.indices = array(self.counts, np.int32, -1), array(self.indices, np.int32, -1)


@dataclass(eq=False)
class Soft(Compared):
    """A solid of tetrahedra that deforms. Volumes are positive: `wsim.geometry.tetra.repair` turns others."""

    path: str
    points: np.ndarray                       # [m] own frame, (n, 3), float32 or float64
    tets: np.ndarray                         # corners of each tet, (t, 4)
    material: Bulk = field(default_factory=Bulk)
    others: list[Bulk] = field(default_factory=list)       # further materials of some tets
    which: np.ndarray | None = None          # material of each tet: 0 is `material`, k is others[k - 1], (t,); None: all 0
    motion: Motion = field(default_factory=Motion.still)
    velocities: np.ndarray | None = None     # [m/s] own frame, (n, 3)
    rest_points: np.ndarray | None = None    # [m] own frame, (n, 3); None: points
    masses: np.ndarray | None = None         # [kg] of each point, (n,); None: material density
    mass: float | None = None                # [kg] of the whole; used where masses is None
    filled: np.ndarray | None = None         # part of each tet that is body (of a cage), (t,): weighs mass and stiffness
    pressure: float = 0.0                    # [Pa] inside above that outside: in its hollows, or where none are on its surface
    quadratic: bool = False                  # ten nodes a tet: accurate from 2 cells across; four want 4 and more
    skins: list[Skin] = field(default_factory=list)

    def __post_init__(self):
        self.points, self.tets = reals(self.points, -1, 3), array(self.tets, np.int32, -1, 4)
        self.which, self.filled = array(self.which, np.int32, -1), reals(self.filled, -1)
        self.velocities = reals(self.velocities, -1, 3)
        self.rest_points = reals(self.rest_points, -1, 3)
        self.masses = reals(self.masses, -1)

    @property
    def materials(self) -> list[Bulk]:
        """All materials, in the order that `which` counts."""
        return [self.material, *self.others]
