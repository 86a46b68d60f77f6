"""On a GPU: bodies under points of cloth, in a captured frame: as on a CPU, twice the same bits. Skipped without a device."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.contact.selfcontact.modules import swept
from tests.make.physics.rigid.contact import ball, box
from tests.make.physics.rigid.touch.blows import FREE, by
from tests.physics.rigid.touch.touching import Mixed, run, scene

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a GPU")


@pytest.mark.parametrize("way", ["xpbd", "xpbd bdf2", "leapfrog", "newton"])
def test_frames_are_those_of_a_cpu_twice_the_same_bits_and_keep_momentum(way):
    ends = []
    for device in ("cpu", "cuda:0", "cuda:0"):
        one = ball("/ball", (0.03, 0.16, 0.02), 0.15, velocity=(0.0, -2.0, 0.3), mass=0.1, rest=0.3)
        sim = run(scene(one, box("/box", (-0.3, -0.2, 0.0), (0.1, 0.1, 0.1), velocity=(0.0, 1.0, 0.0), mass=0.3), gravity=FREE,
                        **by(way)), device=device, precision="float64")
        before = Mixed(sim).momentum
        sim.run(8)
        assert np.abs(Mixed(sim).momentum - before).max() < 1e-11
        ends.append((sim.positions("/sheet"), sim.plan.method("rigid").poses()))
    for cpu, once, again in zip(*ends, strict=True):
        assert np.array_equal(once, again)
        assert np.abs(cpu - once).max() < 1e-6


def test_a_ball_rests_in_a_sheet():
    one = ball("/ball", (0.013, 0.2, 0.008), 0.15, mass=2.0, drag=3.0, spin_drag=3.0)
    sim = run(scene(one, pinned=True, stretch=2e4, damping=2e-3, n=17, air_drag=2.0), device="cuda:0")
    sim.run(380)
    assert Mixed(sim).fastest < 1e-3


@pytest.mark.parametrize("name, many", [("xpbd", True), ("leapfrog", False)])
def test_sweeps_in_one_launch_have_the_bits_of_many(name, many, monkeypatch):
    """Blocks that meet within a launch, beside a launch for each part of a sweep. These project contacts of points that no pair
    moves as well, which by leapfrog changes nothing."""
    found = [swept(name, together, "cuda:0", monkeypatch) for together in (True, many, True)]
    assert all(np.array_equal(found[0], other) for other in found[1:])
