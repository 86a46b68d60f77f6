"""Speed of sweeps, substeps, frames and first frames beside their error, on one device.

    python tools/bench/speed.py [--device cuda:0] [--sides 32,100,1000] [--json FILE]

Times are of replayed graphs: the median over runs, on CUDA between two events. A sweep is one pass over all constraints of
a kind. Points are numbered at random; the engine's own order of memory is part of the build that is timed.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from wsim.scene import Scene  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402


def grid_net(n: int, seed: int = 0):
    """n x n points of a 1 m cloth, springs along both sides and both diagonals, points numbered at random."""
    rng = np.random.default_rng(seed)
    name = rng.permutation(n * n).reshape(n, n)
    axis = np.linspace(0.0, 1.0, n)
    points = np.empty((n * n, 3))
    points[name.ravel()] = np.stack([*np.meshgrid(axis, axis), np.zeros((n, n))], -1).reshape(-1, 3)[:, [0, 2, 1]]
    pairs = [(name[:, :-1], name[:, 1:]), (name[:-1], name[1:]), (name[:-1, :-1], name[1:, 1:]),
             (name[:-1, 1:], name[1:, :-1])]
    edges = np.concatenate([np.stack([a.ravel(), b.ravel()], 1) for a, b in pairs])
    return points, rng.permutation(edges), name[0]


def timed(launch, device, repeats: int = 20, inner: int = 10) -> float:
    """Seconds a call of `launch`, replayed from a graph of `inner` calls: the median over repeats."""
    launch()
    with wp.ScopedCapture(device=device, force_module_load=False) as capture:
        for _ in range(inner):
            launch()
    wp.capture_launch(capture.graph)
    wp.synchronize_device(device)
    times = []
    for _ in range(repeats):
        if device.is_cuda:
            begin, end = wp.Event(device, enable_timing=True), wp.Event(device, enable_timing=True)
            wp.record_event(begin)
            wp.capture_launch(capture.graph)
            wp.record_event(end)
            times.append(1e-3 * wp.get_event_elapsed_time(begin, end))
        else:
            began = time.perf_counter()
            wp.capture_launch(capture.graph)
            times.append(time.perf_counter() - began)
    return float(np.median(times)) / inner


def net_scene(n: int, iterations: int = 1) -> tuple[Scene, np.ndarray]:
    points, edges, top = grid_net(n)
    scene = Scene(solver="xpbd", fps=60.0, substeps=10, iterations=iterations)
    net = scene.net("/net", points, edges, [1.0e3], [0.2 / n**2])
    scene.pin("/pin", net, top)
    return scene, edges


def sweep(n: int, device, precision: str = "float32") -> dict:
    """One net: build, a sweep of its distance constraints, a substep, and the strain it is left with."""
    began = time.perf_counter()
    scene, edges = net_scene(n)
    made = time.perf_counter() - began
    sim = Simulation(scene, device=device, precision=precision)
    sim.step()
    batch, xpbd, clock = sim.plan.method("xpbd").batches[0], sim.plan.method("xpbd"), sim.plan.clock
    a_sweep = timed(lambda: xpbd.project(batch, clock), sim.device)
    sim.state.restore_snapshot()
    substep = timed(sim.plan.substep, sim.device)
    sim.reset()
    sim.run(5)
    return {"points": n * n, "constraints": len(edges), "colours": len(batch.starts) - 1, "precision": precision,
            "sweep_us": 1e6 * a_sweep, "G_per_s": len(edges) / a_sweep / 1e9, "substep_us": 1e6 * substep,
            "build_s": sim.seconds["build"], "compile_s": sim.seconds["compile"], "scene_s": made,
            "max_strain": sim.indicators()["max_strain"]}


def launches(n: int, device, frames: int = 30) -> dict:
    """A frame replayed from its graph against the same frame launched kernel by kernel; both end in the same bits."""
    scene, _ = net_scene(n)
    replayed, launched = Simulation(scene, device=device), Simulation(scene, device=device)
    replayed.run(frames)
    launched.step()
    times = []
    for _ in range(frames - 1):
        began = time.perf_counter()
        launched.plan.before_frame(launched.time)
        launched.plan.frame()
        wp.synchronize_device(launched.device)
        launched.frame += 1
        times.append(1e3 * (time.perf_counter() - began))
    graph = float(np.median(replayed.milliseconds[2:]))
    return {"points": n * n, "graph_ms": graph, "launched_ms": float(np.median(times)),
            "times_faster": float(np.median(times)) / graph,
            "same_bits": bool(np.array_equal(replayed.positions(), launched.positions()))}


def scene_speed(name: str, device, frames: int, **settings) -> dict:
    """Frames a second of an example scene with writing off, and its error indicators at the end."""
    from wsim.usd import load
    scene = replace(load(str(ROOT / "scenes" / f"{name}.usda")), **settings)
    sim = Simulation(scene, device=device)
    sim.run(frames)
    ms = float(np.median(sim.milliseconds[2:]))
    error = {k: v for k, v in sim.indicators().items() if k in ("max_strain", "rms_strain", "residual", "penetration")}
    return {"scene": name, "points": sim.model.points, "substeps": scene.substeps, "iterations": scene.iterations,
            "ms_per_frame": ms, "frames_per_s": 1e3 / ms, **error, "warnings": len(sim.warnings)}


def garment_substep(device) -> dict:
    """One substep of the shirt's 6.4k points with distance and dihedral constraints only, one iteration."""
    from wsim.usd import load
    scene = replace(load(str(ROOT / "scenes" / "shirt.usda")), iterations=1, colliders=[])
    cloth = scene.cloths[0]
    scene.cloths = [replace(cloth, model="springs", material=replace(cloth.material, strain_limit=float("inf")))]
    sim = Simulation(scene, device=device)
    sim.step()
    substep = timed(sim.plan.substep, sim.device)
    kinds = {b.kind: b.size for b in sim.plan.method("xpbd").batches}
    return {"scene": "shirt as springs", "points": sim.model.points, **kinds, "substep_ms": 1e3 * substep}


def hardware(device) -> str:
    """Name of the device; of a CPU its model and number of cores."""
    if device.is_cuda:
        return device.name
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    names = [x.partition(":")[2].strip() for x in lines if x.startswith("model name")]
    return f"{names[0] if names else platform.processor()}, {os.cpu_count()} cores"


def agreement(name: str, device, frames: int = 10) -> dict:
    """RMS distance after some frames between the CPU and this device, and of a second run on it, over the scene's size."""
    from wsim.usd import load
    scene = load(str(ROOT / "scenes" / f"{name}.usda"))
    ends = []
    for where in ("cpu", device, device):
        sim = Simulation(scene, device=where)
        sim.run(frames)
        ends.append(sim.positions())
    size = np.ptp(ends[0], axis=0).max()
    return {"scene": name, "frames": frames, "cpu_against_device": float(np.sqrt(np.mean((ends[0] - ends[1])**2)) / size),
            "same_bits_twice": bool(np.array_equal(ends[1], ends[2]))}


COLD = """
import time, resource, sys
import warp as wp
wp.config.log_level = 40
used = lambda: sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
began, spent = time.perf_counter(), used()
from wsim.usd import load
from wsim.simulation.simulation import Simulation
sim = Simulation(load(sys.argv[1]), device=sys.argv[2])
sim.step()
sim.positions()
print(time.perf_counter() - began, used() - spent)
"""


def cold_start(name: str, device) -> dict:
    """Seconds and CPU-seconds from after `import warp` to the first frame, with an empty kernel cache."""
    with tempfile.TemporaryDirectory() as cache:
        scene = str(ROOT / "scenes" / f"{name}.usda")
        out = [subprocess.run([sys.executable, "-c", COLD, scene, str(device)], cwd=ROOT, capture_output=True, text=True,
                              check=True, env=os.environ | {"WARP_CACHE_PATH": cache}).stdout.split()[-2:]
               for _ in range(2)]
    return {"scene": name, "cold_s": float(out[0][0]), "cold_cpu_s": float(out[0][1]), "warm_s": float(out[1][0]),
            "warm_cpu_s": float(out[1][1])}


def show(rows: list[dict], row: dict) -> None:
    rows.append(row)
    print("  ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default=None)
    parser.add_argument("--sides", default="32,100,1000", help="points a side of each net")
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    device = wp.get_device(args.device)
    print(f"{hardware(device)}, warp {wp.config.version}")
    rows: list[dict] = []
    for n in (int(s) for s in args.sides.split(",")):
        show(rows, sweep(n, device))
    show(rows, launches(32, device))
    show(rows, garment_substep(device))
    for iterations in (1, 4):
        show(rows, scene_speed("shirt", device, 60, substeps=10, iterations=iterations))
    for name in ("hanging_cloth", "flag", "cape", "tablecloth"):
        show(rows, scene_speed(name, device, 48))
    for name in ("hanging_cloth", "tablecloth"):
        show(rows, agreement(name, device))
    for name in ("hanging_cloth", "shirt"):
        show(rows, cold_start(name, device))
    if args.json:
        Path(args.json).write_text(json.dumps({"device": hardware(device), "warp": wp.config.version, "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
