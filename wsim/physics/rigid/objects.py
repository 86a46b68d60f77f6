"""Rigid bodies of a scene: plain data in SI units, NumPy only.

A body has a frame of its own, `motion` to the world at the start, and colliders that are fixed in it: their `motion` leads to
the frame of the body, not to the world. Without colliders it meets nothing. Its mass, centre and inertia are those of its
colliders of `density` unless they are given (`wsim.physics.rigid.mass`). Two settings are of the scene: below its `sleep_speed`
[m/s] bodies that touch or have joints fall asleep together after half a second (0: never), and sweeps over contacts end where
a residual is under its `contact_tolerance` [m/s] (0: after `iterations` of them).
"""

from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any

import numpy as np

from wsim.scene import Collider
from wsim.scene.bodies import ArrayDataclass
from wsim.scene.curve import Motion

DENSITY = 1000.0                             # [kg/m^3] where nothing is given, as USD has it
OTHERS = {"Joint": "wsim.physics.rigid.joints.joint", "Actuator": "wsim.physics.rigid.joints.actuators.actuator",
          "Group": "wsim.physics.rigid.joints.filters.groups",
          "FilteredPairs": "wsim.physics.rigid.joints.filters.groups"}


def vector3_or_none(value) -> np.ndarray | None:
    return None if value is None else np.array(value, np.float64).reshape(3)

SURFACE = ("static_friction", "dynamic_friction", "restitution")         # of a body: of all its colliders

@dataclass(eq=False)
class Body(ArrayDataclass):
    """A rigid body, which moves by forces, as in `scene.body("/die", Box((0.01, 0.01, 0.01)), at=(0, 0.1, 0), density=1200)`.

    path        prim path
    colliders   its shapes; their `motion` leads to the body's frame, with one key
    motion      the body's frame to world at the start, one key, rigid, lengths [m]
    velocity    of its centre of mass at the start, world (3,) [m/s]
    spin        angular velocity at the start, world (3,) [rad/s]
    density     of its colliders [kg/m^3], where no mass is given
    mass        [kg]; None: that of the colliders
    center      centre of mass in the body's frame (3,) [m]; None: that of the colliders
    inertia     principal moments about the centre (3,) [kg m^2]; None: those of the colliders
    axes        quaternion (x, y, z, w) [1] from the principal axes of `inertia` to the body's frame
    force       on the centre of mass, world (3,) [N]
    torque      world (3,) [N m]
    drag        decay rate of the velocity [1/s]
    spin_drag   decay rate of the angular momentum [1/s]
    asleep      at the start, where it hangs or rests until something wakes it
    stretch     of its prim's transform, before `motion`, (3, 3) [1]: it has gone into the colliders, and results keep it
    instancer   prim path of the PointInstancer that it is an instance of, which results write; "": it is a prim
    instance    its number there
    """

    path: str
    colliders: list[Collider] = field(default_factory=list)
    motion: Motion = field(default_factory=Motion.still)
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    spin: np.ndarray = field(default_factory=lambda: np.zeros(3))
    density: float = DENSITY
    mass: float | None = None
    center: np.ndarray | None = None
    inertia: np.ndarray | None = None
    axes: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))
    force: np.ndarray = field(default_factory=lambda: np.zeros(3))
    torque: np.ndarray = field(default_factory=lambda: np.zeros(3))
    drag: float = 0.0
    spin_drag: float = 0.0
    asleep: bool = False
    stretch: np.ndarray | None = field(default=None, compare=False)
    instancer: str = field(default="", compare=False)
    instance: int = field(default=0, compare=False)

    def taken(self, name: str) -> float | np.ndarray | None:
        """A value of the table (`wsim.scene.values.table`): friction and restitution are those of all its colliders, None where
        they differ."""
        if name not in SURFACE:
            return getattr(self, name)
        found = {getattr(c, name) for c in self.colliders}
        return found.pop() if len(found) == 1 else None

    def given(self, name: str, value: Any) -> "Body":
        """A copy with another value."""
        if name not in SURFACE:
            return replace(self, **{name: value})
        return replace(self, colliders=[replace(c, **{name: value}) for c in self.colliders])

    @property
    def written(self) -> str:
        """Path of the prim that results write."""
        return self.instancer or self.path

    def __post_init__(self):
        for name in ("velocity", "spin", "center", "inertia", "force", "torque"):
            setattr(self, name, vector3_or_none(getattr(self, name)))
        self.axes = np.array(self.axes, np.float64).reshape(4)


def __getattr__(name: str):
    """The other objects of the method, which are made of bodies: reached by name, as rows reach a method."""
    if name not in OTHERS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(OTHERS[name]), name)
