"""Balls about points as sources: their distance on the device, smoke and liquid as of a Sphere, and Points in USD."""

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.make.physics.contact.collider.table import DT, asked, screw
from wsim.physics.contact.collider.point_cloud import PointCloud
from wsim.physics.contact.collider.table import ColliderTable
from wsim.scene import Scene, SceneError, Sphere
from wsim.scene.curve import Curve, Motion
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save


@pytest.mark.parametrize("precision", ["float32", pytest.param("float64", marks=pytest.mark.slow)])
@pytest.mark.parametrize("least", [0.02, 0.1])
def test_the_distance_is_the_least_of_all_balls_while_they_move(precision, least):
    """min_k |q - c_k| - r_k at a time within a frame. Centres are float32 on the device, and so are distances.

    The centres go alike, so that the nearest place goes as they do."""
    rng = np.random.default_rng(3)
    points, radii = rng.uniform(-0.4, 0.4, (60, 3)), rng.uniform(least, 0.1, 60)
    cloud = PointCloud(points, radii, Curve([0.0, DT], np.array([points, points + (0.1, 0.0, -0.05)])))
    scene, times = Scene(fps=1.0 / DT, frames=1), np.array([0.0, DT])
    air = scene.smoke("/air", (-1, -1, -1), (1, 1, 1), 0.5)
    source = scene.smoke_source("/cloud", air, cloud, motion=Motion(times, np.array([screw(t) for t in times])), smoke=1.0)
    model = Simulation(scene, device="cpu", precision=precision).model
    table = ColliderTable(model, [source])
    table.pose(0.0, DT)
    y = rng.uniform(-0.6, 0.6, (1, 500, 3)) + screw(0.0)[:3, 3]
    time, M = 0.3 * DT, screw(0.3 * DT)
    phi, _, _, v = asked(table, y, time, model.real)
    q = (y[0] - M[:3, 3]) @ M[:3, :3] - np.array((0.1, 0.0, -0.05)) * 0.3
    exact = (np.linalg.norm(q[:, None] - points, axis=2) - radii).min(axis=1)
    near = exact < 4 * 0.1 - (0.1 - least)                          # that of the nearest centre is below four largest radii
    assert near.sum() > 300 and np.abs(phi[0] - exact)[near].max() < 2e-6
    own = np.array((0.1, 0.0, -0.05)) / DT
    turned = np.cross([0.0, 0.0, 3.0], y[0]) + [0.0, 0.0, 0.2] + M[:3, :3] @ own
    assert np.abs(v[0] - turned).max() < 1e-3


def smoked(shape, **more) -> np.ndarray:
    scene = Scene(frames=3)
    air = scene.smoke("/air", (0, 0, 0), (1, 1, 1), 0.1)
    scene.smoke_source("/source", air, shape, smoke=4.0, **more)
    sim = Simulation(scene, device="cpu")
    sim.run()
    return sim.fields("/air")["smoke"]


def test_a_cloud_of_one_ball_smokes_as_a_sphere_and_overlapping_balls_once():
    ball = smoked(Sphere(0.2), at=(0.4, 0.5, 0.5))
    assert ball.max() > 0.3
    one = PointCloud([(0.4, 0.5, 0.5)], 0.2)
    assert np.abs(smoked(one) - ball).max() < 1e-5
    same = PointCloud([(0.0, 0.0, 0.0)] * 3 + [(0.02, 0.0, 0.0)], [0.2, 0.2, 0.15, 0.1])
    assert np.abs(smoked(same, at=(0.4, 0.5, 0.5)) - ball).max() < 1e-5


@pytest.mark.slow
def test_points_that_move_smoke_as_a_sphere_on_its_way():
    """The same way by poses of points and by a motion, float32 places apart."""
    places = [(0.3, 0.5, 0.5), (0.6, 0.5, 0.5)]
    ball = smoked(Sphere(0.2), motion=Motion.through([0.0, 0.125], places, kind="linear"))
    cloud = PointCloud(places[:1], 0.2, Curve([0.0, 0.125], np.array(places)[:, None]))
    assert np.abs(smoked(cloud) - ball).max() < 1e-4


def poured(*sources, role: str = "start") -> float:
    scene = Scene(frames=2)
    tank = scene.liquid("/tank", (0, 0, 0), (1, 1, 1), 0.1)
    for k, (shape, at) in enumerate(sources):
        scene.liquid_source(f"/source{k}", tank, shape, at=at, role=role)
    sim = Simulation(scene, device="cpu")
    if role == "source":
        sim.run()
    return sim.indicators()["liquid_particles"]


@pytest.mark.parametrize("role", ["start", pytest.param("source", marks=pytest.mark.slow)])
def test_balls_are_full_of_liquid_as_spheres_are(role):
    cloud = PointCloud([(0.3, 0.5, 0.0), (0.7, 0.5, 0.0)], [0.2, 0.15])
    spheres = poured((Sphere(0.2), (0.3, 0.5, 0.5)), (Sphere(0.15), (0.7, 0.5, 0.5)), role=role)
    assert spheres > 250 and poured((cloud, (0.0, 0.0, 0.5)), role=role) == spheres


def test_clouds_come_back_equal(tmp_path):
    scene, points = Scene(up="Z"), [(0.1, 0.2, 0.3), (0.4, 0.5, 0.625)]
    air = scene.smoke("/air", (0, 0, 0), (1, 1, 1), 0.125)
    tank = scene.liquid("/tank", (2, 0, 0), (3, 1, 1), 0.125)
    moving = Curve([0.0, 0.5], np.array([points, np.array(points) + 0.25], np.float32))
    scene.smoke_source("/sparks", air, PointCloud(np.array(points, np.float32), [0.125, 0.25], moving), smoke=1.0)
    scene.liquid_source("/drops", tank, PointCloud(np.array(points, np.float32), 0.125), at=(2.0, 0.0, 0.0))
    save(scene, tmp_path / "a.usda")
    again = load(tmp_path / "a.usda")
    for name in ("Source", "LiquidSource"):
        assert again.things(name) == scene.things(name)


def stage_with_points(path, widths=(20.0, 10.0), counts=(2, 2)) -> Usd.Stage:
    """A domain of 1 m and two points in centimetres, below an Xform that doubles and turns them."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, "Y")
    cube = UsdGeom.Cube.Define(stage, "/air")
    cube.AddScaleOp().Set((50.0, 50.0, 50.0))
    cube.GetPrim().AddAppliedSchema("WsimFluidDomainAPI")
    around = UsdGeom.Xform.Define(stage, "/rig")
    around.AddRotateZOp().Set(90.0)
    around.AddScaleOp().Set((2.0, 2.0, 2.0))
    points = UsdGeom.Points.Define(stage, "/rig/sparks")
    for k, n in enumerate(counts):
        points.GetPointsAttr().Set([(10.0 * i, 5.0 * k, 0.0) for i in range(n)], 24.0 * k)
    if widths:
        points.CreateWidthsAttr(list(widths))
    points.GetPrim().AddAppliedSchema("WsimFluidSourceAPI")
    points.GetPrim().CreateAttribute("wsim:fluid:smoke", Sdf.ValueTypeNames.Float).Set(2.0)
    return stage


def test_points_of_a_stage_are_balls_in_metres(tmp_path):
    stage = stage_with_points(tmp_path / "a.usda")
    stage.Save()
    (source,) = load(tmp_path / "a.usda").things("Source")
    cloud, M = source.shape, source.motion.at(0.0)
    assert isinstance(cloud, PointCloud) and np.allclose(cloud.radii, [0.2, 0.1])
    assert np.allclose(cloud.poses.at(1.0) @ M[:3, :3].T + M[:3, 3], [(-0.1, 0.0, 0.0), (-0.1, 0.2, 0.0)], atol=1e-6)
    assert source.smoke == 2.0


@pytest.mark.parametrize(("given", "said"), [
    ({"widths": ()}, "/rig/sparks: has no widths: its points have no size; author float\\[\\] widths, one or 2"),
    ({"widths": (1.0, 1.0, 1.0)}, "/rig/sparks: has 3 widths and 2 points; author float\\[\\] widths, one or 2"),
    ({"counts": (2, 3)}, "its number of points changes, from 2 to 3 at time code 24; a source keeps its points"),
    ({"counts": ()}, "/rig/sparks: has no points; author point3f"),
    ({"widths": (0.0,)}, "/rig/sparks: 1 of 1 radii are too small")])
def test_points_that_are_no_source_are_said_in_a_line(tmp_path, given, said):
    from wsim.scene.check.scene import check_scene
    stage_with_points(tmp_path / "a.usda", **given).Save()
    with pytest.raises(SceneError, match=said):
        raise SceneError([problem for problem in check_scene(load(tmp_path / "a.usda")) if problem.fatal])


def test_wrong_shapes_are_said_in_a_line():
    for shape, said in ((PointCloud([(0, 0, np.nan)], 0.1), "point 0 is"), (PointCloud([(0, 0, 0)], [0.1, 0.2]), "2 radii"),
                        (PointCloud([(0, 0, 0)], 0.1, Curve([0.0], np.zeros((1, 2, 3)))), "animated points have shape"),
                        (0.2, "its shape is a float; allowed: Plane, Sphere")):
        scene = Scene()
        air = scene.smoke("/air", (0, 0, 0), (1, 1, 1), 0.1)
        scene.smoke_source("/source", air, shape, smoke=1.0)
        with pytest.raises(SceneError, match=said):
            Simulation(scene, device="cpu")


def test_a_cloud_is_no_collider():
    scene = Scene()
    scene.cloth("/cloth", [(0, 0, 0), (1, 0, 0), (0, 0, 1)], [3], [0, 1, 2])
    scene.collider("/cloud", PointCloud([(0, -1, 0)], 0.1))
    with pytest.raises(SceneError, match="/cloud: its shape is a PointCloud; allowed: Surface, Plane, Sphere"):
        Simulation(scene, device="cpu")
