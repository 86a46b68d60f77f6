"""Bodies of a scene: what has points that move. Plain data in SI units, NumPy only; see `wsim.scene`."""

from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches

import numpy as np

from wsim.scene.curve import Curve, Motion
from wsim.scene.fabric import Fabric
from wsim.scene.solid import Bulk

CLOTH_MODELS = ("membrane", "springs")


def contiguous_array(value, dtype, *shape):
    """value as a contiguous array of that dtype and shape (-1: any); None stays None. Raises ValueError where numbers of
    points are none (a mask, fractions), and as `demand_rows` does."""
    if value is None:
        return None
    given = np.asarray(value)
    demand_rows(given, shape)
    if dtype is np.int32 and given.dtype == bool:
        raise ValueError("found a mask where numbers of points or the like belong; give numpy.flatnonzero(mask)")
    if dtype is np.int32 and given.dtype.kind == "f" and (parts := given[given % 1 != 0]).size:
        raise ValueError(f"found {parts[0]:g} where whole numbers belong")
    return np.ascontiguousarray(value, dtype).reshape(shape)


def real_array(value, *shape):
    """value as a contiguous array of that shape, float32 where it is float32, as files hold it, else float64: nobody's doubles
    are rounded. None stays None."""
    if value is None:
        return None
    kept = np.asarray(value)
    if kept.dtype in (np.float16, np.float32):
        return contiguous_array(kept, np.float32, *shape)
    demand_rows(kept, shape)
    return np.array(kept, np.float64, order="C").reshape(shape)              # apart from the caller's


def demand_rows(given: np.ndarray, shape: tuple[int, ...]) -> None:
    """Raises ValueError where a table has rows of another length than `shape`: a reshape would cut them anew."""
    if given.ndim > 1 and len(shape) > 1 and given.size and given.shape[-1] != shape[-1] > 0:
        raise ValueError(f"found rows of {given.shape[-1]} where rows of {shape[-1]} belong, in an array {given.shape}")


def demand_kind(path: str, name: str, value, kind: type, example: str) -> None:
    """Raises ValueError where a field is none of that class."""
    if not isinstance(value, kind):
        raise ValueError(f"{path}: {name} is {value!r}; allowed is a {kind.__name__}, such as {example}")


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
    that is no field raises AttributeError."""

    def __setattr__(self, name: str, value) -> None:
        if not (name.startswith("_") or hasattr(type(self), name) or name in vars(type(self))["__dataclass_fields__"]):
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


@dataclass(eq=False)
class Cloth(ArrayDataclass):
    """A surface that deforms, as in `scene.cloth("/sheet", *shapes.sheet(1.0, 1.0, 8, 8), material=fabric("silk"))`. Polygons
    as authored; `wsim.geometry.triangulate` cuts them into triangles.

    path           prim path
    points         (n, 3) [m], own frame, float32 or float64
    counts         corners of each polygon, (faces,)
    indices        point of each corner, (sum of counts,)
    material       a `Fabric`
    motion         own frame to world at the start, lengths [m]
    velocities     at the start, (n, 3) [m/s], own frame; None: at rest
    rest_points    shape without strain, (n, 3) [m], own frame; None: points
    masses         of each point, (n,) [kg]; None: from the material's density
    mass           of the whole cloth [kg]; used where masses is None
    thicknesses    of each point, (n,) [m]; None: the material's thickness
    model          in-plane elasticity: "membrane" (strain of triangles) or "springs" (edges)
    flat           True: it bends from flat; False: from the angles of its rest shape
    weld           points closer than this are one particle [m] (seams); 0: none
    tethers        long-range attachments to the nearest pin
    drag           aerodynamic drag coefficient [1], along the relative wind; it replaces the `normal_drag` of the material, so
                   that 0 is no drag at all. None: the material's `normal_drag`, which presets have
    lift           aerodynamic lift coefficient [1], across the relative wind
    stretches      stiffness of each polygon, (faces,) [N/m], shear and weft in its ratio; None: the material's
    bends          of each polygon, (faces,) [N m]; None: the material's bend
    self_collision    True: it passes neither through itself, nor other surfaces that say so, nor mesh colliders and boxes
    """

    path: str
    points: np.ndarray
    counts: np.ndarray
    indices: np.ndarray
    material: Fabric = field(default_factory=Fabric)
    motion: Motion = field(default_factory=Motion.still)
    velocities: np.ndarray | None = None
    rest_points: np.ndarray | None = None
    masses: np.ndarray | None = None
    mass: float | None = None
    thicknesses: np.ndarray | None = None
    model: str = "membrane"
    flat: bool = True
    weld: float = 0.0
    tethers: bool = False
    drag: float | None = None
    lift: float = 0.0
    stretches: np.ndarray | None = None
    bends: np.ndarray | None = None
    self_collision: bool = False

    def __post_init__(self):
        demand_kind(self.path, "material", self.material, Fabric, 'wsim.fabric("silk")')
        self.points = real_array(self.points, -1, 3)
        self.counts, self.indices = contiguous_array(self.counts, np.int32, -1), contiguous_array(self.indices, np.int32, -1)
        self.velocities = real_array(self.velocities, -1, 3)
        self.rest_points = real_array(self.rest_points, -1, 3)
        self.masses, self.thicknesses = real_array(self.masses, -1), real_array(self.thicknesses, -1)
        self.stretches, self.bends = real_array(self.stretches, -1), real_array(self.bends, -1)

    @property
    def air(self) -> dict[str, float]:
        """Coefficients that count: drag [1], lift [1], normal_drag [kg/(m^2 s)]."""
        own = self.material.normal_drag if self.drag is None else 0.0
        return {"drag": self.drag or 0.0, "lift": self.lift, "normal_drag": own}

    @property
    def feels_air(self) -> bool:
        """True if a coefficient of the air is not 0."""
        return any(self.air.values())


@dataclass(eq=False)
class Springs(ArrayDataclass):
    """A net of linear springs between own points, as in `scene.net("/rope", [(0, 0, 0), (1, 0, 0)], [(0, 1)],
    stiffness=[100.0], masses=[0.1])`. With `actuation` some are muscles: their rest length is multiplied by the factor of
    their group, which changes over time.

    path                prim path
    points              (n, 3) [m], own frame, float32 or float64
    edges               points of each spring, (m, 2)
    stiffness           (m,) or (1,) for all [N/m]
    masses              (n,) or (1,) for all [kg]
    lengths             rest lengths, (m,) [m]; None: those of points
    damping             relaxation time of the elastic forces [s]
    radius              distance that colliders keep from its points [m]
    motion              own frame to world at the start, lengths [m]
    velocities          at the start, (n, 3) [m/s], own frame; None: at rest
    static_friction     coefficient of friction [1] up to which a contact sticks
    dynamic_friction    coefficient of friction of a contact that slides [1]
    actuation           factors of rest lengths over time, values (keys, groups), > 0 [1], linear between keys
    muscles             group of each spring, (m,), -1: passive; None: all are of group 0
    """

    path: str
    points: np.ndarray
    edges: np.ndarray
    stiffness: np.ndarray
    masses: np.ndarray
    lengths: np.ndarray | None = None
    damping: float = 0.0
    radius: float = 0.0
    motion: Motion = field(default_factory=Motion.still)
    velocities: np.ndarray | None = None
    static_friction: float = 0.5
    dynamic_friction: float = 0.5
    actuation: Curve | None = None
    muscles: np.ndarray | None = None

    def __post_init__(self):
        self.muscles = contiguous_array(self.muscles, np.int32, -1)
        if self.actuation is not None:
            self.actuation = self.actuation.flat()
        self.points, self.edges = real_array(self.points, -1, 3), contiguous_array(self.edges, np.int32, -1, 2)
        self.stiffness, self.masses = real_array(self.stiffness, -1), real_array(self.masses, -1)
        self.lengths, self.velocities = real_array(self.lengths, -1), real_array(self.velocities, -1, 3)


@dataclass(eq=False)
class Skin(ArrayDataclass):
    """A mesh that is only seen: each point follows the tet of its soft body that it lies in (USD: a Mesh of the body), as in
    `jelly.skins.append(Skin("/jelly/skin", *shapes.box((0.1, 0.1, 0.1))))`.

    path       prim path
    points     (m, 3) [m], the soft body's own frame, where its rest (bind) pose is, float32
    counts     corners of each polygon, (faces,), so that it can be saved
    indices    point of each corner, (sum of counts,)
    """

    path: str
    points: np.ndarray
    counts: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))
    indices: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))

    def __post_init__(self):
        self.points = contiguous_array(self.points, np.float32, -1, 3)
        self.counts, self.indices = contiguous_array(self.counts, np.int32, -1), contiguous_array(self.indices, np.int32, -1)


@dataclass(eq=False)
class Soft(ArrayDataclass):
    """A solid of tetrahedra that deforms, as in `scene.soft("/cube", *shapes.block((0.2, 0.2, 0.2), 3),
    material=Bulk(young=2e4))`. Volumes are positive: `wsim.geometry.tetra.repair` turns others.

    path           prim path
    points         (n, 3) [m], own frame, float32 or float64
    tets           corners of each tet, (t, 4)
    material       a `Bulk`
    others         further materials of some tets, list of `Bulk`
    which          material of each tet, (t,): 0 is `material`, k is others[k - 1]; None: all 0
    motion         own frame to world at the start, lengths [m]
    velocities     at the start, (n, 3) [m/s], own frame; None: at rest
    rest_points    shape without strain, (n, 3) [m], own frame; None: points
    masses         of each point, (n,) [kg]; None: from the material's density
    mass           of the whole body [kg]; used where masses is None
    filled         share of each tet of a cage that is body, (t,) [1]: weighs mass and stiffness; None: all of it
    pressure       inside above that outside [Pa]: in its hollows, or where it has none on its surface
    quadratic      ten-node tets: accurate from 2 cells across, where four nodes need 4 and more
    skins          meshes that follow it, list of `Skin`
    self_collision    True: its surface passes neither through itself, nor others that say so, nor mesh colliders and boxes
    """

    path: str
    points: np.ndarray
    tets: np.ndarray
    material: Bulk = field(default_factory=Bulk)
    others: list[Bulk] = field(default_factory=list)
    which: np.ndarray | None = None
    motion: Motion = field(default_factory=Motion.still)
    velocities: np.ndarray | None = None
    rest_points: np.ndarray | None = None
    masses: np.ndarray | None = None
    mass: float | None = None
    filled: np.ndarray | None = None
    pressure: float = 0.0
    quadratic: bool = False
    skins: list[Skin] = field(default_factory=list)
    self_collision: bool = False

    def __post_init__(self):
        for material in self.materials:
            demand_kind(self.path, "material", material, Bulk, "wsim.Bulk(young=2e4)")
        self.points, self.tets = real_array(self.points, -1, 3), contiguous_array(self.tets, np.int32, -1, 4)
        self.which, self.filled = contiguous_array(self.which, np.int32, -1), real_array(self.filled, -1)
        self.velocities = real_array(self.velocities, -1, 3)
        self.rest_points = real_array(self.rest_points, -1, 3)
        self.masses = real_array(self.masses, -1)

    @property
    def materials(self) -> list[Bulk]:
        """All materials, in the order that `which` counts."""
        return [self.material, *self.others]
