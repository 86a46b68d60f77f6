"""Explicit steps of garments and soft bodies: time of a frame beside its error, launch by launch and many substeps at once.

    python -m tools.bench.nets.garments [--device cuda:0] [--only sheet,shirt_hung] [--frames 6] [--json FILE]

Scenes are those of `scenes/` with solver = explicit, the sheet of hanging_cloth without damping, the shirt hung by its collar
without its dummy. The reference is a float64 trajectory of the same scene at REFINED times the substeps: errors are RMS and
largest distance of points [m] after the last frame. A time is the median over frames that are replayed [ms], one device.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from wsim.scene import Scene
from wsim.usd import load

ROOT = Path(__file__).resolve().parents[3]
REFINED = 2            # leapfrog errs by a fourth of what the row does
HUNG = 0.02            # [m]: points this close to the highest one of either side are held


def scene(name: str) -> Scene:
    found = load(str(ROOT / "scenes" / f"{name}.usda"))
    found.solver, found.integrator = "explicit", "auto"
    return found


def sheet() -> Scene:
    """33 x 33 points of cotton, undamped."""
    from dataclasses import replace
    found = scene("hanging_cloth")
    cloth = found.cloths[0]
    cloth.material = replace(cloth.material, damping=0.0)
    return found


def shirt_hung() -> Scene:
    """The shirt without its dummy."""
    found = scene("shirt")
    found.colliders, cloth = [], found.cloths[0]
    p = cloth.motion.points(cloth.points, 0.0)
    middle, held = 0.5 * (p[:, 0].min() + p[:, 0].max()), []
    for half in (p[:, 0] < middle, p[:, 0] >= middle):
        top = p[np.flatnonzero(half)[np.argmax(p[half, 1])]]
        held += np.flatnonzero(np.linalg.norm(p - top, axis=1) < HUNG).tolist()
    found.pin("/held", cloth, sorted(set(held)))
    return found


SCENES: dict[str, Callable[[], Scene]] = {"sheet": sheet, "shirt_hung": shirt_hung} | {
    name: (lambda name=name: scene(name)) for name in
    ("hanging_cloth", "flag", "cape", "shirt", "trampoline", "squeezed_cube", "bear", "twist")}


def run(made: Scene, device: str, frames: int, precision: str = "float32", fused: bool = True) -> dict:
    """Median time of a frame [ms], positions (points, 3) of all bodies [m], and what was done."""
    from wsim.model.launches import Launches
    from wsim.simulation.simulation import Simulation
    before, Launches.fuses = Launches.fuses, fused
    try:
        sim = Simulation(made, device=device, precision=precision)
        for _ in range(frames):
            sim.step()
    finally:
        Launches.fuses = before
    x = sim.state.x.numpy().astype(np.float64) + sim.state.e.numpy()
    said = sim.model.fuser
    return {"ms": float(np.median(sim.milliseconds[2:])), "x": x, "substeps": sim.plan.clock.substeps,
            "points": len(x), "forms": sim.forms, "launched": said.launched if said else 0, "why": said.why if said else ""}


def apart(a: np.ndarray, b: np.ndarray) -> dict[str, float]:
    """RMS and largest distance [m]."""
    d = np.linalg.norm(a - b, axis=1)
    return {"rms": float(np.sqrt(np.mean(d**2))), "most": float(d.max())}


def rows(name: str, device: str, frames: int) -> list[dict]:
    """Rows of a scene: launch by launch, and many substeps a launch."""
    made, found = SCENES[name], []
    each = [run(made(), device, frames, fused=fused) for fused in (False, True)]
    fine = made()
    fine.substeps = REFINED * each[0]["substeps"]
    true = run(fine, device, frames, "float64")
    for fused, r in zip((False, True), each, strict=True):
        found.append({"scene": name, "device": device, "frames": frames, "one launch": fused,
                      **{k: v for k, v in r.items() if k != "x"}, **apart(r["x"], true["x"])})
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default=None)
    parser.add_argument("--only", default=",".join(SCENES))
    parser.add_argument("--frames", type=int, default=6)
    parser.add_argument("--json", default="")
    given = parser.parse_args()
    found, began = [], time.perf_counter()
    for name in given.only.split(","):
        try:
            found += rows(name, given.device, given.frames)
        except Exception as error:                               # noqa: BLE001  (a table says which row failed)
            print(f"{name}: {type(error).__name__}: {str(error)[:300]}", flush=True)
            continue
        for r in found[-2:]:
            print(f"{r['scene']:14} {r['points']:6} points {r['substeps']:6} substeps  {r['ms']:9.3f} ms  "
                  f"rms {r['rms']:.2e} m, most {r['most']:.2e}  {'one launch' if r['one launch'] else 'apart':10}  "
                  f"{r['why'][:90]}", flush=True)
    print(f"{time.perf_counter() - began:.0f} s")
    if given.json:
        Path(given.json).write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
