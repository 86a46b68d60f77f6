"""The rerun viewer: what a recording holds (read by rerun's own program), and what is said when there is none."""

import sys

import numpy as np
import pytest
from pxr import Usd, UsdGeom, Vt

from tests.make.show.view import Stepped, needs_rerun, rows
from wsim import usd
from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Capsule, Collider, Cone, Cylinder, Plane, Scene, SceneError, Skin, Sphere, Surface, samples, shapes
from wsim.scene.curve import Curve, Motion
from wsim.scene.fabric import Fabric
from wsim.show import rerun_log as logs
from wsim.show.plots import ResultMeasures
from wsim.show.viewer import Viewer, _fit_viewer_eye, view
from wsim.show.visible import read_visible_stage


def triangle_surface(**more) -> Surface:
    return Surface(np.eye(3), [3], [0, 1, 2], **more)


@needs_rerun
def test_topology_is_sent_once_and_points_every_frame(tmp_path, scene):
    scene.collider("/ball", Sphere(0.3))
    scene.collider("/mill", Box((1, 2, 3)), motion=Motion(np.array([0.0, 1.0]), np.stack([np.eye(4), 2 * np.eye(4)])))
    scene.collider("/wave", triangle_surface(poses=Curve([0.0, 1.0], np.stack([np.eye(3), 2 * np.eye(3)]))))
    scene.net("/net", np.eye(3), [(0, 1), (1, 2)], [10.0], [1.0])
    sim, viewer = Stepped(scene), Viewer(scene, save=tmp_path / "a.rrd")
    for _ in range(3):
        sim.step()
        viewer.log(sim)
    viewer.close()
    found = rows(tmp_path / "a.rrd")
    for path, times in (("cloth", 4), ("ball/shape", 1), ("mill/shape", 1), ("wave/shape", 4)):
        assert found[f"/world/{path} triangle_indices"] == 1
        assert found[f"/world/{path} vertex_positions"] == times == found[f"/world/{path} vertex_normals"]
    assert found["/world/mill/shape translation"] == 4 and found["/world/ball/shape translation"] == 1
    assert found["/world/net strips"] == 4
    for curve in ("energy/kinetic_energy", "strain/max_strain", "other/residual"):
        assert found[f"/plots/{curve} scalars"] == 3


@needs_rerun
def test_a_soft_body_is_shown_by_its_surface_or_by_its_skin(tmp_path):
    """8 corners and the middles of the 12 edges and 6 faces of a cube, and not its centre; three normals at a corner, two on
    an edge."""
    scene, points = Scene(), 0.2 * np.eye(3)
    scene.soft("/jelly", *shapes.block((1, 1, 1), 2))
    scene.soft("/bear", *shapes.block((1, 1, 1), 2), skins=[Skin("/bear/fur", points, [3], [0, 1, 2])])
    sim, viewer = Stepped(scene), Viewer(scene, save=tmp_path / "a.rrd")
    sim.step()
    viewer.log(sim)
    viewer.close()
    found = rows(tmp_path / "a.rrd")
    assert len(np.unique(viewer.shown["/jelly"].point)) == 26 and len(viewer.shown["/jelly"].point) == 8 * 3 + 12 * 2 + 6
    assert found["/world/jelly triangle_indices"] == found["/world/bear/fur triangle_indices"] == 1
    assert found["/world/bear/fur vertex_positions"] == 2 and "/world/bear triangle_indices" not in found


@needs_rerun
@pytest.mark.parametrize("shape", [Plane(), Sphere(1.0), Box((1, 1, 1)), Capsule(0.5, 1.0), Cylinder(0.5, 1.0),
                                   Cone(0.5, 1.0), triangle_surface()], ids=lambda s: type(s).__name__)
def test_every_collider_is_shown(tmp_path, shape):
    scene = Scene()
    scene.collider("/it", shape)
    Viewer(scene, save=tmp_path / "a.rrd").close()
    assert rows(tmp_path / "a.rrd")["/world/it/shape vertex_positions"] == 1


@needs_rerun
def test_bodies_instances_particles_and_smoke_are_shown_while_they_are_simulated(tmp_path):
    """A shape once and its transform a frame; an instance is moved from where it was at the start."""
    start = np.diag([1.0, 1.0, 1.0, 1.0])
    start[0, 3] = 2.0
    made = Scene()
    made.add(Body("/box", [Collider("/box", Box((1, 1, 1)))], stretch=np.diag([2.0, 1.0, 1.0])))
    made.add(Body("/many/0", [Collider("/many/0", Sphere(1.0))], motion=Motion.still(start), instancer="/many", instance=0))
    moved = np.eye(4)
    moved[1, 3] = 3.0
    scaled = moved @ np.diag([2.0, 1.0, 1.0, 1.0])
    nothing = np.zeros((1, 3))
    found = [samples.TransformSample("/box", scaled),
             samples.InstanceSample("/many", np.array([0]), moved[None], nothing, nothing, nothing),
             samples.ParticleSample("/drops", np.ones((4, 3)), np.full(4, 0.1), np.arange(4)),
             samples.VolumeSample("/air", np.zeros(3), 0.5, {"density": np.ones((2, 2, 2), np.float32)})]
    sim, viewer, placed = Stepped(made), Viewer(made, save=tmp_path / "a.rrd"), {}
    sim.samples = lambda: found
    place = viewer.moved._place
    viewer.moved._place = lambda path, pose: (placed.__setitem__(path, pose), place(path, pose))
    for _ in range(2):                                       # it rests where it has got to: the second frame sends no pose
        sim.step()
        viewer.log(sim)
    viewer.close()
    assert np.allclose(placed["/box"], moved) and np.allclose(placed["/many/0"], moved @ start)
    seen = rows(tmp_path / "a.rrd")
    for path in ("/world/box/shape", "/world/many/0/shape"):
        assert seen[f"{path}/0 triangle_indices"] == 1 and seen[f"{path} translation"] == 2
    assert seen["/world/drops positions"] == 2 and seen["/world/air_volume positions"] == 2


def test_the_eye_of_a_viewer_sees_all_but_what_is_far_from_the_rest():
    """Within the lens of rerun, 55 degrees from top to bottom; a ball 40 m away does not make a pyramid small."""
    near = [np.array([[x, 0.0, 0.0], [x + 0.5, 0.5, 0.5]]) for x in (-1.0, 0.0, 1.0)]
    place, target = _fit_viewer_eye([*near, np.array([[40.0, 0.0, 0.0], [41.0, 1.0, 1.0]])], "Y")
    ahead = (target - place) / np.linalg.norm(target - place)
    for points in near:
        to = points - place
        assert (to @ ahead > 0).all()
        assert (np.arccos(to @ ahead / np.linalg.norm(to, axis=1)) < np.radians(0.5 * 55.0) * 1.5).all()
    assert np.linalg.norm(target - place) < 8.0 and _fit_viewer_eye([], "Y") is None


@needs_rerun
def test_a_result_is_shown_with_energy_and_strain(tmp_path):
    made = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(made, 1.0)
    made.SetEndTimeCode(2)
    mesh = UsdGeom.Mesh.Define(made, "/cloth")
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    for t in range(3):
        mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy((1 + 0.1 * t) * points), t)
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    mesh.GetPrim().AddAppliedSchema("PhysicsDeformableBodyAPI")
    mesh.GetPrim().AddAppliedSchema("PhysicsSurfaceDeformableSimAPI")
    made.Save()
    view(tmp_path / "a.usda", save=tmp_path / "a.rrd")
    found = rows(tmp_path / "a.rrd")
    assert found["/world/cloth vertex_positions"] == 3 and found["/world/cloth triangle_indices"] == 1
    assert found["/plots/strain/max_strain scalars"] == found["/plots/energy/gravity_energy scalars"] == 3


def test_strain_and_energy_of_a_result_are_those_of_its_points(tmp_path):
    """A sheet of 1 m x 1 m, 0.2 kg, stretched by 10 % each way and lifted by 2 m at 3 m/s."""
    made = Scene(gravity=(0.0, -9.81, 0.0), frames=1)
    points = np.array([[-0.5, 0, -0.5], [0.5, 0, -0.5], [0.5, 0, 0.5], [-0.5, 0, 0.5]])
    made.cloth("/cloth", points, [4], [0, 3, 2, 1], material=Fabric(density=200.0, thickness=1e-3))
    usd.save(made, tmp_path / "a.usda")
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    mesh = UsdGeom.PointBased(stage.GetPrimAtPath("/cloth"))
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)), 0)
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy((1.1 * points + [0, 2.0, 0]).astype(np.float32)), 1)
    mesh.GetVelocitiesAttr().Set(Vt.Vec3fArray.FromNumpy(np.tile(np.float32([0, 3, 0]), (4, 1))), 1)
    stage.Save()
    seen = read_visible_stage(tmp_path / "a.usda")
    found = ResultMeasures.of(seen).at(seen.times[-1])
    expected = {"kinetic_energy": 0.9, "gravity_energy": 0.2 * 9.81 * 2, "max_strain": 0.1, "rms_strain": 0.1}
    assert found == pytest.approx(expected, rel=1e-6)


def test_without_rerun_the_mend_is_said(monkeypatch, scene):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(SceneError, match=r'pip install -e "\.\[view\]"'):
        Viewer(scene, save="a.rrd")


@needs_rerun
@pytest.mark.parametrize(("save", "error", "words"), [
    ("a.txt", SceneError, ".rrd"), ("nowhere/a.rrd", FileNotFoundError, "make it")])
def test_a_wrong_output_is_said(tmp_path, scene, save, error, words):
    with pytest.raises(error, match=words):
        Viewer(scene, save=tmp_path / save)


@needs_rerun
def test_without_a_screen_a_file_is_proposed(monkeypatch, scene):
    if not sys.platform.startswith("linux"):
        pytest.skip("only Linux names its screen in the environment")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(logs, "PORT", 1)                 # nothing listens there
    with pytest.raises(SceneError, match="no screen.*rerun run.rrd"):
        Viewer(scene)


def test_a_viewer_must_go_somewhere(scene):
    with pytest.raises(ValueError, match="neither"):
        Viewer(scene, spawn=False)
