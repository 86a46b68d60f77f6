"""wsim beside Newton and MuJoCo on one soft beam, the same mesh for all: time of a frame and errors, row by row, and verdicts.

    python tools/bench/soft/peers.py [--peer-python X/bin/python] [--mujoco-python Y/bin/python] [--device cuda:0|cpu]
                                     [--sides wsim,newton,mujoco] [--young 1e6] [--cells 16,4,4] [--quick] [--precision float64]
                                     [--cache FOLDER] [--json FILE]

X as peers.py says. Y, on the CPU only: python -m venv Y; Y/bin/pip install mujoco==4.0.0 (without a net: the wheels mujoco_core
and numpy, and pip install --no-index --no-deps). A side without its interpreter is left out.

problem.py has the beam and says what is measured: every row is held against the float64 answer for its own material on
its own mesh, so that a material or a mesh is never called a solver's error. The tables print

    0.25 s, 0.5 s   RMS distance [m] from the exact trajectory        static     error of the tip's drop at rest
    freq            error of the first frequency                      damping    its ratio, of numerical origin

Lame parameters are matched where an engine asks for others: E and nu at rest are those given in all rows. ms: median frame of
the fall; all wait for each frame, wsim and Newton replay graphs. MuJoCo runs on this machine's CPU, in float64. `!`: the run
warned, as where wsim took another integrator than it was given; the texts are in the JSON. One corotational trajectory takes a
minute of a CPU: --cache keeps them and may be carried along.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from math import ceil, isfinite
from pathlib import Path

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tools.bench.soft.problem import FRAME, Beam  # noqa: E402
from tools.bench.soft.runs import Make, measured, plain, processor  # noqa: E402
from tools.bench.speed import hardware  # noqa: E402
from tools.bench.suite import commit, write  # noqa: E402
from tools.bench.verdict import verdicts  # noqa: E402
from wsim.scene import Scene, SceneError  # noqa: E402
from wsim.scene.solid import Bulk  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

KEY = "error_025"
SCRIPTS = {"newton": "peer_newton.py", "mujoco": "peer_mujoco.py"}
NEO_HOOKEAN = {"neo_hookean": True}

EXPLICIT = (1.05, 1.25, 2.0, 4.0)            # times the substeps that are stable about rest; a bent beam asks for a tenth more
# (solver, integrators, substeps, iterations, models): every combination; explicit ones by times the stable substeps
OWN = (("implicit", ("backward_euler", "bdf2", "implicit_midpoint"), (1, 2, 4, 8, 16), (1, 2), ("corotational", "neo_hookean")),
       ("implicit", ("bdf2", "implicit_midpoint"), (1, 4), (1,), ("st_venant_kirchhoff",)))
OWN_EXPLICIT = ((("leapfrog", 1.0), ("rk4", 2.0**0.5)), EXPLICIT, ("corotational", "neo_hookean"))
QUICK_OWN = (("implicit", ("backward_euler", "bdf2", "implicit_midpoint"), (1, 4), (1,), ("corotational",)),)
QUICK_EXPLICIT = (OWN_EXPLICIT[0], EXPLICIT[1:2], ("corotational",))
VBD = ((1, 16), (1, 64), (1, 256), (2, 16), (2, 64), (4, 4), (4, 16), (4, 64), (8, 16), (16, 4), (16, 16), (16, 64), (32, 4),
       (32, 16), (64, 4), (64, 16))
QUICK_VBD = ((1, 20), (4, 20), (10, 10), (20, 5))
# substeps, tolerances: of Saint Venant-Kirchhoff, of Neo-Hookean
DISCRETE = (((1, 2, 4, 8, 16, 32), (1e-4, 1e-8)), ((1, 4), (1e-8,)))
QUICK_DISCRETE = (((1, 4, 16), (1e-4,)), ((4,), (1e-4,)))


def own_settings(limit: float, quick: bool) -> list[dict]:
    rows = [(solver, integrator, substeps, i, model) for solver, integrators, many, iterations, models in
            (QUICK_OWN if quick else OWN) for model in models for integrator in integrators for substeps in many
            for i in iterations]
    methods, factors, models = QUICK_EXPLICIT if quick else OWN_EXPLICIT
    rows += [("explicit", name, ceil(f * limit / longer), 1, model) for model in models for name, longer in methods
             for f in factors]
    return [dict(zip(("solver", "integrator", "substeps", "iterations", "model"), row, strict=True)) for row in rows]


def newton_settings(limit: float, quick: bool, cuda: bool) -> list[dict]:
    rows = [(solver, *steps) for solver in ("vbd", "vbd_tile")[:1 + cuda] for steps in (QUICK_VBD if quick else VBD)]
    rows += [("semi_implicit", ceil(f * limit), 1) for f in (EXPLICIT[1:2] if quick else EXPLICIT)]
    return [dict(zip(("solver", "substeps", "iterations"), row, strict=True)) for row in rows]


def mujoco_settings(limit: float, quick: bool) -> list[dict]:
    rows = [{"solver": "discrete", "substeps": substeps, "iterations": 1000, "tolerance": tolerance} | more
            for (many, tolerances), more in zip(QUICK_DISCRETE if quick else DISCRETE, ({}, NEO_HOOKEAN), strict=True)
            for tolerance in tolerances for substeps in many]
    return rows + [{"solver": name, "substeps": ceil(f * limit / longer), "iterations": 100} for name, longer in
                   (("Euler", 1.0), ("RK4", 2.0**0.5)) for f in (EXPLICIT[1:2] if quick else EXPLICIT)]


class Own:
    """The beam in wsim."""

    def __init__(self, beam: Beam, setting: dict, run: tuple[wp.Device, str], start: tuple[np.ndarray, np.ndarray, float]):
        (device, precision), (gravity, offset, decay) = run, start
        scene = Scene(fps=1.0 / FRAME, gravity=tuple(gravity.tolist()), air_drag=decay,
                      **{k: v for k, v in setting.items() if k != "model"})
        solid = beam.solid(setting["model"])
        body = scene.soft("/beam", beam.points + offset, beam.tets, rest_points=beam.points,
                          material=Bulk(young=solid.young, poisson=solid.poisson, density=solid.density, model=solid.model))
        scene.pin("/clamp", body, points=beam.pinned)
        self.sim = Simulation(scene, device=device, precision=precision)

    def frame(self) -> None:
        self.sim.step()

    def positions(self) -> np.ndarray:
        return np.asarray(self.sim.positions("/beam"), np.float64)


def judged(beam: Beam, row: dict, states: dict[str, np.ndarray]) -> dict:
    """The row with its errors; finite False where one of the states or of the errors in place is no number."""
    if not row["finite"] or not all(np.isfinite(x).all() for x in states.values()):
        return row | {"finite": False}
    return row | beam.judge(row["model"], states)


def own(beam: Beam, setting: dict, device: wp.Device, precision: str) -> dict:
    """One row of ours."""
    row, sims = {"side": "wsim"} | setting, []

    def make(*start) -> Own:
        sims.append(Own(beam, setting, (device, precision), start))
        return sims[-1]

    try:
        given: Make = make
        found, states = measured(given, beam.problem())
    except Exception as error:                    # refused, or broken: a row of the table either way
        kind = "" if isinstance(error, SceneError) else f"{type(error).__name__}: "
        return row | {"finite": False, "failed": f"{kind}{error}"}
    warnings = list(dict.fromkeys(text for made in sims for text in made.sim.warnings if not text.startswith("warning: /beam")))
    return judged(beam, row | found | {"ran": sims[0].sim.plan.clock.substeps, "warnings": warnings}, states)


def peer(side: str, beam: Beam, settings: list[dict], args: argparse.Namespace, folder: Path) -> tuple[list[dict], dict]:
    """A peer's rows, and its versions and device. CalledProcessError when its process ends badly."""
    np.savez(folder / "problem.npz", **beam.problem())
    (folder / "settings.json").write_text(json.dumps(settings))
    script = Path(__file__).with_name(SCRIPTS[side])
    device = ["--device", args.device] if args.device and side == "newton" else []
    subprocess.run([args.python[side], str(script), "problem.npz", "settings.json", ".", *device], cwd=folder, check=True,
                   stdout=subprocess.DEVNULL, env=os.environ | {"WARP_CACHE_PATH": str(Path(args.cache or folder) / "peer")})
    head, rows = json.loads((folder / "rows.json").read_text()), []
    with np.load(folder / "states.npz") as found:
        for number, row in enumerate(head.pop("rows")):
            states = {name: found[f"{name}{number}"] for name in ("fall", "settle", "swing") if f"{name}{number}" in found}
            rows.append(judged(beam, {"side": side, "integrator": ""} | row, states))
    return rows, head


def line(row: dict) -> str:
    text = (f"  {row['side']:<7}{row['solver']:<14}{row['integrator']:<18}{row.get('ran', row['substeps']):>5} x "
            f"{row['iterations']:<5}{row['model']:<20}")
    if "ms" not in row:
        return f"{text}  {row['failed'].splitlines()[0][:100]}"
    if not row["finite"]:
        return f"{text}{row['ms']:>9.3f}  no number"
    rates = [f"{row[k]:>10.1e}" if isfinite(row[k]) else f"{'none':>10}" for k in ("static", "frequency", "damping")]
    return (f"{text}{row['ms']:>9.3f}{row['error_025']:>10.1e}{row['error_05']:>10.1e}{''.join(rates)}{row['first_s']:>8.2f}"
            + "  still moves" * (row["still"] > 1e-4) + "  !" * bool(row.get("warnings")))


def said(name: str, pair: dict | None) -> str:
    """A verdict in a line."""
    if pair is None:
        return f"  {name}: no usable row"
    rows = [f"{r['solver']} {r['integrator']} {r.get('ran', r['substeps'])} x {r['iterations']}, {r['ms']:.3f} ms, {r[KEY]:.1e}"
            for r in (pair["peer"], pair["ours"]) if r]
    return f"  {name}: {'no row of ours' if pair['ratio'] is None else format(pair['ratio'], '.3g')}  ({' | '.join(rows)})"


def compare(beam: Beam, args: argparse.Namespace, device: wp.Device, folder: Path) -> dict:
    """All rows on a beam, printed as a table, and the verdicts against each peer, and against VBD alone."""
    print(f"{beam.name}: first frequency {beam.frequency:.4f} Hz, limit {beam.limit:.1f} substeps\n  side   solver        "
          "integrator     substeps x it.  material             ms/frame    0.25 s     0.5 s    static      freq   damping"
          " first s", flush=True)
    rows, about = [], {}
    for side, settings in (("newton", newton_settings(beam.limit, args.quick, device.is_cuda)),
                           ("mujoco", mujoco_settings(beam.limit, args.quick))):
        if side in args.sides:
            found, about[side] = peer(side, beam, settings, args, folder)
            rows += found
            print(*map(line, found), sep="\n", flush=True)
    ours = []
    for setting in own_settings(beam.limit, args.quick) if "wsim" in args.sides else ():
        ours.append(own(beam, setting, device, args.precision))
        print(line(ours[-1]), flush=True)
    worst, found = beam.moved(), {}
    groups = {"vbd": [r for r in rows if r["solver"].startswith("vbd")]}
    groups |= {side: [r for r in rows if r["side"] == side] for side in about}
    for name, theirs in groups.items() if ours and rows else ():
        found[name] = {k: v for k, v in verdicts(ours, theirs, (), KEY, worst).items() if k != "tenth"}
        for key, what in (("accuracy", "times smaller error in its time"), ("speedup", "times faster at its error")):
            print(said(f"{name}: {what}, its best case", found[name][key]["verdict"]), flush=True)
    return {"problem": beam.name, **beam.facts(), "worst": worst, "about": about, "rows": rows + ours, "verdicts": found}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer-python", default=None, help="interpreter of an environment with Newton")
    parser.add_argument("--mujoco-python", default=None, help="interpreter of an environment with MuJoCo")
    parser.add_argument("--device", default=None)
    parser.add_argument("--sides", default="wsim,newton,mujoco")
    parser.add_argument("--young", default="1e6", help="[Pa], one or more, comma between them")
    parser.add_argument("--cells", default="16,4,4")
    parser.add_argument("--precision", default="float32", choices=("float32", "float64"), help="of wsim")
    parser.add_argument("--quick", action="store_true", help="few rows, for a CPU")
    parser.add_argument("--cache", default=None, help="folder that keeps exact trajectories and the peer's kernels")
    parser.add_argument("--commit", default=None, help="of wsim, where git cannot say")
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    # an interpreter's path is not resolved: a link is how a venv knows itself
    args.python = {k: os.path.abspath(v) for k, v in (("newton", args.peer_python), ("mujoco", args.mujoco_python)) if v}
    args.sides = [s for s in args.sides.split(",") if s == "wsim" or s in args.python]
    args.cache = args.cache and os.path.abspath(args.cache)
    with tempfile.TemporaryDirectory() as name:
        wp.config.log_level = wp.LOG_WARNING
        wp.config.kernel_cache_dir = str(Path(name) / "own")
        device = wp.get_device(args.device)
        head = {"hardware": hardware(device), "processor": processor(), "device": str(device), "precision": args.precision,
                "warp": wp.config.version, "wsim": args.commit or commit()}
        print(", ".join(f"{k} {v}" for k, v in head.items()), flush=True)
        if args.cache:
            Path(args.cache).mkdir(parents=True, exist_ok=True)
        found = []
        for young in map(float, args.young.split(",")):
            beam = Beam(tuple(map(int, args.cells.split(","))), young, args.cache or name)
            found.append(compare(beam, args, device, Path(name)))
            if args.json:
                write(args.json, plain(head | {"problems": found}))


if __name__ == "__main__":
    main()
