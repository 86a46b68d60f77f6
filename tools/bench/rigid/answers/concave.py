"""Concave bodies beside closed forms: hanging chains and gears; python -m tools.bench.rigid.answers.concave

Float32, frames of 1/60 s of 8 substeps of 4 sweeps. Prints rows of tools/results/rigid.md, with the CPU time of a frame [ms]:

    chain    largest departure of a link's distance from 2 (R - r), and the deepest overlap, over R, after two seconds
    gears    ratio of the turns of 12 and 20 teeth in scenes/gears.usda over 12 / 20, less 1, after 72 frames
"""

import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[4]
sys.path.insert(0, str(ROOT))

from tools.scenes.machines import loop_faces, torus_grid  # noqa: E402
from wsim import Motion, Scene, Simulation, Surface, load  # noqa: E402

R, TUBE, LINKS, FRAMES = 1.0, 0.25, 12, 120
TURNS = (np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]), np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]]))      # of rings in turn


def hanging_chain(size: float, weight: float) -> Scene:
    """Rings in each other, the first of which stands; the last has the mass of `weight` of them."""
    scene = Scene(fps=60, substeps=8, iterations=4, gravity=(0, 0, -9.81), up="Z")
    grid = torus_grid(R * size, TUBE * size, 32, 16)
    shape = Surface(grid.reshape(-1, 3), np.full(grid[..., 0].size, 4), loop_faces(32, 16).ravel())
    for k in range(LINKS + 1):
        M = np.eye(4)
        M[:3, :3], M[2, 3] = TURNS[k % 2], -k * (2.0 * (R - TUBE) - 2e-3) * size
        if k == 0:
            scene.collider("/hook", shape, motion=Motion.still(M))
        else:
            scene.body(f"/link{k}", shape, motion=Motion.still(M), density=1000.0 * (weight if k == LINKS else 1.0))
    return scene


def print_chains() -> None:
    for size in (1.0, 0.01):
        simulation = Simulation(hanging_chain(size, 10.0), device="cpu")
        simulation.step()
        began = time.process_time()
        simulation.run(FRAMES)
        ms = (time.process_time() - began) / FRAMES * 1e3
        z = np.array([0.0, *(simulation.poses()[f"/link{k}"][2, 3] for k in range(1, LINKS + 1))])
        off = np.abs(np.diff(z) / size + 2.0 * (R - TUBE)).max()
        deep = simulation.plan.method("rigid").indicators(None, None)["rigid_overlap"] / size
        print(f"chain of {LINKS} links of {size:g} m under ten: distances off by {off:.1e}, overlap {deep:.1e}, {ms:.1f} ms")


def print_gears() -> None:
    simulation = Simulation(load(ROOT / "scenes/gears.usda"), device="cpu")
    paths = [body.path for body in simulation.scene.things("Body")][:2]

    def angles() -> np.ndarray:
        return np.array([np.arctan2(M[1, 0], M[0, 0]) for M in (simulation.poses()[path] for path in paths)])
    turned, last, spent = np.zeros(2), angles(), 0.0
    for _ in range(72):
        began = time.process_time()
        simulation.step()
        spent += time.process_time() - began
        turned, last = turned + np.mod(angles() - last + np.pi, 2.0 * np.pi) - np.pi, angles()
    print(f"gears: ratio off by {abs(turned[1] / turned[0]) * 20.0 / 12.0 - 1.0:.1e} after {turned[0]:.2f} rad, "
          f"{spent / 72 * 1e3:.1f} ms with the first frame")


if __name__ == "__main__":
    print_chains()
    print_gears()
