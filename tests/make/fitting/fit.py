"""What tests/fitting/test_fit.py shares with other tests: CPU, bar, motion, sheet."""

import numpy as np

from wsim import Bulk, Fabric, Scene, Simulation
from wsim.fitting import Settings
from wsim.scene import shapes

CPU = Settings(device="cpu")
FRAMES = 20


def sheet(**more) -> Scene:
    """8 x 8 points, 1 m wide, falls from the horizontal on two pinned corners."""
    scene = Scene(fps=24, frames=FRAMES, solver="explicit", substeps=34, **more)
    cloth = scene.cloth("/sheet", *shapes.sheet(1.0, 1.0, 7, 7, horizontal=True),
                        material=Fabric(stretch=200.0, shear=60.0, bend=1e-3, density=200.0))
    scene.pin("/pin", cloth, [0, 7])
    return scene


def bar(young=1e5, nu=0.3) -> Scene:
    """6 x 2 x 2 cells, held at one end, swings under its weight."""
    scene = Scene(fps=60, frames=FRAMES, solver="implicit", integrator="backward_euler", substeps=2, iterations=2)
    points, tets = shapes.block((0.6, 0.2, 0.2), (6, 2, 2))
    body = scene.soft("/bar", points, tets, material=Bulk(young, nu, 1e3))
    scene.pin("/wall", body, np.flatnonzero(points[:, 0] < points[:, 0].min() + 1e-6))
    return scene


def motion(scene: Scene) -> np.ndarray:
    """Positions [m] at frames 1, 2 ..., (frames, n, 3), in float64."""
    sim, found = Simulation(scene, device="cpu", precision="float64"), []
    sim.run(scene.frames, lambda s: found.append(s.positions()))
    return np.array(found)
