"""`wsim new robot`: what it asks a converter for, and what it takes from the model. The converter is one of this test."""

import json
import os
import stat
import sys

import pytest
from pxr import Usd, UsdGeom, UsdPhysics

from wsim.cli import main
from wsim.physics.rigid.mass import body_inertia
from wsim.usd import load
from wsim.usd.new.robot.converter import failure_reason

CONVERTER = """#!{python}
import sys
from pxr import Usd, UsdGeom, UsdPhysics
file, folder = sys.argv[-2:]
if "bad" in file:
    sys.exit("line 3: no such element")
stage = Usd.Stage.CreateNew(folder + "/robot.usda")
UsdGeom.SetStageMetersPerUnit(stage, 1.0)
UsdGeom.SetStageUpAxis(stage, "Z")
stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/robot").GetPrim())
UsdPhysics.Scene.Define(stage, "/robot/scene")
rail = UsdGeom.Cube.Define(stage, "/robot/rail")
UsdPhysics.CollisionAPI.Apply(rail.GetPrim())
for k in range(0 if "empty" in file else 3):
    body = UsdGeom.Cube.Define(stage, "/robot" + "/link" * (k + 1))
    body.CreateSizeAttr(1.0)
    body.AddTranslateOp().Set((0.0, 0.0, 5.0 if k == 0 else 0.25))
    UsdPhysics.CollisionAPI.Apply(body.GetPrim())
    UsdPhysics.RigidBodyAPI.Apply(body.GetPrim())
stage.Save()
"""
# the world's geom and the first two links touch nothing of their kind; the third touches all
MODEL = {"geoms": [[0, 0, 1], [1, 0, 1], [2, 0, 1], [3, 1, 1]], "mass": [0.0, 2.0, 3.0, 4.0],
         "places": [[0, 0, 0], [0, 0, 5], [0, 0, 5.25], [0, 0, 5.5]], "moments": [[0, 0, 0]] + 3 * [[0.1, 0.2, 0.25]],
         "center": 4 * [[0.0, 0.0, 0.1]], "axes": 4 * [[1.0, 0.0, 0.0, 0.0]]}
PYTHON = """#!{python}
import sys
open(sys.argv[-1], "w").write({model!r})
"""


@pytest.fixture
def converter(tmp_path, monkeypatch):
    folder = tmp_path / "env" / ("Scripts" if os.name == "nt" else "bin")
    folder.mkdir(parents=True)
    texts = {"mujoco_usd_converter": CONVERTER, "urdf_usd_converter": CONVERTER, "python": PYTHON}
    for name, text in texts.items():
        (folder / name).write_text(text.format(python=sys.executable, model=json.dumps(MODEL)))
        (folder / name).chmod(stat.S_IRWXU)
    monkeypatch.setenv("WSIM_ROBOTS", str(tmp_path / "env"))
    monkeypatch.chdir(tmp_path)


def test_without_a_converter_it_says_how_to_get_one(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("WSIM_ROBOTS", str(tmp_path / "none"))
    monkeypatch.setenv("PATH", str(tmp_path))
    (tmp_path / "a.xml").write_text("<mujoco/>")
    assert main(["new", "robot", str(tmp_path / "a.xml"), "-o", str(tmp_path / "a.usda")]) == 1
    said = capsys.readouterr().err
    assert "mujoco-usd-converter: is not installed" in said and "-m venv" in said and not (tmp_path / "a.usda").exists()


@pytest.mark.skipif(os.name == "nt", reason="the converter of this test is a script that Windows does not start")
def test_a_model_gives_its_masses_and_keeps_apart_what_its_masks_do(converter, tmp_path):
    (tmp_path / "a.xml").write_text("<mujoco/>")
    assert main(["new", "robot", "a.xml", "-o", "a.usda", "--ground", "-1.5", "--frames", "12"]) == 0
    scene = load("a.usda")
    bodies = [body_inertia(body) for body in scene.things("Body")]
    assert [round(body.mass, 5) for body in bodies] == [2.0, 3.0, 4.0] and scene.frames == 12
    assert abs(bodies[1].moments - (0.1, 0.2, 0.25)).max() < 1e-6 and abs(bodies[1].center - (0.0, 0.0, 0.1)).max() < 1e-6
    links = ["/robot/link", "/robot/link/link", "/robot/link/link/link"]
    assert {p.path: set(p.others) for p in scene.things("FilteredPairs")} == {links[0]: {links[1], "/robot/rail"},
                                                                     links[1]: {"/robot/rail"}}
    ground = next(c for c in scene.colliders if c.path.endswith("ground"))
    assert abs(ground.motion.at(0.0)[2, 3] - (-1.0 - 0.5)) < 1e-6                # the rail reaches down to -1


@pytest.mark.skipif(os.name == "nt", reason="the converter of this test is a script that Windows does not start")
def test_what_a_converter_refuses_is_told_and_leaves_nothing(converter, tmp_path, capsys):
    (tmp_path / "bad.urdf").write_text("<robot/>")
    assert main(["new", "robot", "bad.urdf", "-o", "b.usda"]) == 1
    assert "bad.urdf: urdf_usd_converter refuses it: line 3: no such element" in capsys.readouterr().err
    assert not (tmp_path / "b.usda").exists() and not (tmp_path / "b_robot").exists()
    (tmp_path / "empty.urdf").write_text("<robot/>")
    assert main(["new", "robot", "empty.urdf", "-o", "b.usda"]) == 1
    assert "empty.urdf: has no body; allowed: at least one that moves; fix: " in capsys.readouterr().err
    assert not (tmp_path / "b.usda").exists() and not (tmp_path / "b_robot").exists()
    assert main(["new", "robot", "a.obj", "-o", "b.usda"]) == 1
    assert "ends in '.obj'; allowed is .urdf, or .xml of MuJoCo" in capsys.readouterr().err


@pytest.mark.parametrize(("said", "reason"), [
    (["Traceback (most recent call last):", "ValueError: Error: range[0] should be smaller than range[1] in joint",
      "Element name 'j', id 0, line 1"],
     "Error: range[0] should be smaller than range[1] in joint Element name 'j', id 0, line 1"),
    (["[Warning] [a.b] Conversion failed:", "Error in 'a.b' at line 56 in file /x/mesh.py : 'Python runtime error: Mesh m file "
      "gone.stl does not exist'"], "Mesh m file gone.stl does not exist"),
    (["[Warning] [a.b] Conversion failed: XML Error: Unrecognized XML model type: 'html'"],
     "XML Error: Unrecognized XML model type: 'html'"), ([], "no reason")])
def test_reasons_are_those_of_the_last_error(said, reason):
    assert failure_reason(said) == reason


@pytest.mark.skipif(os.name == "nt", reason="the converter of this test is a script that Windows does not start")
def test_a_folder_of_somebody_else_is_kept_and_one_of_its_own_replaced(converter, tmp_path, capsys):
    (tmp_path / "a.urdf").write_text("<robot/>")
    (tmp_path / "a_robot").mkdir()
    (tmp_path / "a_robot" / "mine.usda").write_text("#usda 1.0")
    assert main(["new", "robot", "a.urdf", "-o", "a.usda", "--force"]) == 1
    assert "a_robot: is there already, and not by this command" in capsys.readouterr().err
    assert (tmp_path / "a_robot" / "mine.usda").read_text() == "#usda 1.0"
    for _ in range(2):
        assert main(["new", "robot", "a.urdf", "-o", "b.usda", "--force"]) == 0
    for out in ("b.txt", "nowhere/b.usda"):
        assert main(["new", "robot", "a.urdf", "-o", out]) == 1
        assert f"{out}: is no place for a scene" in capsys.readouterr().err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.urdf", "a_robot", "b.usda", "b_robot", "env"]


def test_the_masses_of_bodies_within_bodies_stay_apart(tmp_path):
    """A pair of filtered bodies says nothing of the bodies within them."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    for path in ("/a", "/a/b", "/c"):
        cube = UsdGeom.Cube.Define(stage, path)
        cube.CreateSizeAttr(1.0)
        UsdPhysics.RigidBodyAPI.Apply(cube.GetPrim())
        UsdPhysics.CollisionAPI.Apply(cube.GetPrim())
    UsdPhysics.FilteredPairsAPI.Apply(stage.GetPrimAtPath("/a")).CreateFilteredPairsRel().SetTargets(["/c"])
    stage.Save()
    from wsim.physics.rigid.joints.filters.groups import contact_filters
    scene = load(stage)
    owned = [(body.path, 0, body.colliders[0].path) for body in scene.things("Body")]
    found = contact_filters(scene, owned)
    paths = [path for path, *_ in owned]
    apart = {(paths[k], paths[j]) for k in range(3) for j in found.parted[found.first[k]:found.first[k + 1]]}
    assert apart == {("/a", "/c"), ("/c", "/a")}
