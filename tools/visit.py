"""Everything that wants a GPU, job after job, each with its own limit: for a machine that is lent for minutes.

    python tools/visit.py FOLDER [--peer-python X/bin/python] [--cache FOLDER] [--only NAME,...] [--seconds 1500]

Each job writes FOLDER/NAME.txt as it goes, and FOLDER/NAME.json where its tool has one, so that a visit cut short keeps what
was done. A job that would begin with less than half its limit left is skipped, and said. Last come the jobs' times and exit
codes; exit code 1 if one failed. The limits are generous guesses, or what is left. peers.py says what X is.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path
from time import perf_counter

ROOT = Path(__file__).resolve().parents[1]
PYTHON, DEVICE = sys.executable, "cuda:0"
# name: (seconds at most, command; {json} is the job's file)
JOBS = {
    "tests": (300, ["-m", "pytest", "-q", "-p", "no:cacheprovider", "--tb=short", "tests/gpu",
                    "tests/physics/motion/test_compensated.py", "tests/physics/solver/test_newton.py", "-k",
                    "gpu or cuda"]),
    "cluster": (120, ["tools/bench/nets/cluster.py", "--device", DEVICE, "--json", "{json}"]),
    "choice": (240, ["tools/bench/choice/misses.py", "--device", DEVICE, "--json", "{json}"]),
    "speed": (240, ["tools/bench/speed.py", "--device", DEVICE, "--json", "{json}"]),
    "bench": (120, ["-m", "wsim", "bench", "scenes/hanging_cloth.usda", "--device", DEVICE, "--quick", "--json", "{json}"]),
    "stress": (240, ["-m", "tools.stress", "--device", DEVICE, "--solvers", "auto", "--json", "{json}"]),
    "stress_soft": (240, ["-m", "tools.stress", "--device", DEVICE, "--only", "soft", "--solvers", "auto,implicit/sdirk3",
                          "--json", "{json}"]),
    "gradients": (480, ["tools/bench/gradients.py", "--device", DEVICE, "--million", "--json", "{json}"]),
    "contact": (120, ["tools/bench/contact/points.py", "--device", DEVICE, "--json", "{json}"]),
    "soft": (120, ["tools/bench/soft/substeps.py", "--device", DEVICE, "--json", "{json}"]),
}
PEERS = {
    "peers_32": (400, ["--sides", "32"]),
    "peers_64": (500, ["--sides", "64"]),
    "peers_garment": (300, ["--sides", "", "--garment"]),
}


def jobs(args: argparse.Namespace) -> dict[str, tuple[int, list[str]]]:
    """The jobs that were asked for. SystemExit for an unknown name."""
    found = dict(JOBS)
    if args.peer_python:
        more = ["--peer-python", args.peer_python, *(["--cache", args.cache] if args.cache else [])]
        found |= {name: (limit, ["tools/bench/nets/peers.py", "--device", DEVICE, *words, *more, "--json", "{json}"])
                  for name, (limit, words) in PEERS.items()}
    names = args.only.split(",") if args.only else list(found)
    if unknown := set(names) - set(found):
        sys.exit(f"--only: no job {', '.join(sorted(unknown))}; there are {', '.join(found)}"
                 + ("" if args.peer_python else "; those of peers.py want --peer-python"))
    return {name: found[name] for name in names}


def run(name: str, words: list[str], folder: Path, limit: float) -> tuple[str, float]:
    """Exit code, or "time", and seconds."""
    began = perf_counter()
    command = [PYTHON, *(w.replace("{json}", str(folder / f"{name}.json")) for w in words)]
    path = os.pathsep.join(filter(None, [os.environ.get("PYTHONPATH"), str(ROOT)]))
    with open(folder / f"{name}.txt", "w") as out:
        try:
            done = subprocess.run(command, cwd=ROOT, stdout=out, stderr=subprocess.STDOUT, timeout=limit,
                                  env=os.environ | {"PYTHONUNBUFFERED": "1", "PYTHONPATH": path})
            code = str(done.returncode)
        except subprocess.TimeoutExpired:
            code = "time"
    return code, perf_counter() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--peer-python", default=None)
    parser.add_argument("--cache", default=None, help="folder that keeps exact trajectories")
    parser.add_argument("--only", default=None, help="names of jobs, by commas")
    parser.add_argument("--seconds", type=float, default=1500.0, help="for all jobs together")
    args = parser.parse_args()
    args.folder = args.folder.resolve()
    args.folder.mkdir(parents=True, exist_ok=True)
    end, said = perf_counter() + args.seconds, []
    for name, (limit, words) in jobs(args).items():
        left = end - perf_counter()
        code, seconds = run(name, words, args.folder, min(limit, left)) if left > 0.5 * limit else ("skipped", 0.0)
        said.append((name, code, seconds))
        last = (args.folder / f"{name}.txt").read_text().splitlines()[-3:] if code != "skipped" else []
        print(f"{name:<16}{code:>8}{seconds:>8.0f} s", *(f"    {line[:150]}" for line in last), sep="\n", flush=True)
    print(*(f"{name} {code} {seconds:.0f} s" for name, code, seconds in said), sep="; ")
    sys.exit(any(code != "0" for _, code, _ in said))


if __name__ == "__main__":
    main()
