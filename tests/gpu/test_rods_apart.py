"""Substeps in a launch for each part of an iteration beside those in one launch, on a GPU."""

import numpy as np
import pytest
import warp as wp

from tests.physics.rods.rig import scene
from wsim.physics.rods import method
from wsim.scene import Sphere
from wsim.simulation.simulation import Simulation

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")


def fallen(monkeypatch, apart: bool, air: bool):
    """Strands of 14, 9 and 2 points, the first held, that fall on a ball."""
    monkeypatch.setattr(method, "APART", apart)
    x = np.zeros((25, 3))
    x[:14, 0], x[:14, 1] = np.linspace(-0.1, 0.4, 14), 0.28
    x[14:23, 0], x[14:, 1], x[14:, 2] = np.linspace(-0.2, 0.2, 9), 0.3, 0.05
    x[23:, 0], x[23:, 2] = (0.0, 0.05), 0.1
    made, rods = scene(x, gravity=(0.0, -9.81, 0.0), young=1e6, drag=2.0 * air, skin_drag=0.1 * air)
    rods.counts = np.array([14, 9, 2], np.int32)
    made.wind = (0.0, 0.0, 3.0)
    rods.pin("/clamp", [0, 1])
    made.collider("/ball", Sphere(0.25))
    simulation = Simulation(made, device="cuda:0")
    found = []
    for _ in range(10):
        simulation.step()
        rods = simulation.plan.method("rods")
        found.append((*rods.points(0), rods.said.numpy().copy(), rods.part.arrays["load"].numpy().max()))
    assert max(load for *_, load in found) > 0.0                                # the ball is met
    return found


@pytest.mark.parametrize("air", [False, True])
def test_each_way_ends_where_the_other_does(monkeypatch, air):
    one, other = fallen(monkeypatch, False, air), fallen(monkeypatch, True, air)
    for (x, v, said, _), (y, w, told, _) in zip(one, other, strict=True):
        assert np.abs(x - y).max() < 1e-9 and np.abs(v - w).max() < 1e-6
        assert np.array_equal(said[:, 0], told[:, 0])                           # iterations
        assert said[:, 2] == pytest.approx(told[:, 2], abs=1e-9)
    again = fallen(monkeypatch, True, air)
    assert all(np.array_equal(a[0], b[0]) and np.array_equal(a[1], b[1]) for a, b in zip(other, again, strict=True))
