"""What tests/fitting/test_shared.py shares with other tests: WINDS, hung, seen."""

import numpy as np

from tests.conftest import grid
from wsim.fitting.observations.observe import Track
from wsim.scene import Scene, Sphere
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

WINDS = (1.0, 3.0)
HOW = {"xpbd": {"integrator": "backward_euler", "substeps": 4, "iterations": 3},
       "implicit": {"integrator": "bdf2", "substeps": 2},
       "explicit": {"integrator": "leapfrog", "substeps": 50}}


def hung(solver: str = "xpbd", wind: float = 0.0, stretch: float = 300.0, **more) -> Scene:
    """A cloth of 16 points that is held at two of them in a wind, beside a ball."""
    scene = Scene(solver=solver, wind=(wind, 0.0, 0.0), **HOW[solver] | more)
    cloth = scene.cloth("/cloth", *grid(), material=Fabric(stretch=stretch, bend=1e-4), model="springs", drag=1.0)
    scene.pin("/pin", cloth, points=[0, 3])
    scene.collider("/ball", Sphere(0.25), at=(0.5, -0.45, 0.5))
    return scene


def seen(scene: Scene, frames=(2, 5, 8)) -> list[Track]:
    found: list[np.ndarray] = []
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.plan.clock.touching = True
    sim.run(max(frames), lambda s: found.append(s.positions()))
    return [Track("/cloth", list(frames), np.array([found[f - 1] for f in frames]), sigma=1e-4)]
