"""Actuators of a scene: plain data in SI units, NumPy only. Their law: kernels/rigid/joint/actuation/actuators.py."""

from dataclasses import dataclass
from math import inf
from typing import Any

from wsim.scene import Problem, Scene, SceneError, Varying
from wsim.scene.bodies import ArrayDataclass
from wsim.scene.curve import Curve


@dataclass(eq=False)
class Actuator(ArrayDataclass):
    """A motor or a servo on a coordinate g of a joint, as in
    `scene.actuator("position", "/servo", "/elbow", stiffness=100.0, damping=5.0, control=0.5)`.

        f = gain control + bias[0] + bias[1] gear g + bias[2] gear g',    force on g = gear f

    path            prim path
    joint           prim path of the joint
    axis            name of the coordinate, such as rotX (see `wsim.Joint`); "": the only free one
    gear            turns of the motor for one of the joint [1]; of another size the force on g has another unit than f
    gain            [N], [N m] for each unit of the control
    bias            (3,): [N], [N m]; for each unit of gear g; for each unit of its rate
    control         at the start; of motors a force or torque, of servos a goal [m], [rad], [m/s], [rad/s]
    control_range   (lowest, highest) control, in the unit of the control; one beyond is taken as the nearest of them
    force_range     (lowest, highest) f [N], [N m]
    """

    path: str
    joint: str
    axis: str = ""
    gear: float = 1.0
    gain: float = 1.0
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    control: float = 0.0
    control_range: tuple[float, float] = (-inf, inf)
    force_range: tuple[float, float] = (-inf, inf)

    def __post_init__(self):
        for name, size in (("bias", 3), ("control_range", 2), ("force_range", 2)):
            values = tuple(float(v) for v in getattr(self, name))
            if len(values) != size:
                raise ValueError(f"{name} has {len(values)} numbers; allowed are {size}")
            setattr(self, name, values)
        for name in ("gear", "gain", "control"):
            setattr(self, name, float(getattr(self, name)))


def motor(path: str, joint: str, **more) -> Actuator:
    """Force or torque as the control says [N], [N m]."""
    return Actuator(path, joint, **more)


def position_servo(path: str, joint: str, stiffness: float, damping: float = 0.0, **more) -> Actuator:
    """Goes to the control [m], [rad]: f = stiffness (control - gear g) - damping gear g'."""
    return Actuator(path, joint, gain=stiffness, bias=(0.0, -stiffness, -damping), **more)


def velocity_servo(path: str, joint: str, damping: float, **more) -> Actuator:
    """Moves as fast as the control says [m/s], [rad/s]: f = damping (control - gear g')."""
    return Actuator(path, joint, gain=damping, bias=(0.0, 0.0, -damping), **more)


# by name, for scenes
KINDS: dict[str, Any] = {"motor": motor, "position": position_servo, "velocity": velocity_servo, "general": Actuator}


def add_actuator(scene: Scene, kind: str, path: str, joint: Any, control: Any, **more) -> Actuator:
    """Adds an actuator of KINDS to a scene. Raises SceneError for another kind."""
    if kind not in KINDS:
        raise SceneError(Problem(path, f"kind is {kind!r}; allowed is one of {', '.join(KINDS)}"))
    follows = isinstance(control, Curve)
    start = float(control.at(0.0)) if follows else control
    found = scene.add(KINDS[kind](path, getattr(joint, "path", joint), control=start, **more))
    if follows:
        scene.varying.append(Varying(path, "control", control))
    return found
