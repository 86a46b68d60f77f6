"""What tests/physics/fluid/obstacles/test_walls.py shares with other tests: duct."""

import numpy as np

from tests.physics.fluid.flows import box
from wsim.scene import Motion, shapes

N, CELL = (24, 8, 8), 1.0 / 24.0


def duct(sides, frames: int = 4, speed: float = 0.0, **more):
    """A duct of 1 m, with a sheet across it, beyond its walls, held but for a corner, that goes along it at a speed [m/s]."""
    smoke = np.zeros(N)
    smoke[:10] = 1.0
    seconds = frames / 24.0
    scene = box(N, size=1.0, seconds=seconds, frames=frames, sides=sides, steps=2, smoke=smoke, **more)
    points, counts, indices = shapes.sheet(0.6, 0.6, 8, 8)
    points = points[:, [2, 1, 0]] + [0.5, 1.0 / 6.0, 1.0 / 6.0]
    cloth = scene.cloth("/sheet", points, counts, indices)
    M = np.tile(np.eye(4), (2, 1, 1))
    M[1, 0, 3] = speed * seconds
    scene.pin("/hand", cloth, range(1, len(points)), motion=Motion(np.array([0.0, seconds]), M))
    return scene
