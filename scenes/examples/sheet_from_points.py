"""Stretch and bending stiffness of a sheet from noisy points of its fall: two numbers, by copies of the scene that differ in
one each (`wsim.fit`), with error bars.

    python scenes/examples/sheet_from_points.py
"""

import numpy as np

import wsim
from wsim import Fabric, Scene, Simulation
from wsim.fitting import Settings, Track
from wsim.scene import shapes

TRUTH = {"stretch": 200.0, "bend": 1e-3}                    # [N/m], [N m]
NOISE = 1e-3                                                # [m]


def scene_of(frames: int = 20) -> Scene:
    """8 x 8 points, 1 m wide, falls from the horizontal on two pinned corners."""
    scene = Scene(fps=24.0, frames=frames, solver="explicit", substeps=34)
    cloth = scene.cloth("/sheet", *shapes.sheet(1.0, 1.0, 7, 7, horizontal=True),
                        material=Fabric(shear=60.0, density=200.0, **TRUTH))
    scene.pin("/pin", cloth, [0, 7])
    return scene


def run(noise: float = NOISE) -> dict:
    scene, x = scene_of(), []
    Simulation(scene, device="cpu", precision="float64").run(each=lambda sim: x.append(sim.positions()))
    points = np.array(x) + noise * np.random.default_rng(0).normal(size=np.shape(x))
    found = wsim.fit(scene, [Track("/sheet", np.arange(1, len(x) + 1), points)], "stretch,bend",
                     start={"stretch": 400.0, "bend": 5e-4}, settings=Settings(device="cpu", accuracy=0.01))
    return {"values": found.values, "errors": found.errors, "simulations": found.simulations, "text": found.text()}


if __name__ == "__main__":
    r = run()
    print(r["text"])
    for name, true in TRUTH.items():
        print(f"{name}: found {r['values'][name]:.4g} +- {r['errors'][name]:.1g}, true {true:g}")
