"""Rigid bodies: the same scenes by wsim, MuJoCo and Newton's solvers, time of a frame beside error, row by row.

    python tools/bench/rigid/peers.py [--peer-python X/bin/python] [--device cuda:0|cpu] [--json FILE] [--only NAME,...]
                                      [--engines wsim,mujoco,...] [--rounds 3] [--limit 300] [--again] [--table]

X is an environment of the peers' own; what it lacks is said and left out:

    python -m venv X; X/bin/pip install mujoco==4.0.0 newton==1.8.0 mujoco-warp==4.0.0 warp-lang==1.19.0

Without a net: the wheels of mujoco, mujoco_core, newton, mujoco_warp, absl_py and etils (21 MB for Python 3.12) unzipped into a
folder that PYTHONPATH names, and wsim's own interpreter, which has Warp and NumPy, as the peer's.

Scenes, and what they are judged by, are in problems.py; engines in run_NAME.py, each run in a process of its own.
The rows of a scene run in turns, `rounds` times, and ms and cpu_ms are the least of all turns: others may use the machine.
Rows that FILE has are kept and not run again, so that a run cut short goes on where it was. Each engine runs at a setting at
which the columns stand and at its own default. MuJoCo runs on a CPU only, in float64; others in float32 but where it is said.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tools.bench.rigid.problems import PROBLEMS, Problem  # noqa: E402
from tools.bench.rigid.settings import ENGINES, Engine, settings  # noqa: E402
from tools.bench.rigid.table import line, slower, table  # noqa: E402
from tools.bench.speed import hardware  # noqa: E402

LIMIT = 300                      # [s] that one run of one row may take, where nothing else is said


def present(engine: Engine, python: str) -> bool:
    """Whether an interpreter has what an engine needs."""
    code = "import importlib.util as u, sys; sys.exit(any(u.find_spec(m) is None for m in sys.argv[1:]))"
    return subprocess.run([python, "-c", code, *engine.modules], stdout=subprocess.DEVNULL).returncode == 0


def run(row: dict, problem: Problem, scene: dict, args: argparse.Namespace, folder: Path) -> dict:
    """One turn of a row, with its errors."""
    engine = ENGINES[row["engine"]]
    for name, data in (("scene", scene), ("setting", row["setting"])):
        (folder / f"{name}.json").write_text(json.dumps(data))
    out = folder / "out.npz"
    out.unlink(missing_ok=True)
    python = sys.executable if engine.own else args.peer_python
    command = [python, str(ROOT / "tools/bench/rigid" / engine.runner), "scene.json", "setting.json", "out.npz", "--device",
               args.device if engine.gpu else "cpu"]
    try:
        ended = subprocess.run(command, cwd=folder, timeout=args.limit, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    except subprocess.TimeoutExpired:
        return {"finite": False, "failed": f"not within {args.limit:g} s"}
    if not out.exists():
        said = ended.stderr.decode(errors="replace").strip().splitlines()
        return {"finite": False, "failed": said[-1] if said else f"exit code {ended.returncode}"}
    with np.load(out) as found:
        result = json.loads(str(found["row"]))
        if result["finite"]:
            result["errors"] = problem.judge(scene, {name: found[name] for name in "xqvw"})
    return result


def turns(problem: Problem, rows: list[dict], args: argparse.Namespace, folder: Path) -> None:
    """All rows of a scene, in turns; the first turn says the errors, all of them the times."""
    scene = problem.make()
    for turn in range(args.rounds):
        for row in rows:
            if row.get("failed"):
                continue
            found = run(row, problem, scene, args, folder)
            if turn == 0:
                row |= found
            elif found["finite"]:
                row |= {name: min(row[name], found[name]) for name in ("ms", "cpu_ms", "first_s") if name in found}
            row["rounds"] = turn + 1
    for row in rows:
        print(line(row, problem), flush=True)


def wanted(problem: Problem, args: argparse.Namespace, have: set[str]) -> list[dict]:
    return [{"problem": problem.name, "engine": name, "setting": setting} for name in ENGINES if name in have
            for setting in settings(name, problem.name, args.device != "cpu")]


def same(row: dict) -> tuple:
    return row["problem"], row["engine"], json.dumps(row["setting"], sort_keys=True)


def opened(args: argparse.Namespace, head: dict) -> list[dict]:
    """Rows of the file. SystemExit where they are of other hardware."""
    if not args.json or not args.json.exists():
        return []
    before = json.loads(args.json.read_text())
    if before["hardware"] != head["hardware"]:
        sys.exit(f"{args.json} has rows of {before['hardware']}; this is {head['hardware']}. Take another file")
    return before["rows"]


def written(args: argparse.Namespace, head: dict, rows: list[dict]) -> None:
    if args.json:
        part = args.json.with_suffix(".part")
        part.write_text(json.dumps(head | {"rows": rows}, indent=1, allow_nan=False))
        os.replace(part, args.json)


def problems(args: argparse.Namespace) -> list[Problem]:
    """SystemExit for a name that is none."""
    names = args.only.split(",") if args.only else [name for name, p in PROBLEMS.items() if args.device != "cpu" or not p.gpu]
    if unknown := set(names) - set(PROBLEMS):
        sys.exit(f"--only: no scene {', '.join(sorted(unknown))}; there are {', '.join(PROBLEMS)}")
    return [PROBLEMS[name] for name in names]


def clock(device: str) -> str:
    """Which time decides."""
    return "cpu_ms" if device == "cpu" else "ms"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer-python", default=None, help="interpreter of an environment with the peers, see above")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--only", default=None, help="scenes; all that suit the device where left out")
    parser.add_argument("--engines", default=",".join(ENGINES))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--limit", type=float, default=LIMIT, help="seconds that one run of one row may take")
    parser.add_argument("--again", action="store_true", help="run rows that the file has once more")
    parser.add_argument("--table", action="store_true", help="print the file's rows as a table, run nothing")
    parser.add_argument("--json", type=Path, default=None)
    args = parser.parse_args()
    if args.peer_python:
        args.peer_python = os.path.abspath(args.peer_python)          # not resolved: a link is how a venv knows itself
    wp.config.log_level = wp.LOG_WARNING
    if args.table:
        found = json.loads(args.json.read_text())
        print(table(found["rows"]), *slower(found["rows"], clock(found["device"])), sep="\n")
        return
    head = {"hardware": hardware(wp.get_device(args.device)), "device": args.device, "warp": wp.config.version}
    rows, have = opened(args, head), set()
    for name in args.engines.split(","):
        if ENGINES[name].own or (args.peer_python and present(ENGINES[name], args.peer_python)):
            have.add(name)
        else:
            print(f"left out: {name}, which wants {', '.join(ENGINES[name].modules)} in --peer-python")
    print(head)
    with tempfile.TemporaryDirectory() as folder:
        for problem in problems(args):
            known = {} if args.again else {same(row): row for row in rows if not row.get("failed")}
            fresh = [row for row in wanted(problem, args, have) if same(row) not in known]
            turns(problem, fresh, args, Path(folder))
            replaced = {same(row) for row in fresh}
            rows = [row for row in rows if same(row) not in replaced] + fresh
            written(args, head, rows)                                 # after every scene: a run cut short keeps its rows
    print(*slower(rows, clock(args.device)), sep="\n")


if __name__ == "__main__":
    main()
