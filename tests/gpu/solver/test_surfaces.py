"""Surfaces that collide, on a GPU: momentum, bits that repeat, and the motion of a CPU."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.contact.selfcontact.momentum import meeting, moments
from tests.make.physics.solver.newton_surfaces import caught, draped
from tests.physics.contact.selfcontact.rig import crossed, said, solvers
from wsim.simulation.simulation import Simulation

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no GPU")


def met(solver: dict, device: str, frames: int = 3):
    sim = Simulation(meeting(0.5, **solver), device=device)
    before, _, size, _ = moments(sim)
    for _ in range(frames):
        sim.step()
        assert np.abs(moments(sim)[0] - before).max() < 1e-6 * size
    return sim, np.concatenate([sim.positions(b.path) for b in sim.model.bodies])


@pytest.mark.parametrize("solver", solvers("xpbd", "newton", "newton bdf2", "newton midpoint", "leapfrog"))
def test_two_sheets_that_collide_keep_their_momentum_and_repeat_to_the_bit(solver):
    sim, found = met(solver, "cuda:0")
    assert crossed(sim) == 0 and said(sim)["cut"] == 0
    assert np.array_equal(found, met(solver, "cuda:0")[1])


@pytest.mark.parametrize("solver", solvers("leapfrog", "newton", "newton bdf2", "newton midpoint"))
def test_they_go_as_on_a_cpu(solver):
    """Behind the blow, within what rounding makes of it: on a CPU float32 and float64 part by 0.1 (leapfrog) to 0.7 mm."""
    found = [met(solver, device, 1)[1] for device in ("cpu", "cuda:0")]
    assert np.abs(found[0] - found[1]).max() < (5e-4 if solver["solver"] == "explicit" else 1.4e-3)


@pytest.mark.parametrize("scene, frames", [(draped, 5), (caught, 5)])
def test_newton_steps_of_surfaces_that_touch_go_as_on_a_cpu(scene, frames):
    """On a box, whose edges are rows of the solve, and under a ball, which Newton steps know: captured frames, with further
    steps in a loop of the graph. To 1 mm until rounding grows, and to the bit from run to run."""
    found = []
    for device in ("cpu", "cuda:0", "cuda:0"):
        sim = Simulation(scene("backward_euler"), device=device)
        sim.run(frames)
        assert sim.graphs or device == "cpu"
        found.append(sim.positions("/c"))
    assert np.abs(found[0] - found[1]).max() < 1e-3 and np.array_equal(found[1], found[2])
