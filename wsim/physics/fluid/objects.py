"""Fluids of a scene: plain data in SI units, NumPy only.

A domain is a box along the world's axes, of cubes; colliders of the scene are obstacles in it. It holds air with smoke, a
number without unit that 1 makes dense, and a temperature above that of the air around [K].
"""

from dataclasses import dataclass, field, replace

import numpy as np

from wsim.physics.contact.collider.point_cloud import PointCloud
from wsim.physics.rigid.objects import vector3_or_none
from wsim.scene.bodies import ArrayDataclass
from wsim.scene.curve import Curve, Motion
from wsim.scene.solids import Shape, turn_plane

SIDES = ("-x", "+x", "-y", "+y", "-z", "+z")               # in the order of `Fluid.sides` and `Fluid.side_velocities`
KINDS = ("open", "closed", "periodic", "wind")
ADVECTION = ("reflection", "cubic", "maccormack", "bfecc", "linear")     # of velocity; reflection: cubic, twice a step
PRESSURE = ("auto", "direct", "multigrid")
SCALARS = ("cubic", "maccormack", "bfecc", "linear")                     # of smoke and temperature


class Cubes(ArrayDataclass):
    """A box along the world's axes, of cubes."""

    path: str
    low: np.ndarray
    high: np.ndarray
    cell: float
    sides: tuple[str, ...]

    @property
    def elements(self) -> int:
        """Cells."""
        x, y, z = self.shape
        return x * y * z

    @property
    def shape(self) -> tuple[int, int, int]:
        """Cells along x, y, z, at least one; (0, 0, 0) where the box or the cell is none."""
        size = (self.high - self.low) / self.cell if self.cell > 0.0 else np.zeros(3)
        if not (np.isfinite(size).all() and (size > 0.0).all()):
            return 0, 0, 0
        x, y, z = (max(1, round(float(v))) for v in size)
        return x, y, z

    @property
    def axes(self) -> tuple[int, ...]:
        """Axes with more than one cell: two of a flat fluid."""
        return tuple(a for a, n in enumerate(self.shape) if n > 1)

    @property
    def cells(self) -> int:
        x, y, z = self.shape
        return x * y * z

    def centers(self) -> np.ndarray:
        """Centres of the cells, world (nx, ny, nz, 3) [m]."""
        index = np.stack(np.meshgrid(*(np.arange(n) for n in self.shape), indexing="ij"), -1)
        return self.low + self.cell * (index + 0.5)


@dataclass(eq=False)
class Fluid(Cubes):
    """A box of air on a grid of cubes, as in `scene.smoke("/air", (0, 0, 0), (1, 2, 1), cell=0.1)`. Where an axis has one
    cell the fluid is flat, and costs no third axis.

    path             prim path
    low              corner of the box, world (3,) [m]
    high             corner across from it (3,) [m], rounded to whole cells
    cell             edge of a cell [m]
    sides            what is at -x, +x, -y, +y, -z, +z: "open" (pressure 0: air comes and goes), "closed" (a wall), "periodic"
                     (both sides of an axis), "wind" (air passes with the scene's wind)
    side_velocities  of what is at a closed side, (6, 3) [m/s]: along it that of a wall that is not slippery, across it that of
                     air which is let through
    slip             walls and obstacles let viscous air slide along them; False: it sticks to them
    layers           where it sticks: friction of closed sides to order 2 and, in a flat fluid, velocities between rows by
                     cubics, which resolve the layers along walls (a lid at Re 1000 on 128 x 128 cells: 0.8 % off, without
                     1.3 %). Not with gradients
    density          of the air [kg/m^3]; only pressures [Pa] depend on it
    viscosity        kinematic [m^2/s]; 0: none
    lift             buoyancy of heat, acceleration against gravity by K over the air around, in units of g [1/K]
    weight           acceleration of smoke of 1 along gravity, in units of g [1]
    vorticity        confinement [1]: acceleration by this times cell size times curl
    acceleration     by any other force, world [m/s^2]: (3,) of all air or (nx, ny, nz, 3) at the cells' centres; None: 0. Set
                     while it runs, where there is one at the start. Not with margin
    smoke_decay      decay rate of the smoke [1/s]
    cooling          decay rate of the temperature [1/s]
    advection        of the velocity: "reflection", "cubic", "maccormack", "bfecc" or "linear"
    scalar_advection  of smoke and temperature: "cubic", "maccormack", "bfecc" or "linear"
    pressure         how it is solved: "direct" (boxes without obstacles), "multigrid", or "auto": directly up to 800 cells
                     along all axes together
    tolerance        of the pressure solve, residual over right-hand side [1]
    cfl              cells that air may cross in a step [1]: as many steps a frame as that takes, up to `most_steps`
    conserve         what air carries of smoke and temperature sums to what it was, to rounding: what limited cubics lose or
                     make is put back. Where no air passes a side: closed or periodic ones. Not with gradients
    steps            steps a frame; 0: by `cfl`
    margin           air around smoke, heat, sources and moving obstacles that is solved, in parts of the least edge of the box
                     that they fill [1]; farther away it is at rest. 0: all air is solved. 0.75: what rises is 0.1 to 0.5 % off.
                     Not with gradients
    most_steps       steps a frame at most, by `cfl`
    velocity         at the start, at the cells' centres (nx, ny, nz, 3) [m/s]; None: the wind, where a side lets it in, else 0
    smoke            at the start, (nx, ny, nz) [1]; None: 0
    temperature      at the start, (nx, ny, nz) [K above the air around]; None: 0
    """

    path: str
    low: np.ndarray
    high: np.ndarray
    cell: float
    sides: tuple[str, ...] = ("open",) * 6
    side_velocities: np.ndarray = field(default_factory=lambda: np.zeros((6, 3)))
    slip: bool = True
    layers: bool = False
    density: float = 1.2
    viscosity: float = 0.0
    lift: float = 1.0 / 293.0
    weight: float = 0.0
    vorticity: float = 0.0
    smoke_decay: float = 0.0
    cooling: float = 0.0
    advection: str = "reflection"
    scalar_advection: str = "cubic"
    pressure: str = "auto"
    tolerance: float = 1e-4
    cfl: float = 2.0
    steps: int = 0
    margin: float = 0.0
    conserve: bool = False
    most_steps: int = 32
    velocity: np.ndarray | None = None
    smoke: np.ndarray | None = None
    temperature: np.ndarray | None = None
    acceleration: np.ndarray | None = None

    def __post_init__(self):
        self.low, self.high = (np.array(v, np.float64).reshape(3) for v in (self.low, self.high))
        self.sides = tuple(self.sides)
        self.side_velocities = np.array(self.side_velocities, np.float64).reshape(6, 3)


@dataclass(eq=False)
class Source(ArrayDataclass):
    """A shape that puts smoke, heat, air or speed into the fluids that it reaches, as in
    `scene.smoke_source("/fire", scene.smoke("/air", (0, 0, 0), (1, 2, 1), cell=0.1), Sphere(0.2), temperature=400, smoke=5)`.

    path          prim path
    shape         as of a collider: Sphere, Box, Capsule, Cylinder, Cone, Plane, a closed Surface, or a PointCloud
    motion        own frame to world over time, rigid, lengths [m]
    fluid         prim path of the domain; "": all
    smoke         what is added inside [1/s]; of `hold` what is kept there [1]
    temperature   what is added inside [K/s]; of `hold` what is kept there [K above the air around]
    hold          smoke and temperature are raised to these values, not by these rates
    velocity      of the air inside, world (3,) [m/s]; None: it is left alone
    expansion     air that comes out of nothing, volume by volume and time [1/s]; below 0: a sink
    strength      factor over time, a Curve of numbers or one number [1]: of rates, of what is held, and of the expansion;
                  the velocity is held while it is above 0
    """

    path: str
    shape: Shape | PointCloud
    motion: Motion = field(default_factory=Motion.still)
    fluid: str = ""
    smoke: float = 0.0
    temperature: float = 0.0
    hold: bool = False
    velocity: np.ndarray | None = None
    expansion: float = 0.0
    strength: Curve = 1.0  # type: ignore[assignment]  # a number becomes a curve below

    def __post_init__(self):
        self.shape, self.motion = turn_plane(self.shape, self.motion)
        self.velocity = vector3_or_none(self.velocity)
        if not isinstance(self.strength, Curve):
            self.strength = Curve(np.zeros(1), np.array([self.strength], np.float64))

    @property
    def place(self) -> np.ndarray:
        """Place where its frame begins, world (3,) [m]."""
        return self.motion.values[0, :3, 3].copy()

    def taken(self, name: str):
        """A value of the table (`wsim.scene.values.table`): strength is the values of its keys, (keys,); velocity may be
        None."""
        return self.strength.values if name == "strength" else getattr(self, name)

    def given(self, name: str, value) -> "Source":
        """A copy with another value. place: all of its motion is shifted so that it begins there. strength: one number in the
        place of the mean of the keys, which keep their proportions."""
        if name == "place":
            values = self.motion.values.copy()
            values[:, :3, 3] += np.asarray(value, np.float64) - self.place
            return replace(self, motion=Motion(self.motion.times, values))
        if name == "strength":
            now = self.strength.values
            each = now * (float(value) / float(now.mean())) if len(now) > 1 else np.array([float(value)])
            return replace(self, strength=Curve(self.strength.times, each))
        return replace(self, **{name: value})


def meets_bodies(fluid: Fluid) -> bool:
    """Whether smoke meets bodies and cloth: not in a part that follows it, nor by a direct solve."""
    return fluid.margin == 0.0 and fluid.pressure != "direct"
