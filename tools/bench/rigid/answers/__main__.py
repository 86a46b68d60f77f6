"""Rigid contacts beside what is known of them: closed forms, conservation, converged solutions.

    python -m tools.bench.rigid.answers [NAME ...] [--precision float32|float64] [--list] [--failed]

NAME is a pattern of names of cases (`roll/*`, `blow/*/24x10*`); all of them where none is given. A row has the case, what is
measured, its error, the error that is allowed, and on the first row of a case the CPU seconds of its frames without the first.
Exit code 1 where an error is larger than allowed.
"""

import argparse
import sys
from fnmatch import fnmatch

from tools.bench.rigid.answers import blows, carried, coin, flush, prism, rolling, slopes, unchanged, walls
from tools.bench.rigid.answers.case import Case, Figure, lines

PARTS = (rolling, slopes, coin, prism, blows, flush, carried, walls, unchanged)


def every() -> list[Case]:
    return [case for part in PARTS for case in part.cases()]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=["*"])
    parser.add_argument("--precision", default="float32")
    parser.add_argument("--list", action="store_true", help="names only")
    parser.add_argument("--failed", action="store_true", help="print rows that fail, and a line for each case that does not")
    args = parser.parse_args()
    chosen = [c for c in every() if any(fnmatch(c.name, pattern) for pattern in args.names)]
    if not chosen:
        sys.exit(f"no case is named {' or '.join(args.names)}; --list prints the names")
    if args.list:
        print(*(c.name for c in chosen), sep="\n")
        return 0
    bad = 0
    for case in chosen:
        try:
            figures, cpu = case.run(args.precision)
        except Exception as error:                             # a case that cannot run is a row that fails
            figures, cpu = [Figure(f"{type(error).__name__}: {str(error)[:90]}", float("nan"), 0.0)], 0.0
        wrong = sum(not f.good for f in figures)
        bad += bool(wrong)
        rows = lines(case, figures, cpu)
        if args.failed:
            good = f"ok   {case.name:<46} all of {len(figures)} {cpu:>8.2f} s"
            rows = [row for row in rows if row.startswith("FAIL")] or [good]
        print(*rows, sep="\n", flush=True)
    print(f"{len(chosen) - bad} of {len(chosen)} cases are as they should be")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
