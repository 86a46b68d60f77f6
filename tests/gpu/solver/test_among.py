"""Rods against cloth on a GPU: never through it, with their momentum, near where they are on a CPU, the same bits each run."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.rods.with_surfaces import crossed, thrown
from tests.physics.contact.selfcontact.rig import solvers
from wsim.simulation.simulation import Simulation

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")


@pytest.mark.parametrize("solver", solvers("xpbd", "newton", "newton bdf2", "leapfrog"))
def test_a_rope_that_is_thrown_at_a_cloth_never_passes_and_keeps_momentum(solver):
    most = 3e-6 if solver["integrator"] == "bdf2" else 1e-6              # of which float32 rounds by 1e-6 on a CPU

    def flown(device: str, frames: int, held: bool) -> np.ndarray:
        scene = thrown(1, 6.0, **solver)
        scene.pins = scene.pins if held else []
        scene.gravity = scene.gravity if held else (0.0, 0.0, 0.0)
        sim = Simulation(scene, device=device)
        rods, m = sim.plan.method("rods"), sim.model.bodies[0].masses
        mass, first = rods.table.values["m"].T.ravel(), None
        for _ in range(frames):
            v = rods.points(0)[1]
            now = mass @ v + m @ np.asarray(sim.velocities("/cloth"), np.float64)
            first = (now, mass @ np.linalg.norm(v, axis=1)) if first is None else first
            assert held or np.abs(now - first[0]).max() < most * first[1]
            sim.step()
            assert crossed(sim) == 0
        found = sim.plan.method("selfcontact").indicators(None, None)
        assert found["held"] == 0
        return np.concatenate([rods.points(0)[0], sim.positions("/cloth")])
    one = flown("cuda:0", 10, True)
    assert np.array_equal(one, flown("cuda:0", 10, True))
    flown("cuda:0", 10, False)
    assert np.abs(flown("cuda:0", 2, True) - flown("cpu", 2, True)).max() < 1e-4
