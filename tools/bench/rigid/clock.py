"""Frames of an engine, timed: what all runners share. It imports NumPy only, for any engine's environment.

    RUNNER SCENE.json SETTING.json OUT.npz [--device cuda:0|cpu]

A runner has a class of (scene, setting, device) with `step()`, a frame, after which the device is waited for; `state()`, arrays
x, q, v, w of all bodies; and `facts`, words and numbers of the row. OUT.npz has the states that the scene keeps, and as JSON in
`row`: ms, the median wall time of a frame behind the first WARM; cpu_ms, the mean processor time of those (all threads of the
process); first_s, from the scene to the end of the first frame; finite; or `failed`.
"""

import argparse
import json
import os
import time
from pathlib import Path

import numpy as np

WARM = 5


def frames(run, count: int, keep: str) -> tuple[dict, dict[str, np.ndarray]]:
    wall, cpu, states = [], [], []
    for _ in range(count):
        began, busy = time.perf_counter(), time.process_time()
        run.step()
        wall.append(1e3 * (time.perf_counter() - began))
        cpu.append(1e3 * (time.process_time() - busy))
        if keep == "all":
            states.append(run.state())
    states = states or [run.state()]
    kept = {name: np.stack([np.asarray(s[name], np.float64) for s in states]) for name in "xqvw"}
    return {"ms": float(np.median(wall[WARM:])), "worst_ms": max(wall[WARM:]), "cpu_ms": float(np.mean(cpu[WARM:])),
            "first_frame_s": 1e-3 * wall[0], "finite": bool(all(np.isfinite(a).all() for a in kept.values()))}, kept


def main(make) -> None:
    parser = argparse.ArgumentParser()
    for name in ("scene", "setting", "out"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--device", default="cpu")
    args = parser.parse_args()
    scene, setting = (json.loads(path.read_text()) for path in (args.scene, args.setting))
    began, kept = time.perf_counter(), {}
    try:
        run = make(scene, setting, args.device)
        built = time.perf_counter() - began
        row, kept = frames(run, scene["frames"], scene["keep"])
        row |= {"first_s": built + row.pop("first_frame_s"), **run.facts}
    except Exception as error:                             # a row that fails is a row of the table
        row = {"finite": False, "failed": f"{type(error).__name__}: {error}"}
    part = args.out.with_suffix(".part")
    with open(part, "wb") as file:
        np.savez(file, row=np.array(json.dumps(row)), **kept)
    os.replace(part, args.out)
