"""Live use: how even frames are, and what memory they take, while Python moves a collider and pins and sets a stiffness.

    python -m tools.bench.choice.live [--scenes curtain,shirt] [--frames 10000] [--points 33] [--device cuda:0] [--json FILE]

Scenes are those of scenes/examples/live.py. A frame lasts from the first value that is set until positions are there, as a
tensor or an array of the device: wall clock, and on a CPU the process's CPU seconds beside, which others on the machine do not
lengthen, and threads do. Memory: on a GPU the most that the device's pool has held, over the arrays that the plan lists; on a
CPU by how much the process grew from the first tenth of the frames to the last.
"""

import argparse
import json
import resource
import time
from pathlib import Path

import numpy as np
import warp as wp

from scenes.examples import live
from tools.bench.speed import hardware
from wsim.simulation.measure.memory import bytes_held_by

MADE = {"curtain": lambda points: live.curtain(points), "shirt": lambda points: live.shirt()}


def watch(kept: list):
    """A viewer that notes the memory of the process, frame by frame [bytes]."""
    class Watch:
        def log(self, sim) -> None:
            kept.append(1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    return lambda scene: Watch()


def row(name: str, points: int, frames: int, device) -> dict:
    kept: list[int] = []
    cpu: list[float] = []

    def clock() -> float:
        cpu.append(time.process_time())
        return time.perf_counter()
    before = wp.get_mempool_used_mem_current(device) if device.is_cuda else 0
    found = live.run(MADE[name](points), frames, str(device), watch(kept), clock=clock)
    sim, ms = found["simulation"], found["ms"]
    own = 1e3 * np.diff(np.array(cpu).reshape(-1, 2), axis=1)[-frames:, 0]
    said = {"scene": name, "points": sim.model.points, "solver": sim.plan.choice.solver, "substeps": sim.plan.clock.substeps,
            "frames": frames, "median_ms": float(np.median(ms)),
            "p99_over_median": float(np.percentile(ms, 99) / np.median(ms)),
            "most_over_median": float(ms.max() / np.median(ms)), "over_3_medians": int((ms > 3.0 * np.median(ms)).sum()),
            "cpu_median_ms": float(np.median(own)), "cpu_p99_over_median": float(np.percentile(own, 99) / np.median(own)),
            "cpu_most_over_median": float(own.max() / np.median(own)), "forms": sim.forms, "warnings": sim.warnings}
    if device.is_cuda:
        most = wp.get_mempool_used_mem_high(device) - before
        said |= {"listed_bytes": bytes_held_by(sim.plan), "peak_bytes": int(most),
                 "peak_over_listed": most / bytes_held_by(sim.plan)}
    else:
        said |= {"listed_bytes": bytes_held_by(sim.plan), "grew_bytes": kept[-1] - kept[len(kept) // 10]}
    return said


def main() -> None:
    parser = argparse.ArgumentParser(prog="tools.bench.choice.live", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", default="curtain,shirt")
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--points", type=int, default=33, help="a side of the curtain")
    parser.add_argument("--device", default=None)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    device, rows = wp.get_device(args.device), []
    print(hardware(device))
    for name in args.scenes.split(","):
        r = row(name, args.points, args.frames, device)
        rows.append(r)
        memory = (f"peak {r['peak_bytes'] / 1e6:.1f} MB, {r['peak_over_listed']:.2f} of the arrays listed" if device.is_cuda
                  else f"arrays {r['listed_bytes'] / 1e6:.1f} MB, the process grew by {r['grew_bytes'] / 1e6:.1f}")
        print(f"{name}: {r['points']} points, {r['substeps']} substeps of {r['solver']}, {args.frames} frames: median "
              f"{r['median_ms']:.3g} ms, 99 of 100 within {r['p99_over_median']:.2f} of it, most {r['most_over_median']:.2f} "
              f"({r['over_3_medians']} beyond 3); CPU {r['cpu_median_ms']:.3g} ms, {r['cpu_p99_over_median']:.2f}, "
              f"{r['cpu_most_over_median']:.2f}; {memory}; {r['forms']}", flush=True)
        print("\n".join(r["warnings"][:3]))
    if args.json:
        args.json.write_text(json.dumps({"device": hardware(device), "warp": wp.config.version, "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
