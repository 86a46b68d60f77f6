"""Garments, sheets and soft bodies by every solver: time of a frame beside its error and its peak strain, frame by frame.

    python -m tools.bench.nets.garments [--device cuda:0] [--only sheet,shirt_hung] [--settings auto,fused,xpbd400]
                                        [--frames 3,6,12] [--cache FOLDER] [--json FILE]

Scenes are those of `scenes/`; the sheet is hanging_cloth without damping, shirt_hung the shirt by its collar without its
dummy, shirt_26k to _410k the shirt on a dummy that sways, with triangles cut in four, once to three times. References, which
`--cache` keeps: leapfrog of the same scene, see `Reference`. Errors are RMS distances of points [m] after the frames, a peak is
the largest stretch of any edge of the first cloth less 1, over that of the reference. A time is the median over frames that
are replayed [ms], one device; `said` is what it was predicted to be; first_s from the scene to the end of the first frame.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil, pi
from pathlib import Path

import numpy as np

from tools.bench.nets.membrane import held, peak_strain, split
from tools.bench.soft.runs import plain
from tools.bench.speed import hardware
from tools.bench.suite import write
from wsim.scene import Cloth, Scene
from wsim.scene.curve import Motion
from wsim.usd import load

ROOT = Path(__file__).resolve().parents[3]
SWAY, RATE = 0.05, 1.0          # [m], [1/s] of a dummy from side to side
TIMED = 8                       # frames that a row is run for at least: one of the first may be repeated for room


@dataclass(frozen=True)
class Reference:
    """The trajectory that a scene is held against: leapfrog of the authored masses in float64, of `refined` times the stable
    substeps. Where that takes minutes (slowed) the default explicit steps, in float32, with mass at slivers: rows then tell how
    well solvers agree, and not what that mass and rounding leave (shirt: 2 mm after three frames)."""

    refined: float = 2.0
    slowed: bool = False

    def run(self, name: str, device: str, ends: list[int]) -> "Run":
        made = SCENES[name]()
        if self.slowed:
            return Run(made, "explicit", device, ends)
        return Run(made, "launched", device, ends, "float64", substeps=ceil(self.refined * stable(made, device)))

    def __str__(self) -> str:
        return "float32, mass at slivers" if self.slowed else f"float64, authored masses, {self.refined:g} x stable substeps"


REFERENCES = {"shirt_102k": Reference(1.05), "shirt_410k": Reference(slowed=True)}


# What a scene is given. Explicit steps as they are by default, launch by launch, many substeps a launch; a rate to hold
def given(solver: str, integrator: str, substeps: int, iterations: int = 1) -> dict:
    return {"solver": solver, "integrator": integrator, "substeps": substeps, "iterations": iterations}


SETTINGS: dict[str, dict] = {"auto": {}} | {name: given("explicit", "auto", 1) for name in ("explicit", "launched", "fused")}
SETTINGS |= {f"xpbd{n}": given("xpbd", "backward_euler", n) for n in (32, 96, 400, 1600)}
SETTINGS |= {f"{name}{n}x{k}": given("implicit", integrator, n, k) for name, integrator in
             (("euler", "backward_euler"), ("bdf", "bdf2")) for n, k in ((8, 2), (32, 2), (96, 1))}
RATES = {f"fps{n}": float(n) for n in (1, 30, 60)}
SETTINGS |= dict.fromkeys(RATES, {})


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
    """The shirt with every triangle cut in four so often, then on a dummy that sways; hung by its collar, without its dummy."""
    found = scene("shirt")
    cloth = found.cloths[0]
    if times:
        points, triangles = split(np.asarray(cloth.points, np.float64), cloth.indices.reshape(-1, 3), times)
        found.cloths[0] = cloth = replace(cloth, points=points, counts=np.full(len(triangles), 3), indices=triangles.ravel())
        found.colliders = [replace(c, motion=swaying(c.motion.at(0.0))) for c in found.colliders]
    if hung:
        found.colliders = []
        found.pin("/held", cloth, held(cloth.motion.points(cloth.points, 0.0)))
    return found


def swaying(place: np.ndarray) -> Motion:
    """From a place (4, 4) from side to side for ever, along x [m]; 48 keys a turn."""
    times = np.arange(49) / 48.0 / RATE
    matrices = np.tile(place, (49, 1, 1))
    matrices[:, 0, 3] += SWAY * np.sin(2.0 * pi * RATE * times)
    return Motion(times, matrices, after="repeat")


SCENES: dict[str, Callable[[], Scene]] = {
    "sheet": sheet, "shirt_hung": lambda: shirt(hung=True), "shirt_26k": lambda: shirt(1), "shirt_102k": lambda: shirt(2),
    "shirt_410k": lambda: shirt(3)} | {
    name: (lambda name=name: scene(name)) for name in
    ("hanging_cloth", "flag", "cape", "shirt", "trampoline", "squeezed_cube", "bear", "twist")}


class Run:
    """A scene by a setting: median time of a frame [ms], positions (points, 3) [m] of all bodies after some frames."""

    def __init__(self, made: Scene, setting: str, device: str, ends: list[int], precision: str = "float32", **more):
        from wsim.model.launches import KernelLaunches
        from wsim.simulation.simulation import Simulation
        before, KernelLaunches.fuses = KernelLaunches.fuses, {"launched": False, "fused": True}.get(setting)
        try:
            began = time.perf_counter()
            self.sim = sim = Simulation(replace(made, **SETTINGS[setting] | more), device=device, precision=precision,
                                        fps=RATES.get(setting))
            self.states, self.peaks = {}, {}
            cloth = next(iter(made.cloths), None)
            for number in range(1, max(ends) + 1):
                sim.step()
                if number == 1:
                    self.first = time.perf_counter() - began
                if number in ends:
                    self.states[number] = sim.state.x.numpy().astype(np.float64) + sim.state.e.numpy()
                    if cloth:
                        self.peaks[number] = peak(cloth, sim.positions(cloth.path))
        finally:
            KernelLaunches.fuses = before

    def row(self) -> dict:
        sim, plan = self.sim, self.sim.plan
        sim.run(max(0, TIMED - sim.frame))
        ms = sim.milliseconds[min(2, len(sim.milliseconds) - 1):]
        return {"said": 1e3 * plan.seconds, "why": plan.choice.why, "ms": float(np.median(ms)), "first_s": self.first,
                "solver": plan.choice.solver, "integrator": plan.choice.integrator.name, "substeps": plan.clock.substeps,
                "iterations": plan.choice.iterations, "points": sim.state.x.shape[0], "forms": sim.forms,
                "warnings": sim.warnings}


def peak(cloth: Cloth, x: np.ndarray) -> float:
    """The largest strain of an edge at positions (n, 3) [m] in the author's order, against the points as they are authored."""
    rest, indices = np.asarray(cloth.motion.points(cloth.points, 0.0), np.float64), np.asarray(cloth.indices)
    start = np.concatenate([[0], np.cumsum(cloth.counts)[:-1]])
    fans = [np.stack([indices[s], indices[s + k], indices[s + k + 1]]) for s, c in zip(start, cloth.counts, strict=True)
            for k in range(1, c - 1)]
    return peak_strain(rest, np.array(fans), np.asarray(x, np.float64))


def stable(made: Scene, device) -> int:
    """Substeps a frame with which leapfrog holds a scene whose points all keep their own mass."""
    import warp as wp

    from wsim.model.model import build_model
    from wsim.physics.cloth.constraints import fill_constraints
    from wsim.physics.motion.frequency import frequency_bound
    from wsim.physics.motion.stability import substeps_needed
    from wsim.scene.integrator import TABLE
    model = build_model(made, 1, wp.get_device(device), wp.float64)
    fill_constraints(model)
    return substeps_needed(made, TABLE["leapfrog"], *frequency_bound(model))


def truth(name: str, device: str, ends: list[int], folder: str) -> dict:
    """Positions x_N (points, 3) [m], in solver order, and peak strains peak_N of the reference of a scene; from the folder, if
    they are there."""
    file = Path(folder or ".") / f"truth_{name}_{'_'.join(map(str, ends))}.npz"
    if folder and file.exists():
        with np.load(file) as found:
            return dict(found)
    run = REFERENCES.get(name, Reference()).run(name, device, ends)
    found = {f"x_{n}": x for n, x in run.states.items()} | {f"peak_{n}": p for n, p in run.peaks.items()}
    if folder:
        np.savez(file, **found)
    return found


def rows(name: str, device: str, ends: list[int], settings: list[str], folder: str):
    """Rows of a scene, one by one."""
    true = truth(name, device, ends, folder)
    for setting in settings:
        row = {"scene": name, "device": device, "setting": setting, "reference": str(REFERENCES.get(name, Reference()))}
        try:
            run = Run(SCENES[name](), setting, device, ends)
        except Exception as error:                               # noqa: BLE001  (a table says which row failed)
            yield row | {"failed": f"{type(error).__name__}: {str(error)[:300]}"}
            continue
        yield row | run.row() | {f"rms_{n}": float(np.sqrt(np.mean(np.sum((x - true[f"x_{n}"])**2, axis=1))))
                                 for n, x in run.states.items()} | {
            f"peak_{n}": p / float(true[f"peak_{n}"]) for n, p in run.peaks.items()} | {
            "true_peak": {n: float(true[f"peak_{n}"]) for n in run.peaks}}


def line(row: dict, ends: list[int]) -> str:
    if "failed" in row:
        return f"{row['scene']:14} {row['setting']:10} {row['failed'][:120]}"
    errors = "  ".join(f"{row[f'rms_{end}']:.2e}" + (f" {row[f'peak_{end}']:5.2f}" if f"peak_{end}" in row else "")
                       for end in ends)
    steps = f"{row['solver']:8} {row['integrator']:14} {row['substeps']:5} x {row['iterations']:<2}"
    times = f"{row['ms']:9.3f} ms (said {row['said']:.3g})"
    return (f"{row['scene']:14} {row['setting']:10} {steps} {times}  {errors}  {row['first_s']:6.2f} s"
            + ("  !" if row["warnings"] else ""))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default=None)
    parser.add_argument("--only", default=",".join(SCENES))
    parser.add_argument("--settings", default=",".join(SETTINGS))
    parser.add_argument("--frames", default="3,6,12")
    parser.add_argument("--cache", default="", help="folder that keeps references")
    parser.add_argument("--json", default="")
    args = parser.parse_args()
    import warp as wp
    found: list[dict] = []
    began, ends, device = time.perf_counter(), [int(n) for n in args.frames.split(",")], wp.get_device(args.device)
    print(hardware(device), "| rms [m] and peak strain over the true one after frames", args.frames)
    for name in args.only.split(","):
        for row in rows(name, str(device), ends, args.settings.split(","), args.cache):
            found.append(row)
            print(line(row, ends), flush=True)
            if args.json:
                write(args.json, plain({"hardware": hardware(device), "frames": ends, "rows": found}))
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
