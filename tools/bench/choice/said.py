"""What a frame of each example scene is said to take before it runs, over what it takes.

    python -m tools.bench.choice.said [--scenes cape,bear] [--frames 24] [--device cpu] [--fps 60] [--json FILE]

said      `wsim.simulation.cost`, as `wsim run` prints it [ms]; with --fps of the setting that is to hold that rate
spent     milliseconds of a frame, of a CPU those of one core, without what compiles: median and most of the frames behind the
          first (the most is of a frame that was repeated with contacts, or captured them)
ratio     said over the median
"""

import argparse
import json
import os
from pathlib import Path
from time import perf_counter, process_time

from tools.bench.speed import hardware, show
from wsim.simulation.simulation import Simulation

ROOT = Path(__file__).resolve().parents[3]


def row(name: str, frames: int, device: str = "cpu", fps: float | None = None) -> dict:
    sim, spent = Simulation(ROOT / "scenes" / f"{name}.usda", device=device, fps=fps), []
    clock = process_time if device == "cpu" else perf_counter
    for _ in range(min(frames, sim.scene.frames)):
        began = clock()
        sim.step()
        spent.append(1e3 * (clock() - began))
    middle, said, choice = sorted(spent[1:])[len(spent) // 2], 1e3 * sim.plan.seconds, sim.plan.choice
    return {"scene": name, "solver": choice.solver, "substeps": choice.substeps, "iterations": choice.iterations,
            "frames": len(spent) - 1, "said": said, "spent": middle, "most": max(spent[1:]), "ratio": said / middle}


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", help="some of the examples, by name; default: all")
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--fps", type=float, help="frames a second that the setting is to hold; default: the scene's setting")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args(argv)
    if args.device == "cpu" and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    names = args.scenes.split(",") if args.scenes else sorted(path.stem for path in (ROOT / "scenes").glob("*.usda"))
    rows: list[dict] = []
    for name in names:
        show(rows, row(name, args.frames, args.device, args.fps))
    if args.json:
        import warp as wp
        args.json.write_text(json.dumps({"hardware": hardware(wp.get_device(args.device)), "load": os.getloadavg()[0],
                                         "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
