"""How often the truth is inside two error bars of a fit, whether it says what cannot be known, and what fits cost.

Many draws of noise on the experiments of tools/bench/fitting/cases.py:

    python tools/bench/fitting/coverage.py [--draws 20] [--only net,drag,...] [--json tools/results/data/fit_cpu.json]

A row a parameter: draws inside two error bars of the truth, root mean square of (found - truth) over the error bar (1: bars are
right), error bar. Of parameters that are not known apart: draws in which a fit said so and gave no finite bar, and a row of the
combination that is known. An experiment: fits that say they converged, those of them that have not (from the returned point,
with differences of another step, chi^2 would still fall by more than PROMISE), those that doubt their bars, simulations (copies
times part of the horizon) and CPU seconds a fit. With --json rows are written as they come, and those of other experiments are
kept.
"""

import argparse
import json
import platform
import sys
from pathlib import Path
from time import process_time

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tools.bench.fitting.cases import CASES, Case  # noqa: E402
from wsim.fitting.fit import Fit  # noqa: E402
from wsim.fitting.observations.observe import Track  # noqa: E402
from wsim.fitting.observations.residuals import DifferenceSteps, Misfit  # noqa: E402

PROMISE = 0.25         # of chi^2: half an error bar


def hardware() -> str:
    """Name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def promise(case: Case, found: Fit, seen: list[Track]) -> float:
    """What a linear model at the returned point would take off chi^2 in the directions that are known, anew: along other
    directions than those of the fit, with other steps."""
    misfit = Misfit([(found.scene, seen)], found.parameters, device="cpu")
    e, p = found.estimate, len(found.parameters)
    B = np.linalg.qr(np.random.default_rng(5).normal(size=(p, p)))[0]
    parts = list(misfit.walk(e.theta, steps=DifferenceSteps(B, np.full(p, 3.0 * misfit.eps))))
    J, r = np.concatenate([part.J for part in parts]), np.concatenate([part.r for part in parts])
    U, S, _ = np.linalg.svd(J, full_matrices=False)
    noise = 1.0 if found.origin == "given" else found.sigma
    known = p - len(e.open)
    return float(((U[:, :known].T @ r)**2).sum() / noise**2) if len(S) else 0.0


def combination(case: Case, found: Fit) -> tuple[float, float]:
    """What is known of parameters that are not known apart, and its error bar."""
    assert case.together
    e, names = found.estimate, list(case.truth)

    def at(theta: np.ndarray) -> float:
        assert case.together
        return case.together({n: float(p.map.inverse(t)) for n, p, t in zip(names, found.parameters, theta, strict=True)})
    h = 1e-5 * np.eye(len(e.theta))
    slope = np.array([(at(e.theta + d) - at(e.theta - d)) / 2e-5 for d in h])
    return at(e.theta), float(np.linalg.norm(slope) / e.singular[0])


def study(case: Case, draws: int) -> dict:
    """Of each parameter: share inside, spread, error bar; and the cost."""
    began = process_time()
    found = [case.fit(seed) for seed in range(draws)]
    seconds = (process_time() - began) / draws
    truth = np.array(list(case.truth.values()))
    values, errors = (np.array([list(getattr(f, name).values()) for f in found]) for name in ("values", "errors"))
    names = list(case.truth)
    row: dict = {"noise": case.noise, "said_open": None}
    if case.together:
        row["said_open"] = int(sum(bool(f.estimate.words) and not np.isfinite(list(f.errors.values())).any() for f in found))
        pairs = np.array([combination(case, f) for f in found])
        names, truth, values, errors = ["+".join(names)], np.array([case.together(case.truth)]), pairs[:, :1], pairs[:, 1:]
    z = (values - truth) / errors
    promised = [promise(case, f, case.seen(seed)) for seed, f in enumerate(found)]
    return row | {
        "parameters": names, "inside": np.mean(np.abs(z) < 2.0, axis=0).tolist(),
        "spread": np.sqrt(np.mean(z**2, axis=0)).tolist(),
        "error": (np.mean(errors, axis=0) / np.abs(truth)).tolist(), "draws": draws,
        "converged": int(sum(f.converged for f in found)),
        "falsely": int(sum(f.converged and p > PROMISE for f, p in zip(found, promised, strict=True))),
        "doubted": int(sum(any("do not trust" in n or "not to be trusted" in n for n in f.notes) for f in found)),
        "simulations": float(np.mean([f.simulations for f in found])), "most": max(f.simulations for f in found),
        "launches": float(np.mean([f.launches for f in found])), "seconds": seconds}


def show(name: str, row: dict) -> None:
    said = "" if row["said_open"] is None else f"  not known apart: said {row['said_open']}"
    for k, parameter in enumerate(row["parameters"]):
        print(f"{name:<10}{parameter:<18}{row['noise']:>8.0e}{row['inside'][k]:>8.2f}{row['spread'][k]:>8.2f}"
              f"{100 * row['error'][k]:>11.4f}%{row['converged']:>7d}/{row['draws']}{row['falsely']:>9d}{row['doubted']:>9d}"
              f"{row['simulations']:>13.1f}{row['seconds']:>9.2f}{said}", flush=True)


def total(rows: dict) -> str:
    """Of the experiments whose truth is the model's own."""
    own = [r for name, r in rows.items() if name != "fine"]
    inside = np.concatenate([np.repeat(r["inside"], r["draws"]) for r in own])
    spread = np.concatenate([np.repeat(np.square(r["spread"]), r["draws"]) for r in own])
    return (f"{len(own)} experiments, {sum(r['draws'] for r in own)} fits: {100 * inside.mean():.1f} % inside two error bars, "
            f"z rms {np.sqrt(spread.mean()):.2f}, {sum(r['falsely'] for r in own)} falsely converged, "
            f"{sum(r['draws'] - r['converged'] for r in own)} not converged")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--only", default=",".join(CASES))
    parser.add_argument("--json", metavar="FILE")
    args = parser.parse_args()
    file = Path(args.json) if args.json else None
    kept = json.loads(file.read_text(encoding="utf-8"))["rows"] if file and file.exists() else {}
    rows: dict = {}
    print(f"{'case':<10}{'parameter':<18}{'noise':>8}{'inside':>8}{'spread':>8}{'error bar':>12}{'converged':>10}{'falsely':>9}"
          f"{'doubted':>9}{'simulations':>13}{'CPU s':>9}")
    for name in args.only.split(","):
        rows[name] = study(CASES[name](), args.draws)
        show(name, rows[name])
        if file:
            kept[name] = rows[name]
            text = json.dumps({"hardware": hardware(), "rows": {n: kept[n] for n in CASES if n in kept}}, indent=1)
            file.write_text(text + "\n", encoding="utf-8")
    print(total(rows))


if __name__ == "__main__":
    main()
