"""What tests/physics/motion/test_carried.py shares with other tests: FRAMES, carried."""

import numpy as np

from wsim.scene import Scene
from wsim.scene.curve import Motion

TIMES, PLACES = np.arange(4.0), np.array([[0.0, 0, 0], [0.3, 0.2, 0], [-0.1, 0.4, 0.2], [0.2, 0.1, 0.1]])
FRAMES, FPS, OMEGA, LENGTH = 26, 10.0, 7.0, 0.5


def carried(substeps: int, integrator: str, solver: str, damping: float = 0.0, kind: str = "catmull_rom") -> Scene:
    """A point on a spring whose other end is carried."""
    scene = Scene(fps=FPS, frames=FRAMES, substeps=substeps, integrator=integrator, solver=solver)
    net = scene.net("/net", [[0.0, 0, 0], [0.0, -0.6, 0]], [[0, 1]], [OMEGA**2], [1.0, 1.0], lengths=[LENGTH], damping=damping)
    scene.pin("/pin", net, [0], motion=Motion.through(TIMES, PLACES, kind=kind))
    return scene
