"""Position-based particles of a scene, and what they are made of: plain data in SI units, NumPy only.

Grains touch by constraints with Coulomb friction (Macklin, Mueller, Chentanez, Kim 2014, mass splitting of Tonge, Benevolenski,
Voroshilov 2012); fluids keep their density (Macklin, Mueller 2013). Equations: kernels/position_based. Numbers that are out of
their range raise SceneError when a `Simulation` is made, or by `wsim check`; see check.py.
"""

from dataclasses import dataclass, field, fields, replace
from importlib import import_module
from math import inf
from typing import Any

import numpy as np

from wsim.physics.particles.pouring import Pour, PouringShape
from wsim.scene.bodies import BodyGeometry, Deformable
from wsim.scene.curve import Motion
from wsim.scene.values.arrays import demand_kind, real_array

LOOSE = 1.1            # edge of a column of poured grains over their diameter, moved at random in what is left
ROLLS, TURNING = 0.3, 500_000    # rolling friction where none is given, and grains of a scene up to which they turn then: on an
#                        H200 a million take 26 ms a frame if they turn, and 16 ms if they do not
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
                        a ball stays on slopes up to that tangent; of two grains the mean counts. inf: grains do not turn,
                        which is cheapest. None: 0.3, and inf in a scene of more than 500 000 grains
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
        """See `Deformable`: one particle at least, which comes never where the scene ends before. Grains turn or not."""
        found: Any = self
        if self.pour is not None:
            count = self.count_of_run(scene)
            poured = self.pouring_shape().pour_points(0, max(count, 1), scene.fps)
            found = replace(self, points=poured.x, velocities=poured.v, motion=Motion.still())
            found._times = poured.t if count else np.full(1, inf)
        if getattr(self.material, "rolling_friction", 0.0) is None:
            all_grains = sum(thing.count_of_run(scene) for thing in scene.things("Particles") if thing.collides_as_grains)
            times = getattr(found, "_times", None)
            found = replace(found, material=replace(self.material, rolling_friction=ROLLS if all_grains <= TURNING else inf))
            found._chosen = True
            if times is not None:
                found._times = times
        return found

    def count_of_run(self, scene: Any) -> int:
        """Particles that a run of a scene has in all its frames."""
        return len(self.points) if self.pour is None else self.pouring_shape().count_until(max(scene.frames, 1) / scene.fps)

    @property
    def rolling_was_chosen(self) -> bool:                              # type: ignore[override]
        """Whether a `body_of_run` turns, or does not, since nobody said."""
        return getattr(self, "_chosen", False)

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
        """See `Deformable`, of a `body_of_run`."""
        given = getattr(self.material, "rolling_friction", None)
        return None if given == inf else given

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


def lattice_edge(radius: float, is_fluid: bool) -> float:
    """Edge [m] of the cubes that particles of a radius [m] begin in, one each: 2 r of a fluid, 2.2 r of grains."""
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
        filling = import_module("wsim.physics.position_based.filling")                     # which imports this module
        more["points"] = filling.fill_with_particles(path, shape, radius, more.get("material"))
    return Particles(path, radius=radius, **more)
