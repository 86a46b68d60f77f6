"""Meshes under a skeleton: one that a skeleton moves is refused, and results are not skinned once more."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdSkel

from tests.make.usda import APIS, SHEET, Reader, cloth, errors
from tests.make.validate import validate
from wsim.scene import Scene
from wsim.usd.result.recorder import Recorder

BOUND = """
    rel skel:skeleton = </char/bones>
    int[] primvars:skel:jointIndices = [0] (elementSize = 1
        interpolation = "constant")
    float[] primvars:skel:jointWeights = [1] (elementSize = 1
        interpolation = "constant")"""
COLLIDES = 'prepend apiSchemas = ["PhysicsCollisionAPI", "SkelBindingAPI"]'
SIMULATED = APIS.replace("]", ', "SkelBindingAPI"]')
RISES = "float3[] translations.timeSamples = {0: [(0, 0, 0)], 12: [(0, 0.5, 0)]}"
STANDS = "float3[] translations = [(0, 0, 0)]"


def character(mesh: str, moves: str = RISES, root: str = "", rest: str = "(0, 0, 0, 1)", kind: str = "SkelRoot") -> str:
    """A SkelRoot with a skeleton of one joint, what moves it, and meshes."""
    one = "( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), {} )"
    return f"""
def {kind} "char" (prepend apiSchemas = ["SkelBindingAPI"]) {{
    {root}
    def Skeleton "bones" (prepend apiSchemas = ["SkelBindingAPI"]) {{
        uniform token[] joints = ["hip"]
        uniform matrix4d[] bindTransforms = [{one.format("(0, 0, 0, 1)")}]
        uniform matrix4d[] restTransforms = [{one.format(rest)}]
        rel skel:animationSource = </char/walk>
    }}
    def SkelAnimation "walk" {{
        uniform token[] joints = ["hip"]
        {moves}
        quatf[] rotations = [(1, 0, 0, 0)]
        half3[] scales = [(1, 1, 1)]
    }}
    {mesh}
}}
"""


def mesh(apis: str, extra: str = BOUND, name: str = "skin") -> str:
    return f'def Mesh "{name}" ({apis}) {{{SHEET}\n{extra}\n}}\n'


BALL = f'def Sphere "ball" ({COLLIDES}) {{{BOUND}\n}}\n'
INHERITED = "\n".join(line for line in BOUND.splitlines() if "rel skel" not in line)


@pytest.fixture
def read(tmp_path):
    return Reader(tmp_path)


@pytest.mark.parametrize(("text", "path"), [
    (cloth() + character(mesh(COLLIDES)), "/char/skin"), (cloth() + character(BALL), "/char/ball"),
    (character(mesh(SIMULATED)), "/char/skin"),
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
