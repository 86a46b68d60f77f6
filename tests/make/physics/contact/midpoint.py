"""What tests/physics/contact/test_midpoint.py shares with other tests: G, draped, fallen, mass."""

from dataclasses import replace

import numpy as np

from tests.physics.contact.selfcontact.rig import layers
from wsim.scene import Plane, Scene, shapes
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric

G = 9.81
MIDPOINT = dict(solver="implicit", integrator="implicit_midpoint", substeps=10, iterations=6)
CLOTH = Fabric(stretch=500.0, shear=100.0, bend=1e-5, thickness=2e-3, density=150.0)
UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])       # a plane's z is +y


def draped(shape, side: int = 16, friction: float = 0.4, **more) -> Scene:
    """A sheet of 0.4 m that falls from 2 cm above a body."""
    scene = Scene(gravity=(0.0, -G, 0.0), fps=60.0, **MIDPOINT | more)
    points, counts, indices = shapes.sheet(0.4, 0.4, side - 1, side - 1, horizontal=True)
    points = np.array(points, np.float64)
    scene.cloth("/cloth", points - points.mean(axis=0), counts, indices,
                material=replace(CLOTH, static_friction=friction, dynamic_friction=friction))
    scene.collider("/body", shape, at=(0.0, -0.12, 0.0), static_friction=friction, dynamic_friction=friction)
    return scene


def fallen(count: int = 3, side: int = 8, **more) -> Scene:
    """Layers 4 mm apart that fall on a floor by 1 cm, turned against each other."""
    scene = layers(count, side, 4e-3, size=0.15, **MIDPOINT | more)
    scene.gravity = (0.0, -G, 0.0)
    for k, cloth in enumerate(scene.cloths):
        c, s = np.cos(0.3 * k), np.sin(0.3 * k)
        cloth.points[:] = cloth.points @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]).T + (0.0, 0.01, 0.0)
    scene.collider("/floor", Plane("Y"), static_friction=0.5, dynamic_friction=0.5)
    return scene


def mass(x, v=(0.0, 0.0, 0.0), shape=None, motion=None, friction: float = 0.0, **more) -> Scene:
    scene = Scene(gravity=(0.0, -G, 0.0), fps=60.0, **MIDPOINT | more)
    scene.net("/mass", [x, np.add(x, 50.0)], [[0, 1]], [1e-9], [1.0, 1.0], velocities=[v, v], static_friction=friction,
              dynamic_friction=friction)
    scene.collider("/body", shape or Plane(), motion=motion or Motion.still(UP), thickness=0.0, static_friction=friction,
                   dynamic_friction=friction)
    return scene
