"""Gradients of whole runs: time of the backward pass over that of the forward pass, memory, and how right they are.

    python tools/bench/gradients.py [--device cuda:0|cpu] [--points 32,100] [--tets 2560] [--substeps 1024] [--side 32]
                                    [--smoke 16,32] [--million] [--json FILE]

sheet    points a side, springs of 1 kN/m, leapfrog, XPBD (as many substeps of an iteration), or XPBD over a ball (as many of
         an iteration, contacts with friction); bar  tets, corotational, leapfrog or BDF2 by Newton's method (64 substeps);
         bars with damping, under pressure, and of an eighth as many tets of ten nodes
side     points a side of: a membrane with hinges in the wind; a sheet held by soft pins; a sheet of springs that bounces on
         a ball; one that falls on a mesh (leapfrog, what is stable)
smoke    cells along x, y and z of air in which a source heats a plume under a ball: two steps a frame by reflection, pressure
         by multigrid, to 1e-4 in float32, to 1e-12 in float64. The loss is the sum of squares of the last smoke, apart of its
         gradient by the smoke at the start, slope by the source's place. cpu: as back/forward, of the process's time
million  XPBD of a sheet of 1000 x 1000 points, a sweep a substep: time of both passes only
keep     all: memory for every substep; checkpoints: for a segment at a time, which then runs twice
ms       of the forward pass (recorded, replayed from graphs), and back/forward of the least of three passes each
bytes    of versions, gradients and checkpoints, and over those of keeping all
apart    of the gradient by initial positions: |float32 - float64| over |float64|; slope: the derivative along a random
         direction against a difference of order 8 of runs in float64, relative

The loss is the sum of squares of the last positions.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from tools.bench.nets import reference  # noqa: E402
from tools.bench.speed import hardware  # noqa: E402
from wsim import Scene, Simulation  # noqa: E402
from wsim.gradient.recording import Recording  # noqa: E402
from wsim.physics.fluid.objects import Fluid, Source  # noqa: E402
from wsim.scene import (  # noqa: E402
    Sphere,
    Surface,
    shapes,  # noqa: E402
)
from wsim.scene.curve import Motion  # noqa: E402
from wsim.scene.fabric import Fabric  # noqa: E402
from wsim.scene.solid import Bulk  # noqa: E402

FRAMES = 16
STEPS = (2e-5, 2e-6, 2e-7)           # of |way| = 1 [m]
WEIGHTS = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])


def sheet(n: int, substeps: int) -> Scene:
    scene = reference.spring_cloth(n, stretch=1e3, diagonal=1e3)
    return replace(scene, solver="explicit", integrator="leapfrog", substeps=substeps)


def swept(n: int, substeps: int, ball: bool) -> Scene:
    """By XPBD; over a ball the sheet begins at rest, touches it, and is held by its edge."""
    scene = replace(sheet(n, substeps), solver="xpbd", integrator="backward_euler", iterations=1)
    if ball:
        middle = scene.springs[0].points.mean(axis=0)
        scene.collider("/ball", Sphere(0.2), at=middle - 0.2 * np.array(scene.gravity) / -np.linalg.norm(scene.gravity) * 1.05)
    return scene


def bar(tets: int, substeps: int, implicit: bool) -> Scene:
    cells = max(1, round((tets / 20) ** (1 / 3)))
    scene = Scene(fps=60.0, solver="implicit" if implicit else "explicit", integrator="bdf2" if implicit else "leapfrog",
                  substeps=substeps, iterations=2)
    points, solid = shapes.block((0.4, 0.1, 0.1), (4 * cells, cells, cells))
    body = scene.soft("/bar", points, solid, material=Bulk(young=2e5, poisson=0.3, density=1e3))
    scene.pin("/wall", body, points=np.flatnonzero(points[:, 0] < points[:, 0].min() + 1e-6))
    return scene


def stable(scene: Scene) -> Scene:
    """By as many steps of leapfrog as it takes."""
    choice = Simulation(replace(scene, solver="explicit", integrator="auto", substeps=1)).plan.choice
    return replace(scene, solver="explicit", integrator="leapfrog", substeps=max(choice.substeps, 8))


def bars(tets: int) -> dict[str, Scene]:
    """What else tets have."""
    found = {name: bar(count, 1, False) for name, count in (("damped", tets), ("pressure", tets), ("ten nodes", tets // 8))}
    damped, pressed, ten = (scene.softs[0] for scene in found.values())
    damped.material = replace(damped.material, damping=1e-4)
    pressed.pressure, ten.quadratic = 200.0, True
    return {name: stable(scene) for name, scene in found.items()}


def sides(n: int) -> dict[str, Scene]:
    """What else sheets meet."""
    blown = Scene(fps=60.0, wind=(3.0, 0.5, 1.0))
    points, counts, indices = shapes.sheet(1.0, 1.0, n - 1, n - 1)
    cloth = blown.cloth("/cloth", points, counts, indices, material=Fabric(stretch=1e3, bend=1e-4), model="membrane", drag=0.8,
                        lift=0.4)
    blown.pin("/pin", cloth, range(n))
    held, thrown, fallen = (sheet(n, 1) for _ in range(3))
    held.pins[0].stiffness, held.pins[0].damping = 500.0, 0.1
    for scene, solid, more in ((thrown, Sphere(0.2), {"restitution": 0.6}), (fallen, surface(), {})):
        middle = scene.springs[0].points.mean(axis=0)
        scene.collider("/below", solid, at=middle - (0.0, 0.25, 0.0), **more)
    return {name: stable(s) for name, s in (("wind", blown), ("soft pins", held), ("bounce", thrown), ("mesh", fallen))}


def surface() -> Surface:
    """A box of 12 triangles, 0.4 m."""
    corners = 0.2 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return Surface(corners, [4] * 6, np.concatenate(faces))


class Loss:
    """1/2 |x|^2 of the last positions, and its gradient by the first ones."""

    def __init__(self, scene: Scene, precision: str, keep: str, device: str | None):
        self.sim = Simulation(scene, device=device, precision=precision, gradients=True)
        self.recording = Recording(self.sim, FRAMES, keep)
        self.recording.run()

    def backward(self):
        return self.recording.backward({FRAMES: self.recording.positions(FRAMES)})

    def seconds(self, what) -> float:
        every = []
        for _ in range(3):
            wp.synchronize_device(self.sim.device)
            began = time.perf_counter()
            what()
            wp.synchronize_device(self.sim.device)
            every.append(time.perf_counter() - began)
        return min(every)


def slope(scene: Scene, way: np.ndarray, device: str | None) -> float:
    """Derivative of the loss along `way` by differences of runs, to order 8, with the step that agrees best with a larger one:
    falling sheets amplify, and a step that is too large leaves what is linear."""
    path, found = scene.bodies()[0].path, []
    for step in STEPS:
        found.append(0.0)
        for k, w in enumerate(WEIGHTS, 1):
            for sign in (1, -1):
                sim = Simulation(scene, device=device, precision="float64", gradients=True)
                sim.set(path, "positions", sim.positions() + sign * k * step * way)
                recording = Recording(sim, FRAMES, "checkpoints")
                recording.run()
                found[-1] += sign * w * 0.5 * float((recording.positions(FRAMES) ** 2).sum()) / step
    return found[1 + int(np.argmin(np.abs(np.diff(found))))]


def row(name: str, scene: Scene, device: str | None) -> list[dict]:
    exact = Loss(scene, "float64", "auto", device)
    found = exact.backward().positions()
    way = np.random.default_rng(1).normal(size=found.shape)
    way /= np.linalg.norm(way)
    expected = slope(scene, way, device)
    rows = []
    for keep in ("all", "checkpoints"):
        loss = Loss(scene, "float32", keep, device)
        gradient = loss.backward().positions()
        forward, back = loss.seconds(loss.recording.run), loss.seconds(loss.backward)
        rows.append({"scene": name, "points": len(found), "substeps": FRAMES * scene.substeps, "keep": keep,
                     "forward_ms": 1e3 * forward, "back_over_forward": back / forward, "megabytes": loss.recording.bytes / 1e6,
                     "share": loss.recording.bytes / loss.recording.cost.full,
                     "apart": float(np.linalg.norm(gradient - found) / np.linalg.norm(found)),
                     "slope": abs(float((found * way).sum()) / expected - 1.0), **loss.recording.residuals})
        print("  ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in rows[-1].items()), flush=True)
    return rows


def million(device: str | None) -> dict:
    """Forward and backward over a frame of 64 substeps, each in microseconds a substep; the loss's derivative is on the
    device already."""
    scene = replace(swept(1000, 64, False), frames=1)
    sim = Simulation(scene, device=device, gradients=True)
    recording = Recording(sim, 1)
    recording.run()
    seeds = {1: wp.clone(sim.state.x)}                # where the points are, on the device
    times = []
    for what in (recording.run, lambda: recording.backward(seeds)):
        each = []
        for _ in range(3):
            wp.synchronize_device(sim.device)
            began = time.perf_counter()
            what()
            wp.synchronize_device(sim.device)
            each.append(time.perf_counter() - began)
        times.append(1e6 * min(each) / 64)
    found = {"scene": "sheet 1000, XPBD", "forward_us": times[0], "back_us": times[1], "megabytes": recording.bytes / 1e6}
    print("  ".join(f"{k} {v:.5g}" if isinstance(v, float) else f"{k} {v}" for k, v in found.items()), flush=True)
    return found


def plume(n: int, tolerance: float) -> Scene:
    cell, rng = 1.0 / n, np.random.default_rng(2)
    scene = Scene(fps=24.0, gravity=(0.0, 0.0, -9.81))
    scene.add(Fluid("/air", np.zeros(3), np.ones(3), cell, steps=2, tolerance=tolerance, smoke=rng.uniform(size=(n, n, n)),
                    velocity=0.1 * np.ones((n, n, n, 3))))
    scene.add(Source("/fire", Sphere(0.17), Motion.at_place((0.43, 0.52, 0.21)), smoke=2.0, temperature=60.0))
    scene.collider("/ball", Sphere(0.15), at=(0.55, 0.46, 0.6))
    return scene


class Smoke(Loss):
    """1/2 |smoke|^2 of the last frame."""

    def backward(self):
        return self.recording.backward(fluids={FRAMES: {"/air": {"smoke": self.recording.fluid(FRAMES, "/air")["smoke"]}}})

    def value(self, place: np.ndarray) -> float:
        self.sim.set("/fire", "place", place)
        self.recording.run()
        return 0.5 * float((self.recording.fluid(FRAMES, "/air")["smoke"] ** 2).sum())


def smoke(n: int, device: str | None) -> list[dict]:
    exact, way, rows = Smoke(plume(n, 1e-12), "float64", "auto", device), np.array([0.6, -0.48, 0.64]), []
    gradient = exact.backward()
    by, slope_ = gradient.value("/air", "smoke"), float(gradient.value("/fire", "place") @ way)
    place = exact.sim.scene.things("Source")[0].place
    slopes = [(exact.value(place + h * way) - exact.value(place - h * way)) / (2.0 * h) for h in STEPS]
    for keep in ("all", "checkpoints"):
        loss = Smoke(plume(n, 1e-4), "float32", keep, device)
        found = loss.backward().value("/air", "smoke")
        times, cpu = [], []
        for what in (loss.recording.run, loss.backward):
            began = time.process_time()
            times.append(loss.seconds(what))
            cpu.append(time.process_time() - began)
        rows.append({"scene": f"smoke {n}", "cells": n**3, "steps": 2 * FRAMES, "keep": keep, "forward_ms": 1e3 * times[0],
                     "back_over_forward": times[1] / times[0], "cpu": cpu[1] / cpu[0], "megabytes": loss.recording.bytes / 1e6,
                     "share": loss.recording.bytes / loss.recording.cost.full,
                     "apart": float(np.linalg.norm(found - by) / np.linalg.norm(by)),
                     "slope": min(abs(slope_ / each - 1.0) for each in slopes), **loss.recording.residuals})
        print("  ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in rows[-1].items()), flush=True)
    return rows


def table(args: argparse.Namespace) -> Iterator[list[dict]]:
    """Rows of every scene that was asked for."""
    each = max(1, args.substeps // FRAMES)
    for n in map(int, filter(None, args.smoke.split(","))):
        yield smoke(n, args.device)
    if args.million:
        yield [million(args.device)]
    for n in map(int, filter(None, args.points.split(","))):
        yield row(f"sheet {n}", sheet(n, max(each, round(2.6 * n))), args.device)
        yield row(f"sheet {n}, XPBD", swept(n, each, False), args.device)
        yield row(f"sheet {n}, XPBD, ball", swept(n, each, True), args.device)
    for tets in map(int, filter(None, args.tets.split(","))):
        yield row(f"bar {tets}", bar(tets, each, False), args.device)
        yield row(f"bar {tets}, implicit", bar(tets, 4, True), args.device)
        for name, scene in bars(tets).items():
            yield row(f"bar {tets}, {name}", scene, args.device)
    for name, scene in sides(args.side).items() if args.side else ():
        yield row(f"sheet {args.side}, {name}", scene, args.device)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default=None)
    parser.add_argument("--points", default="32,100", help="a side of the sheets")
    parser.add_argument("--tets", default="2560")
    parser.add_argument("--substeps", type=int, default=1024, help=f"of {FRAMES} frames, explicit")
    parser.add_argument("--side", type=int, default=32, help="0: none of those")
    parser.add_argument("--smoke", default="", help="cells along an axis")
    parser.add_argument("--million", action="store_true")
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    head = {"hardware": hardware(wp.get_device(args.device)), "warp": wp.config.version}
    print(head)
    rows: list[dict] = []
    for each in table(args):
        rows += each
        if args.json:                                    # as they come: time may run out
            Path(args.json).write_text(json.dumps(head | {"rows": rows}, indent=1))


if __name__ == "__main__":
    main()
