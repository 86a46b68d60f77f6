"""Position-based particles of a scene, and what they are made of: plain data in SI units, NumPy only.

Grains touch by constraints with Coulomb friction (Macklin, Mueller, Chentanez, Kim 2014, mass splitting of Tonge, Benevolenski,
Voroshilov 2012); fluids keep their density (Macklin, Mueller 2013). Equations: kernels/position_based. Numbers that are out of
their range raise SceneError when a `Simulation` is made, or by `wsim check`; see check.py.
"""

from dataclasses import dataclass, field, fields, replace
from math import inf
from numbers import Real
from typing import Any

import numpy as np

from wsim.physics.particles.pouring import MOST_PLACES, Pour, PouringShape
from wsim.scene.bodies import BodyGeometry, Deformable
from wsim.scene.curve import Motion
from wsim.scene.values.arrays import demand_kind, real_array

STABLE_TENSION = 0.02  # h^2 sigma / m, up to which a drop comes to rest
BYTES = 2000.0, 800.0   # that a grain and a particle of a fluid take: 1340 and 520 on a device, the rest on the host
STABLE_VISCOSITY = 0.1 # h mu / (rho (2 r)^2), up to which the explicit step of viscosity is taken


@dataclass(frozen=True)
class Grains:
    """Round grains that touch and rub, as in `Grains(static_friction=0.6, dynamic_friction=0.6)`.

    density             of a grain [kg/m^3], above 0
    static_friction     coefficient [1] up to which a contact sticks, 0 or more; of two grains, or a grain and a collider, the
                        mean counts
    dynamic_friction    coefficient of a contact that slides [1], 0 or more
    rolling_friction    torque that resists rolling over normal force and radius, at most [1] (Ai et al. 2011): 0 rolls freely,
                        a ball stays on slopes up to that tangent; of two grains the mean counts. None: grains do not turn
    """

    density: float = 2600.0
    static_friction: float = 0.5
    dynamic_friction: float = 0.5
    rolling_friction: float | None = None

    def particle_mass(self, radius: np.ndarray) -> np.ndarray:
        """Mass [kg] of particles of these radii (n,) [m], (n,): balls."""
        return self.density * (4.0 / 3.0 * np.pi) * radius**3


@dataclass(frozen=True)
class ConstraintFluid:
    """A fluid whose density constraints keep (Macklin, Mueller 2013), as in `ConstraintFluid(density=1000.0)`.

    density             at rest [kg/m^3], above 0
    viscosity           [Pa s] (Morris, Fox, Zhu 1997), 0 or more; beyond `viscosity_limit` it is reduced, with a warning
    smoothing           part of the differences of velocity, along the line between them, that neighbours lose in a substep [1],
                        0 to 0.5 (XSPH)
    surface_tension     [N/m] (Akinci, Akinci, Teschner 2013), 0 or more; water against air has 0.072; walls are not wetted;
                        beyond `tension_limit` it is reduced, with a warning
    static_friction     of contacts with colliders [1], 0 or more
    dynamic_friction    of contacts with colliders [1], 0 or more

    All fluids of a scene have one radius.
    """

    density: float = 1000.0
    viscosity: float = 1e-3
    smoothing: float = 0.05
    surface_tension: float = 0.0
    static_friction: float = 0.0
    dynamic_friction: float = 0.0

    def particle_mass(self, radius: np.ndarray) -> np.ndarray:
        """Mass [kg] of particles of these radii (n,) [m], (n,): cubes of two radii, which is what one has of a lattice."""
        return self.density * (2.0 * radius) ** 3

    def tension_limit(self, radius: float, h: float) -> float:
        """Largest surface tension [N/m] that explicit substeps of h [s] carry, of particles of a radius [m]:
        h^2 sigma / m = 0.02; at 0.08 drops do not come to rest."""
        return STABLE_TENSION * self.density * (2.0 * radius) ** 3 / h**2

    def viscosity_limit(self, radius: float, h: float) -> float:
        """Largest viscosity [Pa s] that explicit substeps of h [s] carry, of particles of a radius [m]:
        h mu / (rho (2 r)^2) = 0.1."""
        return STABLE_VISCOSITY * self.density * (2.0 * radius) ** 2 / h


MATERIALS: dict[str, Any] = {"grains": Grains, "fluid": ConstraintFluid}


@dataclass(eq=False)
class Particles(Deformable):
    """Particles that constraints move in the XPBD iterations, with cloth, nets and rigid bodies, as in
    `scene.particles("/sand", Box((0.1, 0.1, 0.1)), at=(0, 0.1, 0), radius=0.005)`.

    path         prim path
    points       (n, 3) [m], own frame, float32 or float64
    radius       of each particle, (n,) or (1,) for all [m], above 0; those of a fluid are alike, and two radii apart at rest;
                 those of grains differ by a factor of 50 at most
    material     `Grains` or `ConstraintFluid` of `wsim.physics.position_based.objects`, or "grains", "fluid" for their defaults
    motion       own frame to world at the start, lengths [m]
    velocities   at the start, (n, 3) [m/s], own frame; None: at rest
    colors       linear RGB, 0 to 1 [1], of all, (3,), or of each particle (n, 3); None: by the material
    shape        that they fill, and that stays a prim of its own in results; None: they are points
    velocity     of all at the start, (3,) [m/s], own frame, where `velocities` says nothing
    pour         `Pour`: the shape is empty at the start, and pours with the velocity, which turns with it; a motion may carry
                 it; a `PointCloud` is a shape of balls. None: all are there at the start

    `make_particles` fills a shape. Raises ValueError, with the path and the name, where an array holds no numbers or rows of
    another length, or `pour` is no `Pour`.
    """

    noun, plural, model, is_particles = "particles", True, "particles", True
    meets_as_balls = True

    path: str
    points: np.ndarray
    radius: Any
    material: Any = "grains"
    motion: Motion = field(default_factory=Motion.still)
    velocities: np.ndarray | None = None
    colors: np.ndarray | None = None
    shape: Any = None
    velocity: np.ndarray | None = None
    pour: Pour | None = None

    def __post_init__(self):
        if self.pour is not None:
            demand_kind(self.path, "pour", self.pour, Pour, "Pour(start=0.0, end=1.0)")
        if isinstance(self.material, str) and self.material in MATERIALS:
            self.material = MATERIALS[self.material]()
        self.points, self.velocities = real_array(self.points, -1, 3), real_array(self.velocities, -1, 3)
        self.radius = real_array(np.nan if self.radius is None else self.radius, -1)
        self.colors = None if self.colors is None else real_array(self.colors, *np.shape(self.colors))
        if self.velocity is not None:
            self.velocity = real_array(self.velocity, *np.shape(self.velocity))
            if self.velocities is None and self.velocity.shape == (3,) and not self.pour:
                self.velocities = np.tile(self.velocity, (len(self.points), 1))

    def pouring_shape(self) -> PouringShape:
        """Where and when what it pours comes: columns as wide as its lattice, so that none overlaps another where it comes."""
        edge, mass = lattice_edge(self.radius[0], self.is_fluid), self.material.particle_mass(self.radius[:1])[0]
        return PouringShape(self, edge, float(mass), 1.0 - 2.0 * float(self.radius[0]) / edge)

    def is_counted_anew(self, scene: Any) -> bool:
        """See `Deformable`: where it has a shape, or sinks may take some."""
        return self.shape is not None or bool(scene.things("MaterialSink"))

    def body_of_run(self, scene: Any) -> "Particles":
        """See `Deformable`: one particle at least, which comes never where the scene ends before."""
        if self.pour is None:
            return self
        shape, frames = self.pouring_shape(), max(scene.frames, 1)
        count = shape.count_until(frames / scene.fps)
        poured = shape.pour_points(0, max(count, 1), scene.fps)
        found = replace(self, points=poured.x, velocities=poured.v, motion=Motion.still())
        found._times = poured.t if count else np.full(1, inf)         # type: ignore[attr-defined]
        return found

    def run_bytes(self) -> float:
        """See `Deformable`: of lists of neighbours and contacts, mostly."""
        return BYTES[self.is_fluid] * len(self.points)

    @property
    def arrival_times(self) -> np.ndarray:
        """When each particle of what pours comes, of a `body_of_run`, (n,) [s]."""
        return self._times                                            # type: ignore[attr-defined]

    @property
    def is_fluid(self) -> bool:                                        # type: ignore[override]
        """See `Deformable`."""
        return isinstance(self.material, ConstraintFluid)

    @property
    def collides_as_grains(self) -> bool:                              # type: ignore[override]
        """See `Deformable`."""
        return isinstance(self.material, Grains)

    @property
    def rolling_friction(self) -> float | None:                        # type: ignore[override]
        """See `Deformable`."""
        return getattr(self.material, "rolling_friction", None)

    @property
    def friction(self) -> tuple[float, float]:
        """See `Deformable`."""
        return self.material.static_friction, self.material.dynamic_friction

    @property
    def loses_energy(self) -> bool:
        """See `Deformable`: contacts of its own do."""
        return True

    def radii(self) -> np.ndarray:
        """Radius of each particle [m], (n,)."""
        return np.broadcast_to(self.radius, len(self.points)).copy()

    def geometry(self, places: np.ndarray) -> BodyGeometry:
        """See `Deformable`."""
        radii = self.radii()
        middle = places.mean(axis=0) if len(places) else np.zeros(3)
        return BodyGeometry(places - middle, self.material.particle_mass(radii), radii, np.arange(len(places)))

    def held_points(self) -> tuple[np.ndarray, np.ndarray]:
        """See `Deformable`: contacts hold all."""
        return np.zeros((0, 2), np.int32), np.arange(len(self.points), dtype=np.int32)

    def least_reach(self) -> float:
        """See `Deformable`."""
        return float(self.radius.min(initial=np.inf)) if len(self.radius) else 0.0


LOOSE = 1.1            # edge of a lattice of grains over their diameter: moved at random in what is left, they fall in a heap


def lattice_edge(radius: float, is_fluid: bool) -> float:
    """Edge [m] of the lattice that particles of a radius [m] begin on: 2 r of a fluid, 2.2 r of grains."""
    return 2.0 * float(radius) * (1.0 if is_fluid else LOOSE)


def make_particles(path: str, shape: Any, radius: Any, more: dict) -> Particles:
    """Particles that fill a shape, or points that `more` has. Raises SceneError for both or neither, and for a material's
    number that is no argument of particles."""
    from wsim.scene import Problem, SceneError
    if (shape is None) == (more.get("points") is None):
        found = "neither a shape nor points" if shape is None else "a shape and points"
        raise SceneError(Problem(path, f"has {found}; allowed is one of them; fix: give a shape to fill, or points=..."))
    for kind in MATERIALS.values():
        if named := sorted({f.name for f in fields(kind)} & {*more}):
            raise SceneError(Problem(path, f"{named[0]} is a number of the material; fix: give material="
                                     f"{kind.__name__}({named[0]}={more[named[0]]!r:.60}), of {kind.__module__}"))
    if more.get("pour") is not None:
        if shape is None:
            raise SceneError(Problem(path, "has points and a pour; allowed: a shape that pours; fix: give a shape, or no pour"))
        return Particles(path, np.zeros((0, 3)), radius, shape=shape, **more)
    if shape is not None:
        more["points"] = fill_with_particles(path, shape, radius, more.get("material"))
    return Particles(path, radius=radius, **more)


def fill_with_particles(path: str, shape: Any, radius: Any, material: Any = None) -> np.ndarray:
    """Places of a cubic lattice of edge 2 radius, LOOSE times that of grains, within a closed shape, in its own frame (n, 3)
    [m], each moved at random: grains within what that leaves free, so that they do not overlap, a fluid by as much, so that it
    does not spread along its rows. Balls about them lie within a convex shape. Raises SceneError where there is not one radius
    > 0, a shape has no inside, or it holds no particle or too many."""
    from wsim.physics.particles.check_shapes import check_volume_shape
    from wsim.physics.particles.lattice import index_block, indices_inside_mesh
    from wsim.scene import Plane, Problem, SceneError, Surface
    from wsim.scene.solids import SOLIDS, shape_row
    known = isinstance(radius, Real | np.ndarray)
    if not known or np.size(radius) != 1 or not 0.0 < float(radius) < np.inf:
        raise SceneError(Problem(path, f"radius is {radius!r:.60}; allowed is one length > 0 [m] where a shape is filled; fix: "
                                 "give radius=0.01, or points with a radius each"))
    if type(shape) not in (Surface, *(row.shape for row in SOLIDS)):
        raise SceneError(Problem(path, f"shape is {shape!r:.60}; allowed is a closed shape; fix: give Box((0.1, 0.1, 0.1)) or "
                                 "wsim.Surface(points, counts, indices) of a mesh"))
    if isinstance(shape, Plane):
        raise SceneError(Problem(path, "a Plane has no end to fill; allowed is a closed shape; fix: give a Box, say"))
    is_fluid = material == "fluid" or isinstance(material, ConstraintFluid)
    edge, way = lattice_edge(float(radius), is_fluid), (LOOSE - 1.0) * float(radius)
    free = 0.0 if is_fluid else way
    if broken := [problem for problem in check_volume_shape(path, shape) if problem.fatal]:
        raise SceneError(broken)
    if isinstance(shape, Surface):
        low, high = shape.points.min(axis=0), shape.points.max(axis=0)
        begin, end = np.floor(low / edge).astype(int) - 1, np.ceil(high / edge).astype(int) + 1
        _check_lattice_size(path, radius, float(np.prod(end - begin, dtype=np.float64)))
        inside = indices_inside_mesh(shape, np.eye(4), begin, end, lambda x: x / edge - 0.5)
        places = (index_block(begin, end)[inside] + 0.5) * edge
    else:
        half = np.array(getattr(shape, "half", (float(shape_row(shape).ball(shape)),) * 3), float)
        most = np.ceil(half / edge).astype(int) + 1
        _check_lattice_size(path, radius, float(np.prod(2.0 * most)))
        size = np.floor(2.0 * half / edge + 1e-6) if hasattr(shape, "half") else np.zeros(3)
        lattice = (index_block(tuple(-most), tuple(most)) + 0.5 * (size % 2 == 0)) * edge
        places = lattice[shape_row(shape).distance(shape, lattice) < -(radius + free) * (1.0 - 1e-6)]
    if not len(places):
        raise SceneError(Problem(path, f"its shape holds no particle: its radius is {float(radius):g} m; allowed: a shape that "
                                 "holds one; fix: give a smaller radius, or a larger shape"))
    shift = way * np.random.default_rng(0).uniform(-1.0, 1.0, places.shape)
    if is_fluid and not isinstance(shape, Surface):
        for factor in (-1.0, 0.0):                                    # what would stand out goes back, or nowhere
            out = shape_row(shape).distance(shape, places + shift) > -float(radius) * (1.0 - 1e-6)
            shift[out] *= factor
    return places + shift


def _check_lattice_size(path: str, radius: Any, places: float) -> None:
    """Raises SceneError where the lattice about a shape would not fit in memory."""
    from wsim.scene import Problem, SceneError
    if places > MOST_PLACES:
        larger = float(radius) * (places / MOST_PLACES) ** (1.0 / 3.0)
        raise SceneError(Problem(path, f"radius is {radius:g} m, with which the box about the shape has {places:.3g} places; "
                                 f"allowed are {MOST_PLACES:.3g}; fix: give a radius of {larger:.2g} m, or a smaller shape"))
