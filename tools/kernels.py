"""Where a frame's time goes, kernel by kernel: its launches, their milliseconds, and the share of the frame.

    python tools/kernels.py SCENE ... [--device cuda:0|cpu] [--frames 3] [--after 2] [--top 25] [--json FILE]

SCENE    a USD file; or pile:1000, settled:10000, pyramid:100, column:10 of tools/bench/rigid/speed.py; or plume:128,
         cycle:128, direct:256, ball:128 of tools/bench/fluid/smoke.py (cells along an edge); or twist:50000 of
         tools/bench/contact/twists.py (points; 15 frames, then 30 a turn); or garment:shirt_102k:fps30 (a scene and a setting)
         of tools/bench/nets/garments.py

A frame is run without a graph, launch after launch, and each kernel's time is what CUDA's events say (on a CPU, what the
launch took): the sum is without the gaps between launches. `frame` is the median of
the same frames as a graph, which a user waits for.
"""

import argparse
import json
import sys
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
from tools.bench.contact import twists  # noqa: E402
from tools.bench.fluid import smoke as fluids  # noqa: E402
from tools.bench.nets import garments  # noqa: E402
from tools.bench.rigid import speed  # noqa: E402
from tools.bench.speed import hardware  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

FLUIDS = {"plume": {}, "cycle": {"pressure": "multigrid"}, "direct": {"pressure": "direct"}, "ball": {"ball": True}}


def scene_of(word: str):
    """The scene of a word. SystemExit for an unknown one."""
    name, _, size = word.partition(":")
    if name in speed.SCENES and size:
        args = SimpleNamespace(boxes=int(size), rows=int(size), substeps=8, sweeps=4)
        return replace(speed.SCENES[name](args), frames=1)
    if name in FLUIDS and size:
        return fluids.smoke(int(size), **FLUIDS[name])
    if name == "twist" and size:
        return twists.twist(int(size))
    if name == "garment" and size:
        scene, _, setting = size.partition(":")
        return replace(garments.SCENES[scene](), **garments.SETTINGS[setting or "auto"])
    if not Path(word).exists():
        sys.exit(f"{word}: no such file, and no scene of that name")
    from wsim import load
    return load(word)


def on_cpu(plan) -> list[tuple[str, float]]:
    """(name, milliseconds) of each launch of a frame."""
    seen, launch = [], wp.launch

    def timed(kernel, *args, **more):
        began = time.perf_counter()
        launch(kernel, *args, **more)
        seen.append((kernel.key, 1e3 * (time.perf_counter() - began)))

    wp.launch = timed
    try:
        plan.frame()
    finally:
        wp.launch = launch
    return seen


def on_gpu(plan) -> list[tuple[str, float]]:
    wp.timing_begin(wp.TIMING_ALL)
    plan.frame()
    return [(each.name, each.elapsed) for each in wp.timing_end()]


def measure(word: str, args) -> dict:
    sim = Simulation(scene_of(word), device=args.device, fps=garments.RATES.get(word.rpartition(":")[2]))
    sim.run(args.after)
    whole = []
    for _ in range(args.frames):
        began = time.perf_counter()
        sim.step()
        wp.synchronize_device(sim.device)
        whole.append(1e3 * (time.perf_counter() - began))
    times, counts = defaultdict(float), defaultdict(int)
    for name, elapsed in (on_gpu if sim.device.is_cuda else on_cpu)(sim.plan):
        times[name] += elapsed
        counts[name] += 1
    rows = [{"kernel": name, "launches": counts[name], "ms": times[name]}
            for name in sorted(times, key=times.get, reverse=True)]
    return {"scene": word, "frame_ms": float(np.median(whole)), "sum_ms": sum(times.values()),
            "launches": sum(counts.values()), "kernels": rows}


def shown(row: dict, top: int) -> str:
    lines = [f"{row['scene']}: {row['frame_ms']:.3f} ms a frame; {row['launches']} launches, {row['sum_ms']:.3f} ms in kernels"]
    for each in row["kernels"][:top]:
        lines.append(f"  {each['ms']:9.3f} ms  {100.0 * each['ms'] / row['sum_ms']:5.1f} %  {each['launches']:6} x "
                     f"{1e3 * each['ms'] / each['launches']:9.2f} us  {each['kernel'][:90]}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--json", type=Path)
    for name, value in (("frames", 3), ("after", 2), ("top", 25)):
        parser.add_argument(f"--{name}", type=int, default=value)
    args = parser.parse_args()
    wp.config.quiet = True
    wp.init()
    device, rows = wp.get_device(args.device), []
    for word in args.scenes:
        rows.append(measure(word, args))
        print(shown(rows[-1], args.top), flush=True)
        if args.json:
            args.json.write_text(json.dumps({"hardware": hardware(device), "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
