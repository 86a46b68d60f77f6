"""Heaps of grains and tanks of fluid by constraints; python -m tools.bench.soft.particles heap|tank ...

    heap RADIUS_OF_COLUMN FRAMES SUBSTEPS ITERATIONS      a column twice as high as wide collapses; mu = 0.5, grains of 8 mm
    tank PARTICLES_ACROSS FRAMES SUBSTEPS ITERATIONS      water at rest between walls of no friction, as deep as wide

Columns: CPU time a frame, greatest speed, greatest overlap, steepest part of the slope; or mean height over that at the start,
virial pressure over hydrostatic pressure, density error.
"""

import sys
import time

import numpy as np

import wsim
from wsim.kernels.position_based import density


def heap(radius: float, frames: int, substeps: int, iterations: int) -> None:
    """Prints a line every half second."""
    scene = wsim.Scene(fps=60, substeps=substeps, iterations=iterations)
    scene.collider("/floor", wsim.Plane())
    upright = wsim.Motion.still([[1, 0, 0, 0], [0, 0, 1, 2 * radius + 0.005], [0, -1, 0, 0], [0, 0, 0, 1]])
    scene.particles("/grains", wsim.Cylinder(radius, 2 * radius), motion=upright, radius=0.004)
    simulation = wsim.Simulation(scene, device="cpu")
    print(f"{len(simulation.positions())} grains, {substeps} x {iterations}")
    spent, before = 0.0, simulation.positions().copy()
    for frame in range(1, frames + 1):
        start = time.process_time()
        simulation.step()
        spent += time.process_time() - start
        if frame % 30 == 0:
            x, v = simulation.positions(), np.linalg.norm(simulation.velocities(), axis=1)
            out = np.hypot(x[:, 0], x[:, 2])
            rings = np.linspace(0.2, 0.95, 9) * np.quantile(out, 0.98)
            crest = [x[(out >= a) & (out < b), 1].max() for a, b in zip(rings[:-1], rings[1:], strict=True)]
            slope = -np.polyfit(0.5 * (rings[1:] + rings[:-1]), crest, 1)[0]
            overlap = simulation.report(profile=False)["error"].get("grain_overlap", 0.0)
            print(f"{frame / 60:6.1f} s  {1e3 * spent / 30:6.1f} ms  v {v.max():.1e} m/s  overlap {overlap:.1e}  slope "
                  f"{slope:.2f}  moved {np.abs(x - before).max():.1e} m", flush=True)
            spent, before = 0.0, x.copy()


def tank(across: int, frames: int, substeps: int, iterations: int) -> None:
    """Prints a line every second."""
    r, half = 0.01, 0.01 * across
    scene = wsim.Scene(fps=60, substeps=substeps, iterations=iterations)
    slip = {"static_friction": 0.0, "dynamic_friction": 0.0}
    scene.collider("/floor", wsim.Plane(), **slip)
    for k, n in enumerate(([1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1])):
        M = np.eye(4)
        x = np.cross([0, 1, 0], n)
        M[:3, :3], M[:3, 3] = np.stack([x, np.cross(n, x), n], axis=1), -half * np.array(n)
        scene.collider(f"/wall_{k}", wsim.Plane(), motion=wsim.Motion.still(M), **slip)
    scene.particles("/water", wsim.Box((half, half, half)), at=(0, half, 0), radius=r, material="fluid")
    simulation = wsim.Simulation(scene, device="cpu")
    method = next(m for m in simulation.plan.methods if m.name == "density")
    height, spent = simulation.positions()[:, 1].mean(), 0.0
    print(f"{len(simulation.positions())} particles, {substeps} x {iterations}")
    for frame in range(1, frames + 1):
        start = time.process_time()
        simulation.step()
        spent += time.process_time() - start
        if frame % 60 == 0:
            x, found = simulation.positions(), method.indicators(None, None)
            inner = (np.abs(x[:, [0, 2]]) < half - 4 * r).all(axis=1) & (x[:, 1] > 4 * r) & (x[:, 1] < 2 * half - 6 * r)
            slope = -np.polyfit(x[inner, 1], virial_pressures(method, x)[inner], 1)[0]
            print(f"{frame / 60:5.1f} s  {1e3 * spent / 60:6.1f} ms  height {x[:, 1].mean() / height:.4f}  pressure "
                  f"{slope / 9810:.3f}  density error "
                  f"{found['density_error']:.1e}, most {found['most_density_error']:.1e}", flush=True)
            spent = 0.0


def virial_pressures(method, x: np.ndarray) -> np.ndarray:
    """Pressure at each particle [Pa], from the forces of its pairs."""
    from scipy.spatial import cKDTree
    p, H = method.part.arrays["p"].numpy()[method.part.rows["/water", 0]].astype(float), density.REACHED * method.distance
    i, j = cKDTree(x).query_pairs(H, output_type="ndarray").T
    r = np.linalg.norm(x[i] - x[j], axis=1)
    share = (p[i] + p[j]) * 45.0 / (8.0 * np.pi * density.LATTICE) * (1.0 - r / H) ** 2 / H * r / 6.0
    return np.bincount(i, share, len(x)) + np.bincount(j, share, len(x))


if __name__ == "__main__":
    name, size, *counts = sys.argv[1:]
    (heap if name == "heap" else tank)(float(size) if name == "heap" else int(size), *map(int, counts))  # type: ignore[operator]
