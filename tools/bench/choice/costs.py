"""Constants of `wsim.simulation.cost.COSTS` from measured frames: least squares of relative errors, none below 0.

    sum over rows of (sum_k counts_k c_k / seconds - 1)^2 + HOLD sum_k (c_k / present_k - 1)^2

so that what no row tells apart stays as it is.

    python -m tools.bench.choice.costs tools/results/data/choice_h200.json [--kind cuda]

replays a file of misses.py without running anything: the run of each scene that today's COSTS hold for the fastest of those
measured to err by no more than WANTED, and its measured time over the least of them.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from wsim.simulation.cost import COSTS

HOLD = 1e-3
ROUNDS = 2000
WANTED = 0.01          # error over the size of a scene: what `Scene.error` is by default


def fitted(rows: list[dict], present: dict[str, float]) -> dict[str, float]:
    """rows: {"counts": {name: times a frame}, "seconds": of a frame}; constants by name, for all that the rows do."""
    names = sorted({name for row in rows for name, times in row["counts"].items() if times})
    A = np.array([[row["counts"].get(name, 0.0) * present[name] / row["seconds"] for name in names] for row in rows])
    H, b = A.T @ A + HOLD * np.eye(len(names)), A.sum(axis=0) + HOLD
    z = np.ones(len(names))
    for _ in range(ROUNDS):                                # Gauss-Seidel, each kept from going below 0
        for k in range(len(names)):
            z[k] = max(0.0, z[k] + (b[k] - H[k] @ z) / H[k, k])
    return {name: float(z[k] * present[name]) for k, name in enumerate(names)}


def ratios(rows: list[dict], costs: dict[str, float]) -> np.ndarray:
    """Seconds that the constants say over those measured, (rows,)."""
    return np.array([sum(times * costs[name] for name, times in row["counts"].items()) / row["seconds"] for row in rows])


def replayed(rows: list[dict], costs: dict[str, float]) -> list[tuple[float, str]]:
    """Measured time of the run that the constants choose over the least one, and the case; greatest first. Scenes of which
    no counted run errs by less than WANTED say nothing and are left out."""
    found = []
    for row in rows:
        good = [run for run in (row["auto"], *row["others"]) if run["counts"] and run["error"] <= WANTED]
        if good:
            says = [sum(times * costs[name] for name, times in run["counts"].items()) for run in good]
            found.append((good[int(np.argmin(says))]["seconds"] / min(run["seconds"] for run in good), row["case"]))
    return sorted(found, reverse=True)


def main() -> None:
    parser = argparse.ArgumentParser(prog="tools.bench.choice.costs", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="what misses.py wrote with --json")
    parser.add_argument("--kind", choices=sorted(COSTS), default="cuda")
    given = parser.parse_args()
    record = json.loads(given.file.read_text(encoding="utf-8"))
    found = replayed(record["rows"], COSTS[given.kind])
    print(f"{record['device']}, costs of {given.kind}: time of the chosen run over the least, {len(found)} scenes of "
          f"{len(record['rows'])}")
    for ratio, case in found:
        print(f"{ratio:>6.2f}  {case}")


if __name__ == "__main__":
    main()
