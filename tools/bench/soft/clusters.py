"""Shape matching: what clusters err by, and what a frame costs.

    python tools/bench/soft/clusters.py [--device cuda:0|cpu] [--json FILE]

vibration   a free cluster of 64 points, k 400 /s^2, implicit midpoint, float64: largest error of its strain over its amplitude,
            30 frames of 1/100 s, against the closed form
momentum    linear and angular momentum of a body of 64 points that spins and vibrates, float32, change over a second
tumble      a rigid cluster about its middle axis, which is unstable, half a second: angle from the rigid body solution [rad]
slide       a rigid block at 2 m/s on a plane, mu 0.5: way to rest over v^2 / (2 mu g), less 1
cost        bodies on a plane, 8 substeps x 4 iterations at 60 Hz: ms a frame (CPU: processor time) beside the largest depth and
            speed at the end
"""

import argparse
import json
import sys
import time
from math import inf
from pathlib import Path

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tests.physics.soft.clusters import test_theory as theory  # noqa: E402
from tests.physics.soft.clusters.lattice import angular_momentum, cube_points  # noqa: E402
from tools.bench.speed import hardware  # noqa: E402
from wsim import Plane, Scene, Simulation  # noqa: E402


def vibration() -> dict:
    h, n = 1.0 / 200.0, 2 * np.arange(1, 31)
    exact = 0.1 * np.cos(2.0 * np.arctan(0.5 * np.sqrt(theory.K) * h) * n)
    found = theory.stretched("implicit_midpoint", 100.0, iterations=1)
    return {"case": "vibration", "error": float(np.abs(found - exact).max() / 0.1)}


def momentum(stiffness: float, spacing: float) -> dict:
    p = cube_points(4, 0.07)
    m, v = np.full(len(p), 2.0 / len(p)), np.cross([2.0, -1.0, 3.0], p) + [0.3, 0.1, -0.2] + 0.5 * p * [1, -1, 0]
    scene = Scene(fps=60, substeps=6, iterations=10, gravity=(0, 0, 0))
    scene.clusters("/c", p, mass=2.0, stiffness=stiffness, spacing=spacing, velocities=v)
    sim = Simulation(scene, device="cpu")
    sim.run(60)
    x, u, L = sim.positions("/c").astype(float), sim.velocities("/c").astype(float), angular_momentum(p, v, m)
    return {"case": "momentum", "stiffness": stiffness, "clusters": len(scene.things("Clusters")[0].groups),
            "linear": float(np.linalg.norm(m @ (u - v)) / np.linalg.norm(m @ v)),
            "angular": float(np.linalg.norm(angular_momentum(x, u, m) - L) / np.linalg.norm(L))}


def tumble(integrator: str, substeps: int) -> dict:
    return {"case": "tumble", "integrator": integrator, "substeps_a_second": 20 * substeps,
            "error": theory.spun(substeps, integrator)}


def slide(substeps: int, iterations: int) -> dict:
    p = cube_points(5, 0.04) * [1.0, 0.5, 1.0]
    scene = Scene(fps=60, substeps=substeps, iterations=iterations)
    scene.collider("/floor", Plane())
    scene.clusters("/c", p + [0, 0.0401, 0], mass=1.0, stiffness=inf, velocities=np.tile([2.0, 0, 0], (len(p), 1)))
    sim = Simulation(scene, device="cpu")
    sim.run(90)
    return {"case": "slide", "substeps": substeps, "iterations": iterations,
            "error": float(sim.positions("/c")[:, 0].mean() / (4.0 / 9.81) - 1.0)}


def cost(bodies: int, side: int, stiffness: float, spacing: float, device: str, frames: int = 30) -> dict:
    """Cubes of side^3 points, 2 cm apart, above a plane."""
    p, edge = cube_points(side, 0.02), 0.02 * (side + 2)
    scene, across = Scene(fps=60, substeps=8, iterations=4, solver="xpbd"), int(np.ceil(np.sqrt(bodies)))
    scene.collider("/floor", Plane())
    at = np.array([[edge * (k % across), 0.5 * edge + 0.02, edge * (k // across)] for k in range(bodies)])
    n, more = len(p), {}
    if spacing == inf:
        more = {"sizes": np.full(bodies, n), "members": np.arange(bodies * n)}
    scene.clusters("/c", (p + at[:, None]).reshape(-1, 3), mass=1.0 * bodies, stiffness=stiffness, spacing=spacing,
                   damping=0.004, **more)
    sim = Simulation(scene, device=device)
    sim.run(30)
    wp.synchronize()
    clock = time.process_time if device == "cpu" else time.perf_counter
    began = clock()
    sim.run(frames)
    wp.synchronize()
    ms = 1e3 * (clock() - began) / frames
    x, v = sim.positions("/c"), sim.velocities("/c")
    table = sim.plan.ports.shape_matching.table
    return {"case": "cost", "bodies": bodies, "points": sim.model.points, "clusters": len(table.sizes),
            "colours": len(table.starts) - 1, "members": len(table.point), "stiffness": stiffness, "ms": ms,
            "depth_m": float(max(-x[:, 1].min(), 0.0)), "speed_m_s": float(np.linalg.norm(v, axis=1).max())}


def rows(device: str) -> list[dict]:
    found = [vibration(), *(momentum(k, s) for k in (inf, 1e3) for s in (inf, 0.1))]
    found += [tumble(i, n) for i in ("backward_euler", "implicit_midpoint") for n in (10, 20, 40)]
    found += [slide(10, 4), slide(40, 4)]
    sizes = ((100, 5), (1, 27)) if device == "cpu" else ((1000, 8), (1, 46))
    return found + [cost(n, side, k, s, device) for n, side in sizes for k, s in ((inf, inf), (1e4, inf), (1e4, 0.06))
                    if n == 1 or s == inf]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    found = rows(given.device)
    for each in found:
        print("  ".join(f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}" for k, v in each.items()))
    if given.json:
        text = json.dumps({"hardware": hardware(wp.get_device(given.device)), "rows": found}, indent=1, default=str)
        given.json.write_text(text + "\n")
