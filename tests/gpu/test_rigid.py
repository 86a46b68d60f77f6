"""Rigid bodies on a GPU: they stand, bounce and throw as on a CPU, and the same to the bit from run to run."""

import numpy as np
import pytest
import warp as wp

from tests.physics.rigid.test_contact import Seen, ball, box, world

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a GPU")


def ends(device: str, frames: int, precision: str = "float64") -> tuple[np.ndarray, bytes]:
    bodies = [box(f"/box{k}", (0.02 * k, 0.55 + 1.05 * k, 0.0)) for k in range(5)]
    sim = world(*bodies, ball("/ball", (5.0, 1.5, 0.0), rest=0.8), device=device, precision=precision)
    sim.run(frames)
    method = sim.plan.method("rigid")
    return Seen(sim).poses, b"".join(method.part.arrays[name].numpy().tobytes() for name in ("x", "q", "p", "L"))


def test_a_few_frames_are_those_of_a_cpu():
    """Until blows amplify what rounding left."""
    assert np.abs(ends("cuda:0", 12)[0] - ends("cpu", 12)[0]).max() < 1e-9


def test_runs_are_the_same_to_the_bit():
    assert ends("cuda:0", 60, "float32")[1] == ends("cuda:0", 60, "float32")[1]


def test_a_column_stands():
    sim = world(*[box(f"/box{k}", (0.0, 0.5 + k, 0.0)) for k in range(10)], device="cuda:0", precision="float32")
    sim.run(600)
    assert 9.5 - Seen(sim).at("/box9")[1] < 3e-3 and np.abs(Seen(sim).v).max() < 1e-3
