"""Clusters in USD: round trip, units, results, restart."""

from math import inf

import numpy as np
import pytest
from pxr import Usd

from tests.physics.soft.clusters.lattice import cube_points
from wsim.scene import Plane, Scene, SceneError, shapes
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save

CUBE = cube_points(3, 0.125).astype(np.float32)


def box_scene(**more) -> Scene:
    scene = Scene(fps=30, frames=10)
    scene.collider("/floor", Plane(), at=(0, -0.5, 0))
    points, counts, indices = shapes.box((0.2, 0.2, 0.2))
    points = np.concatenate([points, 0.5 * CUBE]).astype(np.float32)
    scene.clusters("/jelly", points, mass=2.0, counts=counts, indices=indices, **more)
    scene.clusters("/cloud", CUBE + np.float32([1, 0, 0]), masses=np.full(27, 0.125), radius=0.0625)
    return scene


@pytest.mark.parametrize("more", [
    {"stiffness": 500.0, "damping": 0.01}, {"stiffness": inf, "spacing": 0.3, "overlap": 0.5},
    {"yield_strain": 0.1, "creep": 2.0, "max_strain": 0.5, "self_collision": True}])
def test_a_save_and_a_load_give_the_same(tmp_path, more):
    scene = box_scene(**more)
    save(scene, tmp_path / "a.usda")
    found = load(tmp_path / "a.usda")
    assert found.things("Clusters") == scene.things("Clusters")
    assert not [n for n in found.notes if "jelly" in n.path or "cloud" in n.path]


def test_members_and_rest_points_go_through(tmp_path):
    scene = Scene(frames=4, gravity=(0, 0, 0))
    scene.clusters("/c", CUBE * np.float32(1.5), rest_points=CUBE, mass=1.0, sizes=[27, 9], members=[*range(27), *range(9)],
                   velocities=CUBE)
    save(scene, tmp_path / "a.usda")
    assert load(tmp_path / "a.usda").things("Clusters") == scene.things("Clusters")


def test_a_stage_in_centimetres_is_the_same_body(tmp_path):
    text = ('#usda 1.0\n(\n metersPerUnit = 0.01\n upAxis = "Y"\n timeCodesPerSecond = 24\n startTimeCode = 0\n'
            ' endTimeCode = 4\n)\n'
            'def PhysicsScene "s" {}\n'
            'def Points "c" (prepend apiSchemas = ["PhysicsDeformableBodyAPI", "WsimShapeMatchingAPI"]) {\n'
            ' float physics:mass = 3\n double wsim:clusterSpacing = 25\n double wsim:radius = 1\n double wsim:stiffness = 100\n'
            ' point3f[] points = [(0, 0, 0), (10, 0, 0), (0, 10, 0), (0, 0, 10)]\n}\n')
    (tmp_path / "a.usda").write_text(text)
    body = load(tmp_path / "a.usda").things("Clusters")[0]
    assert (body.mass, body.stiffness) == (3.0, 100.0)
    assert abs(body.spacing - 0.25) < 1e-12 and abs(body.radius - 0.01) < 1e-12 and abs(body.points.max() - 0.1) < 1e-6


def test_a_prim_of_another_type_is_refused(tmp_path):
    (tmp_path / "a.usda").write_text('#usda 1.0\ndef Sphere "c" (prepend apiSchemas = ["WsimShapeMatchingAPI"]) {}\n')
    with pytest.raises(SceneError, match="/c: has WsimShapeMatchingAPI and is a Sphere; it must be a Mesh or Points"):
        load(tmp_path / "a.usda")


def test_a_run_goes_on_with_the_same_bits():
    scene = box_scene(stiffness=2e3, yield_strain=0.01, creep=20.0)
    whole, part, again = (Simulation(scene, device="cpu") for _ in range(3))
    whole.run(24)
    part.run(16)
    again.restart(16, {path: part.fields(path) for path in part.state.paths()})
    again.run(8)
    assert np.abs(part.state.parts["clusters"].arrays["flow"].numpy() - np.eye(3)).max() > 1e-3
    for path in ("/jelly", "/cloud"):
        assert np.array_equal(again.positions(path), whole.positions(path))
        assert np.array_equal(again.velocities(path), whole.velocities(path))


def test_a_result_has_the_points_of_each_frame(tmp_path):
    sim = Simulation(box_scene(), device="cpu")
    with sim.record(tmp_path / "out.usdc"):
        sim.run(5)
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    for path in ("/jelly", "/cloud"):
        points = np.array(stage.GetPrimAtPath(path).GetAttribute("points").Get(5))
        np.testing.assert_allclose(points, sim.positions(path), atol=1e-6)
