"""Joints on a GPU: as on a CPU, in every form of launches, and the same to the bit from run to run."""

import numpy as np
import pytest
import warp as wp

from tests.make.gradient.rigid.joints import LAST, SCENES, seeds
from tests.make.physics.joints.aims import slider
from tests.make.physics.joints.beside import run
from tests.make.physics.joints.islands import chain
from tests.make.physics.joints.sleep import chain as hanging
from tests.make.physics.joints.sleep import sleepy
from tests.make.physics.rigid.contact import Seen, ball
from tests.make.physics.rigid.solver.sleep import asleep
from tests.physics.joints.make import coordinates, errors, rod, start
from wsim.gradient.recording import Recording
from wsim.physics.rigid.joints.joint import AXES, Drive, joint_between, revolute_joint
from wsim.simulation.simulation import Simulation

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


def test_drives_follow_curves_within_frames_as_on_a_cpu():
    ends = []
    for device in ("cpu", "cuda:0"):
        sim = Simulation(slider(fps=10.0, substeps=16), device=device, precision="float64")
        sim.run(5)
        rigid = sim.plan.method("rigid")
        ends.append((rigid.poses()[0, 0, 3], rigid.velocities()[0, 0]))
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-12)


def test_a_thousand_pendulums_swing_alike():
    body = rod("/b", (1.0, 0.0, 0.0))
    joint = revolute_joint("/j", None, body, axis=(0.0, 0.0, 1.0))
    many, one = (start(body, joint, device=device, worlds=n) for device, n in (("cuda:0", 1000), ("cpu", 1)))
    many.run(30)
    one.run(30)
    x = many.plan.method("rigid").get("x")
    assert np.array_equal(x, np.tile(x[0], (1000, 1))) and np.abs(x[0] - one.plan.method("rigid").get("x")[0]).max() < 1e-9


def test_limits_met_together_and_a_drive_of_bounded_force_are_those_of_a_cpu():
    """A rod thrown into three narrow limits, one of them with a drive that gives all that it has."""
    ends = []
    for device in ("cpu", "cuda:0", "cuda:0"):
        thrown = {"velocity": (0.3, -0.5, 0.4), "spin": (2.0, -3.0, 4.0)}
        body = rod("/b", (0.4, 0.1, 0.2), mass=2.0, moments=(0.03, 0.05, 0.02), **thrown)
        limits = {name: (0.0, 0.0) for name in AXES} | {name: (-1e-3, 1e-3) for name in AXES[3:]}
        joint = joint_between("/j", None, body, at=(0.1, 0.2, -0.1), limits=limits,
                              drives={"rotX": Drive(50.0, 1.0, 0.2, most=2.0)})
        sim = start(body, joint, device=device, gravity=(1.0, -9.81, 3.0))
        for _ in range(30):
            sim.step()
            assert np.abs(coordinates(sim)[0, 3:]).max() < 1e-3 + 1e-9 and max(errors(sim)) < 1e-9
        ends.append(sim.plan.method("rigid").poses())
    assert np.array_equal(ends[1], ends[2]) and np.abs(ends[0] - ends[1]).max() < 1e-9


def test_a_chain_sleeps_and_a_ball_wakes_all_of_it_and_no_other():
    """The chain of tests/physics/joints/test_sleep.py sleeps on a GPU too."""
    thrown = ball("/ball", (-3.0, 2.0, 0.0), 0.1, asleep=True, drag=1.0)
    sim = sleepy(*hanging("a", velocity=(0.5, 0.0, 0.0)), *hanging("b", 20.0), thrown, device="cuda:0")
    sim.run(300)
    assert all(asleep(sim).values()) and not Seen(sim).v.any()
    sim.set("/ball", "velocity", (10.0, 1.47, 0.0))
    sim.run(30)
    now = asleep(sim)
    assert not now["/ball"] and not now["/a0"] and not now["/a2"] and now["/b0"] and now["/b2"]


@pytest.mark.parametrize("kind", ["driven", "limits"])
def test_gradients_are_those_of_a_cpu(kind):
    """In float64: by a velocity, by gravity, by a drive."""
    poses, twists = seeds()
    ends = []
    for device in ("cpu", "cuda:0"):
        r = Recording(Simulation(SCENES[kind](), device=device, precision="float64", gradients=True), LAST)
        r.run()
        found = r.backward(poses=poses, twists=twists)
        drive = [found.value("/second", "stiffness")] if kind == "driven" else []
        ends.append(np.concatenate([found.value("/a", "velocity"), found.gravity(), drive]))
    assert np.abs(ends[0] - ends[1]).max() < 1e-8 * np.abs(ends[0]).max() and np.abs(ends[0]).min() > 0.0
