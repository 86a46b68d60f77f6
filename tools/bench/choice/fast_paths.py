"""What fast paths gain over the general path: the rows of wsim/bench/fast_paths.py, each in a scene that takes it.

    python -m tools.bench.choice.fast_paths [--device cpu] [--rows NAME,NAME] [--rounds 5] [--least 0.5] [--table]

A scene is built and run twice, with the fast path and with what the row switches off, and both take their frames in turns.
gain: time of the general path over that of the fast one, of the least round each; on a CPU seconds of the thread that launches,
on a GPU wall time of frames that are waited for. apart: greatest distance of points behind all rounds, over the size [1].
--table prints the registry as it stands, without a run.
"""

import argparse
import importlib
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from wsim import Scene, Simulation, load  # noqa: E402
from wsim.bench.fast_paths import ROWS, FastPath  # noqa: E402
from wsim.physics.fluid.objects import Fluid, Source  # noqa: E402
from wsim.scene import Box, Motion, Plane, Sphere, shapes  # noqa: E402
from wsim.scene.fabric import Fabric  # noqa: E402


def example(name: str, **settings: Any) -> Scene:
    """An example scene with other settings."""
    scene = load(str(ROOT / "scenes" / f"{name}.usda"))
    for key, value in settings.items():
        setattr(scene, key, value)
    return scene


def sheet(n: int, **settings: Any) -> Scene:
    """A sheet of 1 m, n by n cells, that hangs by two corners."""
    scene = Scene(fps=24.0, frames=24, **settings)
    points, counts, indices = shapes.sheet(1.0, 1.0, n, n)
    cloth = scene.cloth("/sheet", points, counts, indices, material=Fabric(stretch=500.0, bend=1e-5, damping=1e-3))
    scene.pin("/pin", cloth, [0, n])
    return scene


def far(scene: Scene) -> Scene:
    scene.collider("/ball", Sphere(0.1), at=(0.0, -10.0, 0.0))
    return scene


def net(n: int, **settings: Any) -> Scene:
    from tools.bench.speed import grid_net
    points, edges, row = grid_net(n)
    scene = Scene(fps=24.0, frames=24, solver="explicit", integrator="leapfrog", **settings)
    body = scene.net("/net", points, edges, np.full(len(edges), 1e3), np.full(n * n, 0.2 / n**2))
    scene.pin("/pin", body, [int(row[0]), int(row[-1])])
    return scene


def strewn(balls: int) -> Scene:
    """A sheet that lies on many balls."""
    scene = Scene(fps=24.0, frames=24, solver="xpbd", substeps=20, iterations=1)
    scene.cloth("/sheet", *shapes.sheet(1.0, 1.0, 32, 32, horizontal=True, at=(0.0, 0.06, 0.0)),
                material=Fabric(stretch=500.0, bend=1e-5))
    side = int(np.sqrt(balls))
    for k in range(side * side):
        x, z = (k % side + 0.5) / side - 0.5, (k // side + 0.5) / side - 0.5
        scene.collider(f"/ball{k}", Sphere(0.3 / side), at=(x, 0.0, z))
    return scene


def smoke(cells: int) -> Scene:
    scene = Scene(fps=24.0, frames=24)
    scene.add(Fluid("/air", (0, 0, 0), (1, 1, 1), 1.0 / cells, steps=1, tolerance=1e-5, pressure="auto"))
    scene.add(Source("/fire", Sphere(0.15), smoke=1.0, temperature=100.0, motion=Motion.at_place((0.5, 0.2, 0.5))))
    return scene


def splash(across: int) -> Scene:
    """A cube of fluid that falls apart on a plane."""
    scene = Scene(fps=60.0, frames=24, substeps=8, iterations=4)
    scene.collider("/floor", Plane())
    scene.particles("/water", Box((0.005 * across,) * 3), at=(0, 0.005 * across, 0), radius=0.005, material="fluid")
    return scene


EXPLICIT = {"solver": "explicit", "integrator": "leapfrog"}
SWEPT = {"solver": "xpbd", "integrator": "backward_euler"}
SCENES: dict[str, Any] = {
    "springs in one pass": lambda: net(32, substeps=200),
    "sheets by eights": lambda: example("hanging_cloth", substeps=1200, **EXPLICIT),
    "substeps by a team": lambda: example("squeezed_cube", substeps=200, **EXPLICIT),
    "tets by eights": lambda: example("bear", substeps=80, **EXPLICIT),
    "sweeps by eights": lambda: sheet(32, substeps=40, iterations=1, **SWEPT),
    "fluids by eights": lambda: splash(20),
    "launches by several cores": lambda: splash(20),
    "tree of colliders": lambda: strewn(100),
    "frames without contacts": lambda: far(example("hanging_cloth", substeps=1200, **EXPLICIT)),
    "direct pressure": lambda: smoke(32),
    "frames of sheets by blocks": lambda: example("hanging_cloth", substeps=1200, **EXPLICIT),
    "frames of nets by a cluster": lambda: net(64, substeps=400),
    "substeps in one launch": lambda: net(32, substeps=200),
    "conjugate gradients by a cluster": lambda: example("twist", solver="implicit", integrator="bdf2", substeps=4),
    "conjugate gradients by a block": lambda: sheet(30, solver="implicit", integrator="bdf2", substeps=4, iterations=1),
    "Schwarz domains": lambda: sheet(80, solver="implicit", integrator="bdf2", substeps=1, iterations=1),
    "colours by a block": lambda: sheet(24, substeps=40, iterations=1, **SWEPT),
    "colours by a cluster": lambda: sheet(64, substeps=40, iterations=1, **SWEPT),
    "ropes by a block": lambda: example("rope_knot"),
    "bodies and points by a block": lambda: example("ball_into_cloth"),
    "sweeps of surfaces in a launch": lambda: example("ribbon"),
    "small levels by a block": lambda: example("dam_break"),
    "rigid bodies by a block": lambda: example("card_house"),
}


@contextmanager
def switched(pairs: tuple[tuple[str, Any], ...]):
    """Attributes with other values; a function of them where it is imported by name too."""
    before = []
    for place, value in pairs:
        module, _, path = place.partition(":")
        owner: Any = importlib.import_module(module)
        *inner, name = path.split(".")
        for part in inner:
            owner = getattr(owner, part)
        before.append((owner, name, getattr(owner, name)))
        setattr(owner, name, value)
    try:
        yield
    finally:
        for owner, name, value in reversed(before):
            setattr(owner, name, value)


class Run:
    def __init__(self, row: FastPath, device: str, fast: bool):
        self.pairs = () if fast else (row.off,)
        self.device = wp.get_device(device)
        with switched(self.pairs):
            self.sim = Simulation(SCENES[row.name](), device=device)
            for _ in range(3):
                self.sim.step()
        self.least = np.inf

    def round(self, frames: int) -> None:
        clock = time.perf_counter if self.device.is_cuda else time.thread_time
        with switched(self.pairs):
            wp.synchronize_device(self.device)
            began = clock()
            for _ in range(frames):
                self.sim.step()
            wp.synchronize_device(self.device)
        self.least = min(self.least, (clock() - began) / frames)


def measure(row: FastPath, device: str, rounds: int, least: float) -> str:
    runs = [Run(row, device, True), Run(row, device, False)]
    for run in runs:
        run.round(1)
    frames = max(1, round(0.5 * least / runs[0].least))
    for k in range(rounds):
        for run in runs if k % 2 else runs[::-1]:
            run.round(frames)
    x, y = (np.asarray(run.sim.positions(), np.float64) if len(run.sim.model.bodies) else np.zeros((1, 3)) for run in runs)
    apart = np.abs(x - y).max() / max(np.ptp(y, axis=0).max(), 1e-9)
    fast, general = (1e3 * run.least for run in runs)
    return f"{row.name:44s} {fast:9.2f} {general:9.2f} ms  gain {general / fast:5.2f}  apart {apart:.1e}"


def table() -> str:
    """The registry as a page has it."""
    lines = ["| fast path | computes | on | for | gain | measured | formulas | test |", "|---|---|---|---|---|---|---|---|"]
    lines += [f"| {r.name} | {r.law} | {r.device} | {r.sizes} | {'' if r.gain is None else f'{r.gain:g}'} | {r.measured} | "
              f"{'in C++ again' if r.copies else 'the same'} | `{r.test}` |" for r in ROWS]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--rows", default="")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--least", type=float, default=0.5, help="seconds of a round")
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    if given.table:
        print(table())
        return
    kind = "cuda" if wp.get_device(given.device).is_cuda else "cpu"
    for row in ROWS:
        if row.device == kind and row.name in SCENES and (not given.rows or row.name in given.rows.split(",")):
            try:
                print(measure(row, given.device, given.rounds, given.least), flush=True)
            except Exception as failed:       # the next row may still run
                print(f"{row.name:44s} {type(failed).__name__}: {failed}", flush=True)


if __name__ == "__main__":
    main()
