"""wsim beside Newton's solvers on the same net of springs in one run: time of a frame and error, row by row, and verdicts.

    python tools/bench/nets/peers.py --peer-python X/bin/python [--device cuda:0|cpu] [--sides 32,64] [--stiffness 1e3,1e5]
                                [--garment] [--quick] [--cache FOLDER] [--json FILE]

The environment X, apart from wsim's own (three packages; Newton imports no others for this):

    python -m venv X; X/bin/pip install warp-lang==1.19.0 numpy; X/bin/pip install --no-deps newton==1.8.0

Without a net: the wheels newton-1.8.0-py3-none-any (9 MB), warp_lang-1.19.0-py3-none-manylinux_2_28_x86_64 and NumPy's for
that Python, X/bin/pip install --no-index --no-deps *.whl. Where wsim's own environment has them but Newton, its interpreter
may be the peer's too, with Newton's wheel unzipped into a folder that PYTHONPATH names (the process is another still).

The sheet is `reference.spring_cloth`, 1 m, weak cross springs, 0.2 kg/m^2, one edge pinned, 60 frames a second; errors are
RMS distances [m] from the exact float64 trajectory at 0.25 s and 0.5 s. The garment is garment.py's, judged by its energy
and strain. peer_newton.py runs Newton in a process of its own and says what was switched off there, and why Style3D is missing.
Both sides replay graphs and wait for each frame; ms is the median of the later frames. first_s is from the scene to the end of
the first frame, with an empty kernel cache: a solver's first row compiles. verdict.py says what the verdicts are; its
time is that of 0.25 s. `limit` is the number of substeps that keep symplectic Euler stable by reference.Net.frequency.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tools.bench.nets import garment, reference  # noqa: E402
from tools.bench.soft.runs import plain  # noqa: E402
from tools.bench.speed import hardware  # noqa: E402
from tools.bench.verdict import verdicts  # noqa: E402
from wsim.scene import Scene, SceneError  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

FRAME, TIMES = 1.0 / 60.0, (0.25, 0.5)       # [s]
ENDS = [round(t / FRAME) for t in TIMES]
KEY = "error_025"
LEFT_OUT = {"SolverStyle3D": "reads no springs, only triangles of its own: another model, with another trajectory"}
STABLE = (0.72, 0.725, 0.76, 0.8, 1.05, 1.5, 2.0, 4.0, 8.0, 16.0)     # times the limit, a bound that cloths undercut by sqrt(2)
MOST = 4096                                  # substeps of an explicit row past twice the limit

# (solvers, substeps x iterations); VBD and XPBD of Newton
IMPLICIT = ((1, 16), (2, 16), (4, 4), (4, 16), (8, 8), (8, 16), (16, 4), (16, 16), (32, 4), (32, 16), (64, 4), (64, 16))
PEER = ((("xpbd", "vbd", "vbd_tile"), IMPLICIT), (("vbd", "vbd_tile"), ((16, 64),)))
# Newton's XPBD adds up the corrections of all springs of a point without a damping factor: it needs steps near the limit
PEER_FINE = ("xpbd", (0.5, 0.72, 0.8, 1.05, 1.5, 2.0, 4.0), (1, 2, 4))
# (solver, integrators, substeps, iterations): every combination
OWN = (("xpbd", ("backward_euler", "bdf2"), (1, 2, 4, 8, 16), (4, 8, 16)),
       ("xpbd", ("backward_euler",), (1,), (2, 3)),
       ("xpbd", ("bdf2",), (32, 64), (4, 16)),
       ("implicit", ("backward_euler", "bdf2", "implicit_midpoint"), (1, 2, 4, 8, 16), (1, 2)),
       ("auto", ("auto",), (10,), (4,)))
OWN_EXPLICIT = (("leapfrog", 1.0), ("symplectic_euler", 1.0), ("rk4", 2.0**0.5))    # and how much longer a step it takes

QUICK_PEER = ((("xpbd", "vbd"), ((1, 16), (4, 16), (8, 8), (16, 16))),)
QUICK_OWN = (("xpbd", ("backward_euler", "bdf2"), (1, 4, 8, 16), (4, 16)), ("implicit", ("bdf2",), (2, 4, 8), (1, 2)),
             ("auto", ("auto",), (10,), (4,)))
QUICK_FINE = ("xpbd", (0.72, 1.05, 2.0), (1,))
QUICK_STABLE = (0.72, 0.76, 0.8, 1.05, 2.0)


def stable(limit: float, quick: bool) -> list[int]:
    """Substeps about and over the limit, ascending."""
    return sorted({math.ceil(f * limit) for f in (QUICK_STABLE if quick else STABLE) if f <= 2.0 or f * limit <= MOST})


def peer_settings(limit: float, device: wp.Device, quick: bool) -> list[dict]:
    rows = [(solver, *steps) for solvers, all_steps in (QUICK_PEER if quick else PEER) for solver in solvers
            for steps in all_steps if solver != "vbd_tile" or device.is_cuda]
    solver, factors, iterations = QUICK_FINE if quick else PEER_FINE
    rows += [(solver, math.ceil(f * limit), i) for f in factors for i in iterations if f <= 2.0 or f * limit <= MOST]
    rows += [("semi_implicit", substeps, 1) for substeps in stable(limit, quick)]
    return [dict(zip(("solver", "substeps", "iterations"), row, strict=True)) for row in rows]


def own_settings(limit: float, quick: bool) -> list[dict]:
    rows = [(solver, integrator, substeps, i) for solver, integrators, all_substeps, iterations in (QUICK_OWN if quick else OWN)
            for integrator in integrators for substeps in all_substeps for i in iterations]
    rows += [("explicit", name, substeps, 1) for name, longer in OWN_EXPLICIT for substeps in stable(limit / longer, quick)]
    return [dict(zip(("solver", "integrator", "substeps", "iterations"), row, strict=True)) for row in rows]


class Sheet:
    """The cloth of n by n points and springs of k [N/m], with its exact positions at TIMES."""

    def __init__(self, n: int, k: float, folder):
        self.name, self.scene = f"sheet, n {n}, k {k:g} N/m", reference.spring_cloth(n, stretch=k, diagonal=k)
        self.net = reference.net(self.scene)
        tolerance = 1e-6 if n * n * k > 2e8 else 1e-7
        self.where, error = reference.exact(self.net, TIMES, tolerance, folder=folder)
        self.facts = {"n": n, "stiffness": k, "exact_error": error}
        self.worst = reference.rms(self.net.points - self.where[0])

    def judge(self, states) -> dict[str, float]:
        return {f"error_{name}": reference.rms(x - where) for (x, _), name, where in
                zip(states, ("025", "05"), self.where, strict=True)}


class Shirt:
    """The garment; a row whose energy or strain is wrong by half is no solution."""

    name, worst = "garment", 0.5

    def __init__(self, folder):
        self.scene = garment.shirt()
        hanging = garment.Hanging(self.scene, TIMES, FRAME, folder)
        self.net, self.judge = hanging.net, hanging.judge
        self.facts = {"points": len(self.net.points), "reference_energy_error": hanging.drift}


def row_of(problem, row: dict, states: list) -> dict:
    """The row with its errors, or with finite False. A run that flew apart overflows in the judge: no number either."""
    with np.errstate(over="ignore", invalid="ignore"):
        errors = problem.judge(states) if row["finite"] else {}
    return row | errors | {"finite": bool(errors) and bool(np.isfinite(list(errors.values())).all())}


def own(problem, setting: dict, device: wp.Device) -> dict:
    """One row of ours; `ran` are the substeps that were run."""
    row = {"side": "wsim"} | setting
    try:
        scene: Scene = replace(problem.scene, **setting)
        sim, states = Simulation(scene, device=device), []
        for end in ENDS:
            sim.run(end - sim.frame)
            states.append((sim.positions(), sim.velocities()))
    except Exception as error:                    # refused, or broken: a row of the table either way
        kind = "" if isinstance(error, SceneError) else f"{type(error).__name__}: "
        return row | {"finite": False, "failed": f"{kind}{error}"}
    row |= {"ms": float(np.median(sim.milliseconds[3:])), "first_s": sim.seconds["build"] + sim.seconds["first_frame"],
            "ran": sim.plan.clock.substeps, "warnings": sim.warnings, "finite": True}
    return row_of(problem, row, states)


def peer(problem, settings: list[dict], args: argparse.Namespace, folder: Path) -> tuple[list[dict], dict]:
    """Newton's rows, and its versions. CalledProcessError when its process ends badly."""
    net = problem.net
    np.savez(folder / "problem.npz", points=net.points, edges=net.edges, stiffness=net.stiffness, lengths=net.lengths,
             masses=net.masses, pinned=net.pinned, gravity=net.gravity, frame=FRAME, ends=ENDS)
    (folder / "settings.json").write_text(json.dumps(settings))
    subprocess.run([args.peer_python, str(Path(__file__).with_name("peer_newton.py")), "problem.npz", "settings.json", ".",
                    *(["--device", args.device] if args.device else [])], cwd=folder, check=True,
                   stdout=subprocess.DEVNULL, env=os.environ | {"WARP_CACHE_PATH": str(folder / "kernels")})
    versions = json.loads((folder / "rows.json").read_text())
    rows = []
    with np.load(folder / "states.npz") as found:
        for number, row in enumerate(versions.pop("rows")):
            states = list(zip(found[f"x{number}"], found[f"v{number}"], strict=True)) if "ms" in row else []
            rows.append(row_of(problem, {"side": "newton", "integrator": ""} | row, states))
    return rows, versions


def line(row: dict) -> str:
    text = (f"  {row['side']:<7}{row['solver']:<14}{row['integrator']:<18}{row.get('ran', row['substeps']):>6} x "
            f"{row['iterations']:<3}")
    if "ms" not in row:
        return f"{text}  {row['failed'].splitlines()[0][:110]}"
    errors = f"{row['error_025']:>10.2e}{row['error_05']:>10.2e}" if row["finite"] else f"{'no number':>20}"
    return f"{text}{row['ms']:>10.3f}{errors}{row['first_s']:>9.2f}" + ("  !" if row.get("warnings") else "")


def said(name: str, pair: dict | None) -> str:
    """A verdict in a line."""
    if pair is None:
        return f"  {name}: Newton has no usable row"
    rows = [f"{r['solver']} {r['integrator']} {r.get('ran', r['substeps'])} x {r['iterations']}, {r['ms']:.3f} ms, {r[KEY]:.1e}"
            for r in (pair["peer"], pair["ours"]) if r]
    return f"  {name}: {'no row of ours' if pair['ratio'] is None else format(pair['ratio'], '.3g')}  ({' | '.join(rows)})"


def compare(problem, args: argparse.Namespace, device: wp.Device, folder: Path) -> dict:
    """All rows of both sides on a problem, printed as a table, and the verdicts."""
    limit = FRAME * problem.net.frequency() / 2.0
    print(f"{problem.name}: limit {limit:.0f} substeps; {problem.facts}\n  side   solver        integrator        substeps"
          " x it.  ms/frame    0.25 s     0.5 s  first s", flush=True)
    theirs, versions = peer(problem, peer_settings(limit, device, args.quick), args, folder)
    print(*map(line, theirs), sep="\n", flush=True)
    ours = []
    for setting in own_settings(limit, args.quick):
        ours.append(own(problem, setting, device))
        print(line(ours[-1]), flush=True)
    explicit = [r for r in theirs if r["solver"] == "semi_implicit"]
    found = verdicts(ours, [r for r in theirs if r not in explicit], explicit, KEY, problem.worst)
    for key, name in (("speedup", "(a) times faster than its implicit solvers at their error"),
                      ("tenth", "(b) our time at a tenth of its explicit solver's error, over its"),
                      ("accuracy", "(c) times smaller error in the time of its implicit solvers")):
        print(said(f"{name}, its best case", found[key]["verdict"]), said("    at its least error", found[key]["best"]),
              sep="\n", flush=True)
    print(said("    fastest explicit", next(iter(found["tenth"]["pairs"]), None)), flush=True)
    return {"problem": problem.name, "limit": limit, "worst": problem.worst, **problem.facts, **versions,
            "rows": theirs + ours, "verdicts": found}


def commit() -> str:
    """Of this checkout; "unknown" without git."""
    try:
        return subprocess.run(["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True,
                              check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer-python", required=True, help="interpreter of an environment with Newton, see above")
    parser.add_argument("--device", default=None)
    parser.add_argument("--sides", default="32,64", help="points a side of each sheet; empty: none")
    parser.add_argument("--stiffness", default="1e3,1e5", help="of the springs [N/m]")
    parser.add_argument("--garment", action="store_true", help="the shirt too")
    parser.add_argument("--quick", action="store_true", help="few rows, for a CPU")
    parser.add_argument("--cache", default=None, help="folder that keeps exact trajectories")
    parser.add_argument("--commit", default=None, help="of wsim, where git cannot say")
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    args.peer_python = os.path.abspath(args.peer_python)              # not resolved: a link is how a venv knows itself
    with tempfile.TemporaryDirectory() as name:
        wp.config.log_level = wp.LOG_WARNING
        wp.config.kernel_cache_dir = str(Path(name) / "own")
        device = wp.get_device(args.device)
        head = {"hardware": hardware(device), "device": str(device), "warp": wp.config.version, "wsim": args.commit or commit()}
        print(head, "\nleft out:", LEFT_OUT, flush=True)
        folder, found = args.cache or name, []
        problems = [lambda n=n, k=k: Sheet(n, k, folder) for n in map(int, filter(None, args.sides.split(",")))
                    for k in map(float, args.stiffness.split(","))] + ([lambda: Shirt(folder)] if args.garment else [])
        for make in problems:
            found.append(compare(make(), args, device, Path(name)))
            if args.json:                                             # after every problem: a run cut short keeps its rows
                part = Path(f"{args.json}.part")
                part.write_text(json.dumps(plain(head | {"left_out": LEFT_OUT, "problems": found}), indent=1, allow_nan=False))
                os.replace(part, args.json)


if __name__ == "__main__":
    main()
