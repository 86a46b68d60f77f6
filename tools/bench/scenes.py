"""Every example scene on a GPU and on a CPU of the same machine: time of a frame beside its error.

    python tools/bench/scenes.py [--devices cuda:0,cpu] [--scenes cape,bear] [--seconds 10] [--json FILE] [--at-once 1]

Each scene runs on each device in a process of its own with an empty kernel cache, until its last frame or for so many seconds
after its first frame. Frames are those of wsim.Simulation without a result file.

first      s from the import of Warp to the end of the first frame: load, build, compile, capture
median, p99      ms a frame, without the first two
own        ms that the scene's rate of frames leaves for a frame, in asterisks where p99 is more
captures   graphs captured after the tenth frame
launches   kernel launches that the largest graph of a frame holds; a loop that ends on the device counts once
python     ms a frame outside the launch of graphs and the wait for the device
said       error of positions that the run states, in % of the size of what moves
strain     rms of edges, or of a rod's [%]; overlap: deepest penetration [mm]; energy: unexplained change [%]
apart      root mean square distance of points and bodies from the first device's, at the last of the frames that both saw, over
           the size of what moves: rounding, until folds or blows make more of it

With --at-once N so many processes run side by side: first frames as on a busy machine, and other times are worth nothing.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
EARLY, SETTLED = 2, 10             # frames that times leave out; after so many, captures count
APART = (6, 12, 24, 48)            # frames whose places are compared
ERRORS = {"strain": ("rms_strain", "rod_strain"), "overlap": ("penetration", "rigid_overlap", "rod_penetration")}


def examples() -> list[str]:
    return sorted(path.stem for path in (ROOT / "scenes").glob("*.usda"))


class Watch:
    """Counts launches and captures, and the time of graph launches and waits, of one simulation."""

    def __init__(self, simulation) -> None:
        import warp as wp

        from wsim.model import kernel_cache, status
        self.launched, self.most, self.captured, self.away, self.inside = 0, 0, 0, 0.0, False
        self.wrap_attribute(wp, "capture_launch", self.timed_call)
        self.wrap_attribute(wp, "launch", self.counted_launch)
        self.wrap_attribute(wp, "launch_tiled", self.counted_launch)
        self.wrap_attribute(status.FrameStatus, "wait", self.timed_call)
        self.wrap_attribute(kernel_cache, "capture_graph", self.counted_capture)

    @staticmethod
    def wrap_attribute(owner, name: str, wrap) -> None:
        setattr(owner, name, wrap(getattr(owner, name)))

    def timed_call(self, call):
        def run(*args, **more):
            if self.inside or threading.current_thread() is not threading.main_thread():
                return call(*args, **more)
            began, self.inside = time.perf_counter(), True
            try:
                return call(*args, **more)
            finally:
                self.away += time.perf_counter() - began
                self.inside = False
        return run

    def counted_launch(self, call):
        def run(*args, **more):
            self.launched += 1
            return call(*args, **more)
        return run

    def counted_capture(self, call):
        @contextmanager
        def run(*args, **more):
            self.captured, self.launched = self.captured + 1, 0
            with call(*args, **more) as capture:
                yield capture
            self.most = max(self.most, self.launched)
        return run


def measure_scene(name: str, device: str, seconds: float) -> dict:
    """The row of a scene on a device: run in a process of its own."""
    began = time.perf_counter()
    import warp as wp
    wp.config.log_level = wp.LOG_WARNING
    from wsim import Simulation, load
    scene = load(str(ROOT / "scenes" / f"{name}.usda"))
    simulation = Simulation(scene, device=device)
    watch = Watch(simulation)
    each, python, captures, seen, start = [], [], [], {}, 0.0
    for frame in range(1, scene.frames + 1):
        at, watch.away = time.perf_counter(), 0.0
        simulation.step()
        wp.synchronize_device(device)
        took = time.perf_counter() - at
        each.append(1e3 * took)
        python.append(1e3 * (took - watch.away))
        captures.append(watch.captured)
        if frame == 1:
            first, start = time.perf_counter() - began, time.perf_counter()
        if frame in APART:
            seen[frame] = point_places(simulation)
        if time.perf_counter() - start > seconds:
            break
    report = simulation.report(profile=False)
    error = report["error"]
    late = each[EARLY:] or each
    worst = {key: max((error[n] for n in names if error.get(n) is not None), default=None) for key, names in ERRORS.items()}
    settled = captures[SETTLED - 1] if len(captures) >= SETTLED else captures[-1]
    return {"scene": name, "device": device, "solver": report.get("solver"), "substeps": report.get("substeps"),
            "first": first, "seconds": report["seconds"], "frames": len(each), "median": float(np.median(late)),
            "p99": float(np.percentile(late, 99)), "own": 1e3 / scene.fps, "captures": captures[-1] - settled,
            "launches": watch.most, "python": float(np.median(python[EARLY:] or python)),
            "said": (report.get("predicted") or {}).get("error"), **worst, "energy": error.get("energy_change"),
            "seen": seen, "each": [round(ms, 3) for ms in each]}


def point_places(simulation) -> list[list[float]]:
    """Places [m] of points of cloth, soft bodies and rods, and of the origins of bodies and colliders."""
    rows = [simulation.positions(body.path) for body in simulation.model.bodies]
    rows += [sample.positions for sample in simulation.samples() if type(sample).__name__ == "PointSample"]
    rows += [np.array([pose[:3, 3] for _, pose in sorted(simulation.poses().items())])]
    return np.concatenate([np.reshape(r, (-1, 3)) for r in rows]).tolist()


def run_scene(name: str, device: str, seconds: float) -> dict:
    """The row of a process of its own; where that fails, its last words under "failed"."""
    with tempfile.TemporaryDirectory() as cache:
        kept = os.environ.get("WSIM_BENCH_KERNELS")            # a folder of kernels: first frames then compile nothing anew
        done = subprocess.run([sys.executable, __file__, "--child", name, "--devices", device, "--seconds", str(seconds)],
                              cwd=ROOT, capture_output=True, text=True, env=os.environ | {"WARP_CACHE_PATH": kept or cache})
    try:
        return json.loads(done.stdout.splitlines()[-1])
    except (IndexError, json.JSONDecodeError):
        return {"scene": name, "device": device, "failed": (done.stderr.strip().splitlines() or ["no output"])[-1]}


def rms_distance(own: dict, first: dict) -> float | None:
    """Root mean square distance of two runs at the last frame that both saw, over the size of what moves."""
    both = sorted(set(own.get("seen", {})) & set(first.get("seen", {})), key=int)
    if not both or not own["seen"][both[-1]]:
        return None
    a, b = (np.array(r["seen"][both[-1]]) for r in (own, first))
    size = np.linalg.norm(np.ptp(b, axis=0)) or 1.0
    return float(np.sqrt(((a - b) ** 2).sum(1).mean()) / size)


def format_number(value, unit: float = 1.0, digits: str = ".3g") -> str:
    return "-" if value is None else f"{unit * value:{digits}}"


def table_cells(r: dict) -> list[str]:
    if "failed" in r:
        return [r["scene"], r["device"], "failed: " + r["failed"][:100], *[""] * 12]
    rate = f"{r['own']:.3g}" if r["p99"] <= r["own"] else f"*{r['own']:.3g}*"
    return [r["scene"], r["device"], f"{r['first']:.1f}", f"{r['median']:.3g}", f"{r['p99']:.3g}", rate, str(r["captures"]),
            str(r["launches"]), f"{r['python']:.2g}", format_number(r["said"], 100, ".2g"),
            format_number(r["strain"], 100, ".2g"), format_number(r["overlap"], 1e3, ".2g"),
            format_number(r["energy"], 100, ".2g"), format_number(r["apart"], 1.0, ".1e"), str(r["frames"])]


HEAD = ["scene", "device", "first s", "median", "p99", "own ms", "captures", "launches", "python ms", "said %", "strain %",
        "overlap mm", "energy %", "apart", "frames"]


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--devices", default="cuda:0,cpu")
    parser.add_argument("--scenes", help="some of the examples, by name; default: all")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--at-once", type=int, default=1)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--child", help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    if args.child:
        print(json.dumps(measure_scene(args.child, args.devices, args.seconds)))
        return
    from wsim.simulation.measure.columns import text_columns
    names = args.scenes.split(",") if args.scenes else examples()
    if unknown := sorted(set(names) - set(examples())):
        sys.exit(f"--scenes: no example {', '.join(unknown)}; there are {', '.join(examples())}")
    devices, widths = args.devices.split(","), [16, 7, *map(len, HEAD[2:])]
    print(*text_columns([HEAD], "<<" + ">" * 13, widths), sep="\n", flush=True)
    rows: list[dict] = []
    with ThreadPoolExecutor(args.at_once) as pool:
        for found in pool.map(lambda name: [run_scene(name, device, args.seconds) for device in devices], names):
            for r in found:
                r["apart"] = rms_distance(r, found[0]) if r is not found[0] else None
            print(*text_columns([table_cells(r) for r in found], "<<" + ">" * 13, widths), sep="\n", flush=True)
            rows += [{k: v for k, v in r.items() if k != "seen"} for r in found]
            if args.json:
                import warp as wp

                from tools.bench.speed import hardware
                said = {"hardware": [hardware(wp.get_device(d)) for d in devices], "seconds": args.seconds, "rows": rows}
                args.json.write_text(json.dumps(said, indent=1) + "\n")


if __name__ == "__main__":
    main()
