"""Liquids of a scene: plain data in SI units, NumPy only.

A domain is a box along the world's axes, of cubes, as that of smoke; colliders of the scene are obstacles in it. Particles
carry the liquid; where there are none is air, which has no weight and a pressure of 0.
"""

from dataclasses import dataclass, field

import numpy as np

from wsim.physics.contact.collider.point_cloud import PointCloud
from wsim.physics.fluid.objects import Cubes
from wsim.physics.rigid.objects import vector3_or_none
from wsim.scene.bodies import ArrayDataclass
from wsim.scene.curve import Curve, Motion
from wsim.scene.solids import Shape, turn_plane

KINDS = ("open", "closed", "periodic")                     # of sides
TRANSFERS = ("apic", "flip", "pic")
ROLES = ("start", "source", "sink")
ACROSS = 2                                                 # particles of a full cell along each axis
WAVE = 0.5               # [rad] of the shortest wave of the surface in a step: pressure is of the surface as the step began, so
                         # that at 1.3 noise grows 4 times a step, at 0.6 slowly, and at 0.33 it dies out
GIVEN = 0.5              # cells that what a source gives may cross in a step


@dataclass(eq=False)
class Liquid(Cubes):
    """A box in which liquid moves, on a grid of cubes, as in `scene.liquid("/tank", (0, 0, 0), (1, 1, 1), cell=0.1)`. Where
    an axis has one cell the liquid is flat, and costs no third axis.

    path        prim path
    low         corner of the box, world (3,) [m]
    high        corner across from it (3,) [m], rounded to whole cells
    cell        edge of a cell [m]
    sides       what is at -x, +x, -y, +y, -z, +z: "closed" (a wall along which liquid slides), "open" (liquid leaves),
                "periodic" (both sides of an axis)
    density     of the liquid [kg/m^3]; only pressures [Pa] depend on it
    transfer    between particles and grid: "apic" (keeps angular momentum), "flip" or "pic" (damps)
    flip        part of flip in it [1], the rest is pic; 1 keeps noise too
    volume      particles are spread to the density at rest in each step, so that the liquid keeps its volume
    tolerance   of the pressure solve, residual over right-hand side [1]
    cfl         cells that liquid may cross in a step [1]: as many steps a frame as that and waves of its surface take, up to
                `most_steps`
    steps       steps a frame; 0: by `cfl`
    most_steps  steps a frame at most, by `cfl`
    """

    path: str
    low: np.ndarray
    high: np.ndarray
    cell: float
    sides: tuple[str, ...] = ("closed",) * 6
    density: float = 1000.0
    transfer: str = "apic"
    flip: float = 0.97
    volume: bool = True
    tolerance: float = 1e-4
    cfl: float = 2.0
    steps: int = 0
    most_steps: int = 64

    def __post_init__(self):
        self.low, self.high = (np.array(v, np.float64).reshape(3) for v in (self.low, self.high))
        self.sides = tuple(self.sides)

@dataclass(eq=False)
class LiquidSource(ArrayDataclass):
    """A shape that liquid fills at the start, flows from, or vanishes in, as in `scene.liquid_source("/water",
    scene.liquid("/tank", (0, 0, 0), (1, 1, 1), cell=0.1), Box((0.5, 0.2, 0.5)), at=(0.5, 0.2, 0.5))`.

    path        prim path
    shape       as of a collider: Sphere, Box, Capsule, Cylinder, Cone, Plane, a closed Surface, or a PointCloud
    motion      own frame to world over time, rigid, lengths [m]
    liquid      prim path of the domain; "": all
    role        "start" (filled when the scene starts), "source" (kept full while `strength` is above 0) or "sink" (emptied
                while it is)
    velocity    of the liquid that it gives, world (3,) [m/s]; None: 0
    strength    over time, a Curve of numbers or one number [1]; of "start" it does not count
    """

    path: str
    shape: Shape | PointCloud
    motion: Motion = field(default_factory=Motion.still)
    liquid: str = ""
    role: str = "start"
    velocity: np.ndarray | None = None
    strength: Curve = 1.0  # type: ignore[assignment]  # a number becomes a curve below

    def __post_init__(self):
        self.shape, self.motion = turn_plane(self.shape, self.motion)
        self.velocity = vector3_or_none(self.velocity)
        if not isinstance(self.strength, Curve):
            self.strength = Curve(np.zeros(1), np.array([self.strength], np.float64))
