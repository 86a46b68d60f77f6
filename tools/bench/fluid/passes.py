"""Each pass of a step of smoke alone: its launches, its time in a graph, its bytes beside those that a copy moves in that time.

    python tools/bench/fluid/passes.py [--device cuda:0|cpu] [--sizes 64,128,256] [--pressure direct,multigrid] [--ball]
                                       [--root CHECKOUT] [--json FILE]

A step of the plume of tools/bench/fluid/steps.py runs once without a graph, and each launch is written down: kernel, threads,
arrays. Each kind of launch (kernel, threads) is then repeated alone, on CUDA in one graph between two events.

    calls    launches of that kind in the step
    us       of one of them
    sum      calls * us [ms]
    floor    all its arrays once at the rate of a copy of as many bytes [us]; what stays in a cache goes faster
    step     a frame of one step by its own graph [ms]; what it takes beyond the sum of all passes is between them

--root: another checkout, whose passes are timed by this script.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
import warp as wp


def bytes_of(value, seen: set) -> int:
    """Of the arrays in a launch's argument, each once."""
    if isinstance(value, wp.array):
        if value.ptr in seen or value.size == 0:
            return 0
        seen.add(value.ptr)
        return value.size * wp.types.type_size_in_bytes(value.dtype)
    return sum(bytes_of(getattr(value, name), seen) for name in value._cls.vars) if hasattr(value, "_cls") else 0


class Listener:
    """Stands in for `wp.launch`, `wp.launch_tiled` and `wp.copy`, and writes down what is launched. calls: by (name, size), the
    count, how to launch one again, and the bytes of its arrays."""

    def __init__(self):
        self.calls: dict[tuple, list] = {}
        self.plain = {name: getattr(wp, name) for name in ("launch", "launch_tiled", "copy")}

    def __enter__(self) -> "Listener":
        for name in self.plain:
            setattr(wp, name, lambda *args, _name=name, **named: self.note(_name, args, named))
        return self

    def __exit__(self, *_) -> None:
        for name, function in self.plain.items():
            setattr(wp, name, function)

    def note(self, name: str, args: tuple, named: dict):
        function, seen = self.plain[name], set()
        if name == "copy":
            key, arrays = ("copy", args[0].size), args
        else:
            kernel = args[0]
            dim = named.get("dim", args[1] if len(args) > 1 else 0)
            arrays = [a for k, group in ((2, "inputs"), (3, "outputs"))
                      for a in named.get(group, args[k] if len(args) > k else [])]
            key = (kernel.key, str(dim))
        row = self.calls.setdefault(key, [0, lambda: function(*args, **named), sum(bytes_of(a, seen) for a in arrays)])
        row[0] += 1
        return function(*args, **named)


def alone(launch, device, least: float = 0.02) -> float:
    """Seconds of one of many equal launches."""
    launch()
    wp.synchronize_device(device)
    if device.is_cuda:
        with wp.ScopedCapture(device=device) as capture:
            for _ in range(20):
                launch()
        wp.capture_launch(capture.graph)
        first, last = (wp.Event(device=device, enable_timing=True) for _ in range(2))
        found = []
        for _ in range(5):
            wp.record_event(first)
            wp.capture_launch(capture.graph)
            wp.record_event(last)
            found.append(wp.get_event_elapsed_time(first, last) / 20e3)
        return float(np.median(found))
    count, began = 0, time.process_time()
    while time.process_time() - began < least:
        launch()
        count += 1
    return (time.process_time() - began) / count


def rate(size: int, device) -> float:
    """Bytes [B/s] that a copy of an array of so many reads and writes."""
    a, b = (wp.zeros(max(size // 8, 1), dtype=wp.float32, device=device) for _ in range(2))
    return 8.0 * a.size / alone(lambda: wp.copy(b, a), device)


def profile(n: int, pressure: str, ball: bool, device: str) -> dict:
    from tools.bench.fluid.steps import smoke
    from wsim import Simulation
    sim = Simulation(smoke(n, ball=ball, pressure=pressure), device=device)
    whole = []
    for _ in range(8):
        began = time.perf_counter(), time.process_time()
        sim.step()
        wp.synchronize_device(sim.device)
        whole.append((time.perf_counter() - began[0]) if sim.device.is_cuda else time.process_time() - began[1])
    domain = sim.plan.method("fluid").domains[0]
    domain._step()
    with Listener() as heard:
        domain._step()
    rows = []
    for (name, size), (calls, launch, traffic) in heard.calls.items():
        took = alone(launch, sim.device)
        rows.append({"pass": name, "size": size, "calls": calls, "us": 1e6 * took, "sum_ms": 1e3 * calls * took,
                     "MB": traffic / 1e6, "floor_us": 1e6 * traffic / rate(traffic, sim.device) if traffic > 4096 else 0.0})
    rows.sort(key=lambda row: -row["sum_ms"])
    return {"n": n, "pressure": pressure, "ball": ball, "step_ms": 1e3 * float(np.median(whole[3:])),
            "launches": sum(row["calls"] for row in rows), "passes_ms": sum(row["sum_ms"] for row in rows),
            "iterations": sim.indicators()["fluid_iterations"], "rows": rows}


def show(found: dict) -> None:
    print(f"\n{found['n']}^3 {found['pressure']}{' ball' * found['ball']}: step {found['step_ms']:.3f} ms, {found['launches']} "
          f"launches, passes {found['passes_ms']:.3f} ms, iterations {found['iterations']:.0f}")
    print(f"{'pass':44} {'size':>18} {'calls':>5} {'us':>9} {'sum ms':>8} {'MB':>8} {'floor us':>9}")
    for row in found["rows"]:
        print(f"{row['pass']:44} {row['size']:>18} {row['calls']:5} {row['us']:9.2f} {row['sum_ms']:8.3f} {row['MB']:8.2f} "
              f"{row['floor_us']:9.2f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0" if wp.is_cuda_available() else "cpu")
    parser.add_argument("--sizes", default="64,128")
    parser.add_argument("--pressure", default="direct,multigrid")
    parser.add_argument("--ball", action="store_true")
    parser.add_argument("--root", default=str(Path(__file__).resolve().parents[3]))
    parser.add_argument("--json")
    args = parser.parse_args()
    sys.path.insert(0, args.root)
    sys.path.append(str(Path(__file__).resolve().parents[3]))          # for the scene, where that checkout lacks it
    found = []
    for n in map(int, args.sizes.split(",")):
        for pressure in args.pressure.split(","):
            found.append(profile(n, pressure, args.ball and pressure != "direct", args.device))
            show(found[-1])
    if args.json:
        Path(args.json).write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
