"""On a GPU: pairs of carriers, sorted, coloured and walked in a captured frame. Skipped where there is no device."""

import numpy as np
import pytest
import warp as wp

from tests.make.balls import ROW, method
from tests.physics.carrier.test_balls import momentum, thrown
from wsim.scene import methods
from wsim.simulation.simulation import Simulation

wp.init()
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")


@pytest.fixture(autouse=True)
def row(monkeypatch):
    monkeypatch.setattr(methods, "METHODS", [*methods.METHODS, ROW])
    for module in ("wsim.simulation.plan", "wsim.simulation.methods"):
        monkeypatch.setattr(f"{module}.METHODS", methods.METHODS)


@pytest.mark.parametrize("warm", [False, True])
@pytest.mark.parametrize("scheme", [("xpbd", "bdf2", 8), ("explicit", "leapfrog", 1), ("implicit", "backward_euler", 1)],
                         ids=lambda scheme: scheme[0])
def test_frames_are_those_of_the_cpu_twice_the_same_bits_and_keep_momentum(scheme, warm, monkeypatch):
    """Pairs are found in another order there: keys give the order, and colours no atomic to the sums. With a frame that is
    repeated, since there was room for 8 pairs."""
    monkeypatch.setattr(method, "WARM", warm)
    ends = []
    for device in ("cpu", "cuda:0", "cuda:0"):
        sim = Simulation(thrown(*scheme, friction=(0.5, 0.4), restitution=0.3), precision="float64", device=device)
        before = momentum(sim).sum(axis=0)
        sim.run(8)
        assert np.abs(momentum(sim).sum(axis=0) - before).max() < 1e-12
        assert scheme[0] == "explicit" or any("pairs were in contact" in w for w in sim.repeats)       # 8 are enough there
        ends.append((sim.positions(), sim.state.parts["balls"].arrays["x"].numpy()))
    for cpu, once, again in zip(*ends, strict=True):
        assert np.array_equal(once, again)
        assert np.abs(cpu - once).max() < 1e-6
