"""Meshes under a skeleton: a collider follows it, what is simulated is refused, and results are not skinned once more."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel

import wsim
from tests.make.usd.prims.skeleton import BOUND, COLLIDES, RISES, character, mesh
from tests.make.usd.validate import validate
from tests.make.usda import APIS, Reader, cloth, errors
from wsim.scene import Scene, Surface
from wsim.usd.result.recorder import Recorder

SIMULATED = APIS.replace("]", ', "SkelBindingAPI"]')
STANDS = "float3[] translations = [(0, 0, 0)]"


BALL = f'def Sphere "ball" ({COLLIDES}) {{{BOUND}\n}}\n'
INHERITED = "\n".join(line for line in BOUND.splitlines() if "rel skel" not in line)


ASSETS = Path(__file__).parents[3] / "scenes" / "assets"
SHAPED = BOUND + """
    uniform token[] skel:blendShapes = ["lift", "push"]
    rel skel:blendShapeTargets = [</char/skin/lift>, </char/skin/push>]
    def BlendShape "lift" {{
        uniform vector3f[] offsets = [(0, 1, 0), (0, 2, 0)]
        uniform int[] pointIndices = [0, 3]
        uniform vector3f[] inbetweens:half = [(0, 0.9, 0), (0, 0, 0)] ( weight = 0.5 )
    }}
    def BlendShape "push" {{
        uniform vector3f[] offsets = [(1, 0, 0)]
        uniform int[] pointIndices = [1]
    }}""".replace("{{", "{").replace("}}", "}")
WEIGHTS = """uniform token[] blendShapes = ["push", "lift"]
        float[] blendShapeWeights.timeSamples = {0: [0, 0], 12: [0.25, 1]}"""


@pytest.fixture
def read(tmp_path):
    return Reader(tmp_path)


@pytest.mark.parametrize(("text", "path"), [
    (cloth() + character(BALL), "/char/ball"), (character(mesh(SIMULATED)), "/char/skin"),
    (character(mesh(SIMULATED, INHERITED), root="rel skel:skeleton = </char/bones>"), "/char/skin")])
def test_what_a_skeleton_moves_is_an_error_that_says_how_far(read, text, path):
    said = errors(read, text)
    assert f"{path}: is bound to the skeleton /char/bones, which puts its points up to 0.5 m from where they are" in said
    assert "UsdSkel.BakeSkinning" in said and "empty skel:skeleton" in said


def test_a_rest_pose_that_is_not_the_bind_pose_moves_too(read):
    still = character(mesh(SIMULATED), moves="", rest="(0, 0, 2, 1)").replace("rel skel:animationSource = </char/walk>", "")
    assert "up to 2 m from where they are authored (at time code 0)" in errors(read, still)


@pytest.mark.parametrize("text", [
    character(mesh(SIMULATED), STANDS), character(mesh(SIMULATED), kind="Xform"),
    character(mesh(SIMULATED, BOUND.replace("</char/bones>", "[]"))), character(mesh(SIMULATED, "")),
    cloth() + character(mesh(COLLIDES), STANDS)])
def test_a_skeleton_that_moves_nothing_is_no_error(read, text):
    assert isinstance(read(text), Scene)


@pytest.mark.parametrize("text", [character(mesh(SIMULATED), STANDS), character(
    mesh(SIMULATED, INHERITED), STANDS, root="rel skel:skeleton = </char/bones>")])
def test_no_viewer_skins_a_result_once_more(read, tmp_path, text):
    scene = read(text)
    places = scene.cloths[0].points + np.array([0.0, 3.0, 0.0])
    with Recorder(scene, tmp_path / "out.usda") as recorder:
        recorder.append(recorder.time_code(0), {"/char/skin": places})
    source = tmp_path / "scene.usda"
    source.write_text(source.read_text().replace(STANDS, RISES))       # whatever the skeleton does later
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    stage.Reload()
    root, cache = UsdSkel.Root(stage.GetPrimAtPath("/char")), UsdSkel.Cache()
    cache.Populate(root, Usd.TraverseInstanceProxies())
    assert not any(b.GetSkinningTargets() for b in cache.ComputeSkelBindings(root, Usd.TraverseInstanceProxies()))
    UsdSkel.BakeSkinning(root, Gf.Interval(0, 12))
    assert np.array_equal(UsdGeom.Mesh.Get(stage, "/char/skin").GetPointsAttr().Get(0.0), places.astype(np.float32))
    assert not [line for line in validate(tmp_path / "out.usda") if "Skel" in line]


def baked(stage: Usd.Stage, path: str, codes) -> list[np.ndarray]:
    """World points of a mesh whose skinning USD writes into its points."""
    root = UsdSkel.Root.Find(stage.GetPrimAtPath(path))
    assert UsdSkel.BakeSkinning(root, Gf.Interval(min(codes), max(codes)))
    own = UsdGeom.Mesh.Get(stage, path)
    found = []
    for code in codes:
        M = np.array(UsdGeom.XformCache(Usd.TimeCode(code)).GetLocalToWorldTransform(own.GetPrim()))
        found.append(np.array(own.GetPointsAttr().Get(code)) @ M[:3, :3] + M[3, :3])
    return found


def follow(scene: Scene, path: str, times) -> list[np.ndarray]:
    """World points [m] of a mesh collider."""
    (collider,) = [c for c in scene.colliders if c.path == path]
    assert isinstance(collider.shape, Surface)
    return [collider.motion.points(collider.shape.poses.at(t), t) for t in times]


@pytest.mark.parametrize(("asset", "path"), [
    ("RiggedSimple.usdz", "/RiggedSimple/Geom/Z_UP/Armature/Bone_3/Cylinder_2"),
    ("CesiumMan.usdz", "/CesiumMan/Geom/Z_UP/Armature/Skeleton_torso_joint_1_3/Cesium_Man_2")])
@pytest.mark.parametrize("method", ["classicLinear", "dualQuaternion"])
def test_a_mesh_of_a_character_collides_where_usd_skins_it(tmp_path, asset, path, method):
    """At frames, in metres, whatever stands above the skeleton."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "worn.usda"))
    stage.GetRootLayer().subLayerPaths = [str(ASSETS / asset)]
    UsdGeom.SetStageMetersPerUnit(stage, 0.5)
    stage.SetStartTimeCode(1), stage.SetEndTimeCode(20), stage.SetTimeCodesPerSecond(24)
    skin = stage.OverridePrim(path)
    skin.AddAppliedSchema("PhysicsCollisionAPI")
    skin.CreateAttribute("primvars:skel:skinningMethod", Sdf.ValueTypeNames.Token).Set(method)
    sheet = Usd.Stage.CreateInMemory()
    sheet.GetRootLayer().ImportFromString("#usda 1.0\n" + cloth())
    Sdf.CopySpec(sheet.GetRootLayer(), "/cloth", stage.GetRootLayer(), "/cloth")
    stage.Save()
    scene, codes = wsim.load(tmp_path / "worn.usda"), [1.0, 2.0, 7.0, 20.0]
    ours = follow(scene, path, [(code - 1.0) / 24.0 for code in codes])
    for mine, theirs in zip(ours, baked(stage, path, codes), strict=True):
        np.testing.assert_allclose(mine, 0.5 * theirs, atol=1e-5 * np.ptp(theirs, axis=0).max())
    assert np.abs(ours[2] - ours[0]).max() > 0.01


def test_blend_shapes_with_inbetweens_move_a_collider_and_the_skeleton_does_too(read):
    text = character(mesh(COLLIDES, SHAPED), f"{RISES}\n{WEIGHTS}")
    scene = read(cloth() + text)
    (collider,) = scene.colliders
    authored, fps = scene.cloths[0].points, scene.fps          # the same sheet
    for code, lift, half, push in ((0, 0, 0, 0), (3, 0, 0.5, 0.0625), (6, 0, 1, 0.125), (12, 1, 0, 0.25)):
        rise = code / 24
        want = authored + (0.0, rise, 0.0)
        want[[0, 3]] += lift * np.array([(0, 1, 0), (0, 2, 0)]) + half * np.array([(0, 0.9, 0), (0, 0, 0)])
        want[1] += (push, 0, 0)
        np.testing.assert_allclose(collider.motion.points(collider.shape.poses.at(code / fps), code / fps), want, atol=1e-6)


def test_a_broken_binding_of_a_collider_is_one_line(read):
    broken = BOUND.replace("jointIndices = [0]", "jointIndices = [7]")
    said = "/char/skin: primvars:skel:jointIndices[0] is 7; allowed are 0 to 0, the joints of /char/bones"
    assert said in errors(read, cloth() + character(mesh(COLLIDES, broken)))
