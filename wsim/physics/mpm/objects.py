"""Objects of the material point method, and their materials: plain data in SI units, NumPy only."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wsim.physics.particles.pouring import Pour, PouringShape
from wsim.scene.attachments import Pin
from wsim.scene.bodies import ArrayDataclass, PointObject
from wsim.scene.curve import Motion
from wsim.scene.methods import method_file
from wsim.scene.solids import shape_row, turn_plane
from wsim.scene.values.arrays import demand_kind

ACROSS = 2                 # particles of a full cell along each axis
CONES = ("shear", "triaxial")


def lame_moduli(young: float, poisson: float) -> tuple[float, float]:
    """mu and lambda [Pa]."""
    return 0.5 * young / (1.0 + poisson), young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))


@dataclass(frozen=True)
class Jelly:
    """An elastic solid, as in `Jelly(young=1e4, poisson=0.3)`. See `LAWS` in kernels/particles/mpm/laws.py for its energy.

    young       Young's modulus [Pa]
    poisson     Poisson's ratio [1]
    density     at rest [kg/m^3]
    model       "neo_hookean" or "corotational"
    viscosity   of the shear rate [Pa s]
    """

    young: float = 1e5
    poisson: float = 0.3
    density: float = 1000.0
    model: str = "neo_hookean"
    viscosity: float = 0.0

    @property
    def law(self) -> str:
        return self.model

    def numbers(self) -> tuple[float, ...]:
        """Numbers of the law: mu, lambda [Pa], five of its own, the viscosity [Pa s]."""
        return *lame_moduli(self.young, self.poisson), 0.0, 0.0, 0.0, 0.0, 0.0, self.viscosity


@dataclass(frozen=True)
class Snow:
    """Snow that packs and breaks (Stomakhin et al. 2013), as in `Snow(hardening=10.0)`.

    young         Young's modulus [Pa]
    poisson       Poisson's ratio [1]
    density       at rest [kg/m^3]
    compression_limit   stretches below 1 less this become plastic [1]
    tension_limit       stretches above 1 plus this become plastic [1]
    hardening     stiffness grows by exp(hardening (1 - Jp)) [1]
    viscosity     of the shear rate [Pa s]
    """

    young: float = 1.4e5
    poisson: float = 0.2
    density: float = 400.0
    compression_limit: float = 0.025
    tension_limit: float = 0.0075
    hardening: float = 10.0
    viscosity: float = 0.0
    law = "snow"

    def numbers(self) -> tuple[float, ...]:
        """Numbers of the law: mu, lambda [Pa], five of its own, the viscosity [Pa s]."""
        own = self.compression_limit, self.tension_limit, self.hardening, 0.0, 0.0
        return *lame_moduli(self.young, self.poisson), *own, self.viscosity


@dataclass(frozen=True)
class Granular:
    """Sand, soil or grain that slides where shear outweighs pressure (Klar et al. 2016), as in `Granular(friction_angle=0.6)`.

    young            Young's modulus [Pa]; stiffer than what piles up needs costs steps and nothing else
    poisson          Poisson's ratio [1]
    density          of the heap, pores included [kg/m^3]
    friction_angle   steepest angle of a wide slope that stands [rad]
    cohesion         shear stress that it bears without pressure [Pa]; 0: dry
    cone             "shear": the angle is that of a slope, |dev tau| <= sqrt(2) tan(angle) p; "triaxial": that of
                     Mohr and Coulomb in triaxial compression, as Klar has it: slopes stand steeper
    viscosity        of the shear rate [Pa s]
    """

    young: float = 3.5e5
    poisson: float = 0.3
    density: float = 1600.0
    friction_angle: float = float(np.radians(30.0))
    cohesion: float = 0.0
    cone: str = "shear"
    viscosity: float = 0.0
    law = "sand"

    def numbers(self) -> tuple[float, ...]:
        """Numbers of the law: mu, lambda [Pa], five of its own, the viscosity [Pa s]."""
        slope = np.sqrt(2.0) * np.tan(self.friction_angle)
        if self.cone == "triaxial":
            sine = np.sin(self.friction_angle)
            slope = np.sqrt(2.0 / 3.0) * 6.0 * sine / (3.0 - sine)
        own = float(slope), float(np.sqrt(2.0) * self.cohesion), 0.0, 0.0, 0.0
        return *lame_moduli(self.young, self.poisson), *own, self.viscosity


@dataclass(frozen=True)
class Water:
    """A liquid that is a little compressible (Tait's form, Monaghan 1994), as in `Water(bulk=2e4)`.

    bulk        modulus of compression [Pa]; 100 density times the square of the greatest speed keeps it within 1 %
    density     at rest [kg/m^3]
    exponent    of the pressure's growth with density [1]
    tension     True: it bears tension, as closed water does; False: it comes apart
    viscosity   of the shear rate [Pa s]
    """

    bulk: float = 1e5
    density: float = 1000.0
    exponent: float = 7.0
    tension: bool = False
    viscosity: float = 0.0
    law = "water"

    def numbers(self) -> tuple[float, ...]:
        """Numbers of the law: mu, lambda [Pa], five of its own, the viscosity [Pa s]."""
        return 0.0, self.bulk, self.exponent, float(self.tension), 0.0, 0.0, 0.0, self.viscosity


MATERIALS: dict[str, Callable] = {"jelly": Jelly, "snow": Snow, "sand": Granular, "water": Water}


def named_material(material: Any) -> Any:
    """The material of a name, with the values that it has by itself; anything else as it is."""
    return MATERIALS[material]() if isinstance(material, str) and material in MATERIALS else material


@dataclass(eq=False)
class MaterialSink(ArrayDataclass):
    """A shape that takes particles of `MaterialPoints`, and grains and fluids of `Particles`, away where their centres come
    into it, as in `scene.sink("/drain", Box((0.2, 0.1, 0.2)), at=(0, -1, 0))`.

    path     prim path
    shape    as of a collider: Sphere, Box, Capsule, Cylinder, Cone, a closed Surface, or a Plane, which takes what is below it
    motion   own frame to world over time, rigid, lengths [m]
    """

    path: str
    shape: Any
    motion: Motion = field(default_factory=Motion.still)

    def __post_init__(self):
        self.shape, self.motion = turn_plane(self.shape, self.motion)


@dataclass(eq=False)
class MaterialPoints(PointObject):
    """A body of particles that breaks, pours and piles up, as in `scene.mpm("/jelly", Box((0.1, 0.1, 0.1)), at=(0, 1, 0),
    cell=0.025)`. It has a shape, which particles fill, or points. All bodies of a scene meet on one grid of one cell size,
    without bounds. Particles stay outside of the scene's colliders.

    path       prim path
    shape      closed: Sphere, Box, Capsule, Cylinder, Cone or a closed Surface; None: it has points
    material   `Jelly`, `Snow`, `Granular` or `Water` of `wsim.physics.mpm.objects`, or "jelly", "snow", "sand", "water"
    cell       edge of a cell of the grid [m]; a shape gets 8 particles a cell
    motion     own frame to world as the scene starts, rigid, lengths [m]
    points     places of the particles, world (n, 3) [m]
    volumes    of each of the points, (n,) or one number [m^3]
    velocity   at the start, world (3,) [m/s], or of each of the points (n, 3)
    spin       at the start, about the centre of mass, world (3,) [rad/s]
    pour       `Pour`: the shape is empty at the start, and pours with the velocity, which then points along its own axes and
               turns with it; a motion may carry it; a `PointCloud` is a shape of balls. None: it is full at the start
    further    more materials, of which `which` chooses
    which      of each of the points, (n,): 0 is `material`, k is the k-th of `further`; None: all are of `material`
    widths     diameters in results, of all or of each of the points [m]; None: of balls of the volumes
    ids        numbers of the points in results, (n,) [1]; None: 0, 1, 2 ...
    colors     linear RGB, 0 to 1 [1], of all, (3,), or of each of the points (n, 3); None: by the material
    drag       coefficient of the air's drag on its surface, and on what has come off [1]; the air moves with `Scene.wind`
    pins       `Pin`s of its particles
    integrator  "explicit", "implicit", or "auto": implicit ones where they cost less; one for all bodies of a scene
    """

    noun, plural = "material points", True
    refused = dict.fromkeys(("tie", "tie to a body"), "material points share no points with other bodies: pins hold them, and "  # noqa: RUF012
                            "what they touch pushes them")

    path: str
    shape: Any = None
    material: Any = "jelly"
    cell: float = 0.05
    motion: Motion = field(default_factory=Motion.still)
    points: np.ndarray | None = None
    volumes: np.ndarray | None = None
    velocity: np.ndarray | None = None
    spin: np.ndarray | None = None
    pour: Pour | None = None
    further: tuple = ()
    which: np.ndarray | None = None
    widths: np.ndarray | None = None
    ids: np.ndarray | None = None
    colors: np.ndarray | None = None
    drag: float = 0.0
    pins: list[Pin] = field(default_factory=list)
    integrator: str = "auto"

    def __post_init__(self):
        if self.pour is not None:
            demand_kind(self.path, "pour", self.pour, Pour, "Pour(start=0.0, end=1.0)")
        self.material, self.further = named_material(self.material), tuple(map(named_material, self.further))
        if self.points is not None:
            self.points = np.array(self.points, np.float64).reshape(-1, 3)
        if self.volumes is not None:
            self.volumes = np.atleast_1d(np.array(self.volumes, np.float64))
        for name, kind in (("which", np.int64), ("ids", np.int64), ("widths", np.float64), ("colors", np.float64)):
            if getattr(self, name) is not None:
                setattr(self, name, np.array(getattr(self, name), kind))
        self.velocity, self.spin = (np.zeros(3) if v is None else np.array(v, np.float64) for v in (self.velocity, self.spin))

    def placed_points(self) -> np.ndarray:
        """Places of its particles in the world as the scene starts [m], (n, 3), in the order of results; of what pours none."""
        if self.points is None:
            return np.zeros((0, 3)) if self.pour else method_file("MaterialPoints", "seeding").fill_shape(self)
        return self.points

    @property
    def point_count(self) -> int:
        return len(self.placed_points())

    def pouring_shape(self) -> PouringShape:
        """Where and when what it pours comes."""
        edge = self.cell / ACROSS
        return PouringShape(self, edge, self.material.density * edge**3)

    def points_within(self, shape: Any, at: Any = (0.0, 0.0, 0.0)) -> np.ndarray:
        """Numbers of its particles that start within a shape at a place [m], for a pin or a load, as in
        `scene.pin("/top", bar, bar.points_within(Box((0.1, 0.02, 0.1)), at=(0, 1, 0)))`."""
        return np.flatnonzero(shape_row(shape).distance(shape, self.placed_points() - np.asarray(at, np.float64)) < 0.0)

    @property
    def materials(self) -> tuple:
        """Its materials; `which` counts in this order."""
        return (self.material, *self.further)
