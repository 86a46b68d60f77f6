"""What tests/sweep/test_worlds.py shares with other tests: HOW, cloth."""

from tests.conftest import grid
from wsim.scene import Scene, Sphere
from wsim.scene.fabric import Fabric

HOW = {"xpbd": {"integrator": "backward_euler", "substeps": 4, "iterations": 3},
       "implicit": {"integrator": "bdf2", "substeps": 4},
       "explicit": {"integrator": "leapfrog", "substeps": 60}}


def cloth(solver: str) -> Scene:
    scene = Scene(solver=solver, wind=(1.0, 0.0, 0.0), **HOW[solver])
    scene.cloth("/cloth", *grid(), material=Fabric(stretch=300.0, bend=1e-4, damping=1e-4), model="springs", drag=1.0)
    scene.pin("/pin", scene.cloths[0], [0, 3])
    scene.collider("/ball", Sphere(0.3), at=(0.5, -0.35, 0.5))
    return scene
