"""`wsim new cloth`: a bare mesh becomes a scene, and its file stays as it is."""

import os

import numpy as np
import pytest
from pxr import Usd, UsdValidation

from wsim.scene import Plane, SceneError
from wsim.scene.fabric import FABRICS, Fabric
from wsim.usd import load
from wsim.usd.new.cloth import author_cloth

SHIRT = """#usda 1.0
({header})
def "garment"
{{
    def Mesh "shirt" {{
        point3f[] points = [(0, 100, 0), (70, 100, 0), (70, 170, 0), (0, 170, 0)]
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
    }}
    {more}
}}
"""


@pytest.fixture
def shirt(tmp_path):
    (tmp_path / "in").mkdir()

    def write(header='doc = ""', more="", name="shirt.usda"):
        path = tmp_path / "in" / name
        path.write_text(SHIRT.format(header=header, more=more))
        return path
    return write


def test_a_bare_mesh_becomes_a_scene_that_leaves_the_mesh_alone(shirt, tmp_path):
    mesh = shirt()
    before = mesh.read_bytes()
    notes = author_cloth(mesh, tmp_path / "scene.usda", "denim", weld=1e-4, ground=0.5)
    assert mesh.read_bytes() == before and sorted(os.listdir(tmp_path)) == ["in", "scene.usda"]
    assert "@./in/shirt.usda@" in (tmp_path / "scene.usda").read_text()
    scene = load(tmp_path / "scene.usda")
    sheet, ground = scene.cloths[0], scene.colliders[0]
    assert sheet.path == "/garment/shirt" and sheet.weld == pytest.approx(1e-4, rel=1e-12)
    for name in ("stretch", "shear", "bend", "thickness", "density", "static_friction"):
        assert getattr(sheet.material, name) == pytest.approx(getattr(FABRICS["denim"], name), rel=1e-6), name
    assert np.ptp(sheet.points[:, 1]) == pytest.approx(0.7, rel=1e-6) and scene.gravity == (0.0, -9.81, 0.0)
    assert isinstance(ground.shape, Plane) and ground.motion.at(0.0)[1, 3] == pytest.approx(0.5)      # its own at 1 m
    assert np.allclose(ground.motion.at(0.0)[:3, 2], (0, 1, 0))
    assert any("authors none" in note.text for note in notes)


def test_a_shirt_seventy_metres_tall_is_reported_and_meters_per_unit_mends_it(shirt, tmp_path):
    mesh = shirt('metersPerUnit = 1\nupAxis = "Z"')
    notes = author_cloth(mesh, tmp_path / "a.usda")
    assert any("70 m large" in note.text and "meters_per_unit = 0.01" in note.text for note in notes)
    assert author_cloth(mesh, tmp_path / "b.usda", meters_per_unit=0.01, ground=0.0) == []
    scene = load(tmp_path / "b.usda")
    assert np.ptp(scene.cloths[0].points[:, 1]) == pytest.approx(0.7, rel=1e-6) and scene.up == "Z"
    assert scene.gravity == (0.0, 0.0, -9.81) and np.allclose(scene.colliders[0].motion.at(0.0)[:3, 2], (0, 0, 1))


def test_usd_cores_validators_pass_on_what_is_authored(shirt, tmp_path):
    author_cloth(shirt("metersPerUnit = 0.01\nupAxis = \"Y\"", name="s.usda"), tmp_path / "scene.usda", ground=0.1)
    stage = Usd.Stage.Open(str(tmp_path / "scene.usda"))
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    assert [e.GetMessage() for e in context.Validate(stage) if e.GetName() != "MissingExtent"] == []


def test_a_fabric_of_ones_own_and_the_files_time_range_are_taken(shirt, tmp_path):
    mesh = shirt("metersPerUnit = 0.01\nstartTimeCode = 5\nendTimeCode = 45\ntimeCodesPerSecond = 30")
    author_cloth(mesh, tmp_path / "scene.usdc", Fabric(stretch=321.0, poisson=0.25))
    scene = load(tmp_path / "scene.usdc")
    assert scene.cloths[0].material == Fabric(stretch=321.0, poisson=0.25)
    assert (scene.start, scene.frames, scene.fps) == (5.0, 40, 30.0)


def test_the_scene_of_the_mesh_is_kept_if_it_has_one(shirt, tmp_path):
    mesh = shirt("metersPerUnit = 0.01", 'def PhysicsScene "own" {\nfloat physics:gravityMagnitude = 162\n}')
    author_cloth(mesh, tmp_path / "scene.usda")
    assert load(tmp_path / "scene.usda").gravity == pytest.approx((0.0, -1.62, 0.0))


def test_two_meshes_need_a_name(shirt, tmp_path):
    mesh = shirt("metersPerUnit = 0.01", 'def Mesh "sleeve" {\npoint3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n'
                 "int[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 2]\n}")
    with pytest.raises(SceneError, match="/garment/shirt, /garment/sleeve"):
        author_cloth(mesh, tmp_path / "scene.usda")
    author_cloth(mesh, tmp_path / "scene.usda", prim="/garment/sleeve")
    assert load(tmp_path / "scene.usda").cloths[0].path == "/garment/sleeve"


@pytest.mark.parametrize("change, said", [
    ({"prim": "/garment/trousers"}, "its meshes: /garment/shirt"), ({"fabric": "wool"}, "silk, cotton, denim"),
    ({"meters_per_unit": -1.0}, "allowed is a finite number > 0"), ({"out": "scene.txt"}, "allowed is .usda"),
    ({"out": "no/scene.usda"}, "does not exist"), ({"out": "in/shirt.usda"}, "choose another output"),
    ({"mesh_file": "in/none.usda"}, "no such file")])
def test_bad_requests_are_one_clear_error_and_write_nothing(shirt, tmp_path, change, said):
    request = {"mesh_file": shirt(), "out": "scene.usda", **change}
    request = {k: tmp_path / v if k in ("mesh_file", "out") else v for k, v in request.items()}
    with pytest.raises(SceneError) as error:
        author_cloth(**request)
    assert said in str(error.value)
    assert sorted(os.listdir(tmp_path)) == ["in"] and os.listdir(tmp_path / "in") == ["shirt.usda"]


def test_a_mesh_that_cannot_be_simulated_is_not_made_a_scene(tmp_path):
    text = SHIRT.format(header="metersPerUnit = 0.01", more="").replace("[0, 1, 2, 3]", "[0, 1, 2, 7]")
    (tmp_path / "bad.usda").write_text(text)
    with pytest.raises(SceneError, match="/garment/shirt"):
        author_cloth(tmp_path / "bad.usda", tmp_path / "scene.usda")
    assert os.listdir(tmp_path) == ["bad.usda"]


def test_a_mesh_in_an_instance_names_the_instance(tmp_path):
    text = SHIRT.format(header="metersPerUnit = 0.01", more="").replace('def "garment"', 'class "garment"')
    copy = 'def Xform "copy" (instanceable = true\nprepend references = </garment>) {}\n'
    (tmp_path / "i.usda").write_text(text + copy)
    with pytest.raises(SceneError, match="instanceable = false on /copy"):
        author_cloth(tmp_path / "i.usda", tmp_path / "scene.usda")


@pytest.mark.parametrize(("last", "flat"), [("(0, 170, 0)", True), ("(0, 170, 20)", False)])
def test_rest_angles_are_those_of_the_mesh_unless_it_is_flat(shirt, tmp_path, last, flat):
    mesh = shirt()
    mesh.write_text(mesh.read_text().replace("(0, 170, 0)", last))
    author_cloth(mesh, tmp_path / "scene.usda")
    assert load(tmp_path / "scene.usda").cloths[0].flat is flat


def test_of_several_meshes_one_is_named_by_path_holder_or_name(shirt, tmp_path):
    square = """{ point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
    }"""
    mesh = shirt("metersPerUnit = 1", more=f'def Xform "a" {{ def Mesh "hem" {square}\n }}\n def Mesh "cuff" {square}')
    for prim, found in (("/garment/cuff", "/garment/cuff"), ("/garment/a", "/garment/a/hem"), ("hem", "/garment/a/hem")):
        author_cloth(mesh, tmp_path / "scene.usda", prim=prim)
        assert load(tmp_path / "scene.usda").cloths[0].path == found
    with pytest.raises(SceneError, match="3 meshes; name one by prim .*: /garment/shirt, /garment/a/hem, /garment/cuff"):
        author_cloth(mesh, tmp_path / "scene.usda")
    with pytest.raises(SceneError, match="no Mesh at /garment/b; its meshes: /garment/shirt"):
        author_cloth(mesh, tmp_path / "scene.usda", prim="/garment/b")
