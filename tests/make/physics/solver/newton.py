"""What tests/physics/solver/test_newton.py shares with other tests: DOUBLE, INTEGRATORS, garment, make."""

import numpy as np

from wsim.scene import Scene, shapes
from wsim.scene.fabric import Fabric

DOUBLE = {"device": "cpu", "precision": "float64"}
INTEGRATORS = ("backward_euler", "bdf2", "implicit_midpoint", "sdirk3")


def make(**more) -> Scene:
    return Scene(**{"solver": "implicit", "integrator": "backward_euler", "fps": 60.0, "substeps": 2, "iterations": 3} | more)


def garment(size: float = 1.0, damping: float = 0.0, **more) -> Scene:
    """A folded cloth with every element: springs with shear, or membrane, and hinges at rest."""
    scene = make(**more)
    points, counts, indices = shapes.sheet(size, size, 3, 3)
    points[:, 2] += 0.3 * np.abs(points[:, 0])
    scene.cloth("/cloth", points, counts, indices, flat=False, model="membrane",
                material=Fabric(stretch=500.0, shear=200.0, bend=1e-2, damping=damping, poisson=0.2))
    springs, counts, indices = shapes.sheet(size, size, 2, 2, cut="quads", at=(3.0, 0.0, 0.0))
    scene.cloth("/springs", springs, counts, indices, model="springs",
                material=Fabric(stretch=500.0, shear=200.0, bend=1e-2, damping=damping))
    return scene
