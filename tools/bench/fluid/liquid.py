"""Liquids: time of a frame beside error, volume and energy, for each size and transfer, in one run.

    python tools/bench/fluid/liquid.py [--device cuda:0|cpu] [--sizes 16,32] [--transfers apic,flip,pic]
                                 [--problems rest,ritter,slosh] [--precision float32] [--json FILE]

    rest      a tank half full, 0.5 s: error is the greatest speed left over that of a fall through its depth
    ritter    a flat dam with a long reservoir: error of the front's speed against 2 sqrt(g H), from 2.5 to 3.6 sqrt(H / g)
    slosh     a column that falls into the rest of its tank, 2 s: error is that of the volume, the mean of the last half second

ms: a frame of 1/24 s (ritter: of 0.1 sqrt(H / g)), median; cpu_ms: of the process. Sizes are cells along the tank's edge, of
the dam in its depth.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from wsim import Scene, Simulation  # noqa: E402
from wsim.physics.fluid.liquid.objects import Liquid, LiquidSource  # noqa: E402
from wsim.scene import Motion  # noqa: E402
from wsim.scene.solids import Box  # noqa: E402

G = 9.81


def tank(size, fill, cell: float, fps: float = 24.0, **more) -> Scene:
    """A box from the origin to `size` [m], filled up to `fill`."""
    scene = Scene(fps=fps, gravity=(0.0, -G, 0.0))
    scene.add(Liquid("/tank", (0, 0, 0), size, cell, **more))
    half = 0.5 * np.array(fill, float)
    scene.add(LiquidSource("/water", Box(tuple(half)), Motion.at_place(tuple(half))))
    return scene


def timed(scene: Scene, frames: int, args) -> tuple[Simulation, list[dict], dict]:
    """Indicators after each frame, and medians of the times of all but the first."""
    sim = Simulation(scene, device=args.device, precision=args.precision)
    said, wall, cpu = [], [], []
    for _ in range(frames):
        began = time.perf_counter(), time.process_time()
        sim.step()
        wp.synchronize_device(sim.device)
        wall.append(time.perf_counter() - began[0])
        cpu.append(time.process_time() - began[1])
        said.append(sim.indicators() | {"front": float(sim.samples()[0].positions[:, 0].max())})
    last = said[-1]
    return sim, said, {"ms": 1e3 * float(np.median(wall[1:])), "cpu_ms": 1e3 * float(np.median(cpu[1:])),
                       "particles": int(last["liquid_particles"]), "steps": int(last["liquid_steps"]),
                       "iterations": int(max(s["liquid_iterations"] for s in said)), "warnings": sim.warnings}


def rest(n: int, transfer: str, args) -> dict:
    cell = 1.0 / n
    sim, said, row = timed(tank((1, 1, 1), (1, 0.5, 1), cell, transfer=transfer, tolerance=1e-6), 12, args)
    return row | {"error": said[-1]["liquid_speed"] / np.sqrt(2 * G * 0.5)}


def ritter(n: int, transfer: str, args) -> dict:
    cell = 1.0 / n
    scene = tank((13, 1.25, cell), (5, 1, cell), cell, np.sqrt(G) / 0.1, transfer=transfer)
    sim, said, row = timed(scene, 36, args)
    return row | {"error": abs((said[-1]["front"] - said[24]["front"]) / 1.1 / 2.0 - 1.0)}


def slosh(n: int, transfer: str, args) -> dict:
    cell = 1.0 / n
    sim, said, row = timed(tank((1, 1, 0.5), (0.375, 0.75, 0.5), cell, transfer=transfer), 48, args)
    whole = said[-1]["liquid_particles"] * cell ** 3 / 8
    volumes = [s["liquid_volume"] / whole for s in said]
    return row | {"error": abs(float(np.mean(volumes[-12:])) - 1.0), "least": min(volumes), "energy": said[-1]["liquid_energy"]}


PROBLEMS = {"rest": rest, "ritter": ritter, "slosh": slosh}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0" if wp.is_cuda_available() else "cpu")
    parser.add_argument("--sizes", default="16,32")
    parser.add_argument("--transfers", default="apic")
    parser.add_argument("--problems", default=",".join(PROBLEMS))
    parser.add_argument("--precision", default="float32")
    parser.add_argument("--json")
    args = parser.parse_args()
    rows = []
    for name in args.problems.split(","):
        for n in map(int, args.sizes.split(",")):
            for transfer in args.transfers.split(","):
                try:
                    found = PROBLEMS[name](n, transfer, args)
                except Exception as failed:  # noqa: BLE001  # a row that fails is told, and the others go on
                    found = {"failed": str(failed)[:300]}
                rows.append({"problem": name, "n": n, "transfer": transfer, "device": args.device, **found})
                shown = {k: f"{v:.4g}" if isinstance(v, float) else v for k, v in found.items()}
                print(f"{name:8} {n:4} {transfer:5} {shown}", flush=True)
    if args.json:
        Path(args.json).write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
