"""Abuse that must end finite and recover, and example scenes: every row and scene with every solver that wsim has.

    python -m tools.stress [--device cpu] [--only NAME ...] [--solvers xpbd/bdf2,...] [--frames N] [--seconds N] [--long]
                           [--jobs N] [--json FILE]

`--only "scene "` takes the example scenes alone. Exit code 1 if a row does not hold. Rows, bounds and reasons: rows.py,
judge.py, solvers.py; scenes: examples.py.
"""

import argparse
import json
import queue
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import warp as wp

from tools.bench.speed import hardware
from tools.stress import examples, judge
from tools.stress.rows import Row
from tools.stress.run import Worker, watched
from tools.stress.solvers import Solver, available, listed
from tools.stress.table import ROWS

HEAD = f"{'row':<26} {'solver':<26} {'worst strain':>12} {'left':>9} {'energy':>8} {'ms':>7}  verdict"


def chosen(only: list[str], solvers: str) -> tuple[list[Row], list[str], list[Solver]]:
    """Rows and example scenes ("scene flag") whose name contains one of `only`, solvers whose name begins with one of a comma
    list; ValueError for none."""
    rows = [r for r in ROWS if not only or any(o in r.name for o in only)]
    scenes = [n for n in examples.names() if not only or any(o in f"scene {n}" for o in only)]
    found = [s for s in available() if not solvers or any(s.name.startswith(n) for n in solvers.split(","))]
    if not rows and not scenes:
        raise ValueError(f"--only {only} names no row; there are {', '.join(r.name for r in ROWS)}, "
                         f"{', '.join(f'scene {n}' for n in examples.names())}")
    if not found:
        raise ValueError(f"--solvers {solvers} names none; there are {', '.join(s.name for s in available())}")
    return rows, scenes, found


def line(record: judge.Record, verdict: judge.Verdict) -> str:
    final = f"{record.strain[-1]:.2g}" if record.strain else "-"
    return (f"{record.row:<26} {record.solver + '/' + record.integrator:<26} {record.worst:>12.3g} {final:>9} "
            f"{judge.energy_ratio(record):>8.3g} {record.ms:>7.2f}  {'' if verdict.held else 'FAILS: '}{verdict.text}")


def verdict_of(record: judge.Record, row: Row, solver: Solver) -> judge.Verdict:
    return judge.judge(record, row.reasons(solver.solver, solver.integrator) | listed(row.scene(), solver))


def abused(worker: Worker, row: Row, solvers: list[Solver], how: tuple) -> list[dict]:
    """A row with every solver; how: device, precision, whether it is the long one."""
    results = []
    for solver in (s for s in solvers if not row.solvers or s.solver in row.solvers):
        record = watched(worker, row, solver, *how)
        verdict = verdict_of(record, row, solver)
        print(line(record, verdict), flush=True)
        results.append(record.as_dict() | {"held": verdict.held, "verdict": verdict.text})
    return results


def scene(worker: Worker, name: str, solvers: list[Solver], seconds: float, how: tuple) -> list[dict]:
    """An example scene with every solver, each in so many seconds; how: frames, device, precision."""
    right, results = answered(worker, examples.converged, (name, *how), examples.Example(name, "converged"), seconds), []
    print(examples.line(right, judge.Verdict(True, "what others are held against")), flush=True)
    for solver in solvers:
        found = answered(worker, examples.case, (name, solver, *how), examples.Example(name, solver.name), seconds)
        verdict = examples.judge(found, right)
        print(examples.line(found, verdict), flush=True)
        results.append(examples.as_dict(found, verdict))
    return results


def answered(worker: Worker, work, arguments: tuple, empty: examples.Example, seconds: float) -> examples.Example:
    done, answer = worker.ask(work, arguments, seconds)
    if not done:
        empty.broke = answer
    return answer if done else empty


def spread(works: list[Callable[..., list[dict]]], jobs: int) -> Iterator[list[dict]]:
    """What each work leaves, in their order; so many at a time, each with a worker of its own."""
    free: queue.Queue[Worker] = queue.Queue()
    for _ in range(jobs):
        free.put(Worker())

    def one(work: Callable[..., list[dict]]) -> list[dict]:
        worker = free.get()
        try:
            return work(worker)
        finally:
            free.put(worker)
    with ThreadPoolExecutor(jobs) as pool:
        yield from pool.map(one, works)
    while not free.empty():
        free.get().end()


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tools.stress", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--precision", default="float32")
    parser.add_argument("--only", nargs="+", default=[], help="rows whose name contains one of these")
    parser.add_argument("--solvers", default="", help="solver/integrator, or its beginning, by commas")
    parser.add_argument("--frames", type=int, default=24, help="of the example scenes")
    parser.add_argument("--seconds", type=float, default=1800.0, help="limit of an example scene with one solver")
    parser.add_argument("--long", action="store_true", help="rest of 10^5 frames")
    parser.add_argument("--jobs", type=int, default=1, help="rows at a time; their times are then no measurement")
    parser.add_argument("--json", default=None)
    args = parser.parse_args(arguments)
    try:
        rows, scenes, solvers = chosen(args.only, args.solvers)
    except ValueError as error:
        parser.error(str(error))
    wp.config.log_level = 40
    device = wp.get_device(args.device)
    print(f"{hardware(device)}, {args.precision}, warp {wp.config.version}\n{HEAD}", flush=True)
    works = [partial(abused, row=row, solvers=solvers, how=(args.device, args.precision, args.long)) for row in rows]
    works += [partial(scene, name=name, solvers=solvers, seconds=args.seconds, how=(args.frames, args.device, args.precision))
              for name in scenes]
    bounds = [{"row": r.name, "what": r.what, "energy": r.energy, "work": r.work} for r in rows]
    head, results = {"device": hardware(device), "warp": wp.config.version, "rows": bounds}, []
    for found in spread(works, args.jobs):
        results += found
        if args.json:                                    # as it goes: a run that is cut short keeps what it found
            Path(args.json).write_text(json.dumps(head | {"results": results}, indent=1))
    failed = [r for r in results if not r["held"]]
    print(f"{len(results) - len(failed)} of {len(results)} hold")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
