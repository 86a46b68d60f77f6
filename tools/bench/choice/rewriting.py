"""What each rewriting of kernel source buys: seconds to a first frame with it and without, and milliseconds of later frames.

    python -m tools.bench.choice.rewriting [--scenes bear,dominoes] [--without header,calls] [--device cpu] [--rounds 1]
                                           [--at-once 1] [--frames 6] [--limit SECONDS] [--json FILE]

Each row is a pair of processes with a kernel cache of their own: the first finds it empty ("cold"), the second full ("warm").
Seconds are counted from the end of `import warp` to the end of the first frame. Ratios are the time without the rewriting over
the time with all of them: 1.3 means that it shortens a first frame by 1.3 times.

    plain      none of them: WSIM_PLAIN_WARP=1
    header     Warp's header is read without adjoints
    reference  structs and arrays that a function only reads go by reference
    noinline   long functions stand by themselves on a CPU (`wp.func(inline=False)`); on a GPU they do not
    calls      the last two, of which the first spares the second its copies
    single     each kernel has one variant, none for arrays without gaps
    parallel   modules for a CPU that the cache lacks are compiled at the same time
    recorded   launches are recorded in a CPU's graph as bytes

CPU seconds are those of all threads of a process. With --at-once N, N pairs run side by side, each on cores of its own. Rows
that have not begun after --limit seconds are left out.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from time import perf_counter, process_time

ROOT = Path(__file__).resolve().parents[3]
SCENES = "hanging_cloth", "squeezed_cube", "dominoes", "humanoid", "plume", "dam_break", "caped_man", "cape", "shirt"
PARTS = {"calls": ("reference", "noinline")}
SWITCHES = "plain", "header", "reference", "noinline", "calls", "single", "parallel", "recorded"
FIGURES = "cold_cpu", "cold_wall", "warm_cpu", "warm_wall", "warm_ms"
MARK = "first frame: "


def leave_out(switch: str, gpu: bool) -> None:
    """Turns one rewriting off in this process."""
    from wsim.model.compiler import header, parallel, recorded, source, variants
    for part in PARTS.get(switch, ()):
        leave_out(part, gpu)
    if switch == "header":
        header.with_lean_header = lambda text: text
        header.with_precompiled_header = lambda text, flags, place: (text, {})
    elif switch == "reference":
        source.only_read = lambda body, names: set()
    elif switch == "single":
        variants.QUESTION = "no such question"
    elif switch == "noinline":
        if not gpu:
            words = variants.codegen._INLINE_ATTRS
            variants.codegen._INLINE_ATTRS = {word: code for word, code in words.items() if word != variants.APART}
        variants.WORDS = "no such words"
    elif switch == "parallel":
        parallel.compile_all = lambda modules, device: None
    elif switch == "recorded":
        recorded.lighten_capture = lambda: None


def first_frame(scene: str, switch: str, device: str, frames: int) -> dict[str, float]:
    """Seconds of this process to the first frame, and the median of later ones [ms; of CPU time on a CPU]."""
    import warp as wp
    gpu = not device.startswith("cpu")
    clock = perf_counter if gpu else process_time
    cpu, wall = process_time(), perf_counter()
    if switch and switch != "plain":
        leave_out(switch, gpu)
    from wsim.simulation.simulation import Simulation
    from wsim.usd import load
    sim = Simulation(load(str(ROOT / "scenes" / f"{scene}.usda")), device=device)
    sim.step()
    wp.synchronize()
    found = {"cpu": process_time() - cpu, "wall": perf_counter() - wall}
    later = []
    for _ in range(1 + frames if frames else 0):
        began = clock()
        sim.step()
        wp.synchronize()
        later.append(1e3 * (clock() - began))
    return found | ({"ms": statistics.median(later[1:])} if later else {})


def measured(scene: str, switch: str, options, cores: set[int] | None) -> dict:
    """Cold and warm first frame of a scene without a rewriting ("": with all), in processes of their own."""
    row: dict = {"scene": scene, "without": switch}
    with tempfile.TemporaryDirectory() as cache:
        more = {"WARP_CACHE_PATH": cache, "WSIM_PLAIN_WARP": str(int(switch == "plain"))}
        bound = ["taskset", "-c", ",".join(map(str, sorted(cores)))] if cores else []
        for stage, frames in (("cold", 0), ("warm", options.frames)):
            done = subprocess.run([*bound, sys.executable, "-m", "tools.bench.choice.rewriting", "--child", scene, switch,
                                   options.device, str(frames)], cwd=ROOT, env=os.environ | more, capture_output=True,
                                  text=True)
            if done.returncode:
                return row | {"failed": (done.stderr.strip() or f"exit status {done.returncode}").splitlines()[-1]}
            said = next(text for text in done.stdout.splitlines() if text.startswith(MARK))
            row |= {f"{stage}_{key}": value for key, value in json.loads(said.removeprefix(MARK)).items()}
    return row


def shares(count: int) -> list[set[int] | None]:
    """Cores of each of so many processes that run side by side; None: all."""
    if count == 1 or not hasattr(os, "sched_getaffinity"):
        return [None] * count
    cores = sorted(os.sched_getaffinity(0))
    each = max(len(cores) // count, 1)
    return [set(cores[k * each:(k + 1) * each]) or None for k in range(count)]


def run(options) -> list[dict]:
    """Least of the rounds, by scene and switch."""
    free: SimpleQueue = SimpleQueue()
    for share in shares(options.at_once):
        free.put(share)
    began = perf_counter()

    def work(job: tuple[str, str]) -> dict | None:
        if perf_counter() - began > options.limit:
            return None
        cores = free.get()
        try:
            return measured(*job, options, cores)
        finally:
            free.put(cores)
    jobs = [(scene, switch) for _ in range(options.rounds) for scene in options.scenes for switch in ("", *options.without)]
    rows: dict[tuple[str, str], dict] = {}
    with ThreadPoolExecutor(options.at_once) as threads:
        for row in filter(None, threads.map(work, jobs)):
            key = row["scene"], row["without"]
            old = rows.get(key, row)
            rows[key] = {name: value if isinstance(value, str) else min(value, old.get(name, value))
                         for name, value in row.items()}
            print(line(rows[key]), flush=True)
    return list(rows.values())


def line(row: dict) -> str:
    """A row in print."""
    figures = row.get("failed") or "".join(f"  {key} {row[key]:8.2f}" for key in FIGURES if key in row)
    return f"{row['scene']:16s} without {row['without'] or '(nothing)':11s}{figures}"


def summary(rows: list[dict], without) -> list[str]:
    """Ratios of each rewriting, by scene, then their geometric mean."""
    base = {row["scene"]: row for row in rows if not row["without"] and "failed" not in row}
    lines = []
    for key in FIGURES:
        lines += ["", f"{key}: without over with", " " * 12 + "".join(f"{name[:13]:>14s}" for name in base) + f"{'mean':>8s}"]
        for switch in without:
            found = {r["scene"]: r[key] / base[r["scene"]][key] for r in rows
                     if r["without"] == switch and key in r and key in base.get(r["scene"], {})}
            if found:
                cells = "".join(f"{found[name]:14.2f}" if name in found else " " * 14 for name in base)
                lines.append(f"{switch:12s}{cells}{statistics.geometric_mean(found.values()):8.2f}")
    return lines


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=lambda text: text.split(","), default=list(SCENES))
    parser.add_argument("--without", type=lambda text: text.split(","), default=list(SWITCHES))
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--at-once", type=int, default=1)
    parser.add_argument("--frames", type=int, default=6)
    parser.add_argument("--limit", type=float, default=float("inf"))
    parser.add_argument("--json", type=Path)
    parser.add_argument("--child", nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.child:
        scene, switch, device, frames = options.child
        print(MARK + json.dumps(first_frame(scene, switch, device, int(frames))))
        return
    rows = run(options)
    print(*summary(rows, options.without), sep="\n")
    if options.json:
        said = {"cores": os.cpu_count(), "load": os.getloadavg()[0], "device": options.device, "rows": rows}
        options.json.write_text(json.dumps(said, indent=1) + "\n")


if __name__ == "__main__":
    main()
