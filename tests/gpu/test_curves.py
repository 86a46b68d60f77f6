"""On a GPU: motions of every kind are those of the host, and 10k colliders on curves take at most 1 ms of host time a frame.
Skipped where there is no device."""

from time import perf_counter

import numpy as np
import pytest
import warp as wp

from tests.make.physics.contact.collider.poses import tried
from tests.make.physics.motion.carried import FRAMES, carried
from tests.make.physics.motion.fused.kernel_fusion import staged
from tests.make.scene.curve.motion import KINDS, OUTSIDE, keys, made
from tests.make.scene.curve.usd_splines import both
from wsim.model.launches import KernelLaunches
from wsim.physics.contact import poses
from wsim.scene import Collider, Sphere
from wsim.scene.curve import Curve, Motion, Part, Stack
from wsim.scene.curve.stack import SHIFT, TURN
from wsim.simulation.simulation import Simulation

wp.init()
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")


def test_motions_of_every_kind_are_those_of_the_host(monkeypatch):
    monkeypatch.setattr(poses, "HOST_MOST", 0)
    motions = [made(kind, outside, seed) for kind in KINDS for seed, outside in enumerate(OUTSIDE)]
    motions += [Stack([Part(SHIFT, both(seed, jumps=True, before=outside, after=outside)[0]), made("catmull_rom")])
                for seed, outside in enumerate(OUTSIDE)]
    motions = [m for m in motions if not m.plain]
    c = tried([Collider(f"/c{k}", Sphere(0.1), m) for k, m in enumerate(motions)], device="cuda:0")
    for time in (-7.0, -1.9, 0.37, 1.9, 3.7, 11.0):
        c.prepare(time)
        of, t = c.poses.device_rows.sampled, time + 0.5 * np.arange(8) / 7
        A, p = of.A.numpy(), of.p.numpy()
        for k, motion in enumerate(motions):
            M = motion.sampled(t)
            np.testing.assert_allclose(A[k], M[:, :3, :3], rtol=0, atol=1e-12)
            np.testing.assert_allclose(p[k], M[:, :3, 3], rtol=0, atol=1e-12)


def test_ten_thousand_colliders_on_curves_take_a_millisecond_of_the_host():
    rng, motions = np.random.default_rng(0), []
    for k in range(10_000):
        if k % 2:
            motions.append(Motion.through(*keys(k, 4), "catmull_rom", "repeat", "repeat"))
        else:
            swing = Curve([0.0, 1.0, 2.0], rng.normal(size=3), "bezier", leave=rng.normal(size=3))
            turn = Curve([0.0, 1.0, 2.0], rng.normal(size=3), "catmull_rom")
            motions.append(Stack([Part(SHIFT, swing, 0), Part(TURN, turn, 2)]))
    c = tried([Collider(f"/c{k}", Sphere(0.1), m) for k, m in enumerate(motions)], device="cuda:0")
    c.prepare(0.0)
    taken = []
    for frame in range(30):
        wp.synchronize_device("cuda:0")
        start = perf_counter()
        c.prepare(0.1 * frame)
        taken.append(perf_counter() - start)
    print(f"host {1e3 * np.median(taken):.3f} ms a frame")
    assert np.median(taken) < 1e-3


@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_explicit_steps_see_pins_on_splines(integrator):
    ends = []
    for device in ("cpu", "cuda:0"):
        sim = Simulation(carried(8, integrator, "explicit", 0.02), device=device, precision="float64")
        sim.run(FRAMES)
        ends.append(np.concatenate([sim.positions("/net"), sim.velocities("/net")]))
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-12)


def test_stages_in_one_launch_leave_the_bits(monkeypatch):
    ends = []
    for fused in (False, True):
        monkeypatch.setattr(KernelLaunches, "fuses", fused)
        sim = Simulation(staged(), device="cuda:0")
        sim.run(3)
        ends.append(np.concatenate([sim.positions("/cloth"), sim.velocities("/cloth")]))
    assert sim.model.fuser.launched > 0, sim.model.fuser.why
    assert np.array_equal(ends[0], ends[1])
