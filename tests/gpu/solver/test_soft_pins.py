"""Soft pins that share points, on a GPU, where all pins of a launch pull at once. Skipped where there is no CUDA device."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.motion.soft_pins import balance, pulled
from tests.physics.contact.selfcontact.rig import solvers
from wsim.simulation.simulation import Simulation

wp.init()
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")

@pytest.mark.parametrize("solver", solvers("xpbd", "xpbd bdf2", "newton", "leapfrog", "rk4"))
@pytest.mark.parametrize("count", [2, 3])
def test_a_point_between_soft_pins_rests_where_they_balance(solver, count):
    sim = Simulation(pulled(count, 4000, **solver), device="cuda:0", precision="float64")
    sim.run(120)
    np.testing.assert_allclose(sim.positions()[:4000], np.tile(balance(count), (4000, 1)), atol=1e-6)


@pytest.mark.parametrize("solver", solvers("xpbd", "leapfrog"))
def test_soft_pins_of_one_point_move_it_as_on_a_cpu(solver):
    found = []
    for device in ("cpu", "cuda:0", "cuda:0"):
        sim = Simulation(pulled(3, 4000, **solver), device=device, precision="float64")
        sim.run(10)
        found.append(sim.positions())
    assert np.array_equal(found[1], found[2]) and np.abs(found[1] - found[0]).max() < 1e-12
