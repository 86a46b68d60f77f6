"""Speed of sweeps, substeps and frames beside their error, on one device. `python tools/bench/speed.py [--device cuda:0] [--big]`

Times are of replayed graphs: the median over runs, on CUDA between two events. A sweep is one pass over all constraints of a
kind. The random numbering is undone by the engine's locality order; it is part of what is measured at build.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from wsim.scene import Scene  # noqa: E402
from wsim.simulation import Simulation  # noqa: E402


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
    scene = Scene(fps=60.0, substeps=10, iterations=iterations)
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
    sim.state.restore()
    substep = timed(sim.plan.substep, sim.device)
    sim.reset()
    sim.run(5)
    return {"points": n * n, "constraints": len(edges), "colours": len(batch.starts) - 1, "precision": precision,
            "sweep_us": 1e6 * a_sweep, "G_per_s": len(edges) / a_sweep / 1e9, "substep_us": 1e6 * substep,
            "build_s": sim.seconds["build"], "compile_s": sim.seconds["compile"], "scene_s": made,
            "max_strain": sim.indicators()["max_strain"]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default=None)
    parser.add_argument("--sides", default="32,100,1000", help="points a side of each net")
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    device = wp.get_device(args.device)
    print(f"{device.name}, warp {wp.config.version}")
    rows = []
    for n in (int(s) for s in args.sides.split(",")):
        rows.append(sweep(n, device))
        print("  ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in rows[-1].items()), flush=True)
    if args.json:
        Path(args.json).write_text(json.dumps({"device": device.name, "warp": wp.config.version, "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
