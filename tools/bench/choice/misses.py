"""How often `auto` misses: over a grid of scenes, its error against the wanted one and its time against the best of what else
could be taken; and the constants of `wsim.simulation.cost.COSTS` that fit what was measured.

    python tools/bench/choice/misses.py [--device cuda:0] [--quick] [--kinds net,soft] [--scenes flag,cape] [--json FILE]

error    largest of the frames up to T = sqrt(2 L / g), L the size of the scene (of a cloth that folds on a ball, and then
         amplifies whatever differs, to half of T): RMS distance from leapfrog in float64 with
         four times the substeps that are stable, over L; `doubt` is what twice as many changed, to which no error is compared
ms       of a frame replayed from its graph: on a CPU CPU seconds on one core (so that others on the machine do not count, nor
         do threads), on a GPU wall clock, least of three
misses   error: beyond the wanted one; time: more than LATE times the fastest of the alternatives that err by no more than that
"""

import argparse
import json
import os
import sys
from dataclasses import replace
from math import ceil
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tools.bench.choice.costs import fitted, ratios  # noqa: E402
from tools.bench.choice.scenes import Authored, Case, cases  # noqa: E402
from tools.bench.speed import hardware  # noqa: E402
from wsim.bench.track import all_world_positions, largest_body_extent, rms_point_distance  # noqa: E402
from wsim.scene import Scene, SceneError  # noqa: E402
from wsim.simulation import cost  # noqa: E402
from wsim.simulation.choice import predict_choice_error  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

LATE = 1.3             # times the time of the best
LASTING = 0.03         # [s] that the replays of a frame last together
REFINED = 4            # times the stable substeps, of the reference
DOUBTED = 0.3          # of the wanted error, up to which a reference can judge it
SWEPT = ((10, 4), (40, 1), (80, 1), (40, 4))                          # XPBD, substeps x sweeps
NEWTON = (("bdf2", 10, 1), ("bdf2", 20, 1), ("bdf2", 40, 1), ("backward_euler", 20, 1))      # of sheets and nets
SOLVED = (("backward_euler", 10, 2), ("backward_euler", 40, 2), ("sdirk3", 5, 2), ("sdirk3", 10, 2))


def frame_seconds(sim: Simulation) -> float:
    """Of a replayed frame."""
    clock = perf_counter if sim.device.is_cuda else process_time

    def replayed(times: int) -> float:
        wp.synchronize_device(sim.device)
        began = clock()
        for _ in range(times):
            wp.capture_launch(sim.graph)
        wp.synchronize_device(sim.device)
        return (clock() - began) / times
    once = max(replayed(1), 1e-6)
    return min(replayed(max(1, min(200, int(LASTING / once)))) for _ in range(3 if once < LASTING else 1))


def track(sim: Simulation, frames: int) -> np.ndarray:
    """Places after each frame, (frames, points, 3) [m]."""
    found: list[np.ndarray] = []
    sim.run(frames, lambda s: found.append(all_world_positions(s)))
    return np.array(found)


def reference(scene: Scene, frames: int, device) -> tuple[np.ndarray, float]:
    """Places by frame, and what the last doubling of the substeps changed [m]."""
    least = Simulation(replace(scene, solver="explicit", substeps=1), device=device).plan.clock.substeps
    coarse, fine = (track(Simulation(replace(scene, solver="explicit", substeps=least * k), device=device, precision="float64"),
                          frames) for k in (REFINED // 2, REFINED))
    return fine, float(rms_point_distance(coarse, fine).max())


def counts(sim: Simulation) -> dict[str, float]:
    """What a frame does, by the names of `wsim.simulation.cost`."""
    model, choice, n = sim.model, sim.plan.choice, sim.plan.clock.substeps
    if choice.solver == "explicit":
        return cost.count_explicit_frame(model, n)
    if choice.solver == "xpbd":
        return cost.count_sweeps_frame(model, n, choice.iterations)
    if sim.scene.softs:
        return cost.count_newton_of_soft_bodies(model, n, choice.iterations)
    return cost.count_newton_of_sheets(model, n, choice.iterations, choice.omega or cost.highest_frequency(model))


def alternatives(scene: Scene) -> list[dict]:
    """What a scene may be stepped with besides."""
    explicit = {"solver": "explicit", "integrator": "leapfrog", "substeps": 1, "iterations": 1}
    if scene.softs:
        return [explicit] + [{"solver": "implicit", "integrator": name, "substeps": n, "iterations": m} for name, n, m in SOLVED
                             if name == "backward_euler" or not scene.colliders]
    xpbd = [{"solver": "xpbd", "integrator": "backward_euler", "substeps": n, "iterations": m} for n, m in SWEPT]
    return [explicit, *xpbd] + [
        {"solver": "implicit", "integrator": name, "substeps": n, "iterations": m} for name, n, m in NEWTON]


def measured(scene: Scene, there: np.ndarray, device, **settings) -> dict:
    """One run: what it was, its error over the size, its time, and what a frame does."""
    if settings.get("solver") == "explicit":                   # as many substeps as are stable, which a named one does not get
        settings |= {"integrator": "auto"}
    sim = Simulation(replace(scene, **settings), device=device)
    choice, errors = sim.plan.choice, rms_point_distance(track(sim, len(there)), there) / largest_body_extent(scene)
    return {"solver": choice.solver, "integrator": choice.integrator.name, "substeps": choice.steps,
            "iterations": choice.iterations, "error": float(errors.max()), "seconds": frame_seconds(sim),
            "predicted": [sim.plan.seconds, predict_choice_error(sim.model, choice)],
            "counts": counts(sim) if sim.plan.choice is choice else None, "notes": sim.warnings}


def judged(case: Case | Authored, device) -> dict:
    """A scene by every alternative and by `auto`."""
    scene = case.scene
    frames = max(2, ceil((2.0 * largest_body_extent(scene) / 9.81)**0.5 * scene.fps * case.part))
    there, doubt = reference(scene, frames, device)
    row = {"case": str(case), "kind": case.kind, "doubt": doubt / largest_body_extent(scene),
           "auto": measured(scene, there, device), "others": []}
    for settings in alternatives(scene):
        try:
            row["others"].append(measured(scene, there, device, **settings))
        except SceneError as error:
            row.setdefault("refused", []).append(f"{settings}: {error}")
    good = [r for r in (row["auto"], *row["others"]) if r["error"] <= scene.error]
    best = min(good, key=lambda r: r["seconds"], default=None)
    known = row["doubt"] <= DOUBTED * scene.error
    row["known"], row["error_over_wanted"] = known, row["auto"]["error"] / scene.error
    row["time_over_best"] = row["auto"]["seconds"] / best["seconds"] if best else None
    row["misses"] = [name for name, is_so in (("error", row["error_over_wanted"] > 1.0), ("time", best and
                     row["time_over_best"] > LATE)) if known and is_so]
    return row


def line(r: dict) -> str:
    seconds, error = r["predicted"]
    return (f"{r['solver']} {r['integrator']} {r['substeps']} x {r['iterations']}: {1e3 * r['seconds']:.3g} ms, "
            f"{r['error']:.1e} (predicted {1e3 * seconds:.3g}, {error:.1e})")


def told(rows: list[dict]) -> str:
    """How often, and by how much."""
    judgeable = [r for r in rows if r["known"]]
    lines = [f"{len(judgeable)} scenes of {len(rows)} that a reference can judge"]
    for name, key in (("error", "error_over_wanted"), ("time", "time_over_best")):
        missed = [r for r in judgeable if name in r["misses"]]
        worst = max(judgeable, key=lambda r: r[key] or 0.0, default=None)
        lines.append(f"{name}: {len(missed)} misses" + (f"; most {worst[key]:.2g} times ({worst['case']})"
                                                        if worst and worst[key] else ""))
    return "\n".join(lines)


def constants(rows: list[dict], present: dict[str, float]) -> dict[str, float]:
    """Fitted and printed, with how far the present ones and they are from what was measured."""
    runs = [r for row in rows for r in (row["auto"], *row["others"]) if r["counts"]]
    found = fitted(runs, present)
    for name, costs in (("present", present), ("fitted", present | found)):
        off = ratios(runs, costs)
        print(f"{name:<8} constants say {off.min():.2f} to {off.max():.2f} of what was measured, median {np.median(off):.2f}")
    print("fitted: {" + ", ".join(f'"{name}": {value:.3g}' for name, value in found.items()) + "}")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default=None)
    parser.add_argument("--quick", action="store_true", help="small scenes only: what a CPU does in some minutes")
    parser.add_argument("--kinds", default="", help="of scenes, by commas; all unless given")
    parser.add_argument("--scenes", default="", help="example scenes, by commas, in place of the grid")
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    device, rows = wp.get_device(args.device), []
    if not device.is_cuda and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    where = f"{hardware(device)}{'' if device.is_cuda else ', one of them'}"
    print(f"{where}, warp {wp.config.version}, {'wall clock' if device.is_cuda else 'CPU seconds'}")
    grid = [c for c in cases(args.quick) if not args.kinds or c.kind in args.kinds.split(",")]
    for case in [Authored(name) for name in args.scenes.split(",")] if args.scenes else grid:
        rows.append(judged(case, device))
        r = rows[-1]
        print(f"{r['case']}: reference to {r['doubt']:.0e}; {'MISSES ' + ' and '.join(r['misses']) if r['misses'] else 'holds'}"
              f"\n  auto {line(r['auto'])}\n" + "\n".join(f"       {line(o)}" for o in r["others"]), flush=True)
    print(told(rows))
    found = constants(rows, cost.COSTS["cuda" if device.is_cuda else "cpu"])
    if args.json:
        Path(args.json).write_text(json.dumps({"device": where, "warp": wp.config.version, "fitted": found, "rows": rows},
                                              indent=1))


if __name__ == "__main__":
    main()
