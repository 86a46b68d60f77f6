"""Joints on a GPU: as on a CPU, in every form of launches, and the same to the bit from run to run."""

import numpy as np
import pytest
import warp as wp

from tests.physics.joints.make import errors, rod, start
from tests.physics.joints.test_beside import run
from tests.physics.joints.test_islands import chain
from wsim.physics.rigid.joints.joint import revolute

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a GPU")


@pytest.mark.parametrize("name", ["block", "cluster", "launches"])
def test_walkers_are_those_of_a_cpu_in_every_form(name, monkeypatch):
    one, other = run("coloured", "cpu", monkeypatch, 20), run(name, "cuda:0", monkeypatch, 20)
    assert np.abs(one.poses() - other.poses()).max() < 1e-6


def test_walkers_fall_the_same_to_the_bit_from_run_to_run(monkeypatch):
    one, other = (run("block", "cuda:0", monkeypatch, 60) for _ in range(2))
    assert all(np.array_equal(one.get(name), other.get(name)) for name in ("x", "q", "p", "L"))


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_chain_with_a_heavy_end_stays_closed(precision):
    sim = chain(100.0, precision=precision, device="cuda:0")
    sim.run(100)
    assert errors(sim)[0] < 1e-6


def test_a_thousand_pendulums_swing_alike():
    body = rod("/b", (1.0, 0.0, 0.0))
    joint = revolute("/j", None, body, axis=(0.0, 0.0, 1.0))
    many, one = (start(body, joint, device=device, worlds=n) for device, n in (("cuda:0", 1000), ("cpu", 1)))
    many.run(30)
    one.run(30)
    x = many.plan.method("rigid").get("x")
    assert np.array_equal(x, np.tile(x[0], (1000, 1))) and np.abs(x[0] - one.plan.method("rigid").get("x")[0]).max() < 1e-9
