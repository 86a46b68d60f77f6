"""Time of rods beside their error: hairs that hang from clamps on a sphere and are shaken, and a cantilever's first mode.

    python tools/bench/nets/rods.py --device cuda:0 [--hairs 100,1000,10000] [--substeps 4,10] [--points 32] [--json FILE]

Rows: ms a frame of 1/60 s (median: of all frames, of FREE, in which hairs swing, of MET, in which they lie on the ball),
substeps, RMS distance from a run of 40 substeps after FREE and MET [m], Newton's iterations (most of a strand), what they left
over an edge's length, greatest strain; of the cantilever the error of its first frequency against Euler and Bernoulli.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from wsim.physics.rods.objects import Rods
from wsim.scene import Motion, Scene, Sphere
from wsim.simulation.simulation import Simulation

LENGTH, RADIUS = 0.2, 0.1
FREE, MET, FINE = slice(2, 13), slice(16, 31), 40


def hairs(count: int, points: int) -> Scene:
    """Hairs of 0.1 mm and 4 GPa (human: 3 to 4), 20 cm long, on a ball that turns to and fro twice a second."""
    k = np.arange(count) + 0.5
    y = 1.0 - 0.95 * k / count
    turn, out = np.pi * (1.0 + 5.0**0.5) * k, np.sqrt(1.0 - y * y)
    n = np.stack([out * np.cos(turn), y, out * np.sin(turn)], axis=1)
    x = n[:, None] * (RADIUS + LENGTH * (np.arange(points) - 1.5) / (points - 1))[None, :, None]
    scene = Scene(gravity=(0.0, -9.81, 0.0), fps=60.0)
    rods = scene.add(Rods("/hair", x.reshape(-1, 3), np.full(count, points), 1e-4, 4e9, density=1300.0))
    times = np.linspace(0.0, 2.0, 241)
    frames = np.tile(np.eye(4), (len(times), 1, 1))
    angle = 0.5 * np.sin(2.0 * np.pi * 2.0 * times)
    frames[:, 0, 0] = frames[:, 2, 2] = np.cos(angle)
    frames[:, 0, 2], frames[:, 2, 0] = np.sin(angle), -np.sin(angle)
    motion = Motion(times, frames)
    rods.pin("/roots", np.sort(np.concatenate([np.arange(count) * points, np.arange(count) * points + 1])), motion=motion)
    scene.collider("/head", Sphere(RADIUS), motion=motion)
    return scene


def cantilever(points: int) -> Scene:
    """A rod, 1 m long, clamped at its first edge, that starts in its first mode with 1 mm/s at the tip."""
    edge, r, young, density = 1.0 / (points - 1), 0.01, 1e8, 1000.0
    x = np.zeros((points + 1, 3))
    x[:, 0] = np.arange(points + 1) * edge - edge
    b, s = 1.8751040687, np.clip(x[:, 0], 0.0, None)
    mode = np.cosh(b * s) - np.cos(b * s) - 0.7340955138 * (np.sinh(b * s) - np.sin(b * s))
    mode[:2] = 0.0
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=400.0, substeps=1)
    rods = scene.add(Rods("/rod", x, [points + 1], 2.0 * r, young, density=density,
                          velocities=5e-4 * mode[:, None] * np.array([0.0, 1.0, 0.0])))
    rods.pin("/clamp", [0, 1])
    return scene


def frequency(points: int, device) -> dict:
    """Error of the first frequency, from two zeros of the tip's height."""
    simulation, tip = Simulation(cantilever(points), device=device), [0.0]
    for _ in range(480):
        simulation.step()
        tip.append(simulation.plan.method("rods").points(0)[0][-1, 1])
    y = np.array(tip[1:])
    k = np.flatnonzero(y[:-1] * y[1:] < 0.0)[:2]
    zero = (k + y[k] / (y[k] - y[k + 1])) / 400.0
    exact = 1.8751040687**2 / (2.0 * np.pi) * np.sqrt(1e8 * np.pi * 0.01**4 / 4.0 / (1000.0 * np.pi * 0.01**2))
    return {"scene": "cantilever", "points": points, "frequency_error": 0.5 / (zero[1] - zero[0]) / exact - 1.0}


def shaken(count: int, points: int, substeps: int, device) -> tuple[dict, list[np.ndarray]]:
    """A row, and positions after FREE and MET."""
    scene = hairs(count, points)
    scene.substeps = substeps
    simulation, began = Simulation(scene, device=device), time.perf_counter()
    method, places = simulation.plan.method("rods"), []
    for frame in range(MET.stop):
        simulation.step()
        if frame == 0:
            first = time.perf_counter() - began
        if frame + 1 in (FREE.stop, MET.stop):
            places.append(method.points(0)[0])
    ms = np.array(simulation.milliseconds)
    return {"scene": "hairs", "hairs": count, "points": points, "substeps": method.substeps, "first_s": first,
            "ms": float(np.median(ms[1:])), "free_ms": float(np.median(ms[FREE])), "met_ms": float(np.median(ms[MET])),
            "most_ms": float(ms[1:].max()), **method.indicators(None, None)}, places


def beside(count: int, points: int, each: list[int], device):
    """Rows of a number of hairs, with their errors."""
    _, true = shaken(count, points, FINE, device)
    for substeps in each:
        row, places = shaken(count, points, substeps, device)
        far = [float(np.sqrt(((x - y)**2).sum(1).mean())) for x, y in zip(places, true, strict=True)]
        yield row | {"free_rms": far[0], "met_rms": far[1]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--device", default=None)
    parser.add_argument("--hairs", default="100,1000")
    parser.add_argument("--points", type=int, default=32)
    parser.add_argument("--substeps", default="4,10")
    parser.add_argument("--json", default="")
    given = parser.parse_args()
    device = wp.get_device(given.device)
    rows = [frequency(n, device) for n in (9, 17, 33)]
    each = [int(n) for n in given.substeps.split(",")]
    rows += [row for n in given.hairs.split(",") for row in beside(int(n), given.points, each, device)]
    for row in rows:
        print("  ".join(f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}"
                        for name, value in row.items()), flush=True)
    if given.json:
        with open(given.json, "w") as file:
            json.dump({"device": device.name, "rows": rows}, file, indent=1)


if __name__ == "__main__":
    main()
