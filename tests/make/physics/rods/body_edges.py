"""What tests/physics/rods/test_body_edges.py shares with other tests: EDGE, blow, landing."""

import numpy as np

from tests.make.physics.rods.bodies import THICK, G, at, line
from wsim.physics.rigid.objects import Body
from wsim.physics.rods.objects import Rods
from wsim.scene import Box, Collider, Motion, Scene
from wsim.scene.solids import Capsule

EDGE = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, np.sqrt(2.0)]]) / np.sqrt(2.0)


def turned(x, R: np.ndarray) -> Motion:
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = R, x
    return Motion.still(frame)


def ropes(scene: Scene, zs: tuple, n: int = 6, **more) -> Rods:
    """Light ropes of a metre and n points at heights 0, held at their ends."""
    rods = scene.add(Rods("/ropes", np.concatenate([line(n, 0.5, 0.0, z) for z in zs]), [n] * len(zs), 0.01,
                          stretch=2e4, bend=1e-3, twist=1e-3, density=400.0, **more))
    rods.pin("/ends", np.array([k for j in range(len(zs)) for k in (j * n, j * n + n - 1)]))
    return rods


def landing(R: np.ndarray, on: bool = False, shape=None, zs: tuple = (0.03, 0.0, -0.03)) -> Scene:
    """A box of 10 cm and 2 kg that falls on three ropes between points 20 cm apart."""
    scene = Scene(gravity=(0.0, -G, 0.0), fps=60.0, substeps=4)
    ropes(scene, zs, self_collision=on)
    c = Collider("/box/shape", shape or Box((0.05,) * 3), static_friction=0.5, dynamic_friction=0.5)
    scene.add(Body("/box", [c], turned((0.03, 0.12, 0.0), R), mass=2.0, drag=2.0, spin_drag=2.0))
    return scene


def blow(speed: float, on: bool = False, friction: float = 0.5, mass: float = 0.1) -> Scene:
    """A thin bar that is thrown at a rope which nothing holds, between two points 10 cm apart, across it and off its own
    middle; a substep a frame."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=240.0, substeps=1)
    scene.add(Rods("/rope", line(9, 0.4), [9], THICK, young=1e7, self_collision=on, static_friction=friction,
                   dynamic_friction=friction))
    c = Collider("/bar/shape", Capsule(0.01, 0.08), static_friction=friction, dynamic_friction=friction)
    scene.add(Body("/bar", [c], at((0.045, 0.03, 0.005)), mass=mass, velocity=np.array([0.5, -speed, 0.1])))
    return scene
