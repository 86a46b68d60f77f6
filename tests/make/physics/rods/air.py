"""What tests/physics/rods/test_air.py shares with other tests: hair."""

import numpy as np

from tests.physics.rods.rig import scene

DENSITY, DIAMETER, LENGTH, AIR, WEIGHT = 1300.0, 1e-4, 0.1, 1.2, 9.81
ACROSS, SKIN = 1.1, 0.02


def hair(axis: int, n: int = 9, **more):
    """A free hair along an axis, in air."""
    x = np.zeros((n, 3))
    x[:, axis] = np.linspace(0.0, LENGTH, n)
    given = {"diameters": DIAMETER, "young": 4e9, "density": DENSITY, "drag": ACROSS, "skin_drag": SKIN} | more
    return scene(x, **given)
