"""The error that a run reports beside its true one, in random scenes (`tools.bench.choice.random_scenes`) of default settings.

    python -m tools.bench.choice.reported_errors --references DIR [--scenes 0-39] [--seed 0] [--jobs 1] [--make] [--paired]
        [--json FILE]

    reference   leapfrog in float64 of n and 2 n substeps, n twice those that are stable or a substep of COARSE; kept in DIR,
                where `--make` makes those that are not there yet
    apart       largest RMS difference of the two over the frames, over the scene's size
    true        the same of the default run and the finer reference;   said   what its report calls predicted error
    strain      largest of an edge in a frame, worst ratio to the reference's, and what was warned of
    ms          CPU milliseconds of a frame, of all threads, without the first; with `--paired` over those of a run beside it,
                frame by frame in turn, that estimates neither errors nor strains
    report      CPU seconds of the report, which steps what errors and strains are measured by (in the JSON)
"""

import argparse
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from tools.bench.choice.random_scenes import drawn  # noqa: E402
from wsim.bench.track import LONGEST, all_world_positions, largest_body_extent  # noqa: E402
from wsim.scene import Scene  # noqa: E402
from wsim.simulation.measure.indicators import edge_strain  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

COARSE = 1e-5              # substep of the coarser reference [s], or less
MANY = 100_000             # substeps with which any of the scenes is stable
SENSITIVE = 0.2            # of the reported error that references differ by, from which a scene is counted apart
FAR = 2.0


def strain(sim: Simulation) -> float:
    """Largest strain of an edge now [1]."""
    x = sim.state.x.numpy().astype(np.float64) + sim.state.e.numpy()
    return max(float(edge_strain(b, x).max(initial=0.0)) for b in sim.model.bodies if len(b.edges))


def track(sim: Simulation, frames: int, cut: int = 1, bare: Simulation | None = None
          ) -> tuple[np.ndarray, np.ndarray, list[float], list[float]]:
    """Positions (frames, n, 3) [m] and strain of each frame, of `cut` simulated ones; CPU seconds of each, and of each of
    `bare`, which is stepped in turn."""
    kept, strains, spent, beside = [], [], list[float](), list[float]()
    for k in range(frames):
        for each, times in ((bare, beside), (sim, spent))[::1 - 2 * (k % 2)]:
            if each:
                began = time.process_time()
                each.run(cut)
                times.append(time.process_time() - began)
        kept.append(all_world_positions(sim))
        strains.append(strain(sim))
    return np.array(kept), np.array(strains), spent, beside


def reference(scene: Scene, frames: int) -> dict:
    """Tracks of leapfrog in float64 of n and 2 n substeps."""
    explicit = replace(scene, solver="explicit", integrator="leapfrog", substeps=MANY)   # named: with no mass added to slivers
    least = Simulation(explicit, device="cpu", precision="float64").plan.ports.stable_substeps()
    n = max(2 * least, int(1.0 / scene.fps / COARSE))
    found: dict = {"n": n}
    for name, many in (("coarse", n), ("fine", 2 * n)):
        cut = -(-many // LONGEST)
        short = replace(explicit, fps=scene.fps * cut, substeps=-(-many // cut))
        sim = Simulation(short, device="cpu", precision="float64")
        found[name], found[f"{name}_strain"], *_ = track(sim, frames, cut)
    found["apart"] = distance(found.pop("coarse"), found["fine"])
    return found


def made(k: int, seed: int, folder: Path) -> str:
    """Keeps the reference of a scene."""
    file = folder / f"{seed}_{k}.npz"
    if file.exists():
        return f"{k} there"
    began, scene = time.perf_counter(), drawn(k, seed)
    try:
        found = reference(scene.scene, scene.frames)
    except Exception as error:                             # noqa: BLE001  one scene of many
        return f"{k} failed: {error}"
    np.savez_compressed(file, **found)
    return f"{k} {found['n']} in {time.perf_counter() - began:.0f} s"


def distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """RMS over the points in each frame [m]."""
    return np.sqrt(np.mean(np.sum((a - b)**2, axis=-1), axis=-1))


def row(k: int, seed: int, folder: Path, device: str, paired: bool) -> dict:
    """The default run of a scene beside its reference."""
    scene = drawn(k, seed)
    kept = np.load(folder / f"{seed}_{k}.npz")
    began = time.process_time()
    sim = Simulation(scene.scene, device=device)
    build = time.process_time() - began
    bare = Simulation(scene.scene, device=device) if paired else None
    if bare:
        bare.measured = False
    x, strains, spent, beside = track(sim, scene.frames, bare=bare)
    began = time.process_time()
    report, over = sim.report(False), largest_body_extent(scene.scene)         # steps what measures the run
    asked = time.process_time() - began
    both = np.maximum(strains, 1e-3) / np.maximum(kept["fine_strain"], 1e-3)
    worst = int(np.argmax(np.abs(np.log(both))))
    error = distance(x, kept["fine"]) / over
    return {"scene": k, "what": " ".join(scene.said), "points": x.shape[1], "solver": sim.plan.choice.solver,
            "steps": sim.plan.clock.steps, "iterations": sim.plan.clock.iterations,
            "apart": float(kept["apart"].max() / over), "true": float(error.max()),
            "last": float(error[-1]), "said": report["predicted"]["error"], "sensitive": report["predicted"].get("sensitive"),
            "strain": float(strains[worst]), "right": float(kept["fine_strain"][worst]), "ratio": float(both[worst]),
            "ms": 1e3 * float(np.mean(spent[1:])), "build": build, "report": asked,
            "bare_ms": 1e3 * float(np.mean(beside[1:])) if paired else None,
            "strains": sim.settled.found if sim.settled else [], "warnings": [str(w) for w in report["warnings"]]}


HEAD = (f"{'':>3} {'solver':<9}{'steps':>6} {'apart':>8} {'true':>8} {'last':>8} {'said':>8} {'/true':>6} {'strain':>7} "
        f"{'right':>7} {'ms':>6}  what")


def line(r: dict) -> str:
    mark = "sensitive" if apart(r) else "LIES" if r["true"] > r["said"] else ""
    return (f"{r['scene']:>3} {r['solver']:<9}{r['steps']:>4}x{r['iterations']} {r['apart']:>8.1e} {r['true']:>8.1e} "
            f"{r['last']:>8.1e} {r['said']:>8.1e} {r['said'] / r['true']:>6.2f} {r['strain']:>7.3f} {r['right']:>7.3f} "
            f"{r['ms']:>6.1f}{_times(r)}  {r['what']} {mark} {'; said sensitive' if r['sensitive'] else ''} "
            f"{len(r['warnings']) or ''}")


def _times(r: dict) -> str:
    return f" {r['ms'] / r['bare_ms']:.2f}x" if r["bare_ms"] else ""


def apart(r: dict) -> bool:
    return not r["apart"] <= SENSITIVE * r["said"]


def summary(rows: list[dict]) -> str:
    good, parted = [r for r in rows if not apart(r)], [r for r in rows if apart(r)]
    ratio = np.array([r["said"] / r["true"] for r in good] or [np.nan])
    beside = sum(r["bare_ms"] or 0.0 for r in rows)
    spent = sum(r["ms"] for r in rows)
    return (f"{len(good)} scenes, {len(parted)} sensitive ones apart: true error at most the reported one in "
            f"{int((ratio >= 1.0).sum())}, over {FAR:g} times it in {int((ratio < 1.0 / FAR).sum())}; reported over true "
            f"{np.median(ratio):.2g} in the median, {ratio.min():.2g} to {ratio.max():.3g}; said sensitive of those apart "
            f"{sum(bool(r['sensitive']) for r in parted)}, of the others {sum(bool(r['sensitive']) for r in good)}; "
            f"{spent:.0f} ms a frame of all" + (f", {spent / beside:.2f} times that without estimates" if beside else ""))


def numbers(said: str) -> list[int]:
    """2,5-7 as 2, 5, 6, 7."""
    spans = [part.split("-") for part in said.split(",")]
    return [k for span in spans for k in range(int(span[0]), int(span[-1]) + 1)]


def main() -> None:
    parser = argparse.ArgumentParser(prog="tools.bench.choice.reported_errors", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", default="0-39")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--references", type=Path, required=True)
    parser.add_argument("--make", action="store_true")
    parser.add_argument("--paired", action="store_true")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    if given.make:
        given.references.mkdir(parents=True, exist_ok=True)
        with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
            for done in as_completed([pool.submit(made, k, given.seed, given.references) for k in numbers(given.scenes)]):
                print(done.result(), flush=True)
        return
    rows = []
    print(HEAD)
    for k in numbers(given.scenes):
        if (given.references / f"{given.seed}_{k}.npz").exists():
            rows.append(row(k, given.seed, given.references, given.device, given.paired))
            print(line(rows[-1]), flush=True)
            if given.json:
                given.json.write_text("[" + ",\n".join(json.dumps(r) for r in rows) + "]\n")
    print(summary(rows) if rows else f'no references in {given.references}: --make')


if __name__ == "__main__":
    main()
