"""Two revisions through the suite, turn and turn about on one machine: what got slower, what got less accurate.

    python tools/bench/compare.py REV_A REV_B [--only TEXT,...] [--repeats 3] [--quick] [--one-suite] [--device cuda:0|cpu]
                                  [--json FILE]

A revision is anything that git knows as a commit, or WORK: the files as they stand. Others are checked out into worktrees,
which are removed at the end. Each run of the suite is a process of its own, A B A B ...; kernels are compiled before, in a
cache for each side. A revision without a suite gets the newer one's (this checkout's where both have none). Where each has its
own and they differ, that is said, since a row of one name may then be two problems; --one-suite judges both sides by the
newer one's. Rows that a side cannot run are said by name.

    ratio       ms of B over ms of A, of their medians; in brackets the lowest and highest of the pairs of runs
    SLOWER      by more than the spread of the runs, which is the larger of both sides' (max - min) / median, in every pair;
                `faster` likewise. One repeat has no spread, and nothing is marked
    LESS ACCURATE   the least error of B is more than WORSE times the largest of A, and than the answer is known to
    NOT FINITE  B has no number where A has one; times are compared only where both have
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
BENCH = Path("tools") / "bench"
JUDGES = ("suite.py", "problems.py", "reference.py", "speed.py")
WORK = "WORK"
WORSE = 1.01


def git(*words: str) -> str:
    """What git says. SystemExit with its complaint."""
    try:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    except FileNotFoundError:
        raise SystemExit("compare: git is not installed") from None
    except subprocess.CalledProcessError as error:
        raise SystemExit(f"compare: git {words[0]}: {error.stderr.strip().splitlines()[-1]}") from None


@dataclass
class Side:
    """One revision: where it stands, and when it was committed."""

    name: str                                # "A" or "B"
    revision: str
    commit: str
    root: Path
    when: float

    @classmethod
    def of(cls, name: str, revision: str, folder: Path) -> "Side":
        """Raises SystemExit where git knows no such commit. Nothing is checked out yet."""
        if revision == WORK:
            return cls(name, WORK, git("describe", "--always", "--dirty", "--exclude", "*"), ROOT, float("inf"))
        commit = git("rev-parse", "--verify", "--end-of-options", f"{revision}^{{commit}}")
        return cls(name, revision, commit[:12], folder / name, float(git("show", "-s", "--format=%ct", commit)))


def judges(root: Path) -> dict[str, bytes]:
    """The files of a suite; {} where there is none."""
    found = {file: (root / BENCH / file).read_bytes() for file in JUDGES if (root / BENCH / file).exists()}
    return found if JUDGES[0] in found else {}


def share(sides: list[Side], same: bool) -> bool:
    """Gives a suite to the sides that have none, or the newer one's to both. Whether both now have the same."""
    newer = judges(max(sides, key=lambda s: s.when).root) or judges(ROOT)
    for side in sides:
        if side.root != ROOT and (same or not judges(side.root)):
            (side.root / BENCH).mkdir(parents=True, exist_ok=True)
            for file, text in newer.items():
                (side.root / BENCH / file).write_bytes(text)
    return judges(sides[0].root) == judges(sides[1].root)


@contextmanager
def checked_out(revisions: tuple[str, str]) -> Iterator[tuple[list[Side], Path]]:
    """Both sides, and a folder for caches; worktrees and folder are gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="compare_") as name:
        folder = Path(name)
        sides = [Side.of(side, revision, folder) for side, revision in zip("AB", revisions, strict=True)]
        try:
            for side in sides:
                if side.root != ROOT:
                    git("worktree", "add", "--detach", str(side.root), side.commit)
            yield sides, folder
        finally:
            for side in sides:
                if side.root != ROOT and side.root.exists():
                    git("worktree", "remove", "--force", str(side.root))


def suite(side: Side, folder: Path, options: list[str]) -> dict:
    """One run of the suite in a process of its own; {"rows": []} with `failed` where it does not even start."""
    out = folder / "rows.json"
    out.unlink(missing_ok=True)
    done = subprocess.run([sys.executable, str(BENCH / "suite.py"), *options, "--json", str(out)], cwd=side.root,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                          env=os.environ | {"WARP_CACHE_PATH": str(folder / f"kernels_{side.name}")})
    if done.returncode or not out.exists():
        return {"rows": [], "failed": (done.stdout.strip() or f"exit status {done.returncode}").splitlines()[-1]}
    return json.loads(out.read_text())


# the table: arithmetic on rows, nothing else

def one(runs: list[list[dict]], name: str) -> tuple[list[dict], str]:
    """That row of every run of a side, and why there is none."""
    found = [row for rows in runs for row in rows if row["name"] == name]
    failed = [row["failed"].splitlines()[0] for row in found if "failed" in row]
    return found, failed[0] if failed else ("" if found else "no such row")


def beside(a: list[list[dict]], b: list[list[dict]]) -> list[dict]:
    """a and b: the rows of each run. One entry a name, in the order of b, then what only a has."""
    names = list(dict.fromkeys(row["name"] for rows in (*b, *a) for row in rows))
    return [entry(name, one(a, name), one(b, name)) for name in names]


def entry(name: str, a: tuple[list[dict], str], b: tuple[list[dict], str]) -> dict:
    """A row of the table; `cannot` says which side cannot run it and why."""
    out: dict = {"name": name, "cannot": {side: why for side, (_, why) in (("A", a), ("B", b)) if why}, "marks": []}
    for side, (rows, why) in (("a", a), ("b", b)):
        if why:
            continue
        finite = all(row["finite"] for row in rows)
        out |= {f"ms_{side}": float(np.median([r["ms"] for r in rows])), f"unit_{side}": rows[0].get("unit", "1"),
                f"error_{side}": float(np.median([r["error"] for r in rows])) if finite else None}
    if out["cannot"]:
        return out
    out |= times([r["ms"] for r in a[0]], [r["ms"] for r in b[0]])
    if None in (out["error_a"], out["error_b"]):               # how fast nonsense is says nothing
        return out | {"marks": ["NOT FINITE"] * (out["error_a"] is not None)}
    marks = [word for word in ("SLOWER", "faster") if out[word.lower()]]
    worst = max(b[0][0].get("known", 0.0), *(r["error"] for r in a[0]))
    return out | {"marks": marks + ["LESS ACCURATE"] * (min(r["error"] for r in b[0]) > WORSE * worst)}


def times(a: list[float], b: list[float]) -> dict:
    """Ratio of the medians, of the pairs the lowest and highest, the spread (None: one run), slower, faster."""
    pairs = [y / x for x, y in zip(a, b, strict=False)]
    ratio = float(np.median(b) / np.median(a))
    spread = max(float((max(ms) - min(ms)) / np.median(ms)) for ms in (a, b)) if min(len(a), len(b)) > 1 else None
    return {"ratio": ratio, "low": min(pairs), "high": max(pairs), "spread": spread,
            "slower": spread is not None and ratio > 1.0 + spread and min(pairs) > 1.0,
            "faster": spread is not None and 1.0 / ratio > 1.0 + spread and max(pairs) < 1.0}


def line(row: dict) -> str:
    """A row in print."""
    if row["cannot"]:
        return f"{row['name']:<54}  " + "; ".join(f"{side} cannot run it: {why[:90]}" for side, why in row["cannot"].items())
    errors = [f"{e:9.2e}" if e is not None else "no number" for e in (row["error_a"], row["error_b"])]
    return (f"{row['name']:<54}{row['ms_a']:10.3f}{row['ms_b']:10.3f}  {row['ratio']:6.3f} ({row['low']:.3f} to "
            f"{row['high']:.3f})  {errors[0]}  {errors[1]}  {', '.join(row['marks'])}").rstrip()


def summed(table: list[dict]) -> list[str]:
    """What is marked, by name, and the ratio over all."""
    ratios = [row["ratio"] for row in table if not row["cannot"] and None not in (row["error_a"], row["error_b"])]
    out = [f"time of B over A, geometric mean of {len(ratios)} rows: {np.exp(np.mean(np.log(ratios))):.3f}"] if ratios else []
    for mark in ("SLOWER", "LESS ACCURATE", "NOT FINITE", "faster"):
        names = [row["name"] for row in table if mark in row["marks"]]
        out += [f"{mark}: {len(names)}" + "".join(f"\n    {n}" for n in names * (mark != "faster"))] if names else []
    for side in "AB":
        names = [row["name"] for row in table if side in row["cannot"]]
        out += [f"{side} cannot run: {len(names)}" + "".join(f"\n    {n}" for n in names)] if names else []
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("a", metavar="REV_A")
    parser.add_argument("b", metavar="REV_B")
    parser.add_argument("--repeats", type=int, default=3)
    for name in ("--only", "--device", "--precision", "--cache"):
        parser.add_argument(name, default=None, help="as the suite has it")
    parser.add_argument("--quick", action="store_true", help="as the suite has it")
    parser.add_argument("--one-suite", action="store_true", help="both sides by the newer one's suite")
    parser.add_argument("--json", default=None)
    args = parser.parse_args()
    if args.repeats < 1:
        parser.error(f"--repeats {args.repeats}: allowed is 1 or more")
    options = [word for name in ("only", "device", "precision") if getattr(args, name)
               for word in (f"--{name}", getattr(args, name))] + ["--quick"] * args.quick
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))          # worktrees are removed then too
    with checked_out((args.a, args.b)) as (sides, folder):
        if not share(sides, args.one_suite):
            print("the suites of A and B differ: a row of one name may be two problems (--one-suite: the newer one's for both)")
        options += ["--cache", os.path.abspath(args.cache or folder)]
        runs: dict[str, list[dict]] = {"A": [], "B": []}
        for side in sides:
            print(f"{side.name}: {side.revision} ({side.commit}); compiling", flush=True)
            suite(side, folder, [*options, "--warm"])
        for repeat in range(args.repeats):
            for side in sides:
                print(f"run {repeat + 1} of {args.repeats}: {side.name}", flush=True)
                runs[side.name].append(suite(side, folder, options))
        return told(args, sides, runs)


def told(args, sides: list[Side], runs: dict[str, list[dict]]) -> int:
    """Prints the table, writes the JSON. 1 where a side has no rows at all."""
    about: dict = {k: v for k, v in next((r for r in (*runs["B"], *runs["A"]) if r["rows"]), {}).items()
                   if k not in ("rows", "wsim")}
    table = beside(*([run["rows"] for run in runs[side]] for side in "AB"))
    print(", ".join(f"{k} {v}" for k, v in about.items()), f"{'row':<54}{'ms A':>10}{'ms B':>10}   ratio (of pairs)"
          "        error A    error B", *map(line, table), *summed(table), sep="\n")
    broken = {side: run["failed"] for side in "AB" for run in runs[side] if "failed" in run}
    for side, why in broken.items():
        print(f"{side}: the suite itself did not run: {why}")
    if args.json:
        part = Path(f"{args.json}.part")
        part.write_text(json.dumps(about | {s.name.lower(): {"revision": s.revision, "commit": s.commit} for s in sides} | {
            "repeats": args.repeats, "broken": broken, "rows": table, "runs": runs}, indent=1))
        os.replace(part, args.json)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
