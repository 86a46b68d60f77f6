"""Gradients of the material point method: error against differences, CPU time and memory, as a table.

    python tools/bench/soft/mpm/gradients.py [--cells 4] [--frames 10]
"""

from argparse import ArgumentParser
from dataclasses import replace
from time import process_time

import numpy as np

import wsim
from wsim import Box, Plane, Scene
from wsim.physics.mpm.objects import Granular, Jelly, Snow

CASES = {"jelly": (Jelly(2e4), "young"), "snow": (Snow(young=5e4), "hardening"),
         "sand": (Granular(young=1e5), "friction_angle")}
STEP = 1e-7                # of the value, of differences


def make_scene(material, cells: int, frames: int) -> Scene:
    """A cube of so many cells along an edge, thrown on a floor."""
    scene = Scene(fps=60.0, frames=frames)
    scene.collider("/floor", Plane("Y"), static_friction=0.3, dynamic_friction=0.3)
    half = 0.025 * cells
    scene.mpm("/body", Box((half, half, half)), at=(0, half + 0.01, 0), cell=0.05, velocity=(0.5, -1.5, 0.2), material=material)
    return scene


def places_at_end(scene: Scene) -> tuple[np.ndarray, float]:
    """Places after the last frame, and CPU seconds."""
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    began = process_time()
    simulation.run(scene.frames)
    return simulation.samples()[0].positions, process_time() - began


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, default=4)
    parser.add_argument("--frames", type=int, default=10)
    given = parser.parse_args()
    print("| law | by | particles | steps | error | run [CPU s] | recorded | backward | MB |")
    print("|---|---|---|---|---|---|---|---|---|")
    for law, (material, name) in CASES.items():
        places_at_end(make_scene(material, given.cells, 1))
        at, alone = places_at_end(make_scene(material, given.cells, given.frames))
        simulation = wsim.Simulation(make_scene(material, given.cells, given.frames), device="cpu", precision="float64",
                                     gradients=True)
        recording = wsim.Recording(simulation, given.frames)
        weights = np.random.default_rng(0).normal(size=at.shape)
        recording.backward({given.frames: weights})                        # compiles
        times = [process_time()]
        recording.run()
        times.append(process_time())
        gradient = recording.backward({given.frames: weights})
        times.append(process_time())
        value = getattr(material, name)
        ends = [places_at_end(make_scene(replace(material, **{name: value * (1.0 + s * STEP)}), given.cells, given.frames))[0]
                for s in (1, -1)]
        expected = float((weights * (ends[0] - ends[1])).sum()) / (2.0 * STEP * value)
        error = abs(gradient.value("/body", name) / expected - 1.0)
        steps = sum(n for n, _ in recording.grains.frames.values())
        print(f"| {law} | {name} | {len(at)} | {steps} | {error:.1e} | {alone:.2f} | {times[1] - times[0]:.2f} | "
              f"{times[2] - times[1]:.2f} | {recording.bytes / 1e6:.0f} |", flush=True)


if __name__ == "__main__":
    main()
