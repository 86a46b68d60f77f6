"""Random draws of surfaces that collide: no two triangles may intersect, by the exact test on the float32 values of a file.

    python -m tools.draws [--draws 100] [--first 0] [--solvers xpbd,newton,...] [--frames 12] [--most 5000] [--device cpu]
                          [--jobs 1] [--seconds S] [--json FILE]

Each tenth draw is tested behind every substep, the others behind every frame. Triangles of mesh colliders and boxes, where they
stand then, are tested against surfaces too. Exit code 1 where triangles intersect, energy that cuts take is beyond 1e-3 of the
kinetic energy a second, a point is cut by more than 5 % in more than 10 substeps running, or a value is not finite.
"""

import argparse
import itertools
import json
import sys
import time
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from multiprocessing import get_context
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tools.draws.row import held, tried  # noqa: E402
from tools.draws.scenes import SOLVERS, Draw  # noqa: E402

HEAD = (f"{'draw':>5} {'kind':<8} {'prims':>5} {'points':>6} {'solver':<15} {'tested':>6} {'crossed':>7} {'proj':>4} "
        f"{'cut':>4} {'held':>4} {'energy/s':>9} {'run':>4} {'gap/th':>7} {'strain':>7} {'momentum':>9} {'s':>6}")


def line(row: dict) -> str:
    lost = "" if row["momentum"] is None else f"{row['momentum']:.1e}"
    return (f"{row['draw']:>5} {row['kind']:<8} {row['prims']:>5} {row['points']:>6} {row['solver']:<15} {row['tested']:>6} "
            f"{row['crossed']:>7} {row['projected']:>4.0f} {row['cut']:>4.0f} {row['held']:>4.0f} {row['cut_energy']:>9.2g} "
            f"{row['cut_run']:>4.0f} {row['least_gap']:>7.3f} {row['strain']:>7.3f} {lost:>9} "
            f"{row['seconds']:>6.1f}{'' if held(row) else '  FAILS'}")


def rows(given, began: float):
    """Rows as they come; no run begins after `seconds`."""
    todo = [(k, solver) for k in range(given.first, given.first + given.draws) for solver in given.solvers.split(",")
            if Draw(k, solver).able and sum(len(b.points) for b in Draw(k, solver).scene.bodies()) <= given.most]
    if given.jobs == 1:
        for k, solver in todo:
            if time.monotonic() - began < given.seconds:
                yield tried(k, solver, given.frames, given.device)
        return
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        left, running = iter(todo), set()
        while True:
            room = given.jobs - len(running) if time.monotonic() - began < given.seconds else 0
            running |= {pool.submit(tried, k, s, given.frames, given.device) for k, s in itertools.islice(left, room)}
            if not running:
                return
            done, running = wait(running, return_when=FIRST_COMPLETED)
            yield from (f.result() for f in done)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.draws", description=__doc__.splitlines()[0])
    for name, default in (("draws", 100), ("first", 0), ("frames", 12), ("most", 5000), ("jobs", 1)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--solvers", default=",".join(SOLVERS))
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--seconds", type=float, default=np.inf)
    parser.add_argument("--json", type=Path)
    given, found = parser.parse_args(), []
    print(HEAD)
    for row in rows(given, time.monotonic()):
        found.append(row)
        print(line(row), flush=True)
        if given.json:
            given.json.write_text("[" + ",\n".join(json.dumps(r) for r in found) + "]\n")
    failed = sum(not held(row) for row in found)
    print(f"{len(found)} runs, {sum(row['tested'] for row in found)} states tested, {failed} fail")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
