"""What tests/physics/solver/test_coarse_space.py shares with other tests: bar."""

import numpy as np

from wsim.scene import Scene, shapes
from wsim.scene.solid import Bulk


def bar(cells=(6, 2, 2), young=1e6, size=(1.0, 0.4, 0.4)) -> Scene:
    scene = Scene(gravity=(0, -9.81, 0), fps=60.0, solver="implicit", substeps=1, iterations=2, integrator="backward_euler")
    points, tets = shapes.block(size, cells)
    body = scene.soft("/bar", points, tets, material=Bulk(young=young, poisson=0.3, density=1e3, model="corotational"))
    scene.pin("/wall", body, points=np.flatnonzero(points[:, 0] < points[:, 0].min() + 1e-6))
    return scene
