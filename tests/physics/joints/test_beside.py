"""Joints beside contacts, in every form of launches, and beside points."""

import numpy as np
import pytest

import wsim
from tests.make.physics.joints.beside import link, run
from tests.physics.joints.make import errors, places, rod
from wsim.physics.rigid.joints.joint import fixed_joint, spherical_joint
from wsim.scene import Capsule, Scene, Sphere, shapes
from wsim.simulation.simulation import Simulation


def test_islands_and_contacts_of_many_launches_give_the_bits_of_one(monkeypatch):
    one, other = run("coloured", "cpu", monkeypatch), run("launches", "cpu", monkeypatch)
    for name in ("x", "q", "p", "L"):
        assert np.array_equal(one.get(name), other.get(name)), name


def test_bodies_of_a_joint_pass_through_each_other_unless_it_says_that_they_collide():
    """Two balls within each other on a hinge between them."""
    spins = []
    for collides in (False, True):
        scene = Scene(fps=60, substeps=8, gravity=(0.0, 0.0, 0.0))
        balls = [scene.add(link(f"/b{k}", (0.15 * k, 0.0, 0.0), Sphere(0.1))) for k in (0, 1)]
        scene.add(spherical_joint("/j", *balls, at=(0.075, 0.0, 0.0), collides=collides))
        sim = Simulation(scene, device="cpu")
        sim.run(2)
        spins.append(sim.plan.method("rigid").indicators(None, None)["rigid_overlap"])
    assert spins[0] == 0.0 and spins[1] > 0.01


def test_a_chain_lies_on_a_sheet_and_its_joints_stay_closed():
    scene = Scene(fps=24, substeps=20)
    sheet = scene.cloth("/sheet", *shapes.sheet(1.0, 1.0, 8, 8))
    scene.pin("/pin", sheet, [0, 8, 72, 80])
    bodies = [scene.add(link(f"/b{k}", (0.2 * k - 0.2, 0.2, 0.0), Capsule(0.05, 0.05), density=200.0)) for k in range(3)]
    scene.add(spherical_joint("/j0", bodies[0], bodies[1], at=(-0.1, 0.2, 0.0)))
    scene.add(fixed_joint("/j1", bodies[1], bodies[2], at=(0.1, 0.2, 0.0)))
    sim = Simulation(scene, device="cpu")
    worst = 0.0
    for _ in range(24):
        sim.step()
        worst = max(worst, *errors(sim))
    assert worst < 1e-6 and np.isfinite(sim.positions("/sheet")).all()
    assert sim.positions("/sheet")[:, 1].min() < -0.05 and places(sim)[:, 1].min() > -0.6       # it bears them


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_joint_breaks_over_its_force_and_not_below(precision):
    """A ball of 2 kg on a thread: 19.6 N at rest."""
    ends = []
    for most in (19.0, 21.0):
        scene = Scene(fps=60, substeps=8)
        ball = scene.add(rod("/b", (0.0, -1.0, 0.0), mass=2.0))
        scene.add(spherical_joint("/j", None, ball, force=most))
        sim = Simulation(scene, device="cpu", precision=precision)
        sim.run(30)
        ends.append(places(sim)[0][1])
    assert abs(ends[0] + 1.0 + 0.5 * 9.81 * 0.25) < 0.02 and abs(ends[1] + 1.0) < 1e-6


@pytest.mark.parametrize("by_path", [False, True])
def test_a_joint_on_a_collider_goes_with_its_motion(by_path):
    scene = wsim.Scene(fps=24)
    way = wsim.Motion.through([0.0, 0.2, 0.4], [(0.1, 0.2, 0), (0.3, 0.2, 0), (0.3, 0.2, 0.2)])
    cart = scene.collider("/cart", wsim.Box((0.1, 0.05, 0.1)), motion=way)
    pole = scene.body("/pole", wsim.Box((0.02, 0.2, 0.02)), at=(0.1, 0.5, 0))
    scene.joint("revolute", "/hinge", "/cart" if by_path else cart, pole, at=(0.1, 0.3, 0), axis=(0, 0, 1))
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.run(8)
    foot = simulation.poses("/pole")["/pole"] @ [0.0, -0.2, 0.0, 1.0]
    assert np.abs(foot[:3] - (way.at(8 / 24)[:3, 3] + [0.0, 0.1, 0.0])).max() < 1e-9
