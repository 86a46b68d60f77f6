"""Garments, sheets and soft bodies by every solver: time of a frame beside its error and its peak strain, frame by frame.

    python -m tools.bench.nets.garments [--device cuda:0] [--only sheet,shirt_hung] [--settings auto,fused,xpbd400]
                                        [--frames 3,6,12] [--json FILE]

Scenes are those of `scenes/`; the sheet is hanging_cloth without damping, shirt_hung the shirt by its collar without its
dummy, shirt_26k to _410k the shirt with triangles cut in four, once to three times. The reference is a float64 trajectory of
the same scene by leapfrog at REFINED times the stable substeps, with no mass added to slivers: errors are RMS distances of
points [m] after the frames, a peak is the largest stretch of any edge less 1, over that of the reference. A time
is the median over frames that are replayed [ms], one device; first_s from the scene to the end of the first frame.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from math import ceil
from pathlib import Path

import numpy as np

from tools.bench.nets.membrane import held, split
from tools.bench.soft.runs import plain
from tools.bench.speed import hardware
from tools.bench.suite import write
from wsim.scene import Cloth, Scene
from wsim.usd import load

ROOT = Path(__file__).resolve().parents[3]
REFINED = 2            # leapfrog errs by a fourth of what the row does
# What a scene is given. Explicit steps as they are by default, launch by launch, many substeps a launch


def given(solver: str, integrator: str, substeps: int, iterations: int = 1) -> dict:
    return {"solver": solver, "integrator": integrator, "substeps": substeps, "iterations": iterations}


SETTINGS: dict[str, dict] = {"auto": {}} | {name: given("explicit", "auto", 1) for name in ("explicit", "launched", "fused")}
SETTINGS |= {f"xpbd{n}": given("xpbd", "backward_euler", n) for n in (32, 96, 400, 1600)}
SETTINGS |= {f"{name}{n}x{k}": given("implicit", integrator, n, k) for name, integrator in
             (("euler", "backward_euler"), ("bdf", "bdf2")) for n, k in ((8, 2), (32, 2), (96, 1))}


def scene(name: str) -> Scene:
    return load(str(ROOT / "scenes" / f"{name}.usda"))


def sheet() -> Scene:
    """33 x 33 points of cotton, undamped."""
    found = scene("hanging_cloth")
    found.solver, found.integrator = "explicit", "auto"
    cloth = found.cloths[0]
    cloth.material = replace(cloth.material, damping=0.0)
    return found


def shirt(times: int = 0, hung: bool = False) -> Scene:
    """The shirt with every triangle cut in four so often; hung by its collar, without its dummy."""
    found = scene("shirt")
    cloth = found.cloths[0]
    if times:
        points, triangles = split(np.asarray(cloth.points, np.float64), cloth.indices.reshape(-1, 3), times)
        found.cloths[0] = cloth = replace(cloth, points=points, counts=np.full(len(triangles), 3), indices=triangles.ravel())
    if hung:
        found.colliders = []
        found.pin("/held", cloth, held(cloth.motion.points(cloth.points, 0.0)))
    return found


SCENES: dict[str, Callable[[], Scene]] = {
    "sheet": sheet, "shirt_hung": lambda: shirt(hung=True), "shirt_26k": lambda: shirt(1), "shirt_102k": lambda: shirt(2),
    "shirt_410k": lambda: shirt(3)} | {
    name: (lambda name=name: scene(name)) for name in
    ("hanging_cloth", "flag", "cape", "shirt", "trampoline", "squeezed_cube", "bear", "twist")}


class Run:
    """A scene by a setting: median time of a frame [ms], positions (points, 3) [m] of all bodies after some frames."""

    def __init__(self, made: Scene, setting: str, device: str, ends: list[int], precision: str = "float32", **more):
        from wsim.model.launches import Launches
        from wsim.simulation.simulation import Simulation
        before, Launches.fuses = Launches.fuses, {"launched": False, "fused": True}.get(setting)
        try:
            began = time.perf_counter()
            self.sim = sim = Simulation(replace(made, **SETTINGS[setting] | more), device=device, precision=precision)
            self.states = {}
            for number in range(1, max(ends) + 1):
                sim.step()
                if number == 1:
                    self.first = time.perf_counter() - began
                if number in ends:
                    self.states[number] = sim.state.x.numpy().astype(np.float64) + sim.state.e.numpy()
        finally:
            Launches.fuses = before

    def row(self) -> dict:
        sim, plan = self.sim, self.sim.plan
        return {"ms": float(np.median(sim.milliseconds[min(2, len(sim.milliseconds) - 1):])), "first_s": self.first,
                "solver": plan.choice.solver, "integrator": plan.choice.integrator.name, "substeps": plan.clock.substeps,
                "iterations": plan.choice.iterations, "points": sim.state.x.shape[0], "forms": sim.forms,
                "warnings": sim.warnings}


def peaks(run: Run) -> dict[int, float]:
    """The largest strain of an edge of the first body after each of the frames, where that is a cloth."""
    body = run.sim.model.bodies[0]
    if not isinstance(body.source, Cloth):
        return {}
    i, j = (body.edges - body.first).T
    rest = np.linalg.norm(body.rest[i] - body.rest[j], axis=1)
    return {end: float((np.linalg.norm(x[body.first + i] - x[body.first + j], axis=1) / rest).max() - 1.0)
            for end, x in run.states.items()}


def stable(made: Scene, device) -> int:
    """Substeps a frame with which leapfrog holds a scene whose points all keep their own mass."""
    from wsim.simulation.simulation import Simulation
    n = 1
    while True:
        plan = Simulation(replace(made, solver="explicit", integrator="auto", substeps=n), device=device).plan
        if "more mass" not in plan.choice.why:
            return plan.clock.substeps
        n = ceil(1.5 * plan.clock.substeps) if n == 1 else ceil(1.25 * n)


def rows(name: str, device: str, ends: list[int], settings: list[str]):
    """Rows of a scene, one by one."""
    made = SCENES[name]
    fine = Run(made(), "launched", device, ends, "float64", substeps=REFINED * stable(made(), device))
    true, strain = fine.states, peaks(fine)
    for setting in settings:
        row = {"scene": name, "device": device, "setting": setting}
        try:
            run = Run(made(), setting, device, ends)
        except Exception as error:                               # noqa: BLE001  (a table says which row failed)
            yield row | {"failed": f"{type(error).__name__}: {str(error)[:300]}"}
            continue
        each = peaks(run)
        yield row | run.row() | {f"rms_{end}": float(np.sqrt(np.mean(np.sum((x - true[end])**2, axis=1))))
                                 for end, x in run.states.items()} | {
            f"peak_{end}": peak / strain[end] for end, peak in each.items()} | {"true_peak": strain}


def line(row: dict, ends: list[int]) -> str:
    if "failed" in row:
        return f"{row['scene']:14} {row['setting']:10} {row['failed'][:120]}"
    errors = "  ".join(f"{row[f'rms_{end}']:.2e}" + (f" {row[f'peak_{end}']:5.2f}" if f"peak_{end}" in row else "")
                       for end in ends)
    steps = f"{row['solver']:8} {row['integrator']:14} {row['substeps']:5} x {row['iterations']:<2}"
    return (f"{row['scene']:14} {row['setting']:10} {steps} {row['ms']:9.3f} ms  {errors}  {row['first_s']:6.2f} s"
            + ("  !" if row["warnings"] else ""))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default=None)
    parser.add_argument("--only", default=",".join(SCENES))
    parser.add_argument("--settings", default=",".join(SETTINGS))
    parser.add_argument("--frames", default="3,6,12")
    parser.add_argument("--json", default="")
    args = parser.parse_args()
    import warp as wp
    found: list[dict] = []
    began, ends, device = time.perf_counter(), [int(n) for n in args.frames.split(",")], wp.get_device(args.device)
    print(hardware(device), "| rms [m] and peak strain over the true one after frames", args.frames)
    for name in args.only.split(","):
        for row in rows(name, str(device), ends, args.settings.split(",")):
            found.append(row)
            print(line(row, ends), flush=True)
            if args.json:
                write(args.json, plain({"hardware": hardware(device), "frames": ends, "rows": found}))
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
