"""Skins follow the tets of their body, exactly where those move affinely, and come out in a result in their own frame."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from wsim.scene import Scene, SceneError, Skin, Soft, shapes
from wsim.scene.curve import Motion
from wsim.scene.nodal.skin import embed_all_skins, embed_skin
from wsim.usd.result.recorder import Recorder
from wsim.usd.result.restart import ResultReader, load_restart

EPS = np.finfo(np.float32).eps
TETS, SKIN = "/World/body/tets", "/World/body/look/skin"
F, SHIFT = np.array([[1.2, 0.3, 0.0], [-0.4, 0.9, 0.1], [0.2, 0.0, 0.7]]), np.array([0.5, 2.0, -1.0])


def fur(count: int = 200) -> np.ndarray:
    """Points in a box of 1 x 1 x 1 m and up to 5 cm outside of it, (count, 3) float32."""
    return np.random.default_rng(0).uniform(-0.55, 0.55, (count, 3)).astype(np.float32)


@pytest.mark.parametrize("linear", [np.eye(3), np.diag([-1.0, 1.0, 1.0]), np.diag([5.0, 0.1, 1.0])],
                         ids=["as it is", "mirrored", "stretched"])
def test_a_skin_follows_affine_motion_exactly(linear):
    """Also where it lies outside of the tets, and where the body's frame mirrors or stretches."""
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = linear, (100.0, 0.0, -30.0)
    soft = Soft("/body", *shapes.block((1, 1, 1), 3), motion=Motion.still(M))
    found = embed_skin(soft, Skin("/body/skin", fur()))
    world = soft.motion.points(soft.points, 0.0)
    there = found.of(world @ F.T + SHIFT)
    assert np.abs(there - (soft.motion.points(fur(), 0.0) @ F.T + SHIFT)).max() < 1e-11
    assert np.abs(found.weights.sum(axis=1) - 1.0).max() < 1e-12


def test_the_rest_shape_holds_the_skin_and_not_the_start():
    points, tets = shapes.block((1, 1, 1), 2)
    soft = Soft("/body", points @ F.T + SHIFT, tets, rest_points=points)
    at_start = embed_skin(soft, Skin("/body/skin", fur())).of(soft.points)
    assert np.abs(at_start - (fur() @ F.T + SHIFT)).max() < 16 * EPS           # soft.points are float32, up to 3


def test_all_skins_that_cannot_follow_are_named():
    """The tets are 0.5 m cells, so that the longest edges, the diagonals of their sides, have 0.71 m."""
    scene, far = Scene(), np.zeros((3, 3))
    far[2, 0] = 0.5 + 0.72
    broken = np.full((1, 3), np.nan)
    scene.soft("/body", *shapes.block((1, 1, 1), 2), skins=[
        Skin("/body/far", far), Skin("/body/near", far - (0.02, 0.0, 0.0)), Skin("/body/broken", broken)])
    with pytest.raises(SceneError) as error:
        embed_all_skins(scene)
    assert [p.path for p in error.value.problems] == ["/body/far", "/body/broken"]
    assert "1 of 3 lie more than 0.707107 m outside" in str(error.value) and "first: 2, at [1.22" in str(error.value)
    assert "point 0 is not finite" in str(error.value)


# Results

def author(path) -> Scene:
    """A source in centimetres: a body that an animated Xform carries, its skin below a frame that mirrors and stretches. With
    the scene that a loader would make of it."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, "Y")
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    carrier = UsdGeom.Xform.Define(stage, "/World/body").AddTranslateOp()
    for code in range(5):
        carrier.Set((100.0 + 5.0 * code, 0, 0), code)
    frame = UsdGeom.Xform.Define(stage, "/World/body/look").AddTransformOp()
    local = np.array([[-2.0, 0, 0], [0.5, 1, 0], [0, 0, 0.5]])                # of row vectors
    frame.Set(Gf.Matrix4d(*[*local[0], 0, *local[1], 0, *local[2], 0, 10, 20, 30, 1]))
    points, tets = shapes.block((1, 1, 1), 2)
    mesh = UsdGeom.TetMesh.Define(stage, TETS)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy((100 * points).astype(np.float32)))
    mesh.CreateTetVertexIndicesAttr(Vt.Vec4iArray.FromNumpy(tets))
    skin = UsdGeom.Mesh.Define(stage, SKIN)
    own = ((100.0 * fur(201)[:201] - (10, 20, 30)) @ np.linalg.inv(local)).astype(np.float32)
    skin.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(own))
    skin.CreateFaceVertexCountsAttr([3] * 67)
    skin.CreateFaceVertexIndicesAttr(list(range(201)))
    skin.CreateNormalsAttr(Vt.Vec3fArray(201, (0, 0, 1)))
    stage.Save()
    M = np.eye(4)
    M[0, 3] = 1.0
    scene = Scene(source=str(path), frames=4)
    scene.soft(TETS, points, tets, motion=Motion.still(M), skins=[Skin(SKIN, fur(201))])
    return scene


def moved(scene: Scene, code: float) -> tuple[dict, dict]:
    """World positions [m] and velocities [m/s] of the body in a motion that is affine."""
    points = scene.softs[0].points.astype(float)
    return {TETS: points @ (np.eye(3) + 0.1 * code * F).T + code * SHIFT}, {TETS: 24.0 * (0.1 * points @ F.T + SHIFT)}


def record(scene: Scene, path, codes, **more) -> None:
    with Recorder(scene, str(path), **more) as recorder:
        for code in codes:
            recorder.append(code, *moved(scene, code))


def test_a_result_has_the_body_and_its_skin_each_in_its_own_frame(tmp_path):
    scene = author(tmp_path / "s.usda")
    record(scene, tmp_path / "out.usdc", range(3))
    result, rest = ResultReader(tmp_path / "out.usdc"), fur(201).astype(float)
    assert result.paths() == [SKIN, TETS]
    for code in range(3):
        p, v = moved(scene, code)
        places = rest @ (np.eye(3) + 0.1 * code * F).T + code * SHIFT
        assert np.abs(result.positions(TETS, code) - p[TETS]).max() < 64 * EPS       # within 10 m, rounded in that frame
        assert np.abs(result.positions(SKIN, code) - places).max() < 64 * EPS
        speeds = 24.0 * (0.1 * rest @ F.T + SHIFT)
        assert np.abs(result.velocities(TETS, code) - v[TETS]).max() < 1e-4 and \
            np.abs(result.velocities(SKIN, code) - speeds).max() < 1e-4              # 60 m/s, EPS of that is 7e-6
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    layer = stage.GetRootLayer()
    for path in (TETS, SKIN):
        base = UsdGeom.PointBased(stage.GetPrimAtPath(path))
        assert not layer.GetAttributeAtPath(f"{path}.points").HasDefaultValue()
        extent = UsdGeom.PointBased.ComputeExtent(base.GetPointsAttr().Get(1.0))
        assert np.array_equal(base.GetExtentAttr().Get(1.0), extent)
    normals = np.array(UsdGeom.Mesh(stage.GetPrimAtPath(SKIN)).GetNormalsAttr().Get(2.0))
    points = np.array(UsdGeom.Mesh(stage.GetPrimAtPath(SKIN)).GetPointsAttr().Get(2.0), float).reshape(-1, 3, 3)
    across = np.einsum("tk,tck->tc", normals[::3], points - points[:, :1])
    assert np.abs(across).max() < 1e-3                                              # of 100 units: they have followed


def test_a_run_that_goes_on_keeps_the_earlier_samples_of_skins(tmp_path):
    scene = author(tmp_path / "s.usda")
    record(scene, tmp_path / "a.usdc", range(2))
    record(scene, tmp_path / "b.usdc", range(2, 4), continues=load_restart(tmp_path / "a.usdc", scene))
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "b.usdc"))
    for name in ("points", "velocities", "extent", "normals"):
        assert layer.ListTimeSamplesForPath(f"{SKIN}.{name}") == [0, 1, 2, 3], name


def test_a_skin_that_the_source_has_otherwise_writes_nothing(tmp_path):
    scene = author(tmp_path / "s.usda")
    scene.softs[0].skins.append(Skin("/World/body/more", fur(3)))
    with pytest.raises(SceneError, match="/World/body/more: is not in"):
        Recorder(scene, tmp_path / "out.usdc")
    assert [p.name for p in tmp_path.iterdir()] == ["s.usda"]
