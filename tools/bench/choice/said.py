"""What a frame of each example scene is said to take before it runs, over what it takes.

    python -m tools.bench.choice.said [--scenes cape,bear] [--frames 24] [--json FILE]

said      `wsim.simulation.cost`, as `wsim run` prints it [ms]
spent     CPU milliseconds of a frame on one core, without what compiles: median and most of the frames behind the first (the
          most is of a frame that was repeated with contacts, or captured them)
ratio     said over the median
"""

import argparse
import json
import os
from pathlib import Path
from time import process_time

from tools.bench.speed import hardware, show
from wsim.simulation.simulation import Simulation

ROOT = Path(__file__).resolve().parents[3]


def row(name: str, frames: int) -> dict:
    sim, spent = Simulation(ROOT / "scenes" / f"{name}.usda", device="cpu"), []
    for _ in range(min(frames, sim.scene.frames)):
        began = process_time()
        sim.step()
        spent.append(1e3 * (process_time() - began))
    middle, said = sorted(spent[1:])[len(spent) // 2], 1e3 * sim.plan.seconds
    return {"scene": name, "solver": sim.plan.choice.solver, "frames": len(spent) - 1, "said": said, "spent": middle,
            "most": max(spent[1:]), "ratio": said / middle}


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", help="some of the examples, by name; default: all")
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args(argv)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    names = args.scenes.split(",") if args.scenes else sorted(path.stem for path in (ROOT / "scenes").glob("*.usda"))
    rows: list[dict] = []
    for name in names:
        show(rows, row(name, args.frames))
    if args.json:
        import warp as wp
        args.json.write_text(json.dumps({"hardware": hardware(wp.get_device("cpu")), "load": os.getloadavg()[0],
                                         "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
