"""Rows an hour of a sweep by how many workers share it, against one worker: GPUs, or cores of a CPU (needs pip install ray).

    python -m tools.bench.fitting.sweeps [--scene scenes/flag.usda] [--vary "stretch=log(1000,5000,24)"] [--workers 1,2]
                                         [--device cuda:0|cpu] [--repeats 2] [--json FILE]

Rates are of the rows after all workers have given their first: before that they start, import and load kernels, once. Sweeps
of one and of several workers alternate; of each the best rate counts, as others on a machine only take from it. The tables
must be the same to the bit.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import warp as wp

import wsim
from tools.bench.speed import hardware
from wsim.sweep.job import Settings


def rate(args, workers: int) -> tuple[float, dict]:
    """Rows a second once all workers run, and the digests of the runs' ends."""
    settings, seen, ends = Settings(device=args.device, workers=workers, worlds=1, cores=1), [], {}
    with tempfile.TemporaryDirectory() as folder:
        for row in wsim.sweep(args.scene, args.vary, Path(folder) / "out", settings=settings):
            assert row["status"] == "done", row
            seen.append((time.perf_counter(), row["worker"]))
            ends[row["run"]] = row["state"]
    known: set = set()
    for k, (_, worker) in enumerate(seen):
        known.add(worker)
        if len(known) == workers:
            return (len(seen) - 1 - k) / (seen[-1][0] - seen[k][0]), ends
    raise RuntimeError(f"{len(known)} of {workers} workers gave rows: ask for more rows")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="scenes/flag.usda")
    parser.add_argument("--vary", default="stretch=log(1000,5000,24)")
    parser.add_argument("--workers", default="1,2")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    counts, best, ends = [int(n) for n in args.workers.split(",")], {}, {}
    for _ in range(args.repeats):
        for n in counts:
            found, same = rate(args, n)
            best[n], ends = max(best.get(n, 0.0), found), ends or same
            if same != ends:
                raise SystemExit("the table is not that of one worker")
            print(f"{n} workers: {3600.0 * found:.0f} rows an hour, {best[n] / best[counts[0]]:.2f} times {counts[0]}",
                  flush=True)
    if args.json:
        said = {"device": hardware(wp.get_device(args.device)), "scene": args.scene, "vary": args.vary,
                "rows_an_hour": {n: 3600.0 * r for n, r in best.items()},
                "times": {n: r / best[counts[0]] for n, r in best.items()}}
        Path(args.json).write_text(json.dumps(said, indent=1))


if __name__ == "__main__":
    main()
