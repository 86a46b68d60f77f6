"""On a GPU: colliders and self-contact by the implicit midpoint, captured, with further Newton steps in a loop of the graph, go
as on the CPU until rounding grows, and with the same bits from run to run. Skipped where there is no device."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.contact.midpoint import draped, fallen
from tests.physics.contact.selfcontact.rig import crossed, said
from wsim.scene import Sphere, Surface, shapes
from wsim.simulation.simulation import Simulation

wp.init()
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")
BODY = {"sphere": Sphere(0.1), "mesh": Surface(*shapes.sphere(0.1, 8))}


@pytest.mark.parametrize("solver, body", [("implicit", "sphere"), ("implicit", "mesh"), ("xpbd", "sphere")])
def test_a_cloth_that_falls_on_a_body_is_that_of_the_cpu(solver, body):
    sims = [Simulation(draped(BODY[body], solver=solver), device=device) for device in ("cpu", "cuda:0")]
    for frame in range(12):
        for sim in sims:
            sim.step()
        if frame < 6:
            np.testing.assert_allclose(*(sim.positions("/cloth") for sim in sims), rtol=0.0, atol=1e-4)
    assert [sim.plan.integrator for sim in sims] == 2 * ["implicit_midpoint"] or solver == "xpbd"
    assert sims[1].plan.method("contact").indicators(None, None)["contacts"] > 0


def test_layers_that_fall_on_a_floor_have_the_same_bits_from_run_to_run():
    """By 12 iterations, as on the CPU: with 6, a frame misses the residual that the midpoint needs, and says so."""
    found = []
    for _ in range(2):
        sim = Simulation(fallen(iterations=12), device="cuda:0")
        for _ in range(20):
            sim.step()
            assert crossed(sim) == 0
        assert sim.plan.integrator == "implicit_midpoint" and said(sim)["cut"] == said(sim)["held"] == 0
        found.append(np.concatenate([sim.positions(b.path) for b in sim.model.bodies]))
    assert np.array_equal(*found) and np.isfinite(found[0]).all()
