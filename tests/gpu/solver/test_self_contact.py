"""On a GPU: surfaces against corners of a mesh collider, captured, have no intersection, and go as on the CPU until rounding
grows. Skipped where there is no device."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.contact.selfcontact.colliders import crossed, dropped, spike, turning
from tests.make.physics.contact.selfcontact.squeezed import squeezed
from tests.physics.contact.selfcontact.rig import SOLVERS, run, said, thrown
from tests.physics.contact.selfcontact.rig import crossed as intersections

wp.init()
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")


@pytest.mark.parametrize("solver", ["xpbd", "explicit"])
def test_a_cloth_on_a_spike_is_that_of_the_cpu(solver):
    sims = [run(dropped(spike(), turning(2, 1.0), solver=solver), device) for device in ("cpu", "cuda:0")]
    for frame in range(12):
        for sim in sims:
            sim.step()
            assert crossed(sim) == 0
        if frame < 4:
            np.testing.assert_allclose(*(sim.positions("/cloth") for sim in sims), rtol=0.0, atol=1e-4)
    assert said(sims[1])["near_pairs"] > 0 and said(sims[1])["held"] == 0


def test_results_are_the_same_from_run_to_run():
    found = []
    for _ in range(2):
        sim = run(dropped(spike(), turning(2, 1.0)), "cuda:0")
        sim.run(10)
        found.append(sim.positions("/cloth"))
    assert np.array_equal(*found)


@pytest.mark.parametrize("solver", ["newton", "xpbd", "newton bdf2", "newton midpoint"])
def test_a_light_sheet_between_heavy_ones_is_not_cut(solver):
    """Sweeps that go on within a graph, as many as they need. Tight steps of the midpoint may leave a pair to a projection."""
    few, found = 4 * (solver == "newton midpoint"), []
    for _ in range(2):
        sim = run(squeezed(**SOLVERS[solver]), "cuda:0")
        sim.run(3)
        told = said(sim)
        assert told["cut"] == told["held"] == 0 and told["projected"] <= few, told
        found.append(np.concatenate([sim.positions(b.path) for b in sim.model.bodies]))
    assert np.array_equal(*found) and np.isfinite(found[0]).all()


@pytest.mark.parametrize("solver", ["newton", "newton bdf2", "xpbd"])
def test_sheets_that_meet_within_a_substep_are_not_cut(solver):
    """Lists that are made within the loop of projections, a condition within a condition of a graph."""
    found = []
    for _ in range(2):
        sim = run(thrown(2, **{**SOLVERS[solver], "substeps": 12, "iterations": 2}), "cuda:0")
        sim.run(2)
        told = said(sim)
        assert intersections(sim) == told["cut"] == told["held"] == 0 and told["projected"] > 0, told
        found.append(np.concatenate([sim.positions(b.path) for b in sim.model.bodies]))
    assert np.array_equal(*found)
