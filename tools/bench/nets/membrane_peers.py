"""wsim beside Newton's solvers on the same sheet and the same shirt of membranes: time of a frame and error, and verdicts.

    python tools/bench/nets/membrane_peers.py --peer-python X/bin/python [--device cuda:0|cpu] [--only sheet,shirt] [--quick]
                                              [--cache FOLDER] [--json FILE]

X as peers.py says. membrane.py has the problems; every row is held against the float64 trajectory of its own energy, so that a
material is never called a solver's error. Errors are RMS distances [m] from rest after the problem's frames; `peak` is the
largest strain of an edge over the exact one. Both sides replay graphs and wait for each frame; ms is the median of the later
frames. Left out, with why: LEFT_OUT.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from math import ceil
from pathlib import Path

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tools.bench.nets import membrane  # noqa: E402
from tools.bench.nets.garments import stable  # noqa: E402
from tools.bench.nets.reference import kept  # noqa: E402
from tools.bench.soft.runs import plain  # noqa: E402
from tools.bench.speed import hardware  # noqa: E402
from tools.bench.suite import commit, write  # noqa: E402
from tools.bench.verdict import verdicts  # noqa: E402
from wsim.scene import SceneError  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

EXPLICIT = "semi_implicit"                     # as peer_newton.py has it, symplectic Euler
TIMED = 15, 6                                  # frames that are run for their time, on a GPU and on a CPU
KEY = "error"
TOLERANCE = 1e-6                               # [m] of the exact trajectories
LEFT_OUT = {"SolverXPBD": "reads springs, no triangles: a sheet of triangles falls freely",
            "SolverStyle3D": "wants panels in a plane, and has energies of its own for warp, weft and bending"}
VBD = ((1, 20), (4, 10), (10, 10), (20, 5), (20, 20), (40, 10), (100, 4), (200, 2), (400, 1), (400, 4))
QUICK_VBD = ((10, 10), (20, 20), (200, 2))
TIMES = (1.0, 1.5, 2.0, 4.0)                   # the substeps that wsim's bound calls stable
QUICK_TIMES = (1.0, 2.0)
OWN = (("xpbd", "backward_euler", (8, 32, 100, 200, 400), (1, 2)), ("xpbd", "bdf2", (32, 100, 400), (1, 4)),
       ("implicit", "backward_euler", (2, 8, 32, 100), (1, 2)), ("implicit", "bdf2", (2, 8, 32, 100), (1, 2)),
       ("implicit", "implicit_midpoint", (8, 32), (2,)))
QUICK_OWN = (("xpbd", "backward_euler", (32, 100, 200), (1,)), ("implicit", "bdf2", (8, 32), (1,)))


def own_settings(stable: int, quick: bool) -> list[dict]:
    rows = [(solver, integrator, substeps, i) for solver, integrator, many, iterations in (QUICK_OWN if quick else OWN)
            for substeps in many for i in iterations]
    rows += [("explicit", "auto", 1, 1)] + [("explicit", "leapfrog", ceil(k * stable), 1) for k in TIMES[:1 if quick else 3]]
    return [dict(zip(("solver", "integrator", "substeps", "iterations"), row, strict=True)) for row in rows]


def peer_settings(stable: int, quick: bool, cuda: bool) -> list[dict]:
    rows = [(solver, *steps) for solver in ("vbd", "vbd_tile")[:1 + cuda] for steps in (QUICK_VBD if quick else VBD)]
    rows += [(EXPLICIT, ceil(k * stable), 1) for k in (QUICK_TIMES if quick else TIMES)]
    return [dict(zip(("solver", "substeps", "iterations"), row, strict=True)) for row in rows]


class Problem:
    """A sheet, what both engines should do with it, and how far off a row is."""

    def __init__(self, name: str, device: wp.Device, folder: str):
        points, self.triangles, pinned, self.frame, self.frames = membrane.PROBLEMS[name]()
        self.name, self.scene = name, membrane.scene(name)
        self.start = self.scene.cloths[0].points.astype(np.float64)
        self.theirs = membrane.Membrane(points, self.triangles, np.asarray(pinned))
        fine = replace(self.scene, solver="explicit", integrator="leapfrog")
        self.stable = stable(fine, device)
        x, error = kept(Path(folder) / f"membrane_{name}_{len(points)}_{self.stable}_{self.frames}.npz",
                        lambda: self.theirs.exact(self.stable, self.frames, self.frame, TOLERANCE, device))
        ends = []
        for k in (2, 4):
            sim = Simulation(replace(fine, substeps=k * self.stable), device=device, precision="float64")
            sim.run(self.frames)
            ends.append(np.asarray(sim.positions("/cloth"), np.float64))
        self.exact = {"newton": x[-1], "wsim": ends[1]}
        self.known = {"newton": error, "wsim": rms(ends[1] - ends[0]) / 3.0}

    def judged(self, row: dict, x: np.ndarray) -> dict:
        if not np.isfinite(x).all():
            return row | {"finite": False}
        strains = [membrane.peak_strain(self.theirs.points, self.triangles, p) for p in (x, self.exact[row["side"]])]
        return row | {KEY: rms(x - self.exact[row["side"]]), "peak": strains[0] / strains[1]}

    @property
    def worst(self) -> float:
        """The error of a sheet that never moved [m]."""
        return rms(self.exact["wsim"] - self.start)


def rms(d: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(d * d, axis=1))))


def own(problem: Problem, setting: dict, device: wp.Device) -> dict:
    """A row of ours."""
    row = {"side": "wsim"} | setting
    try:
        sim = Simulation(replace(problem.scene, **setting), device=device)
        sim.run(problem.frames)
        row = problem.judged(row | {"finite": True}, np.asarray(sim.positions("/cloth"), np.float64))
        if row["finite"]:
            sim.run(max(TIMED[device.is_cpu] - problem.frames, 0))
    except Exception as error:                    # refused, or broken: a row of the table either way
        kind = "" if isinstance(error, SceneError) else f"{type(error).__name__}: "
        return row | {"finite": False, "failed": f"{kind}{error}"}
    row |= {"substeps": sim.plan.clock.substeps, "integrator": sim.plan.choice.integrator.name}
    return row | {"ms": float(np.median(sim.milliseconds[3:])), "warnings": sim.warnings,
                  "first_s": sim.seconds["build"] + sim.seconds["first_frame"]}


def peer(problem: Problem, settings: list[dict], args: argparse.Namespace, folder: Path) -> tuple[list[dict], dict]:
    """Newton's rows, and its versions. CalledProcessError when its process ends badly."""
    body = problem.theirs
    np.savez(folder / "problem.npz", points=body.points, triangles=body.triangles, mu=body.mu, lame=body.lame,
             masses=body.masses, pinned=body.pinned, gravity=body.gravity, frame=problem.frame,
             ends=[problem.frames, max(problem.frames, TIMED[wp.get_device(args.device).is_cpu])])
    (folder / "settings.json").write_text(json.dumps(settings))
    subprocess.run([args.peer_python, str(Path(__file__).with_name("peer_newton.py")), "problem.npz", "settings.json", ".",
                    *(["--device", args.device] if args.device else [])], cwd=folder, check=True,
                   stdout=subprocess.DEVNULL, env=os.environ | {"WARP_CACHE_PATH": str(folder / "kernels")})
    versions = json.loads((folder / "rows.json").read_text())
    with np.load(folder / "states.npz") as found:
        rows = [{"side": "newton", "integrator": ""} | row for row in versions.pop("rows")]
        return [problem.judged(row, found[f"x{k}"][0]) if "ms" in row else row for k, row in enumerate(rows)], versions


def shown(row: dict) -> str:
    text = f"  {row['side']:<7}{row['solver']:<14}{row['integrator']:<18}{row['substeps']:>6} x {row['iterations']:<3}"
    if "ms" not in row:
        return f"{text}  {row.get('failed', 'no number').splitlines()[0][:110]}"
    errors = f"{row[KEY]:>10.2e}{row['peak']:>8.2f}" if row["finite"] else f"{'no number':>18}"
    return f"{text}{row['ms']:>10.3f}{errors}{row['first_s']:>9.2f}" + ("  !" if row.get("warnings") else "")


def compare(name: str, args: argparse.Namespace, device: wp.Device, folder: Path) -> dict:
    """All rows of both sides on a problem, printed as a table, and the verdicts."""
    problem = Problem(name, device, args.cache or str(folder))
    print(f"{name}: {len(problem.start)} points, stable {problem.stable} substeps, exact to {problem.known}\n"
          "  side   solver        integrator        substeps x it.  ms/frame     error    peak  first s", flush=True)
    theirs, versions = peer(problem, peer_settings(problem.stable, args.quick, device.is_cuda), args, folder)
    print(*map(shown, theirs), sep="\n", flush=True)
    ours = []
    for setting in own_settings(problem.stable, args.quick):
        ours.append(own(problem, setting, device))
        print(shown(ours[-1]), flush=True)
    explicit = [r for r in theirs if r["solver"] == EXPLICIT]
    found = verdicts(ours, [r for r in theirs if r not in explicit], explicit, KEY, problem.worst)
    for key, text in (("speedup", "(a) times faster than VBD at its error"),
                      ("accuracy", "(c) times smaller error in VBD's time"),
                      ("tenth", "(b) our time at a tenth of its explicit solver's error, over its")):
        for which, case in (("verdict", "best case"), ("best", "least error")):
            print(f"  {text}, its {case}: {pair(found[key][which])}", flush=True)
    return {"problem": name, "stable": problem.stable, "known": problem.known, "worst": problem.worst, **versions,
            "rows": theirs + ours, "verdicts": found}


def pair(found: dict | None) -> str:
    """A verdict in words."""
    if found is None:
        return "Newton has no usable row"
    rows = [f"{r['solver']} {r['integrator']} {r['substeps']} x {r['iterations']}, {r['ms']:.3f} ms, {r[KEY]:.1e} m"
            for r in (found["peer"], found["ours"]) if r]
    return f"{'no row of ours' if found['ratio'] is None else format(found['ratio'], '.3g')}  ({' | '.join(rows)})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer-python", required=True, help="interpreter of an environment with Newton, see peers.py")
    parser.add_argument("--device", default=None)
    parser.add_argument("--only", default=",".join(membrane.PROBLEMS))
    parser.add_argument("--quick", action="store_true", help="few rows, for a CPU")
    parser.add_argument("--cache", default=None, help="folder that keeps exact trajectories")
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    args.peer_python = os.path.abspath(args.peer_python)              # not resolved: a link is how a venv knows itself
    with tempfile.TemporaryDirectory() as name:
        wp.config.log_level = wp.LOG_WARNING
        device = wp.get_device(args.device)
        head = {"hardware": hardware(device), "device": str(device), "warp": wp.config.version, "wsim": commit()}
        print(head, "\nleft out:", LEFT_OUT, flush=True)
        found: list[dict] = []
        for problem in args.only.split(","):
            found.append(compare(problem, args, device, Path(name)))
            if args.json:                                             # after every problem: a run cut short keeps its rows
                write(args.json, plain(head | {"left_out": LEFT_OUT, "problems": found}))


if __name__ == "__main__":
    main()
