"""What tests/physics/fluid/test_bodies.py shares with other tests: room."""

import numpy as np

from wsim.physics.fluid.objects import Fluid
from wsim.physics.rigid.objects import Body
from wsim.scene import Collider, Motion, Scene
from wsim.scene.solids import Sphere

CELL = 1.0 / 16.0
RADIUS = 4.0 * CELL


def room(**more) -> Scene:
    """Flat air of 64 x 64 cells, open all around, with a cylinder of its own density in its middle."""
    scene = Scene(fps=24.0, frames=24, gravity=(0.0, 0.0, 0.0))
    fluid = {name: more.pop(name) for name in ("advection", "velocity", "sides") if name in more}
    scene.add(Fluid("/air", np.zeros(3), np.array([64, 64, 1]) * CELL, CELL, **fluid))
    mass = 1.2 * np.pi * RADIUS ** 2 * CELL
    shape = Collider("/body/shape", Sphere(RADIUS))
    scene.add(Body("/body", [shape], Motion.at_place((2.0, 2.0, 0.5 * CELL)), mass=mass, **more))
    return scene
