"""Drape coefficients of the fabric presets beside published ones: a disc of 30 cm hangs over a support of 18 cm (Cusick 1968,
The measurement of fabric drape, J. Text. Inst. 59, 253; BS 5058; ISO 9073-9).

    DC = (shadow - a) / (A - a)      A, a areas of disc and support, shadow that of the hanging disc, seen from above

The plates of the drapemeter hold what lies on the support, so that the ring outside it is all that is solved: rings of points
of equal distance, two of them held. It starts flat, with random offsets of a thousandth of the radius in which folds begin.
Gravity grows from 0 within RAMP, as the disc of a drapemeter is let down slowly. Where the sheet falls at once, 9 to 11 folds
stand that a slow one does not have, and the coefficient is some 10 points higher, another one for each step size. It ends where
the mean speed stays below REST. Backward Euler takes one step a frame: only the end counts.

    python -m tools.bench.bending.drape [fabric ...] [--rings 8 12] [--seeds 2]

Beside it stands what is published.
woven       DC = 5.1 + 24.7 c, c = (B / w)^(1/3) the bending length [cm], w the weight by area: Morooka, Niwa 1976, J. Text.
            Mach. Soc. Japan 22, 67, of a rigidity that is the same in all directions. The coefficients (115.0, 131.1, 1.2 by
            cubic roots of B / W in gf cm^2/cm and mg/cm^2) are quoted from memory of Hu 2004, Structure and Mechanics of Woven
            Fabrics. It is a fit, and no bound: fabrics lie some 10 points from it.
MEASURED    ranges of specimens of that material, where a source was at hand
medium      BS 5058 takes the disc of 30 cm for fabrics of 30 to 85 %, a smaller one below and a larger one above (from memory)
"""

import argparse
import time

import numpy as np

from wsim.scene import Scene, Varying
from wsim.scene.curve import Curve
from wsim.scene.fabric import FABRICS, Fabric, fabric
from wsim.simulation.simulation import Simulation

RADIUS, SUPPORT, G = 0.15, 0.09, 9.81         # [m], [m], [m/s^2]
RAMP = 5.0                                    # [s]
REST, CALM = 5e-4, 24                         # mean speed [m/s], and frames that it stays below it
LONGEST = 600                                 # frames
CELLS = 1200                                  # of the shadow's picture, along a side
# [%] sheep leather for garments of 0.64 to 0.96 mm, four kinds: Memon, Chaklie, Yesuf, Zhu 2021, Materials 14, 4553
MEASURED = {"leather": (47.35, 69.9)}


def ring_mesh(rings: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (n, 3) [m] and triangles (t, 3) of the disc outside the support, in so many rings, and which points are held."""
    length, circles, first = (RADIUS - SUPPORT) / rings, [], 0
    for k in range(-1, rings + 1):
        count = round(2.0 * np.pi * (SUPPORT + k * length) / length * 0.95)
        circles.append((first, count, np.pi * (k % 2) / count))
        first += count
    flat = [(SUPPORT + (k - 1) * length) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
            for k, (_, count, turn) in enumerate(circles) for angle in [turn + 2.0 * np.pi * np.arange(count) / count]]
    points = np.concatenate(flat)
    triangles = np.concatenate([between_circles(*each) for each in zip(circles[:-1], circles[1:], strict=True)])
    return np.stack([points[:, 0], np.zeros(len(points)), points[:, 1]], axis=1), triangles.astype(np.int32), \
        np.arange(len(points)) < circles[2][0]


def between_circles(inner: tuple, outer: tuple) -> np.ndarray:
    """Triangles (t, 3) between two circles of points (first, count, angle of the first), from the point that comes next on."""
    (a, n, low), (b, m, high) = inner, outer
    i, j, found = 0, 0, []
    while i < n or j < m:
        if i < n and (j == m or low + 2.0 * np.pi * (i + 1) / n <= high + 2.0 * np.pi * (j + 1) / m):
            found.append((a + i % n, a + (i + 1) % n, b + j % m))
            i += 1
        else:
            found.append((a + i % n, b + (j + 1) % m, b + j % m))
            j += 1
    return np.array(found)


def shadow(x: np.ndarray, triangles: np.ndarray) -> float:
    """Area [m^2] of triangles seen along y, by counting the cells of a picture."""
    side = 2.2 * RADIUS
    seen = np.zeros((CELLS, CELLS), bool)
    p = (x[:, [0, 2]] / side + 0.5) * CELLS
    for a, b, c in p[triangles]:
        area = (b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0]
        if abs(area) < 1e-9:
            continue
        low, high = (np.floor(np.min([a, b, c], axis=0)).astype(int), np.ceil(np.max([a, b, c], axis=0)).astype(int))
        u, v = np.ogrid[low[0]:high[0], low[1]:high[1]]
        u, v = u + 0.5 - a[0], v + 0.5 - a[1]
        s, r = (u * (c - a)[1] - v * (c - a)[0]) / area, ((b - a)[0] * v - (b - a)[1] * u) / area
        seen[low[0]:high[0], low[1]:high[1]] |= (s >= 0) & (r >= 0) & (s + r <= 1)
    return float(seen.sum()) * (side / CELLS)**2


def folds(x: np.ndarray, rest: np.ndarray) -> int:
    """Number of folds: how often the radius of the hem rises through its mean, round the disc."""
    hem = np.flatnonzero(np.hypot(rest[:, 0], rest[:, 2]) > RADIUS - 1e-6)
    hem = hem[np.argsort(np.arctan2(rest[hem, 2], rest[hem, 0]))]
    r = np.hypot(x[hem, 0], x[hem, 2])
    above = r > r.mean()
    return int((above & ~np.roll(above, 1)).sum())


def measure(material: Fabric, rings: int, seed: int = 1) -> tuple[float, int, float]:
    """(drape coefficient [1], number of folds, mean speed at the end [m/s])."""
    points, triangles, held = ring_mesh(rings)
    start = points.copy()
    start[~held, 1] += 1e-3 * RADIUS * np.random.default_rng(seed).standard_normal((~held).sum())
    scene = Scene(frames=LONGEST, solver="implicit", integrator="backward_euler", substeps=1)
    scene.cloth("/disc", start, np.full(len(triangles), 3), triangles.ravel(), material=material, rest_points=points)
    scene.pin("/plates", "/disc", np.flatnonzero(held))
    scene.varying.append(Varying("/", "gravity", Curve(np.array([0.0, RAMP]), np.array([[0.0, 0.0, 0.0], [0.0, -G, 0.0]]))))
    sim, speeds = Simulation(scene, device="cpu"), list[float]()
    for _ in range(LONGEST):
        sim.step()
        speeds.append(float(np.linalg.norm(sim.velocities("/disc")[~held], axis=1).mean()))
        if len(speeds) > scene.fps * RAMP + CALM and max(speeds[-CALM:]) < REST:
            break
    x, (A, a) = sim.positions("/disc"), (np.pi * r * r for r in (RADIUS, SUPPORT))
    outside = shadow(x, triangles) - shadow(points, triangles[held[triangles].all(axis=1)])
    return outside / (A - a), folds(x, points), speeds[-1]


def bending_length(material: Fabric) -> float:
    """Peirce's (B / w)^(1/3) [m]."""
    return float((material.bend / (material.density * material.thickness * G))**(1 / 3))


def woven(material: Fabric) -> float:
    """Drape coefficient [%] of Morooka and Niwa's fit."""
    return 5.1 + 24.7 * 100.0 * bending_length(material)


def main() -> None:
    parser = argparse.ArgumentParser(description="drape coefficients of fabric presets")
    parser.add_argument("names", nargs="*", default=list(FABRICS), help="presets; default: all")
    parser.add_argument("--rings", type=int, nargs="+", default=[8, 12], help="meshes; 12 rings are 5 mm apart")
    parser.add_argument("--seeds", type=int, default=1, help="starts on each mesh")
    asked = parser.parse_args()
    print(f"{'fabric':9}{'c cm':>6}{'rings':>6}{'seed':>5}{'DC %':>7}{'folds':>6}{'mm/s':>7}{'CPU s':>7}   published")
    for name in asked.names:
        material, found = fabric(name), dict[int, list[float]]()
        low, high = MEASURED.get(name, (np.nan, np.nan))
        beside = f"measured {low:g} to {high:g}" if name in MEASURED else f"fit of woven fabrics {woven(material):.0f}"
        for rings in asked.rings:
            for seed in range(1, asked.seeds + 1):
                began = time.process_time()
                drape, count, speed = measure(material, rings, seed)
                found.setdefault(rings, []).append(100.0 * drape)
                print(f"{name:9}{100 * bending_length(material):6.2f}{rings:6}{seed:5}{100 * drape:7.1f}{count:6}"
                      f"{1e3 * speed:7.2f}{time.process_time() - began:7.0f}   {beside}", flush=True)
        means = [float(np.mean(found[rings])) for rings in asked.rings]
        if len(means) > 1:
            print(f"{name:9} finest mesh less the one before: {means[-1] - means[-2]:+.1f}", flush=True)


if __name__ == "__main__":
    main()
