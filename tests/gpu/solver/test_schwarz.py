"""Solves by domains on a GPU: what a CPU finds, and the same to the bit from run to run."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.solver.schwarz.schwarz import sheet
from wsim.physics.solver.schwarz import solver
from wsim.simulation.simulation import Simulation

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")


def end(device: str, precision: str) -> np.ndarray:
    sim = Simulation(sheet(40, iterations=8), device=device, precision=precision)
    sim.run(3)
    return sim.positions("/cloth")


@pytest.mark.parametrize("precision, apart", [("float64", 1e-6), ("float32", 1e-3)])
def test_newtons_steps_are_those_of_a_cpu(precision, apart, monkeypatch):
    monkeypatch.setattr(solver, "PAYS", dict.fromkeys(solver.PAYS, (0, 0.0)))             # for any sheet, on any device
    one = end("cuda:0", precision)
    assert np.array_equal(one, end("cuda:0", precision))
    assert np.abs(one - end("cpu", precision)).max() < apart
