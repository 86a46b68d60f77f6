"""What tests/simulation/test_simulation.py shares with other tests: chain, drape."""

import numpy as np

from wsim.scene import Scene, Sphere, shapes
from wsim.scene.fabric import Fabric


def chain(n: int, stiffness: float = 200.0, mass: float = 0.01, **more) -> Scene:
    """n springs of 0.1 m hanging from a pinned point."""
    points = np.zeros((n + 1, 3))
    points[:, 1] = -0.1 * np.arange(n + 1)
    scene = Scene(solver="xpbd", fps=60.0, **more)
    net = scene.net("/chain", points, [[i, i + 1] for i in range(n)], [stiffness], [mass])
    scene.pin("/pin", net, [0])
    return scene


def drape(**more) -> Scene:
    """A small cloth over a ball on a floor."""
    scene = Scene(solver="xpbd", fps=60.0, substeps=8, iterations=4, **more)
    scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 12, 12, horizontal=True), material=Fabric(stretch=800.0, bend=1e-4))
    scene.collider("/ball", Sphere(0.25), at=(0.02, -0.27, 0.01))
    return scene
