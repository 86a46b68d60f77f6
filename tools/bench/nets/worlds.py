"""Time and memory of worlds, by how many share one state, and whether each ends as one alone.

    python tools/bench/nets/worlds.py [--device cuda:0] [--side 32] [--counts 1,64,256,1024,4096] [--cases xpbd,explicit ...]
                                      [--json FILE]

A sheet of side x side points without bending that hangs at two corners, by XPBD (10 substeps of 4 iterations), by leapfrog (as
many substeps as keep it stable) and by Newton's method (BDF2, 10 substeps), as a net of springs; `membrane`: leapfrog of
triangles and hinges with damping. `us` is the time of a frame over the number of worlds; `MB` what a world holds, as it is
said before worlds are made; `bits` whether the first, the middle and the last world have the positions of one alone after 12
frames, `apart_um` how far they are from them.
"""

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tools.bench.choice.misses import frame_seconds  # noqa: E402
from tools.bench.speed import hardware, show  # noqa: E402
from wsim.scene import Scene, SceneError, shapes  # noqa: E402
from wsim.scene.fabric import Fabric  # noqa: E402
from wsim.simulation.measure.memory import MemoryForWorlds  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

FRAMES = 12


CASES = {"xpbd": {"solver": "xpbd"}, "explicit": {"solver": "explicit"}, "membrane": {"solver": "explicit"},
         "implicit": {"solver": "implicit", "integrator": "bdf2", "iterations": 1}}


def sheet(side: int, case: str) -> Scene:
    """A square of 1 m that hangs at two corners."""
    scene = Scene(**{"fps": 24.0, "substeps": 10, "iterations": 4} | CASES[case])
    flat = case == "membrane"
    cloth = scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, side - 1, side - 1), model="membrane" if flat else "springs",
                        material=Fabric(stretch=300.0, bend=1e-5 * flat, damping=1e-4 * flat))
    scene.pin("/pin", cloth, [0, side - 1])
    return scene


def fixed(scene: Scene, device) -> Scene:
    """The scene with the steps that one world of it takes."""
    choice = Simulation(scene, device=device).plan.choice
    return replace(scene, solver=choice.solver, integrator=choice.integrator.name, substeps=choice.steps,
                   iterations=choice.iterations)


def ends(scene: Scene, device, worlds: int) -> tuple[Simulation, list[np.ndarray], float]:
    """A simulation after FRAMES frames, positions of its first, middle and last world, and seconds until it was made."""
    began = perf_counter()
    sim = Simulation(scene, device=device, worlds=worlds)
    made = perf_counter() - began
    sim.run(FRAMES)
    return sim, [sim.positions("/cloth", world) for world in (0, worlds // 2, worlds - 1)], made


def row(case: str, scene: Scene, device, worlds: int, alone: np.ndarray, each: int) -> dict:
    sim, found, made = ends(scene, device, worlds)
    return {"worlds": worlds, "case": case, "substeps": sim.plan.clock.steps,
            "us": 1e6 * frame_seconds(sim) / worlds, "MB": each / 1e6, "build_s": made,
            "bits": all(np.array_equal(x, alone) for x in found),
            "apart_um": 1e6 * max(float(np.abs(x - alone).max()) for x in found)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--side", type=int, default=32)
    parser.add_argument("--counts", default="1,64,256,1024,4096")
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    rows: list[dict] = []
    for case in args.cases.split(","):
        scene = fixed(sheet(args.side, case), args.device)
        one, (alone, *_), _ = ends(scene, args.device, 1)
        memory = MemoryForWorlds.of(one, 10**9)
        for worlds in map(int, args.counts.split(",")):
            show(rows, row(case, scene, args.device, worlds, alone, memory.each))
        try:
            Simulation(scene, device=args.device, worlds=2 * memory.fit)
        except SceneError as error:
            print(error)
    if args.json:
        args.json.write_text(json.dumps({"hardware": hardware(wp.get_device(args.device)), "side": args.side, "rows": rows},
                                        indent=1) + "\n")


if __name__ == "__main__":
    main()
