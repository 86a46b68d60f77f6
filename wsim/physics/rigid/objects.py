"""Rigid bodies of a scene: plain data in SI units, NumPy only.

A body has a frame of its own, `motion` to the world at the start, and colliders that are fixed in it: their `motion` leads to
the frame of the body, not to the world. Without colliders it meets nothing. Its mass, centre and inertia are those of its
colliders of `density` unless they are given (`wsim.physics.rigid.mass`).
"""

from dataclasses import dataclass, field

import numpy as np

from wsim.scene import Collider
from wsim.scene.bodies import Compared
from wsim.scene.curve import Motion

DENSITY = 1000.0                             # [kg/m^3] where nothing is given, as USD has it


def vector(value) -> np.ndarray | None:
    return None if value is None else np.array(value, np.float64).reshape(3)


@dataclass(eq=False)
class Body(Compared):
    """A rigid body. Quaternions are (x, y, z, w)."""

    path: str
    colliders: list[Collider] = field(default_factory=list)
    motion: Motion = field(default_factory=Motion.still)      # its frame to the world at the start: one key, rigid [m]
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(3))      # of its centre of mass, world [m/s]
    spin: np.ndarray = field(default_factory=lambda: np.zeros(3))          # angular velocity, world [rad/s]
    density: float = DENSITY                 # [kg/m^3]
    mass: float | None = None                # [kg]; None: of the colliders
    center: np.ndarray | None = None         # centre of mass in the body's frame [m]; None: of the colliders
    inertia: np.ndarray | None = None        # principal moments about the centre (3,) [kg m^2]; None: of the colliders
    axes: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))   # principal axes to the body's frame
    force: np.ndarray = field(default_factory=lambda: np.zeros(3))         # on the centre of mass, world [N]
    torque: np.ndarray = field(default_factory=lambda: np.zeros(3))        # world [N m]
    drag: float = 0.0                        # decay rate of the velocity [1/s]
    spin_drag: float = 0.0                   # of the angular momentum [1/s]
    stretch: np.ndarray | None = field(default=None, compare=False)        # (3, 3) of its prim's transform, before `motion`:
                                             # it has gone into the colliders, and results keep it

    def __post_init__(self):
        for name in ("velocity", "spin", "center", "inertia", "force", "torque"):
            setattr(self, name, vector(getattr(self, name)))
        self.axes = np.array(self.axes, np.float64).reshape(4)
