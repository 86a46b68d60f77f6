"""The largest strain of an edge in every example cloth, by default settings and in a converged run.

    python -m tools.bench.choice.peak_strains [--device cuda:0] [--scenes shirt,cape] [--jobs 1] [--json FILE]
    python -m tools.bench.choice.peak_strains --make [--scenes shirt,cape]

    strain     (length - rest) / rest of the edge that is stretched most, after frames 3, 6 and 12 [%]
    converged  the same of leapfrog of 2 n substeps, n those that are stable; `--make` keeps it and that of n substeps, both in
               float32 on a CPU, in tools/results/data/peak_strains.json
    apart      larger of the two references over the smaller, largest of the three frames: chance above about 1.5
    ratio      strain over the converged one, largest of the three frames; OVER where it is above 1.5 and no warning names both,
               small where no strain is above LEAST
    ms         of a frame, mean of those behind the first: CPU time of all threads, of a GPU wall clock
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

from wsim.scene import Scene  # noqa: E402
from wsim.simulation.measure.indicators import edge_strain  # noqa: E402
from wsim.simulation.predicted.settled import LEAST  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402
from wsim.usd import load  # noqa: E402

ROOT = Path(__file__).resolve().parents[3]
KEPT = ROOT / "tools" / "results" / "data" / "peak_strains.json"
FRAMES = 3, 6, 12
ALLOWED = 1.5
MANY = 100_000             # substeps with which any of the scenes is stable
WORDS = "converged run"    # of the warning of strain


def cloths() -> list[str]:
    """Names of the example scenes that have a cloth."""
    return sorted(p.stem for p in (ROOT / "scenes").glob("*.usda") if 'Deformable' in p.read_text() and scene(p.stem).cloths)


def scene(name: str) -> Scene:
    return load(str(ROOT / "scenes" / f"{name}.usda"))


def peaks(sim: Simulation) -> tuple[list[float], float]:
    """Strains after each of FRAMES; time of a frame [ms]."""
    clock = time.perf_counter if sim.device.is_cuda else time.process_time
    found, spent = [], []
    for frame in range(1, FRAMES[-1] + 1):
        began = clock()
        sim.step()
        spent.append(clock() - began)
        if frame in FRAMES:
            x = sim.state.x.numpy().astype(np.float64) + sim.state.e.numpy()
            found.append(max(float(edge_strain(b, x).max(initial=0.0)) for b in sim.model.bodies if len(b.edges)))
    return found, 1e3 * float(np.mean(spent[1:]))


def reference(name: str) -> dict:
    """Strains of leapfrog of n and 2 n substeps."""
    explicit = replace(scene(name), solver="explicit", integrator="leapfrog", substeps=MANY)     # named: no slivers get mass
    n = Simulation(explicit, device="cpu").plan.ports.stable_substeps()
    coarse, fine = (peaks(Simulation(replace(explicit, substeps=k * n), device="cpu"))[0] for k in (1, 2))
    return {"steps": [n, 2 * n], "coarse": coarse, "fine": fine}


def row(name: str, device: str | None, right: dict) -> dict:
    """The default run of a scene beside its reference."""
    sim = Simulation(scene(name), device=device)
    strains, ms = peaks(sim)
    report, plan = sim.report(False), sim.plan
    warned = [str(w) for w in report["warnings"] if WORDS in str(w)]
    pairs = [(max(a, b), min(a, b)) for a, b in zip(right["coarse"], right["fine"], strict=True)]
    return {"scene": name, "solver": plan.choice.solver, "steps": plan.clock.steps, "iterations": plan.clock.iterations,
            "strain": strains, "converged": right["fine"], "apart": max(a / max(b, 1e-9) for a, b in pairs),
            "ratio": max(s / max(c, 1e-9) for s, c in zip(strains, right["fine"], strict=True)), "ms": ms, "warned": warned}


HEAD = (f"{'scene':<16}{'solver':<9}{'steps':>7}   {'strain [%]':>20}   {'converged [%]':>20} {'apart':>6} {'ratio':>6} "
        f"{'ms':>8}")


def line(r: dict) -> str:
    three = (" ".join(f"{100.0 * s:>6.2f}" for s in r[name]) for name in ("strain", "converged"))
    mark = ("" if r["ratio"] <= ALLOWED else "warned" if r["warned"] else
            "small" if max(r["strain"]) < LEAST else "OVER")
    return (f"{r['scene']:<16}{r['solver']:<9}{r['steps']:>4}x{r['iterations']:<2}   {'   '.join(three)} {r['apart']:>6.2f} "
            f"{r['ratio']:>6.2f} {r['ms']:>8.1f} {mark}")


def main() -> None:
    parser = argparse.ArgumentParser(prog="tools.bench.choice.peak_strains", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device")
    parser.add_argument("--scenes", help="some of the examples, by name; default: all that have a cloth")
    parser.add_argument("--jobs", type=int, default=1, help="scenes at once; their times then say little")
    parser.add_argument("--make", action="store_true", help="make and keep the converged runs instead")
    parser.add_argument("--json", type=Path, help="file for the rows")
    given = parser.parse_args()
    names = given.scenes.split(",") if given.scenes else cloths()
    kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    if given.make:
        for name in names:
            kept[name] = reference(name)
            print(name, kept[name], flush=True)
            KEPT.write_text("{" + ",\n ".join(f"{json.dumps(k)}: {json.dumps(kept[k])}" for k in sorted(kept)) + "}\n")
        return
    rows = []
    print(HEAD, flush=True)
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        for done in as_completed([pool.submit(row, n, given.device, kept[n]) for n in names if n in kept]):
            rows.append(done.result())
            print(line(rows[-1]), *rows[-1]["warned"], sep="\n     ", flush=True)
    print(f"{len(rows)} scenes, {sum(r['ratio'] <= ALLOWED for r in rows)} within {ALLOWED:g}, "
          f"{sum(r['ratio'] > ALLOWED and bool(r['warned']) for r in rows)} more warned of")
    if given.json:
        given.json.write_text("[" + ",\n".join(json.dumps(r) for r in rows) + "]\n")


if __name__ == "__main__":
    main()
