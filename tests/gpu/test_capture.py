"""A frame can be captured as a graph: it takes no memory, neither on the device nor pinned, which CUDA refuses in a capture.

CI has no GPU: here frames of every example scene and solver run on the CPU with their launches left out and the allocator shut.
"""

from pathlib import Path

import pytest
import warp as wp
from warp._src import context

from wsim.scene import SceneError
from wsim.simulation.simulation import Simulation
from wsim.usd import load

SCENES = sorted((Path(__file__).parents[2] / "scenes").glob("*.usda"))
SOLVERS = [("xpbd", "backward_euler"), ("xpbd", "bdf2"), ("implicit", "backward_euler"), ("implicit", "bdf2"),
           ("implicit", "sdirk3"), ("explicit", "auto")]


def shut(allocator, size: int) -> int:
    raise RuntimeError(f"{size} bytes asked for within a frame")


def both(condition, on_true=None, on_false=None, **given) -> None:
    """Both branches, whatever the condition says."""
    for body in filter(None, (on_true, on_false)):
        body(**given)


@pytest.mark.parametrize("solver, integrator", SOLVERS)
def test_a_frame_takes_no_memory(solver, integrator, monkeypatch):
    ran = 0
    for path in SCENES:
        scene = load(path)
        scene.solver, scene.integrator = solver, integrator
        try:
            sim = Simulation(scene, device="cpu")
        except SceneError:                                # not every solver takes every material
            continue
        sim.plan.before_frame(0.0)
        with monkeypatch.context() as patch:
            patch.setattr(wp, "launch", lambda *given, **named: None)
            patch.setattr(wp, "capture_while", lambda condition, body, **given: body(**given))     # once: no kernel ends it
            patch.setattr(wp, "capture_if", both)
            patch.setattr(context.CpuDefaultAllocator, "allocate", shut)
            sim.plan.frame()
        ran += 1
    assert ran > 3
