"""The fixed suite: problems with known answers (problems.py, soft/problems.py) by every method, run time and error of each row.

    python tools/bench/suite.py [--device cuda:0|cpu] [--only TEXT,...] [--quick] [--precision float64] [--cache FOLDER]
                                [--warm] [--json FILE]

A new method is one line in METHODS, a new problem one in PROBLEMS. A row is named "problem solver integrator substeps x
iterations"; --only takes rows whose name has one of the texts. Substeps are those of the problem: of explicit methods what
leapfrog is stable with and so many times it. --quick: each method once on the problems that take seconds on a CPU.
--warm: two frames of each row and no answer, so that the kernels of a later run are compiled.

    ms          median of the frames after the first WARM: compiled, captured, replayed, with what the host does around it
    error       after the problem's time, in its unit; `known`: below that it says nothing about the method
    discrete    distance from the integrator's own closed form
    failed      why a row could not be run; where nothing moved or another solver was taken, it was not run either
    not finite  it ran and blew up, or has no answer
"""

import argparse
import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
import wsim  # noqa: E402
from tools.bench import problems  # noqa: E402
from tools.bench.problems import Problem  # noqa: E402
from tools.bench.soft import problems as soft_problems  # noqa: E402
from tools.bench.speed import hardware  # noqa: E402
from wsim.scene import SceneError  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

PROBLEMS = (*problems.PROBLEMS, *soft_problems.PROBLEMS)
WARM = 3


@dataclass(frozen=True)
class Method:
    """solver and integrator as `Scene` names them; iterations tried; for explicit ones, times the stable substeps."""

    solver: str
    integrator: str
    iterations: tuple[int, ...] = (1,)
    times: tuple[int, ...] = ()

    def settings(self, problem: Problem) -> Iterator[dict]:
        """What it is run with on a problem, the cheapest first."""
        for substeps in [problem.stable * k for k in self.times] or problem.substeps:
            for iterations in self.iterations:
                yield {"solver": self.solver, "integrator": self.integrator, "substeps": substeps, "iterations": iterations}


METHODS = (
    Method("explicit", "leapfrog", times=(1, 4)),
    Method("explicit", "rk4", times=(1, 4)),
    Method("explicit", "symplectic_euler", times=(1, 4)),
    Method("xpbd", "backward_euler", (4, 16)),
    Method("xpbd", "bdf2", (4, 16)),
    Method("implicit", "backward_euler", (1, 3)),
    Method("implicit", "bdf2", (1, 3)),
    Method("implicit", "implicit_midpoint", (1, 3)),
    Method("implicit", "sdirk3", (2,)),
)


def name_of(problem: str, setting: dict) -> str:
    return (f"{problem} {setting['solver']} {setting['integrator']} {setting['substeps']} x {setting['iterations']}")


def rows(quick: bool = False, only: tuple[str, ...] = ()) -> list[tuple[Problem, dict]]:
    """What is run, in order."""
    found = []
    for problem in PROBLEMS:
        for method in METHODS if problem.quick or not quick else ():
            if problem.solvers and method.solver not in problem.solvers:
                continue
            settings = list(method.settings(problem))
            found += [(problem, s) for s in (settings[:1] if quick else settings)]
    return [(p, s) for p, s in found if not only or any(text in name_of(p.name, s) for text in only)]


def judged(row: dict, found: dict[str, float]) -> dict:
    """The row with what was measured; what is no number is None, and the row not finite."""
    finite = all(isfinite(value) for value in found.values())
    return row | {k: v if isfinite(v) else None for k, v in found.items()} | {"finite": finite}


def run(problem: Problem, setting: dict, device, precision="float32", cache: str | None = None, warm=False) -> dict:
    """One row. `ran` are the substeps at the end: a simulation may have taken more than it was given."""
    row = {"name": name_of(problem.name, setting), "problem": problem.name, "unit": problem.unit,
           "known": problem.known} | setting
    try:
        scene = problem.make()
        # before there was a choice of solver there was XPBD
        given = setting if hasattr(scene, "solver") or setting["solver"] != "xpbd" else {
            k: v for k, v in setting.items() if k != "solver"}
        sim = Simulation(replace(scene, **given), device=device, precision=precision)
        start = sim.positions()
        with np.errstate(all="ignore"):          # what flew apart overflows in the judge: not finite
            found = {"error": 0.0} if warm else problem.judge(sim, cache)
            if warm:
                sim.run(2)
    except Exception as error:                   # refused, unknown to this revision, or broken: said by name either way
        kind = "" if isinstance(error, SceneError) else f"{type(error).__name__}: "
        return row | {"failed": f"{kind}{error}", "finite": False}
    unlike = idle(sim, start, setting)
    if unlike:
        return row | {"failed": unlike, "finite": False}
    times = sim.milliseconds[WARM:] or sim.milliseconds
    return judged(row | {"ms": float(np.median(times)), "ran": sim.plan.clock.steps, "warnings": warned(sim)}, found)


def idle(sim: Simulation, start: np.ndarray, setting: dict) -> str:
    """Why a run is no run of its method, or "": a revision may know a name and have nothing behind it."""
    if np.array_equal(sim.positions(), start):
        return "nothing moved: no stage of the plan steps it"
    solver = getattr(getattr(sim.plan, "choice", None), "solver", setting["solver"])
    return "" if solver == setting["solver"] else f"was stepped by {solver} instead"


def warned(sim: Simulation) -> list[str]:
    """What became of the method on the way; warnings of the scene itself say nothing about it."""
    return [text for text in sim.warnings if "no pin holds it" not in text and " across: it bends" not in text]


def line(row: dict) -> str:
    """A row of the printed table."""
    if "failed" in row:
        return f"{row['name']:<54}  cannot run: {row['failed'].splitlines()[0][:120]}"
    unit = " m" if row["unit"] == "m" else ""
    error = f"{row['error']:9.2e}{unit:<2}" if row["finite"] else "  no number"
    more = [f"{k} {row[k]:.1e}" for k in ("discrete", "error_05", "drift", "penetration") if row.get(k) is not None]
    if row["finite"] and row["error"] <= row["known"]:
        more.append("as good as the answer is known")
    if row["ran"] != row["substeps"]:
        more.append(f"took {row['ran']} substeps")
    return f"{row['name']:<54}{row['ms']:10.3f} ms  {error}  {', '.join(more)}" + "  !" * bool(row["warnings"])


def commit(root: Path = ROOT) -> str:
    """Of a checkout; "unknown" without git."""
    try:
        return subprocess.run(["git", "describe", "--always", "--dirty", "--exclude", "*"], cwd=root, capture_output=True,
                              text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def head(device, precision: str) -> dict:
    """What the figures were measured on and with."""
    return {"hardware": hardware(device), "device": str(device), "precision": precision, "wsim": commit(),
            "warp": wp.config.version, "numpy": np.__version__, "python": platform.python_version()}


def write(path: str, found: dict) -> None:
    """JSON, whole or not at all."""
    part = Path(f"{path}.part")
    part.write_text(json.dumps(found, indent=1, allow_nan=False))
    os.replace(part, path)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default=None)
    parser.add_argument("--only", default="", help="rows whose name has one of these texts, comma between them")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--precision", default="float32", choices=("float32", "float64"))
    parser.add_argument("--cache", default=None, help="folder that keeps exact trajectories")
    parser.add_argument("--warm", action="store_true")
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    if Path(wsim.__file__).resolve().parents[1] != ROOT:
        parser.error(f"this would time another wsim, the one of {Path(wsim.__file__).parent}")
    wanted = rows(args.quick, tuple(filter(None, args.only.split(","))))
    if not wanted:
        parser.error(f"--only {args.only}: no row has that in its name; problems are {', '.join(p.name for p in PROBLEMS)}, "
                     f"methods {', '.join(f'{m.solver} {m.integrator}' for m in METHODS)}")
    wp.config.log_level = wp.LOG_WARNING
    try:
        device = wp.get_device(args.device)
    except Exception:
        parser.error(f"--device {args.device}: allowed are {', '.join(str(d) for d in wp.get_devices())}")
    about, found = head(device, args.precision), []
    print(", ".join(f"{k} {v}" for k, v in about.items()), flush=True)
    for problem, setting in wanted:
        found.append(run(problem, setting, device, args.precision, args.cache, args.warm))
        print(line(found[-1]), flush=True)
    if args.json:
        write(args.json, about | {"rows": found})
    return 0


if __name__ == "__main__":
    sys.exit(main())
