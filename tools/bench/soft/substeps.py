"""Soft bodies: time of a substep and a frame beside what was solved, by size, material and integrator.

    python tools/bench/soft/substeps.py [--device cuda:0|cpu] [--cells 8,17,58] [--model corotational,neo_hookean] [--json FILE]

A cube of 1 m, n^3 cells of five tets, E 1e6 Pa, nu 0.3, 1000 kg/m^3, one face held, falls under its weight from rest: frames of
1/60 s, n substeps of `newton` steps each (leapfrog: what it needs, and 0). residual is that of the last Newton step over
inertia and weight; pcg the iterations of the last substep. ms is the median of the later frames, each waited for. build_s,
compile_s: once, as is.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tools.bench.speed import hardware  # noqa: E402
from wsim import Scene, Simulation  # noqa: E402
from wsim.scene import shapes  # noqa: E402
from wsim.scene.solid import Bulk  # noqa: E402

ROWS = ((0, 1, "leapfrog"), (10, 1, "backward_euler"), (4, 1, "backward_euler"), (4, 1, "bdf2"), (4, 2, "bdf2"),
        (1, 2, "backward_euler"))


def cube(cells: int, model: str, substeps: int, iterations: int, integrator: str) -> Scene:
    scene = Scene(gravity=(0, -9.81, 0), fps=60.0, frames=10, solver="implicit", substeps=max(substeps, 1),
                  iterations=iterations, integrator=integrator)
    if integrator == "leapfrog":
        scene.solver, scene.integrator = "explicit", "auto"                  # as many substeps as it needs
    points, tets = shapes.block((1.0, 1.0, 1.0), (cells, cells, cells))
    body = scene.soft("/cube", points, tets, material=Bulk(young=1e6, poisson=0.3, density=1e3, model=model))
    scene.pin("/wall", body, points=np.flatnonzero(points[:, 0] < points[:, 0].min() + 1e-6))
    return scene


def row(cells: int, model: str, setting: tuple, device: str, frames: int) -> dict:
    began = time.perf_counter()
    sim = Simulation(cube(cells, model, *setting), device=device)
    sim.step()
    first, times, iterations = time.perf_counter() - began, [], []
    newton = sim.plan.ports.newton_assembly
    for _ in range(frames):
        start = time.perf_counter()
        sim.step()
        times.append(1e3 * (time.perf_counter() - start))
        iterations.append(int(newton.system.count.numpy().max()) if newton else 0)
    found, substeps = sim.indicators(), sim.plan.clock.substeps
    drop = float(-sim.positions()[:, 1].min() - 0.5)
    return {"cells": cells, "tets": len(sim.scene.softs[0].tets), "points": sim.model.points, "model": model,
            "substeps": substeps, "newton": setting[1] * bool(newton), "integrator": setting[2], "ms": float(np.median(times)),
            "ms_substep": float(np.median(times)) / substeps, "pcg": int(np.median(iterations)),
            "residual": found.get("residual", 0.0), "solid_strain": found["solid_strain"], "drop": drop,
            "build_s": sim.seconds["build"], "compile_s": sim.seconds["compile"], "first_s": first,
            "warnings": len(sim.warnings)}


def kernels(cells: int, model: str, setting: tuple, device: str) -> list[tuple[str, int, float]]:
    """(kernel, launches, ms) of one frame, launched one by one; by a GPU's own clock. Largest first."""
    sim = Simulation(cube(cells, model, *setting), device=device)
    sim.run(2)
    sim.plan.before_frame(sim.time)
    wp.timing_begin(cuda_filter=wp.TIMING_ALL, synchronize=False)
    sim.plan.frame()
    found: dict[str, list] = {}
    for r in wp.timing_end():
        found.setdefault(r.name, []).append(r.elapsed)
    return sorted(((name, len(ms), sum(ms)) for name, ms in found.items()), key=lambda f: -f[2])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default=None)
    parser.add_argument("--cells", default="8,17,58")
    parser.add_argument("--model", default="corotational,neo_hookean")
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--rows", type=int, default=len(ROWS), help="so many of the settings")
    parser.add_argument("--kernels", action="store_true", help="time of each kernel in a frame (GPU)")
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    wp.config.quiet = True
    device, found = str(wp.get_device(args.device)), []
    print(hardware(wp.get_device(device)))
    print(f"{'tets':>9}{'points':>8}  {'model':<14}{'integrator':<16}{'n x newton':>11}{'ms/frame':>10}{'ms/sub':>8}{'pcg':>5}"
          f"{'residual':>10}{'strain':>8}{'drop m':>8}{'build s':>9}{'compile s':>10}")
    for model in args.model.split(","):
        for cells in map(int, args.cells.split(",")):
            for setting in ROWS[:args.rows]:
                r = row(cells, model, setting, device, args.frames)
                found.append(r)
                print(f"{r['tets']:>9}{r['points']:>8}  {model:<14}{r['integrator']:<16}{r['substeps']:>7} x {r['newton']}"
                      f"{r['ms']:>10.3f}{r['ms_substep']:>8.3f}{r['pcg']:>5}{r['residual']:>10.1e}{r['solid_strain']:>8.3f}"
                      f"{r['drop']:>8.4f}{r['build_s']:>9.2f}{r['compile_s']:>10.2f}", flush=True)
        for cells in map(int, args.cells.split(",") if args.kernels else ()):
            for setting in ROWS[:2]:
                print(f"{cells}^3 cells, {model}, {setting}:")
                for name, count, ms in kernels(cells, model, setting, device)[:12]:
                    print(f"  {ms:9.3f} ms {count:6} x {1e3 * ms / count:9.2f} us  {name[:70]}", flush=True)
    if args.json:
        Path(args.json).write_text(json.dumps({"hardware": hardware(wp.get_device(device)), "warp": wp.__version__,
                                               "rows": found}, indent=1) + "\n")


if __name__ == "__main__":
    main()
