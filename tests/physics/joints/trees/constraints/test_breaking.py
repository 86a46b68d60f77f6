"""Joints that break in reduced coordinates: closed forms, momentum, maximal coordinates, restarts, worlds."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest

import wsim
from tests.physics.joints.trees.chains import body_frames, chain_scene, trees_of
from wsim import Box, Plane, Scene, Sphere
from wsim.cli.run import prepare_recorded_run
from wsim.geometry import rotation
from wsim.physics.rigid.joints.joint import Drive

G = 9.81


def weak_chain(kinds, force=inf, torque=inf, which=1, free=False, **settings) -> Scene:
    """A chain of boxes of which a joint may break."""
    scene = chain_scene(kinds, free, **settings)
    scene.things("Joint")[which].force, scene.things("Joint")[which].torque = force, torque
    return scene


def start(scene, **more):
    return wsim.Simulation(scene, **({"device": "cpu", "precision": "float64"} | more))


def run_until_broken(simulation, frames: int) -> int:
    """The frame in which a joint breaks, -1: none."""
    for frame in range(frames):
        simulation.step()
        if trees_of(simulation)[1].linked.broken.numpy().any():
            return frame
    return -1


def momenta(simulation) -> np.ndarray:
    """Momentum and angular momentum about the origin of all bodies, (6,)."""
    x, R, v, w = body_frames(simulation)
    masses = trees_of(simulation)[0].masses
    m, moments = np.array([k.mass for k in masses])[:, None], np.array([k.moments for k in masses])
    L = np.cross(x, m * v) + np.einsum("nij,nj,nkj,nk->ni", R, moments, R, w)
    return np.concatenate([(m * v).sum(axis=0), L.sum(axis=0)])


def test_a_rod_breaks_off_at_the_force_of_the_closed_form():
    """A uniform rod, let go level, on a hinge at its end: by energy, its hinge bears m g sqrt(25 sin^2 a / 4 + cos^2 a / 16) at
    an angle a below the level."""
    fps, a = 480, 0.7
    scene = Scene(fps=fps, substeps=1, coordinates="reduced")
    rod = scene.body("/rod", Box((0.5, 1e-4, 1e-4)), at=(0.5, 0, 0), mass=2.0)
    rod.colliders[0].meets = False
    force = 2.0 * G * np.sqrt(6.25 * np.sin(a)**2 + np.cos(a)**2 / 16.0)
    scene.joint("revolute", "/hinge", None, rod, axis=(0, 0, 1), force=force)                       # a number of NumPy
    simulation = start(scene)
    assert run_until_broken(simulation, fps) > 0
    x = simulation.poses()["/rod"][:3, 0]
    rate = np.sqrt(3.0 * G * np.sin(a))
    assert 0.0 < np.arctan2(-x[1], x[0]) - a < 2.0 * rate / fps                 # the mean of a substep passes it
    at, _, v, w = body_frames(simulation)
    energy = G * at[0, 1] + 0.5 * (v[0] @ v[0] + w[0] @ w[0] / 3.0 * 0.25)      # of a slender rod of 1 m, per mass
    assert abs(energy) < 1e-3 * G
    simulation.run(100)
    t = 100 / fps
    end, _, v_end, w_end = body_frames(simulation)
    assert np.abs(end[0] - (at[0] + t * v[0] - (0, 0.5 * G * t * t, 0))).max() < 1e-9
    assert np.abs(v_end[0] - v[0] + (0, G * t, 0)).max() < 1e-9 and np.abs(w_end[0] - w[0]).max() < 1e-9


@pytest.mark.parametrize("kinds, limit", [
    (("spherical", "revolute", "spherical"), {"force": 12.0}), (("revolute", "fixed", "revolute"), {"torque": 0.5}),
    (("revolute", "prismatic", "revolute"), {"torque": 0.5}), (("revolute", "spherical", "fixed"), {"force": 12.0})])
def test_parts_keep_momentum_and_angular_momentum(kinds, limit):
    """A chain that turns in free fall breaks: the parts have together what the whole had, and fly as free bodies do."""
    scene = weak_chain(kinds, free=True, gravity=(0, 0, 0), **limit)
    for k, body in enumerate(scene.things("Body")):
        body.velocity, body.spin = np.array([0.0, 3.0 * k, -1.0 * k]), np.zeros(3)
    simulation = start(scene)
    simulation.load()
    assert run_until_broken(simulation, 60) >= 0
    before = momenta(simulation)
    simulation.run(60)
    assert np.abs(momenta(simulation) - before).max() < 1e-6 * np.abs(before).max()
    assert trees_of(simulation)[1].linked.broken.numpy().sum() == 1


def test_breaking_itself_changes_no_motion():
    """The same chain with a joint that breaks and one that does not, at the end of the frame of breaking."""
    each = ("spherical", "revolute", "spherical"), ("revolute", "spherical", "revolute"), ("revolute", "fixed", "fixed")
    for kinds in each:
        weak, strong = (start(weak_chain(kinds, force, substeps=1)) for force in (13.0, inf))
        frame = run_until_broken(weak, 60)
        strong.run(frame + 1)
        assert frame >= 0
        for one, other in zip(body_frames(weak), body_frames(strong), strict=True):
            assert np.abs(one - other).max() < 1e-9


@pytest.mark.parametrize("kinds, limit", [
    (("spherical", "fixed", "revolute"), {"force": 20.0}), (("spherical", "fixed", "revolute"), {"torque": 1.5}),
    (("revolute", "spherical", "fixed"), {"force": 20.0}), (("revolute", "revolute", "spherical"), {"torque": 3.5})])
def test_a_joint_breaks_in_the_frame_in_which_it_does_in_maximal_coordinates(kinds, limit):
    one, other = (start(weak_chain(kinds, substeps=1, fps=240, coordinates=how, **limit)) for how in ("reduced", "maximal"))
    frame = run_until_broken(one, 240)
    assert frame > 0 and abs(run_until_broken(other, 240) - frame) <= 1
    one.run(60), other.run(60)
    assert np.abs(one.poses()["/b2"] - other.poses()["/b2"]).max() < 0.02


def test_what_moves_a_joint_ends_with_it():
    """A motor, a limit, dry friction and armature of a hinge that breaks: the rod behind it then keeps its angular momentum."""
    scene = weak_chain(["revolute", "revolute"], force=30.0, gravity=(0, 0, 0), coordinates="reduced")
    joint = scene.things("Joint")[1]
    joint.drives, joint.limits = {"rotX": Drive(0.0, 0.05, speed=40.0)}, joint.limits | {"rotX": (-0.5, 50.0)}
    joint.armature, joint.friction = {"rotX": 0.01}, {"rotX": 0.01}
    simulation = start(scene)
    assert run_until_broken(simulation, 120) > 0
    moments = np.array(trees_of(simulation)[0].masses[1].moments)

    def spin():
        _, R, _, w = body_frames(simulation)
        return R[1] @ (moments * (R[1].T @ w[1]))
    before = spin()
    simulation.run(30)
    assert np.linalg.norm(before) > 0.1 and np.abs(spin() - before).max() < 1e-5 * np.linalg.norm(before)


def test_a_blow_of_a_contact_breaks_a_joint_and_rest_does_not():
    """A ball drops on a shelf: 10 N at rest; the blow is more. A shelf that bears 40 N holds the ball at rest."""
    def shelf(height, force):
        scene = Scene(fps=60, substeps=8, coordinates="reduced")
        board = scene.body("/board", Box((0.2, 0.02, 0.2)), at=(0.2, 0.0, 0.0), mass=1.0)
        scene.body("/ball", Sphere(0.05), at=(0.2, 0.07 + height, 0.0), mass=1.0)
        scene.joint("fixed", "/wall", None, board, at=(0, 0, 0), force=force)
        simulation = start(scene)
        simulation.run(40)
        return bool(trees_of(simulation)[1].linked.broken.numpy().any()), simulation.poses()["/ball"][1, 3]
    assert shelf(0.0, 40.0)[0] is False and abs(shelf(0.0, 40.0)[1] - 0.07) < 1e-3
    assert shelf(0.0, 2.0 * G + 1.0)[0] is False and shelf(0.0, 2.0 * G - 1.0)[0] is True
    assert shelf(0.3, 40.0)[0] is True


def test_pieces_land_and_rest():
    scene = weak_chain(["revolute", "fixed", "revolute"], force=12.0)
    scene.collider("/floor", Plane(), at=(0, -1, 0))
    for body in scene.things("Body"):
        body.colliders[0].meets = True
    simulation = start(scene)
    simulation.run(150)
    assert trees_of(simulation)[1].linked.broken.numpy().tolist().count(1) == 1
    for path in ("/b1", "/b2"):
        assert -1.0 < simulation.poses()[path][1, 3] < -0.9
    assert np.abs(body_frames(simulation)[2][1:]).max() < 0.05


@pytest.mark.parametrize("meets", [False, True])
def test_a_restart_behind_the_break_gives_the_same_bits(tmp_path, meets):
    scene = weak_chain(["revolute", "revolute", "spherical"], force=20.0)
    if meets:
        scene.collider("/floor", Plane(), at=(0, -1, 0))
        scene.things("Body")[2].colliders[0].meets = True
    wsim.save(scene, tmp_path / "s.usda")

    def run(output: str, frames: int, restart: str | None = None):
        scene = replace(wsim.load(tmp_path / "s.usda"), frames=frames)
        job = prepare_recorded_run(scene, output, start, restart=restart)
        job.frames()
        return job.simulation
    whole = run(str(tmp_path / "whole.usdc"), 40)
    run(str(tmp_path / "half.usdc"), 25)
    again = run(str(tmp_path / "again.usdc"), 40, str(tmp_path / "half.usdc"))
    assert trees_of(whole)[1].linked.broken.numpy().any()
    for path, pose in whole.poses().items():
        assert np.array_equal(pose, again.poses()[path])


def test_reset_makes_joints_whole_and_runs_give_the_same_bits():
    simulation = start(weak_chain(["revolute", "revolute", "spherical"], force=20.0))
    ends = []
    for _ in range(2):
        simulation.run(30)
        assert trees_of(simulation)[1].linked.broken.numpy().any()
        ends.append(np.array(list(simulation.poses().values())))
        simulation.reset()
        assert not trees_of(simulation)[1].linked.broken.numpy().any()
    assert np.array_equal(*ends)


def test_worlds_break_by_themselves_with_the_bits_of_one():
    scene = weak_chain(["revolute", "revolute", "spherical"], force=20.0)
    one, many = start(scene), start(scene, worlds=3)
    many.load()
    method, trees = trees_of(many)
    one.run(20)
    many.run(20)
    assert trees.linked.broken.numpy().sum() == 3
    x, wanted = method.get("x").reshape(3, -1, 3), trees_of(one)[0].get("x")
    assert all(np.array_equal(x[w], wanted) for w in range(3))
    many.reset(1)
    many.step()
    assert trees.linked.broken.numpy().reshape(3, -1).sum(axis=1).tolist() == [1, 0, 1]


def test_reduced_coordinates_go_on_from_a_maximal_run_in_which_a_joint_broke():
    first = start(weak_chain(["revolute", "revolute", "spherical"], force=20.0, coordinates="maximal"))
    first.run(30)
    other = start(weak_chain(["revolute", "revolute", "spherical"], force=20.0))
    other.restart(30, {path: first.fields(path) for path in first.state.paths()})
    first.run(6), other.run(6)
    for path, pose in first.poses().items():
        assert np.abs(pose - other.poses()[path]).max() < 2e-4
    assert rotation.matrix_quat(other.poses()["/b2"][:3, :3]).shape == (4,)


def test_inverse_dynamics_know_no_breaking():
    weak, strong = (wsim.JointTree(weak_chain(["revolute", "fixed", "spherical"], force)) for force in (1.0, inf))
    assert weak.dofs == strong.dofs and len(weak.start) == len(strong.start)


def test_a_joint_that_may_break_in_a_closed_loop_is_refused_by_one_line():
    from tests.make.physics.joints.chains import linkage
    scene = linkage()
    scene.things("Joint")[1].force = 10.0
    with pytest.raises(wsim.SceneError, match="/j1: it may break, in a tree of which joints close a loop"):
        wsim.Simulation(scene, device="cpu")
