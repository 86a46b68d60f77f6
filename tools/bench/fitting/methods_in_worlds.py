"""Time of a frame and equality of worlds, for each method: one state of 1, 10 and 100 worlds against a world alone.

    python -m tools.bench.fitting.methods_in_worlds [--device cpu] [--counts 1,10,100] [--methods xpbd,newton ...]
                                                    [--frames 6] [--json FILE]

`ms` is the time of a frame over the number of worlds: CPU time of the process on a CPU, else wall time. `times` says how many
times as fast that is as a world alone. `apart` is the largest difference [SI units of each field] between the first, the middle
and the last world and the world alone, over every field of the state that a restart needs; `bits` says that there is none.
Frames are timed one by one behind the first two; their median counts.
"""

import argparse
import json
import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import warp as wp

import wsim
from tools.bench.speed import hardware, show
from wsim.scene import Scene, SceneError, shapes
from wsim.scene.fabric import Fabric

WARM = 2             # frames that compile and capture


def cloth_scene(**how) -> Scene:
    """A sheet of 16 x 16 points that hangs at two corners over a ball."""
    scene = Scene(wind=(1.0, 0.0, 0.0), **how)
    cloth = scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 15, 15, horizontal=True), model="springs",
                        material=Fabric(stretch=300.0, bend=1e-4, damping=1e-4))
    scene.pin("/pin", cloth, [0, 15])
    scene.collider("/ball", wsim.Sphere(0.2), at=(0.0, -0.25, 0.0))
    return scene


def rods_scene() -> Scene:
    """Four ropes of 20 points, clamped at an end, above a floor."""
    line = np.stack([0.05 * np.arange(20), np.full(20, 0.3), np.zeros(20)], axis=1)
    scene = Scene()
    rods = scene.rods("/ropes", np.concatenate([line + (0.0, 0.0, 0.1 * k) for k in range(4)]), [20] * 4, young=1e6)
    scene.pin("/pin", rods, [0, 20, 40, 60])
    scene.collider("/floor", wsim.Plane())
    return scene


def soft_scene() -> Scene:
    """A block of 4 x 4 x 4 cells that falls on a floor."""
    scene = Scene()
    scene.soft("/block", *shapes.block((0.2, 0.2, 0.2), (4, 4, 4), at=(0.0, 0.12, 0.0)))
    scene.collider("/floor", wsim.Plane())
    return scene


def rigid_scene() -> Scene:
    """Ten boxes that fall on each other and on a floor."""
    scene = Scene()
    for k in range(10):
        scene.body(f"/box{k}", wsim.Box((0.1, 0.05, 0.1)), at=(0.03 * (k % 3), 0.06 + 0.11 * k, 0.02 * (k % 2)), density=500.0)
    scene.collider("/floor", wsim.Plane())
    return scene


def tree_scene() -> Scene:
    """The humanoid of the example scenes, in reduced coordinates."""
    from dataclasses import replace
    return replace(wsim.load(Path(wsim.__file__).parent / "scenes" / "humanoid.usda"), coordinates="reduced")


def smoke_scene() -> Scene:
    """A plume in 16 x 24 x 16 cells."""
    scene = Scene()
    air = scene.smoke("/air", (0.0, 0.0, 0.0), (0.5, 0.75, 0.5), 1.0 / 32.0)
    scene.smoke_source("/hot", air, wsim.Sphere(0.08), at=(0.25, 0.1, 0.25), smoke=1.0, temperature=80.0)
    return scene


def liquid_scene() -> Scene:
    """A dam that breaks, in 16 x 16 x 8 cells."""
    scene = Scene()
    tank = scene.liquid("/tank", (0.0, 0.0, 0.0), (0.5, 0.5, 0.25), 1.0 / 32.0)
    scene.liquid_source("/water", tank, wsim.Box((0.1, 0.15, 0.125)), at=(0.1, 0.15, 0.125))
    return scene


def sand_scene() -> Scene:
    """A box of sand, about 1000 grains, on a floor."""
    scene = Scene()
    scene.mpm("/sand", wsim.Box((0.1, 0.1, 0.1)), at=(0.0, 0.1, 0.0), cell=0.04, material="sand")
    scene.collider("/floor", wsim.Plane(), dynamic_friction=0.4)
    return scene


SCENES: dict[str, Callable[[], Scene]] = {
    "xpbd": lambda: cloth_scene(solver="xpbd", integrator="backward_euler", substeps=10, iterations=4),
    "newton": lambda: cloth_scene(solver="implicit", integrator="bdf2", substeps=4, iterations=1),
    "explicit": lambda: cloth_scene(solver="explicit", integrator="leapfrog", substeps=60),
    "rods": rods_scene, "soft": soft_scene, "rigid": rigid_scene, "tree": tree_scene, "smoke": smoke_scene,
    "liquid": liquid_scene, "mpm": sand_scene}


def fields_of_world(sim: wsim.Simulation, world: int) -> dict[tuple[str, str, str], np.ndarray]:
    """(part, path, name) to values, of every field that a restart needs."""
    found = {}
    for part in sim.state.parts.values():
        part.refresh()
        for (path, of), rows in part.rows.items():
            if of == world and not part.common:
                name = re.sub(r" \d+", "", part.name)                     # a liquid of each world has parts of its own
                found |= {(name, path, f.name): part.arrays[f.name].numpy()[rows] for f in part.kept
                          if not f.name.startswith("balance")}                         # of checks, which begin anew where set
    return found


def largest_difference(one: dict, other: dict) -> float:
    """Largest difference of two such; infinite where they have other rows."""
    if one.keys() != other.keys() or any(len(one[k]) != len(other[k]) for k in one):
        return float("inf")
    return max((float(np.abs(one[k].astype(np.float64) - other[k].astype(np.float64)).max(initial=0.0)) for k in one),
               default=0.0)


def seconds_of_frames(sim: wsim.Simulation, frames: int) -> float:
    """Median of the frames behind the first two [s]."""
    clock, spent = time.process_time if sim.device.is_cpu else time.perf_counter, []
    for _ in range(frames):
        began = clock()
        sim.step()
        spent.append(clock() - began)
    return float(np.median(spent[WARM:]))


def rows_of_method(name: str, scene: Scene, device, counts: list[int], frames: int) -> list[dict]:
    """A row for each number of worlds."""
    alone, rows = wsim.Simulation(scene, device=device), []
    first = seconds_of_frames(alone, frames)
    wanted = fields_of_world(alone, 0)
    for worlds in counts:
        began = time.perf_counter()
        sim = wsim.Simulation(scene, device=device, worlds=worlds)
        made = time.perf_counter() - began
        each = seconds_of_frames(sim, frames) / worlds
        apart = max(largest_difference(wanted, fields_of_world(sim, w)) for w in {0, worlds // 2, worlds - 1})
        rows.append({"method": name, "worlds": worlds, "ms": 1e3 * each, "times": first / each, "apart": apart,
                     "bits": apart == 0.0, "build_s": made})
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--counts", default="1,10,100")
    parser.add_argument("--methods", default=",".join(SCENES))
    parser.add_argument("--frames", type=int, default=8)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    rows: list[dict] = []
    for name in args.methods.split(","):
        try:
            for row in rows_of_method(name, SCENES[name](), args.device, [int(n) for n in args.counts.split(",")], args.frames):
                show(rows, row)
        except SceneError as error:
            print(f"{name}: {error}", flush=True)
    if args.json:
        args.json.write_text(json.dumps({"hardware": hardware(wp.get_device(args.device)), "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
