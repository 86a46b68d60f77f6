"""Fluids with bodies, surfaces, a moving box and kept sums, on a GPU: what a CPU finds, and the same to the bit."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.make.physics.fluid import bodies
from tests.make.physics.fluid.obstacles.walls import duct
from tests.physics.fluid import test_window
from tests.physics.fluid.liquid import test_sheets
from wsim.physics.fluid.objects import Fluid
from wsim.scene import Scene
from wsim.simulation.simulation import Simulation

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")


def smoke_and_body() -> Scene:
    return bodies.room(force=(0.02, 0.0, 0.0))


def kept() -> Scene:
    n = 32
    at = (np.arange(n) + 0.5) / n
    smoke = ((at[:, None] - 0.5) ** 2 + (at[None] - 0.4) ** 2 < 0.04).astype(float)[..., None]
    scene = Scene(gravity=(0.0, -9.81, 0.0), fps=24.0)
    scene.add(Fluid("/air", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0 / n), 1.0 / n, sides=("closed",) * 6, conserve=True, weight=-1.0,
                    smoke=smoke))
    return scene


def fields(make: Callable[[], Scene], device: str, frames: int = 3) -> list[np.ndarray]:
    """All that the parts of a run hold in the end, float64."""
    sim = Simulation(replace(make(), frames=frames), device=device, precision="float64")
    sim.run(frames)
    return [array.numpy() for name, part in sorted(sim.state.parts.items()) for array in part.arrays.values()
            if array.dtype not in (wp.int32, wp.int64)]


@pytest.mark.parametrize("make", [smoke_and_body, kept], ids=["a body in smoke", "kept sums"])
def test_it_goes_as_on_a_cpu_and_repeats_to_the_bit(make):
    one, again, cpu = fields(make, "cuda:0"), fields(make, "cuda:0"), fields(make, "cpu")
    assert len(one) > 2 and all(np.array_equal(a, b) for a, b in zip(one, again, strict=True))
    for a, b in zip(one, cpu, strict=True):
        assert np.abs(a - b).max(initial=0.0) <= 1e-3 * max(np.abs(b).max(initial=0.0), 1e-9)     # solves stop at 1e-4


@pytest.fixture
def on_gpu(monkeypatch):
    """Tests of a CPU run on a GPU."""
    for module in (test_sheets, test_window):
        monkeypatch.setattr(module, "Simulation", lambda scene, **how: Simulation(scene, **how | {"device": "cuda:0"}))


def test_particles_stay_above_a_sheet(on_gpu):
    test_sheets.test_liquid_poured_onto_a_pinned_sheet_stays_above_it()


def test_a_box_follows_its_smoke(on_gpu):
    test_window.test_a_part_is_the_same_run_to_run_and_the_whole_where_it_reaches_all_sides()


def test_air_round_a_sheet_that_is_moved_is_that_of_a_cpu():
    ends = []
    for device in ("cuda:0", "cpu"):
        scene = duct(("closed",) * 6, speed=0.5, tolerance=1e-10)
        sim = Simulation(scene, device=device, precision="float64")
        sim.run()
        ends.append(sim.plan.method("fluid").arrays(0))
    assert all(np.abs(ends[0][name] - ends[1][name]).max() <= 1e-6 for name in ends[0])
