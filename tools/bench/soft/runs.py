"""The three runs by which an engine is judged on a clamped beam, and their way to and from a process of a peer. NumPy only.

    fall    from the rest shape under gravity: positions at given frames, and the time of a frame
    settle  the same with velocities taken down every frame, near critically: where the tip comes to rest
    swing   without gravity from a small offset in the shape of the first mode: its frequency and damping

PROBLEM.npz     points (n, 3) [m], tets (t, 4), masses (n,) [kg], pinned (k,), gravity (3,) [m/s^2], young [Pa], poisson,
                density [kg/m^3], offset (n, 3) [m], frame [s], ends (e,) frames of the fall that are kept, settle and swing:
                numbers of frames, decay [1/s] of velocities in `settle`
SETTINGS.json   [{"solver", "substeps", "iterations", ...}, ...]
OUT_FOLDER      rows.json: the settings with ms, first_s, finite, model, or with `failed`; states.npz: of row k fall{k}
                (e, n, 3), settle{k} (2, n, 3): the last and that of STILL frames before, swing{k} (swing + 1, n, 3) [m]
"""

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np

WARM = 3                  # frames that compile, capture, fill caches
STILL = 10                # frames over which what still moves is seen


class Engine(Protocol):
    """A beam in an engine, a frame at a time; `frame` waits until it is done."""

    def frame(self) -> None: ...

    def positions(self) -> np.ndarray: ...                   # (n, 3) [m] float64


# (gravity (3,) [m/s^2], offset (n, 3) [m] from rest at the start, decay of velocities [1/s]) -> Engine
Make = Callable[[np.ndarray, np.ndarray, float], Engine]


def measured(make: Make, problem: dict[str, np.ndarray]) -> tuple[dict, dict[str, np.ndarray]]:
    """ms, first_s, finite; and the states. A fall that flies apart is not followed by the other runs."""
    none, began = np.zeros_like(problem["points"]), time.perf_counter()
    engine, ends, ms, fall = make(problem["gravity"], none, 0.0), problem["ends"].tolist(), [], []
    first_s = 0.0
    for number in range(1, max(ends) + 1):
        start = time.perf_counter()
        engine.frame()
        ms.append(1e3 * (time.perf_counter() - start))
        first_s = first_s or time.perf_counter() - began
        if number in ends:
            fall.append(engine.positions())
    row = {"ms": float(np.median(ms[WARM:])), "first_s": first_s, "finite": bool(np.isfinite(fall).all())}
    states = {"fall": np.array(fall)}
    if row["finite"]:
        engine = make(problem["gravity"], none, float(problem["decay"]))
        settle = [after(engine, count) for count in (int(problem["settle"]) - STILL, STILL)]
        engine = make(np.zeros(3), problem["offset"], 0.0)
        swing = [problem["points"] + problem["offset"]] + [after(engine, 1) for _ in range(int(problem["swing"]))]
        states |= {"settle": np.array(settle[::-1]), "swing": np.array(swing)}
    return row, states


def after(engine: Engine, frames: int) -> np.ndarray:
    for _ in range(frames):
        engine.frame()
    return engine.positions()


def write(folder: Path, head: dict, rows: list[dict], states: dict[str, np.ndarray]) -> None:
    """Both files, each whole or not at all."""
    for name, put in (("rows.json", lambda f: f.write(json.dumps(head | {"rows": rows}).encode())),
                      ("states.npz", lambda f: np.savez(f, **states))):
        with open(folder / f"{name}.part", "wb") as file:
            put(file)
        os.replace(folder / f"{name}.part", folder / name)


def arguments(text: str) -> tuple[argparse.Namespace, dict[str, np.ndarray], list[dict]]:
    """Of a peer's process: what was asked, the problem, the settings."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("problem")
    parser.add_argument("settings")
    parser.add_argument("out")
    parser.add_argument("--device", default=None)
    args = parser.parse_args()
    with np.load(args.problem) as found:
        problem = {name: found[name] for name in found.files}
    return args, problem, json.loads(Path(args.settings).read_text())


def serve(side: str, head: dict, args: argparse.Namespace, problem: dict[str, np.ndarray],
          rows: list[tuple[dict, Callable[[], Make]]]) -> None:
    """Runs every row, (its settings and model, how to begin it), prints it and writes all. A row that fails is a row."""
    done, states = [], {}
    for number, (setting, begin) in enumerate(rows):
        try:
            row, found = measured(begin(), problem)
            states |= {f"{name}{number}": value for name, value in found.items()}
            row = setting | row
        except Exception as error:
            row = setting | {"finite": False, "failed": f"{type(error).__name__}: {error}"}
        done.append(row)
        print(side, json.dumps(plain(row)), flush=True)
    write(Path(args.out), head, plain(done), states)


def plain(value):
    """Without what JSON has no word for: numbers that are none become null."""
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def processor() -> str:
    """Model of this machine's CPU and the number of its cores."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    names = [x.partition(":")[2].strip() for x in lines if x.startswith("model name")]
    return f"{names[0] if names else sys.platform}, {os.cpu_count()} cores"
