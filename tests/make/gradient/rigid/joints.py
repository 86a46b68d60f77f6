"""What tests/gradient/rigid/test_joints.py shares with other tests: LAST, SCENES, seeds."""

from functools import cache

import numpy as np

from wsim.physics.rigid.joints.joint import (
    Drive,
    Joint,
    fixed_joint,
    joint_between,
    prismatic_joint,
    revolute_joint,
    spherical_joint,
)
from wsim.physics.rigid.objects import Body
from wsim.scene import Scene
from wsim.scene.curve import Motion

LAST = 8
Y = (0.0, 1.0, 0.0)
DRIVE = Drive(stiffness=30.0, damping=2.0, target=0.4)


def pair(*joints, **more) -> Scene:
    """Two bodies beside each other, of which the first hangs at the origin; joints: functions of them."""
    scene = Scene(**{"gravity": (0.0, 0.0, -9.81), "up": "Z", "fps": 60.0, "substeps": 4} | more)
    a = Body("/a", mass=1.0, center=np.zeros(3), inertia=(0.1, 0.2, 0.25), motion=Motion.at_place((0.5, 0.0, 0.0)),
             velocity=(0.0, 0.0, 0.3), spin=(0.2, -0.6, 0.1))
    b = Body("/b", mass=2.0, center=(0.1, 0.0, 0.0), inertia=(0.2, 0.1, 0.3), motion=Motion.at_place((1.4, 0.0, 0.0)), drag=0.1,
             velocity=(0.0, 0.2, 0.0), spin=(0.1, 0.4, 0.5), spin_drag=0.2, force=(0.0, 0.3, 0.0), torque=(0.1, 0.0, 0.2))
    for body in (a, b):
        scene.add(body)
    for make in joints:
        scene.add(make(a, b))
    return scene


def second(kind, **more):
    return lambda a, b: kind("/second", a, b, at=(1.0, 0.0, 0.0), **more)


def hung(kind=spherical_joint, **more):
    return lambda a, b: kind("/first", None, a, **more)


def far(a, b) -> Joint:
    """A rod between points of both, off their centres."""
    return Joint("/second", "/a", "/b", at0=(0.2, 0.1, 0.0), at1=(-0.2, 0.0, 0.1), limits={"distance": (0.0, 0.51)})


def turning(kind: str) -> Drive:
    return Drive(stiffness=12.0, damping=0.8, target=-0.3, speed=0.5, acceleration=kind == "acceleration")


SCENES = {
    "spherical": lambda: pair(hung(), second(spherical_joint)),
    "revolute": lambda: pair(hung(revolute_joint, axis=Y), second(revolute_joint, axis=Y)),
    "fixed": lambda: pair(second(fixed_joint)),
    "prismatic": lambda: pair(hung(), second(prismatic_joint)),
    "distance": lambda: pair(hung(), far, iterations=12),
    "loop": lambda: pair(hung(), second(spherical_joint), lambda a, b: spherical_joint("/third", None, b, at=(1.3, 0.5, 0.2)),
                         iterations=8),
    "limits": lambda: pair(hung(revolute_joint, axis=Y, low=-0.01, high=0.02), second(spherical_joint), iterations=16),
    "cone": lambda: pair(hung(cone=(0.02, 0.03)), second(spherical_joint), iterations=16),
    "driven": lambda: pair(hung(revolute_joint, axis=Y, drives={"rotX": DRIVE}),
                           second(revolute_joint, axis=Y, drives={"rotX": turning("acceleration")})),
    "driven alone": lambda: pair(hung(joint_between, limits={"transX": (0.0, 0.0), "transY": (0.0, 0.0), "transZ": (0.0, 0.0)},
                                       drives={"rotX": turning("acceleration"), "rotY": DRIVE})),
    "driven D6": lambda: pair(hung(), second(joint_between, limits={"transX": (0.0, 0.0), "rotX": (0.0, 0.0)}, drives={
        "transY": DRIVE, "transZ": turning("force"), "rotY": turning("force"), "rotZ": DRIVE})),
    "most": lambda: pair(hung(revolute_joint, axis=Y, drives={"rotX": Drive(900.0, 2.0, 0.9, most=3.0)}),
                         second(spherical_joint), iterations=12),
}


@cache
def seeds() -> tuple[dict, dict]:
    rng = np.random.default_rng(7)
    return ({LAST: {p: rng.normal(size=(4, 4)) for p in ("/a", "/b")}},
            {f: {p: 0.1 * rng.normal(size=(2, 3)) for p in ("/a", "/b")} for f in (LAST - 3, LAST)})
