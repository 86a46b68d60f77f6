"""Fluids of which a part is solved (`Fluid.margin`): how wrong that is and what it saves, beside the whole in one run.

    python tools/bench/fluid/margin.py [--device cpu] [--margins 0.25,0.5,0.75,1] [--problems puff,ring,plume] [--cells 96]

    puff     a ball of warm smoke that rises
    ring     smoke that is blown up for an eighth of a second, and rolls up
    plume    a source of warm smoke

Each lasts 1 s in an open box, 1.5 times as high as wide, of 32 cells a metre. off: of the height that the smoke has risen by;
fastest: of the greatest speed; smoke: sum of its differences over its sum; share: of the cells that were solved, the mean of
all frames; CPU-s: of the process for all frames but the first.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from wsim import Scene, Simulation  # noqa: E402
from wsim.physics.fluid.objects import Fluid, Source  # noqa: E402
from wsim.scene import Motion, Sphere  # noqa: E402
from wsim.scene.curve import Curve  # noqa: E402

CELL, FRAMES, HEIGHT = 1.0 / 32.0, 24, 0.5             # [m], of a second, of what rises at the start [m]
PUFFS = Curve(np.array([0.0, 0.12, 0.125]), np.array([1.0, 1.0, 0.0]))


def scene(name: str, cells: int, margin: float) -> Scene:
    found = Scene(fps=float(FRAMES), frames=FRAMES, gravity=(0.0, -9.81, 0.0))
    size = CELL * np.array([cells, cells * 3 // 2, cells])
    air = found.add(Fluid("/air", (0, 0, 0), size, CELL, steps=2, tolerance=1e-5, margin=margin))
    place = (0.5 * size[0], HEIGHT, 0.5 * size[2])
    motion = Motion.at_place(place)
    if name == "puff":
        ball = 1.0 / (1.0 + np.exp((np.linalg.norm(air.centers() - place, axis=-1) - 0.22) / 0.03))
        air.smoke = np.where(ball < 1e-3, 0.0, ball)
        air.temperature = 60.0 * air.smoke
    elif name == "plume":
        found.add(Source("/fire", Sphere(0.18), smoke=2.0, temperature=200.0, motion=motion))
    else:
        found.add(Source("/jet", Sphere(0.2), smoke=8.0, velocity=(0.0, 3.0, 0.0), strength=PUFFS, motion=motion))
    return found


def run(name: str, cells: int, margin: float, device: str) -> dict:
    sim, shares = Simulation(scene(name, cells, margin), device=device), []
    method = sim.plan.method("fluid")
    sim.step()
    began = time.process_time()
    for _ in range(FRAMES - 1):
        sim.step()
        shares.append(method.domains[0].layout.cells / method.layouts[0].cells)
    now = method.arrays(0)
    smoke = now["smoke"]
    rise = (smoke.sum(axis=(0, 2)) * CELL * (np.arange(smoke.shape[1]) + 0.5)).sum() / smoke.sum() - HEIGHT
    return {"cpu_s": time.process_time() - began, "share": float(np.mean(shares)), "rise": rise, "smoke": smoke,
            "fastest": np.abs(now["v"]).max()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--margins", default="0.25,0.5,0.75,1")
    parser.add_argument("--problems", default="puff,ring,plume")
    parser.add_argument("--cells", type=int, default=96)
    args = parser.parse_args()
    for name in args.problems.split(","):
        whole = run(name, args.cells, 0.0, args.device)
        print(f"{name:6} whole          {whole['cpu_s']:6.1f} CPU-s, rises {whole['rise']:.3f} m", flush=True)
        for margin in map(float, args.margins.split(",")):
            part = run(name, args.cells, margin, args.device)
            off, fast = (100.0 * (part[key] / whole[key] - 1.0) for key in ("rise", "fastest"))
            smoke = np.abs(part["smoke"] - whole["smoke"]).sum() / whole["smoke"].sum()
            print(f"{name:6} margin {margin:<5g} {part['cpu_s']:8.1f} CPU-s, share {part['share']:.3f}, off {off:+.2f} %, "
                  f"fastest {fast:+.2f} %, smoke {smoke:.3f}", flush=True)


if __name__ == "__main__":
    main()
