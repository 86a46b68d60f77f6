"""Young's modulus and Poisson's ratio of a bar from the swing of its points: E bends it, nu is seen where it is held.

    python scenes/examples/moduli_of_a_bar.py
"""

import numpy as np

import wsim
from wsim import Bulk, Scene, Simulation
from wsim.fitting import Settings, Track
from wsim.scene import shapes

TRUTH = {"young": 1e5, "poisson": 0.3}                      # [Pa], [1]
NOISE = 1e-4                                                # [m]


def scene_of(frames: int = 20) -> Scene:
    """6 x 2 x 2 cells, held at one end, swings under its weight."""
    scene = Scene(fps=60.0, frames=frames, solver="implicit", integrator="backward_euler", substeps=2, iterations=2)
    points, tets = shapes.block((0.6, 0.2, 0.2), (6, 2, 2))
    body = scene.soft("/bar", points, tets, material=Bulk(TRUTH["young"], TRUTH["poisson"], 1e3))
    scene.pin("/wall", body, np.flatnonzero(points[:, 0] < points[:, 0].min() + 1e-6))
    return scene


def run(frames: int = 20) -> dict:
    scene, x = scene_of(frames), []
    Simulation(scene, device="cpu", precision="float64").run(each=lambda sim: x.append(sim.positions()))
    points = np.array(x) + NOISE * np.random.default_rng(0).normal(size=np.shape(x))
    found = wsim.fit(scene, [Track("/bar", np.arange(1, len(x) + 1), points)], "young,poisson",
                     start={"young": 2e5, "poisson": 0.4}, settings=Settings(device="cpu"))
    return {"values": found.values, "errors": found.errors, "simulations": found.simulations, "text": found.text()}


if __name__ == "__main__":
    r = run()
    print(r["text"])
    for name, true in TRUTH.items():
        print(f"{name}: found {r['values'][name]:.5g} +- {r['errors'][name]:.1g}, true {true:g}")
