"""Hairs that follow guides."""

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import wsim
from tests.make.physics.rods.follow import EDGE, POINTS, carried, combed
from tests.physics.rods.rig import turning
from wsim.physics.rods.follow.binding import bind_followers, nearest_guides
from wsim.physics.rods.follow.objects import Followers
from wsim.physics.rods.objects import Rods
from wsim.scene import Motion, Scene, SceneError
from wsim.simulation.simulation import Simulation


def test_at_rest_the_authored_points_come_back_as_they_are_written():
    made, rods, followers = combed()
    simulation = Simulation(made, device="cpu")
    assert np.array_equal(carried(simulation).positions, followers.points)
    simulation.run(1)
    assert np.abs(carried(simulation).positions - followers.points).max() < 1e-16
    assert np.abs(carried(simulation).velocities).max() < 1e-13


def test_what_moves_guides_rigidly_moves_their_followers_so():
    """Guides held whole, that turn and go: hairs too, with their velocities."""
    made, rods, followers = combed()
    axis, times = np.array([1.0, 2.0, 2.0]) / 3.0, np.linspace(0.0, 0.2, 49)      # a key a substep
    motion = turning(axis, np.array([0.2, 0.1, 0.0]), times, 6.0 * times)
    rods.pin("/hand", np.arange(3 * POINTS), motion=motion)
    simulation = Simulation(made, device="cpu")
    simulation.run(6)
    M = motion.at(0.1)
    exact = followers.points.astype(np.float64) @ M[:3, :3].T + M[:3, 3]
    found = carried(simulation)
    assert np.abs(found.positions - exact).max() < 1e-9                        # float32 of the pin's keys: none; of d: rounding
    h = 0.1 / 6 / simulation.plan.method("rods").substeps
    spin = np.cross(-6.0 * axis, exact - [0.2, 0.1, 0.0])                       # `turning` turns the other way
    assert np.abs(found.velocities - spin).max() < (6.0 * h)**2 * np.abs(spin).max()     # of order 2


def test_one_between_two_guides_moves_by_their_mean():
    made = Scene(gravity=(0.0, 0.0, 0.0), fps=60.0, substeps=1)
    x = np.zeros((2, 4, 3))
    x[:, :, 2], x[1, :, 0] = -0.05 * np.arange(4), 0.2
    rods = made.add(Rods("/guides", x.reshape(-1, 3), [4, 4], 2e-3, 1e7))
    rods.pin("/still", np.arange(4))
    away = Motion(np.array([0.0, 1.0]), np.stack([np.eye(4), np.eye(4)]))
    away.values[1][:3, 3] = (0.0, 0.6, 0.0)
    rods.pin("/moved", np.arange(4, 8), motion=away)
    hair = np.array([[0.1, 0.0, 0.0], [0.1, 0.0, -0.07]])
    made.add(Followers("/hair", np.concatenate([hair, hair + (0.04, 0.0, 0.0)]), [2, 2], "/guides"))
    simulation = Simulation(made, device="cpu")
    simulation.run(30)
    moved = carried(simulation).positions - np.concatenate([hair, hair + (0.04, 0.0, 0.0)])
    assert moved[:2] == pytest.approx(np.tile([0.0, 0.15, 0.0], (2, 1)), abs=1e-9)
    share = (1.0 / 0.06) / (1.0 / 0.06 + 1.0 / 0.14)                           # by inverse distances of roots
    assert moved[2:] == pytest.approx(np.tile([0.0, 0.3 * share, 0.0], (2, 1)), abs=1e-6)


def test_weights_sum_to_one_and_a_hair_at_the_root_of_a_guide_has_it_alone():
    roots = np.random.default_rng(0).normal(size=(20, 3))
    number, weight = nearest_guides(np.concatenate([roots[7:8], roots[:3] + 0.01]), roots)
    assert weight.sum(axis=1) == pytest.approx(1.0, abs=1e-14)
    assert number[0, 0] == 7 and weight[0].tolist() == [1.0, 0.0, 0.0]
    made, rods, followers = combed()
    table = Simulation(made, device="cpu").plan.method("rods").table
    edge, weight, place = bind_followers(followers, table, table.own[0])
    assert weight.min() >= 0.0 and weight.sum(axis=1) == pytest.approx(1.0, abs=1e-14)


def test_a_hair_beside_a_guide_bends_as_it_does():
    """Along the guide itself, the points between its own lie on it, but for what its corners cut."""
    made, rods, followers = combed(gravity=(0.0, -9.81, 0.0), curl=0.0)
    first = rods.points[:POINTS].astype(np.float64)
    between = np.stack([np.interp(np.linspace(0, 1, 15), np.linspace(0, 1, POINTS), first[:, c]) for c in range(3)], axis=1)
    followers.points, followers.counts = between, np.array([15], np.int32)
    rods.pin("/roots", np.sort(np.concatenate([POINTS * np.arange(3), POINTS * np.arange(3) + 1])))
    simulation = Simulation(made, device="cpu")
    simulation.run(20)
    x = simulation.plan.method("rods").points(0)[0][:POINTS]
    assert np.abs(x - first).max() > EDGE
    on = carried(simulation).positions[::2]
    turn = np.linalg.norm(np.diff(x, 2, axis=0), axis=1).max()                  # of neighbouring edges, times an edge
    assert np.linalg.norm(on - x, axis=1).max() < 0.3 * turn


def test_worlds_each_have_their_own():
    made, rods, followers = combed()
    simulation = Simulation(made, device="cpu", worlds=3)
    simulation.set("/", "gravity", (0.0, -5.0, 0.0), world=1)
    simulation.run(6)
    heights = [carried(simulation, k).positions[:, 1] - followers.points[:, 1] for k in range(3)]
    assert np.abs(heights[0]).max() < 1e-9 and np.abs(heights[2]).max() < 1e-9
    assert heights[1] == pytest.approx(-0.5 * 5.0 * 0.1**2, rel=0.05)


def test_a_file_carries_them_and_a_result_holds_their_points(tmp_path):
    made, rods, followers = combed(gravity=(0.0, -9.81, 0.0))
    made.frames = 4
    path, output = str(tmp_path / "hair.usda"), str(tmp_path / "out.usdc")
    wsim.save(made, path)
    loaded = wsim.load(path)
    assert loaded.things("Followers")[0] == followers and not [n for n in loaded.notes if "/hair" in n.path]
    from wsim.cli.run import prepare_recorded_run
    job = prepare_recorded_run(loaded, output, lambda s: Simulation(s, device="cpu"))
    job.frames()
    stage = Usd.Stage.Open(output)
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/hair"))
    assert np.array_equal(np.array(curves.GetPointsAttr().Get(0.0)), followers.points.astype(np.float32))
    fallen = np.array(curves.GetPointsAttr().Get(4.0)) - followers.points
    assert fallen[:, 1] == pytest.approx(-0.5 * 9.81 * (4 / 60.0)**2, rel=0.1)


@pytest.mark.parametrize("path, says", [
    ("/nothing", "/hair: follows /nothing, which is not simulated"), ("", "/hair: follows nothing"),
    ("/hair", "in a circle (/hair to /hair)"), ("/ball", "follows /ball, a Collider")])
def test_guides_that_are_none_are_told(path, says):
    from wsim.scene import Sphere
    made, rods, followers = combed()
    made.collider("/ball", Sphere(0.1))
    followers.guides = path
    with pytest.raises(SceneError, match=says.replace("(", r"\(").replace(")", r"\)")):
        Simulation(made, device="cpu")


def test_circles_and_points_that_are_no_numbers_are_told():
    made, rods, followers = combed()
    made.add(Followers("/other", followers.points, followers.counts, "/hair"))
    with pytest.raises(SceneError, match="/other: follows /hair, which follows others itself"):
        Simulation(made, device="cpu")
    followers.guides = "/other"
    with pytest.raises(SceneError, match="/hair: follows /other, which follows in a circle"):
        Simulation(made, device="cpu")
    made, rods, followers = combed()
    followers.points[3, 1] = np.nan
    with pytest.raises(SceneError, match=r"/hair: points\[3\] is "):
        Simulation(made, device="cpu")


def test_a_stage_that_says_both_or_neither_is_told(tmp_path):
    made, rods, followers = combed()
    path = str(tmp_path / "hair.usda")
    wsim.save(made, path)
    stage = Usd.Stage.Open(path)
    stage.GetPrimAtPath("/guides").AddAppliedSchema("WsimRodsAPI")
    stage.GetPrimAtPath("/guides").CreateRelationship("wsim:guides").SetTargets(["/hair"])
    stage.Save()
    with pytest.raises(SceneError, match="/guides: is simulated"):
        wsim.load(path)
    stage.GetPrimAtPath("/guides").GetRelationship("wsim:guides").SetTargets([])
    stage.GetPrimAtPath("/hair").GetRelationship("wsim:guides").SetTargets([])
    stage.Save()
    assert [n for n in wsim.load(path).notes if n.path == "/hair" and "does nothing" in str(n)]
