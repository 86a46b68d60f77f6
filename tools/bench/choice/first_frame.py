"""Seconds of a CPU from an empty kernel cache to the first frame of each example scene, and to the end of a run of one frame.

    python -m tools.bench.choice.first_frame [--scenes cape,bear] [--rounds 1] [--json FILE]

Each row is a process of its own with a cache of its own, in CPU seconds of all its threads:

import     of Warp, which the others are counted from            load       from USD, with the imports of wsim
build      the plan                                              compile    the kernels of the plan
frame      what the first frame takes besides                    first      the sum of these four
report     with what it compiles                                 modules    how many were compiled
run        a process `wsim run SCENE --frames 1`, less the import of Warp

Least of the rounds. On a loaded machine they are more than on a quiet one, here by up to a half.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import warp as wp

from tools.bench.speed import hardware, show

ROOT = Path(__file__).resolve().parents[3]

STAGES = """
import json, sys
from time import process_time
seconds, at = {}, process_time()
def stage(name):
    global at
    now = process_time()
    seconds[name], at = now - at, now
import warp
stage("import")
from wsim.usd import load
from wsim.simulation.simulation import Simulation
scene = load(sys.argv[1])
stage("load")
sim = Simulation(scene, device="cpu")
stage("build")
sim.load()
stage("compile")
sim.step()
stage("frame")
sim.report(profile=False)
stage("report")
print(json.dumps(seconds))
"""
PARTS = ("load", "build", "compile", "frame")


def examples() -> list[str]:
    return sorted(path.stem for path in (ROOT / "scenes").glob("*.usda"))


def process(command: list[str]) -> tuple[str, float, int]:
    """What a Python process with an empty kernel cache prints, its CPU seconds, and how many modules it compiled."""
    with tempfile.TemporaryDirectory() as cache:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run([sys.executable, *command], cwd=ROOT, check=True, capture_output=True, text=True,
                              env=os.environ | {"WARP_CACHE_PATH": cache})
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return done.stdout, spent, len(list(Path(cache).rglob("*.cpp")))


def row(name: str) -> dict:
    path = str(ROOT / "scenes" / f"{name}.usda")
    text, _, modules = process(["-c", STAGES, path])
    seconds = json.loads(text.splitlines()[-1])
    with tempfile.TemporaryDirectory() as place:
        _, whole, _ = process(["-m", "wsim", "run", path, "--frames", "1", "--device", "cpu", "-o", f"{place}/out.usdc"])
    return {"scene": name, **seconds, "modules": modules, "first": sum(seconds[part] for part in PARTS),
            "run": whole - seconds["import"]}


def least(rows: list[dict]) -> dict:
    return {key: value if isinstance(value, str) else min(r[key] for r in rows) for key, value in rows[0].items()}


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", help="some of the examples, by name; default: all")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args(argv)
    rows: list[dict] = []
    for name in args.scenes.split(",") if args.scenes else examples():
        show(rows, least([row(name) for _ in range(args.rounds)]))
    if args.json:
        said = {"hardware": hardware(wp.get_device("cpu")), "load": os.getloadavg()[0], "rows": rows}
        args.json.write_text(json.dumps(said, indent=1) + "\n")


if __name__ == "__main__":
    main()
