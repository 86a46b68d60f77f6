"""What tests/physics/contact/selfcontact/test_rest.py shares with other tests: folded."""

import numpy as np

from wsim.scene import Plane, Scene, shapes
from wsim.scene.fabric import Fabric

CLOTH = Fabric(stretch=60.0, shear=20.0, bend=1e-6, thickness=4e-3, density=100.0)


def folded(**more) -> Scene:
    """A strip that is laid in three, over arcs of a radius of 8 mm, a millimetre above a floor; air that slows it down."""
    length, width, r = 0.21, 0.05, 8e-3
    points, counts, indices = shapes.sheet(length, width, 21, 4, horizontal=True)
    points = np.array(points, np.float64)
    points -= points.min(axis=0)
    arc = np.pi * r
    flat = (length - 2.0 * arc) / 3.0
    u = points[:, 0]
    a, b = (u - flat) / r, (u - 2.0 * flat - arc) / r
    parts = [u < flat, u < flat + arc, u < 2.0 * flat + arc, u < 2.0 * flat + 2.0 * arc]
    points[:, 0] = np.select(parts, [u, flat + r * np.sin(a), 2.0 * flat + arc - u, -r * np.sin(b)], u - 2.0 * (flat + arc))
    points[:, 1] = np.select(parts, [0.0, r - r * np.cos(a), 2.0 * r, 3.0 * r - r * np.cos(b)], 4.0 * r)
    points[:, 1] += 0.5 * CLOTH.thickness + 1e-3
    scene = Scene(gravity=(0.0, -9.81, 0.0), fps=60.0, air_drag=10.0, **more)
    scene.cloth("/cloth", points, counts, indices, material=CLOTH, self_collision=True)
    scene.collider("/floor", Plane("Y"), static_friction=0.5, dynamic_friction=0.5)
    return scene
