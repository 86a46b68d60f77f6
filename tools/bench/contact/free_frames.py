"""Nets beside a collider that they never meet: milliseconds a frame and error, without it, with it, and with contacts in every
frame, as a frame was before it could do without.

    python tools/bench/contact/free_frames.py [--device cuda:0] [--sides 32,100] [--rounds 20] [--json FILE]

A net of n x n points, 1 m wide, hangs by one edge and falls (`wsim.shapes.spring_sheet`, 60 frames a second, leapfrog); a ball
of 0.5 m stands 10 m below. Frames of the runs take turns, so that they share whatever else the machine does: the least time of
all frames, and their median. Whole `Simulation.step` calls, with what the host does. The error is the RMS distance of the
points after 0.25 s from float64 steps a quarter as long without a collider; `bits` says whether the positions are those of the
net without the collider.
"""

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))
from tools.bench.speed import hardware, show  # noqa: E402
from wsim.physics.contact import clearance  # noqa: E402
from wsim.scene import Scene, Sphere, shapes  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

FRAMES = 15            # to 0.25 s
FINER = 4              # times as many substeps, of the reference
TURN = 10              # frames of one run before those of the next


def net(n: int, collider: bool) -> Scene:
    scene = Scene(fps=60.0, solver="explicit", gravity=(0.0, -9.81, 0.0))
    body = scene.net("/net", *shapes.spring_sheet(1.0, n))
    scene.pin("/pin", body, range(n))
    if collider:
        scene.collider("/ball", Sphere(0.5), at=(0.0, -10.0, 0.0))
    return scene


def held(scene: Scene, device) -> Simulation:
    """With contacts in every frame."""
    possible = clearance.possible
    clearance.possible = lambda *_: False
    try:
        return Simulation(scene, device=device)
    finally:
        clearance.possible = possible


def reference(n: int, substeps: int, device) -> np.ndarray:
    sim = Simulation(replace(net(n, False), substeps=FINER * substeps), device=device, precision="float64")
    sim.run(FRAMES)
    return sim.positions()


def compare(n: int, device, rounds: int) -> list[dict]:
    sims = {"without": Simulation(net(n, False), device=device), "far": Simulation(net(n, True), device=device),
            "far, contacts": held(net(n, True), device)}
    for sim in sims.values():
        sim.run(FRAMES)
    ends = {name: sim.positions() for name, sim in sims.items()}
    substeps = sims["without"].plan.clock.substeps
    exact = reference(n, substeps, device)
    times: dict[str, list[float]] = {name: [] for name in sims}
    for _ in range(rounds):
        for name, sim in sims.items():
            for _ in range(TURN):
                began = time.perf_counter()
                sim.step()
                times[name].append(1e3 * (time.perf_counter() - began))
    alone = min(times["without"])
    return [{"points": n * n, "run": name, "substeps": substeps, "least_ms": min(times[name]),
             "median_ms": float(np.median(times[name])), "over_without": min(times[name]) / alone,
             "rms_error_m": float(np.sqrt(np.mean(np.sum((ends[name] - exact)**2, axis=1)))),
             "bits": bool(np.array_equal(ends[name], ends["without"])), "free": sim.forms["free"]}
            for name, sim in sims.items()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--sides", default="32,100")
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    found: list[dict] = []
    for device in map(wp.get_device, dict.fromkeys(["cpu", args.device])):
        for n in map(int, args.sides.split(",")):
            for row in compare(n, device, args.rounds):
                show(found, {"hardware": hardware(device)} | row)
    if args.json:
        args.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
