"""Nets beside a collider that they never meet: milliseconds a frame and error, without it, with it, and with contacts in every
frame, as a frame was before it could do without.

    python tools/bench/contact/free_frames.py [--device cuda:0] [--only] [--sides 32,100] [--solvers explicit,xpbd,implicit]
        [--colliders still,slides,turns,mesh,forms] [--held] [--rounds 20] [--json FILE]

A net of n x n points, 1 m wide, hangs by one edge and falls (`wsim.shapes.spring_sheet`, 60 frames a second; leapfrog, XPBD of
10 iterations and Newton's method of 2, 10 substeps both); 10 m below there is a collider:

    still     a ball of 0.5 m                              slides    the ball, by a key every half second, up and down
    turns     a box, by slerps between such keys           mesh      a rigid mesh of 960 faces, smoothly along such keys
    forms     that mesh, whose points move by such keys

Frames of the runs take turns, so that they share whatever else the machine does: the least time of all frames, and their
median. Whole `Simulation.step` calls, with what the host does. The error is the RMS distance of the points after 0.25 s from
float64 leapfrog in steps a quarter as long without a collider; `bits` says whether the positions are those of the net without
the collider. --held: rows with contacts in every frame, as a frame was before it could do without.
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
from wsim.physics.contact import free_flight_test  # noqa: E402
from wsim.scene import Box, Scene, Sphere, Surface, shapes  # noqa: E402
from wsim.scene.curve import Curve, Motion  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

FRAMES = 15            # to 0.25 s
FINER = 4              # times as many substeps, of the reference
TURN = 10              # frames of one run before those of the next
KEYS = 0.5 * np.arange(60)                 # [s] of colliders that move
SOLVERS: dict[str, dict] = {"explicit": {}, "xpbd": {"substeps": 10, "iterations": 10},
                            "implicit": {"substeps": 10, "iterations": 2}}


def collided(scene: Scene, kind: str) -> None:
    """Puts a collider below."""
    places = np.array([0.0, -10.0, 0.0]) + 0.5 * np.sin(2.0 * KEYS)[:, None] * np.array([0.3, 1.0, 0.0])
    turns = np.stack([0.0 * KEYS, np.sin(0.4 * KEYS), 0.0 * KEYS, np.cos(0.4 * KEYS)], axis=1)
    points, counts, corners = shapes.sphere(0.5, 16)
    if kind == "still":
        scene.collider("/ball", Sphere(0.5), at=places[0])
    elif kind == "slides":
        scene.collider("/ball", Sphere(0.5), motion=Motion.through(KEYS, places, kind="linear"))
    elif kind == "turns":
        scene.collider("/box", Box((0.5, 0.3, 0.2)), motion=Motion.through(KEYS, places, turns, "linear"))
    elif kind == "mesh":
        scene.collider("/mesh", Surface(points, counts, corners), motion=Motion.through(KEYS, places, turns))
    else:
        grown = points * (1.0 + 0.2 * np.sin(3.0 * KEYS)[:, None, None])
        scene.collider("/mesh", Surface(points, counts, corners, Curve(KEYS, grown)), at=places[0])


def net(n: int, collider: str = "", solver: str = "explicit") -> Scene:
    scene = Scene(fps=60.0, solver=solver, gravity=(0.0, -9.81, 0.0), **SOLVERS[solver])
    body = scene.net("/net", *shapes.spring_sheet(1.0, n))
    scene.pin("/pin", body, range(n))
    if collider:
        collided(scene, collider)
    return scene


def held(scene: Scene, device) -> Simulation:
    """With contacts in every frame."""
    possible = free_flight_test.allows_free_flight
    free_flight_test.allows_free_flight = lambda *_: False
    try:
        return Simulation(scene, device=device)
    finally:
        free_flight_test.allows_free_flight = possible


def reference(n: int, substeps: int, device) -> np.ndarray:
    sim = Simulation(replace(net(n), substeps=FINER * substeps), device=device, precision="float64")
    sim.run(FRAMES)
    return sim.positions()


def compare(n: int, solver: str, device, args) -> list[dict]:
    sims = {"without": Simulation(net(n, "", solver), device=device)}
    for kind in args.colliders.split(","):
        sims[kind] = Simulation(net(n, kind, solver), device=device)
        if args.held:
            sims[f"{kind}, contacts"] = held(net(n, kind, solver), device)
    for sim in sims.values():
        sim.run(FRAMES)
    ends = {name: sim.positions() for name, sim in sims.items()}
    substeps = sims["without"].plan.clock.substeps
    exact = reference(n, Simulation(net(n), device=device).plan.clock.substeps, device)
    times: dict[str, list[float]] = {name: [] for name in sims}
    for _ in range(args.rounds):
        for name, sim in sims.items():
            for _ in range(TURN):
                began = time.perf_counter()
                sim.step()
                times[name].append(1e3 * (time.perf_counter() - began))
    alone, middle = min(times["without"]), np.median(times["without"])
    return [{"points": n * n, "solver": solver, "run": name, "substeps": substeps, "least_ms": min(times[name]),
             "median_ms": float(np.median(times[name])), "over_without": min(times[name]) / alone,
             "median_over_without": float(np.median(times[name]) / middle),
             "rms_error_m": float(np.sqrt(np.mean(np.sum((ends[name] - exact)**2, axis=1)))),
             "bits": bool(np.array_equal(ends[name], ends["without"])), "free": sim.forms["free"]}
            for name, sim in sims.items()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--only", action="store_true", help="not on the CPU besides")
    parser.add_argument("--sides", default="32,100")
    parser.add_argument("--solvers", default="explicit")
    parser.add_argument("--colliders", default="still,slides,turns,mesh,forms")
    parser.add_argument("--held", action="store_true", help="rows with contacts in every frame too")
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    found: list[dict] = []
    for device in map(wp.get_device, dict.fromkeys([*["cpu"] * (not args.only), args.device])):
        for n in map(int, args.sides.split(",")):
            for solver in args.solvers.split(","):
                for row in compare(n, solver, device, args):
                    show(found, {"hardware": hardware(device)} | row)
    if args.json:
        args.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
