"""What tests/physics/motion/test_loads.py shares with other tests: GROWS, RATE, STAYS, T, pushed."""

import numpy as np

from wsim import Scene
from wsim.scene.curve import Curve

T, RATE = 0.4, 5.0                  # [s], [m/s^3]
STAYS, GROWS = [0.0, 0.5, -1.0], np.array([1.0, 0.0, 0.0])


def pushed(solver="explicit", integrator="leapfrog") -> Scene:
    """Two masses of 2 kg, free but for a slack spring, pushed by a force that grows; and a chain of three on a pin with two
    forces that stay, one of them on the pin too."""
    scene = Scene(gravity=(0.0, -9.81, 0.0), fps=10, frames=4, substeps=8, iterations=4, solver=solver, integrator=integrator)
    pair = scene.net("/pair", [[0, 0, 0], [1, 0, 0]], [[0, 1]], [10.0], [2.0, 2.0])
    chain = scene.net("/chain", [[5, 0, 0], [5.1, 0, 0], [5.2, 0, 0]], [[0, 1], [1, 2]], [400.0], [0.1, 0.1, 0.2])
    scene.pin("/pin", chain, [0])
    scene.force("/grows", pair, [0, 1], Curve([0.0, T], [np.zeros(3), 4.0 * RATE * T * GROWS]))
    scene.force("/stays", chain, [0, 2], STAYS, weights=[0.5, 1.0])
    scene.force("/other", chain, [1, 2], [0.3, 0.0, 0.0])
    return scene
