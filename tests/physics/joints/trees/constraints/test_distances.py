"""Distances in reduced coordinates: strings and rods against closed forms, maximal coordinates, momentum."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest

import wsim
from tests.physics.joints.trees.chains import body_frames, chain_scene, trees_of
from wsim import Box, Motion, Plane, Scene, Sphere
from wsim.cli.run import prepare_recorded_run
from wsim.physics.rigid.joints.joint import Drive, Joint

G = 9.81
CPU = {"device": "cpu", "precision": "float64"}


def tied_ball(low=-inf, high=1.0, at=(1.0, 0.0, 0.0), coordinates="reduced", substeps=4, floor=False, **more) -> Scene:
    """A ball of 1 kg on a string from the origin."""
    scene = Scene(fps=60, substeps=substeps, coordinates=coordinates)
    ball = scene.body("/ball", Sphere(0.1), at=at, mass=1.0)
    ball.colliders[0].meets = floor
    if floor:
        scene.collider("/floor", Plane(), at=(0, -5, 0))
    scene.add(Joint("/string", "", "/ball", limits={"distance": (low, high)}, **more))
    return scene


def run(scene, frames, **more):
    simulation = wsim.Simulation(scene, **(CPU | more))
    simulation.run(frames)
    return simulation


def energy(simulation) -> float:
    return trees_of(simulation)[0].indicators(None, None)["rigid_energy"]


def pendulum(seconds: float) -> np.ndarray:
    """Place of a point on a string of 1 m, let go level along x: phi'' = -G sin(phi) from pi / 2, by RK4 at 1e-4 s."""
    y, h = np.array([np.pi / 2, 0.0]), 1e-4

    def rate(y):
        return np.array([y[1], -G * np.sin(y[0])])
    for _ in range(round(seconds / h)):
        a = rate(y)
        b = rate(y + 0.5 * h * a)
        c = rate(y + 0.5 * h * b)
        y = y + h / 6.0 * (a + 2.0 * b + 2.0 * c + rate(y + h * c))
    return np.array([np.sin(y[0]), -np.cos(y[0]), 0.0])


@pytest.mark.parametrize("low, order, best", [(-inf, 2.0, 3e-5), (1.0, 4.0, 1e-7)])
def test_a_pendulum_on_a_taut_string_and_on_a_rod_converges_to_the_closed_form(low, order, best):
    off = []
    for substeps in (2, 4, 8):
        simulation = run(tied_ball(low, substeps=substeps), 90)
        place = simulation.poses()["/ball"][:3, 3]
        assert abs(np.linalg.norm(place) - 1.0) < 1e-11
        off.append(np.linalg.norm(place - pendulum(1.5)))
    assert off[-1] < best and abs(np.log2(off[0] / off[1]) - order) < 0.5


def test_a_taut_string_beside_contacts_has_order_two_and_its_length_to_the_square_of_the_step():
    for substeps, most in ((4, 1e-5), (16, 1e-7)):
        place = run(tied_ball(substeps=substeps, floor=True), 90).poses()["/ball"][:3, 3]
        assert abs(np.linalg.norm(place) - 1.0) < most
        assert np.linalg.norm(place - pendulum(1.5)) < 1e-3 / substeps**2 * 16


@pytest.mark.parametrize("floor", [False, True])
def test_a_slack_string_exerts_nothing(floor):
    """A ball that falls within its string: the parabola. It then hangs at rest, after a catch without rebound."""
    simulation = run(tied_ball(at=(0.1, 0.8, 0.0), floor=floor), 12)
    t = 12 / 60
    assert np.abs(simulation.poses()["/ball"][:3, 3] - (0.1, 0.8 - 0.5 * G * t * t, 0.0)).max() < 1e-12
    simulation.run(60)
    place = simulation.poses()["/ball"][:3, 3]
    assert np.linalg.norm(place) < 1.0 + 1e-3 and place[1] < -0.8


def test_a_lower_limit_pushes_and_does_not_pull():
    """A ball on top of a rod that is at least 1 m long stays there; one that flies up goes on."""
    scene = tied_ball(low=1.0, high=inf, at=(0.0, 1.0, 0.0))
    assert np.abs(run(scene, 30).poses()["/ball"][:3, 3] - (0, 1, 0)).max() < 1e-9
    scene.things("Body")[0].velocity[1] = 2.0
    t = 20 / 60
    assert abs(run(scene, 20).poses()["/ball"][1, 3] - (1.0 + 2.0 * t - 0.5 * G * t * t)) < 1e-9


@pytest.mark.parametrize("floor", [False, True])
def test_two_bodies_on_a_string_turn_about_their_centre_and_keep_momentum(floor):
    """Masses 1 and 3 kg, 0.8 m apart, taut, at w = 5 rad/s in free flight: the string keeps them on circles."""
    scene = Scene(fps=60, substeps=4, coordinates="reduced", gravity=(0, 0, 0))
    if floor:
        scene.collider("/floor", Plane(), at=(0, -50, 0))
    for path, x, mass in (("/a", 0.6, 1.0), ("/b", -0.2, 3.0)):
        scene.body(path, Sphere(0.05), at=(x, 0, 0), mass=mass, velocity=(1.0, 0.0, 5.0 * x)).colliders[0].meets = floor
    scene.add(Joint("/string", "/a", "/b", limits={"distance": (-inf, 0.8)}))
    simulation = run(scene, 60)
    x, _, v, _ = body_frames(simulation)
    assert np.abs(v[0] + 3.0 * v[1] - (4.0, 0, 0)).max() < 1e-11
    assert np.abs(x[0] + 3.0 * x[1] - (4.0, 0, 0)).max() < 1e-10
    assert abs(np.linalg.norm(x[0] - x[1]) - 0.8) < (1e-5 if floor else 1e-11)
    spin = np.cross(x[0] - x[1], v[0] - v[1])[1] / 0.64
    assert abs(spin + 5.0) < (2e-4 if floor else 1e-10)


def test_strings_beside_joints_do_as_in_maximal_coordinates():
    """A chain of two boxes, and a box on a string from its end, let go level: both coordinates, extrapolated."""
    def fall(coordinates, substeps):
        scene = chain_scene(["spherical", "revolute"], coordinates=coordinates, substeps=substeps)
        weight = scene.body("/w", Box((0.1, 0.1, 0.1)), at=(1.5, 0.0, 0.2), density=100.0)
        weight.colliders[0].meets = False
        scene.add(Joint("/s", "/b1", "/w", at0=(0.25, 0, 0), at1=(0.0, 0.1, 0.0), limits={"distance": (0.2, 0.6)}))
        simulation = wsim.Simulation(scene, **CPU)
        simulation.run(20)
        return simulation.poses()["/w"][:3, 3]
    ends = [[fall(how, n) for n in (16, 32)] for how in ("reduced", "maximal")]
    one, other = (fine + (fine - coarse) / 3.0 for coarse, fine in ends)
    assert np.linalg.norm(one - other) < 5e-4


def test_a_string_goes_with_a_cart_that_keyframes_move():
    """A cart of constant speed: in its frame the pendulum is that of one at rest."""
    scene = Scene(fps=60, substeps=4, coordinates="reduced")
    scene.collider("/cart", Box((0.1, 0.1, 0.1)), motion=Motion.through([0.0, 2.0], [(0, 0, 0), (3.0, 0, 0)]))
    ball = scene.body("/ball", Sphere(0.1), at=(1.0, 0, 0), mass=1.0, velocity=(1.5, 0, 0))
    ball.colliders[0].meets = False
    motion = scene.colliders[0].motion
    scene.add(Joint("/string", "", "/ball", limits={"distance": (-inf, 1.0)}, motion=motion, still="/cart"))
    place = run(scene, 60).poses()["/ball"][:3, 3]
    assert np.abs(place - (1.5, 0, 0) - pendulum(1.0)).max() < 2e-4


@pytest.mark.parametrize("floor", [False, True])
def test_a_string_snaps_at_its_force(floor):
    """A ball on a string, let go level: the string bears 3 m g sin(a) at an angle a below the level."""
    scene = replace(tied_ball(force=3.0 * G * np.sin(0.7), substeps=1, floor=floor), fps=480)
    simulation = wsim.Simulation(scene, **CPU)
    frame = 0
    simulation.load()
    while not trees_of(simulation)[1].linked.broken.numpy().any() and frame < 400:
        simulation.step()
        frame += 1
    x, _, v, _ = body_frames(simulation)
    assert 0.0 < np.arctan2(-x[0, 1], x[0, 0]) - 0.7 < 2.5 * np.sqrt(2.0 * G * np.sin(0.7)) / 480
    simulation.run(48)
    assert np.abs(body_frames(simulation)[0][0] - (x[0] + 0.1 * v[0] - (0, 0.5 * G * 0.01, 0))).max() < 1e-9


def test_a_ball_on_a_string_rests_on_a_floor_and_hits_it():
    scene = tied_ball(high=5.5, at=(0.0, -4.5, 0.0), floor=True)
    simulation = run(scene, 90)
    assert abs(simulation.poses()["/ball"][1, 3] + 4.9) < 1e-3


def test_worlds_and_restarts_have_the_bits_of_one_run(tmp_path):
    scene = tied_ball(at=(0.5, 0.2, 0.1))
    one, many = run(scene, 40), run(scene, 40, worlds=3)
    x = trees_of(many)[0].get("x").reshape(3, -1, 3)
    assert all(np.array_equal(x[w], trees_of(one)[0].get("x")) for w in range(3))
    wsim.save(scene, tmp_path / "s.usda")

    def record(output: str, frames: int, restart: str | None = None):
        job = prepare_recorded_run(replace(wsim.load(tmp_path / "s.usda"), frames=frames), output,
                                   lambda s: wsim.Simulation(s, **CPU), restart=restart)
        job.frames()
        return job.simulation
    whole = record(str(tmp_path / "whole.usdc"), 40)
    record(str(tmp_path / "half.usdc"), 25)
    again = record(str(tmp_path / "again.usdc"), 40, str(tmp_path / "half.usdc"))
    assert np.array_equal(whole.poses()["/ball"], again.poses()["/ball"])


def test_a_drive_along_a_distance_is_refused_by_one_line():
    scene = tied_ball()
    scene.things("Joint")[0].drives = {"distance": Drive(10.0)}
    with pytest.raises(wsim.SceneError, match="/string: it has a drive along a distance"):
        wsim.Simulation(scene, device="cpu")
