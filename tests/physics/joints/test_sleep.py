"""Sleep over joints: islands that joints make, what wakes them, and that joints of those that sleep do nothing."""

import numpy as np
import pytest

from tests.make.physics.joints.sleep import DAMPED, chain, sleepy
from tests.make.physics.rigid.contact import G, Seen, ball, box
from tests.make.physics.rigid.solver.sleep import asleep
from tests.physics.joints.make import coordinates, places, rod, start
from wsim.physics.rigid import forms
from wsim.physics.rigid.joints.joint import Drive, revolute_joint, spherical_joint
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation


def arm(drive: Drive, **more) -> list:
    """A box on a driven hinge of the world about z, its centre 0.3 m from it."""
    own = box("/arm", (0.3, 2.0, 0.0), (0.25, 0.05, 0.05), mass=1.0)
    return [own, revolute_joint("/hinge", None, own, at=(0.0, 2.0, 0.0), axis=(0.0, 0.0, 1.0), drives={"rotX": drive}, **more)]


@pytest.fixture(params=("listed", "coloured"))
def form(request, monkeypatch):
    monkeypatch.setattr(forms, "choose_pass_form", lambda device, shapes: forms.ContactPassForm(request.param))


def test_a_damped_chain_sleeps_hanging_straight_and_a_thrown_ball_wakes_all_of_it_and_no_other(form):
    thrown = ball("/ball", (-3.0, 2.0, 0.0), 0.1, asleep=True, drag=1.0)
    sim = sleepy(*chain("a", velocity=(0.5, 0.0, 0.0)), *chain("b", 20.0), thrown)
    sim.run(20)
    assert not asleep(sim)["/a0"]
    sim.run(280)
    assert all(asleep(sim).values()) and not Seen(sim).v.any()
    seen = Seen(sim)
    assert max(abs(seen.at(f"/a{k}") - (0.0, 2.8 - 0.4 * k, 0.0)).max() for k in range(3)) < 0.02
    before = sim.plan.method("rigid").poses()
    sim.set("/ball", "velocity", (10.0, 1.47, 0.0))
    sim.run(12)
    now = sim.plan.method("rigid").poses()
    assert not asleep(sim)["/ball"] and asleep(sim)["/a0"] and np.array_equal(now[:6], before[:6]) and not Seen(sim).v[:6].any()
    sim.run(12)
    state = asleep(sim)
    assert not any(state[f"/a{k}"] for k in range(3)) and all(state[f"/b{k}"] for k in range(3))
    assert Seen(sim).speed("/a2")[0] > 0.1 and abs(Seen(sim).speed("/a0")[0]) > 1e-3
    sim.run(400)
    assert all(asleep(sim).values())


def test_a_driven_hinge_is_awake_while_its_target_moves_and_sleeps_behind_it(form):
    """The target goes 0.12 rad/s: the arm is slower than the speed at which others fall asleep."""
    sim = sleepy(*arm(Drive(400.0, 16.0)), speed=0.5)
    sim.run(60)
    assert all(asleep(sim).values())
    angle = float(coordinates(sim)[0, 3])
    for k in range(90):
        sim.set("/hinge", "target", 0.002 * (k + 1))
        sim.step()
        assert not asleep(sim)["/arm"] and asleep(sim)["/far/box"]
    assert abs(coordinates(sim)[0, 3] - angle - 0.18) < 0.02
    sim.run(60)
    rests = float(coordinates(sim)[0, 3])
    assert abs(400.0 * (0.18 - rests) - 0.3 * G * np.cos(rests)) < 1e-3          # the spring bears the weight
    assert asleep(sim)["/arm"]
    sim.set("/hinge", "target", 0.18)
    sim.run(2)
    assert asleep(sim)["/arm"]                                      # the same target is none that moves


def test_a_sleeping_arm_that_a_spring_bears_does_not_move_while_others_do(form):
    sim = sleepy(*arm(Drive(400.0, 40.0)), ball("/ball", (9.0, 60.0, 0.0)))
    sim.run(90)
    before = sim.plan.method("rigid").poses()[0]
    assert asleep(sim)["/arm"] and not asleep(sim)["/ball"]
    sim.run(30)
    assert np.array_equal(sim.plan.method("rigid").poses()[0], before) and not Seen(sim).v[0].any() and not Seen(sim).w[0].any()


def test_a_drive_with_a_speed_keeps_its_island_awake(form):
    sim = sleepy(*arm(Drive(0.0, 1e4, speed=0.1)), speed=0.5)
    sim.run(120)
    assert not asleep(sim)["/arm"] and asleep(sim)["/far/box"]
    assert abs(coordinates(sim)[0, 3] - 0.2) < 1e-2


def test_what_a_joint_hangs_on_wakes_it_when_it_moves(form):
    times, frames = np.array([0.0, 2.0, 4.0]), np.tile(np.eye(4), (3, 1, 1))
    frames[2, 0, 3] = 0.4                                            # 0.2 m/s from 2 s on
    own = box("/box", (0.0, 2.0, 0.0), (0.1, 0.1, 0.1), **DAMPED)
    sim = sleepy(own, spherical_joint("/j", None, own, at=(0.0, 2.5, 0.0), motion=Motion(times, frames)), speed=0.5)
    sim.run(115)
    assert all(asleep(sim).values())
    for _ in range(120):
        sim.step()
        assert not asleep(sim)["/box"] or sim.frame <= 120
    assert abs(Seen(sim).at("/box")[0] - 0.4) < 0.1
    sim.run(60)
    assert asleep(sim)["/box"]


def test_joints_that_meet_nothing_sleep_and_wake_too():
    def rods(**more):
        own = [rod(f"/r{k}", (0.0, -0.5 - k, 0.0), **DAMPED, **(more if k == 2 else {})) for k in range(3)]
        lone = rod("/lone", (5.0, 0.0, 0.0), velocity=(0.01, 0.0, 0.0))
        joints = [spherical_joint(f"/j{k}", own[k - 1] if k else None, own[k], at=(0.0, -float(k), 0.0)) for k in range(3)]
        return *own, lone, *joints
    sim = start(*rods(velocity=(0.3, 0.0, 0.0)), sleep_speed=0.02)
    sim.run(300)
    assert [asleep(sim)[f"/r{k}"] for k in range(3)] == [True] * 3 and not asleep(sim)["/lone"]
    before = places(sim)
    sim.run(30)
    assert np.array_equal(places(sim)[:3], before[:3]) and np.abs(before[:3, 0]).max() < 0.05
    sim.set("/r0", "velocity", (1.0, 0.0, 0.0))
    sim.run(10)
    assert not any(asleep(sim)[f"/r{k}"] for k in range(3)) and np.abs(places(sim)[:3] - before[:3]).max() > 0.01


def test_a_chain_that_slept_goes_on_as_one_that_never_did(form):
    """But for what sleep took of the speed."""
    def swung(speed: float) -> np.ndarray:
        sim = sleepy(*chain("a"), speed=speed)
        sim.run(60)
        assert speed == 0.0 or asleep(sim)["/a0"]
        sim.set("/a2", "velocity", (1.0, 0.0, 0.0))
        sim.run(20)
        return np.array([Seen(sim).at(f"/a{k}") for k in range(3)])
    assert np.abs(swung(0.05) - swung(0.0)).max() < 1e-6


def test_many_launches_give_the_bits_of_one_and_a_restart_those_of_a_run(monkeypatch):
    def made(name: str) -> Simulation:
        monkeypatch.setattr(forms, "choose_pass_form", lambda device, shapes: forms.form_by_name(name, device))
        return sleepy(*chain("a"), ball("/ball", (0.1, 9.0, 0.0), 0.3))

    def ends(sim: Simulation) -> bytes:
        return b"".join(a.numpy().tobytes() for a in sim.plan.method("rigid").part.arrays.values())
    whole, half, other, many = made("coloured"), made("coloured"), made("coloured"), made("launches")
    for sim in (whole, many):
        sim.run(80)
    half.run(50)
    assert asleep(half)["/a0"] and not asleep(half)["/ball"] and not asleep(whole)["/a0"]
    other.restart(50, {path: half.fields(path) for path in half.state.paths()})
    other.run(30)
    assert ends(other) == ends(whole) == ends(many)
