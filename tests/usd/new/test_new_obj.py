"""OBJ files: read as surfaces, and as what `wsim new` makes scenes of."""

import numpy as np
import pytest

from wsim import cli
from wsim.scene import shapes
from wsim.usd import load

CLOTH = "# a square\no cloth\nv 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nv 9 9 9\nvt 0 0\nf 1/1/1 2/1 3//2 4\nf -5 -3 -4\n"


@pytest.fixture
def write(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda text: (tmp_path / "a.obj").write_text(text)


def test_faces_are_read_with_any_form_of_index_and_without_points_that_none_has(write):
    write(CLOTH)
    points, counts, indices = shapes.read_obj("a.obj")
    assert points.tolist() == [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]
    assert counts.tolist() == [4, 3] and indices.tolist() == [0, 1, 2, 3, 0, 2, 1]


@pytest.mark.parametrize(("text", "said"), [
    ("v 0 0\n", "line 1: a point has 2 coordinates"), ("v 0 0 x\n", "line 1: 'v 0 0 x' has no numbers"),
    ("v 0 0 0\nf 1 1 2\n", "line 2: 'f 1 1 2' names 3 points of the 1 before it"),
    ("v 0 0 0\nf 1 1\n", "line 2: 'f 1 1' names 2 points"), ("v 0 0 0\nf 1 1 -2\n", "line 2"), ("v 0 0 0\n", "has no faces"),
    ("", "has no faces")])
def test_what_is_wrong_is_said_with_its_line(write, capsys, text, said):
    write(text)
    with pytest.raises(ValueError, match=said):
        shapes.read_obj("a.obj")
    assert cli.main(["new", "cloth", "a.obj", "-o", "b.usda"]) == 1 and f"a.obj: {said}" in capsys.readouterr().err


def test_an_obj_becomes_a_scene_and_a_collider(write, tmp_path, capsys):
    write(CLOTH.replace("f -5 -3 -4\n", ""))
    (tmp_path / "box.obj").write_text("v 0 -1 0\nv 1 -1 0\nv 1 -1 1\nf 1 3 2\n")
    assert cli.main(["new", "cloth", "a.obj", "--pin", "0", "--collider", "box.obj", "-o", "b.usda"]) == 0
    assert "a.obj: has no unit: its numbers are taken as metres, so that it is 1 m large" in capsys.readouterr().err
    scene = load("b.usda")
    (sheet,), (collider,) = scene.cloths, scene.colliders
    assert np.allclose(np.ptp(sheet.points, axis=0), (1, 0, 1)) and len(collider.shape.points) == 3 and scene.up == "Y"
    assert cli.main(["new", "cloth", "a.obj", "-o", "c.usda"]) == 1
    assert "a_mesh.usdc: is there already" in capsys.readouterr().err
    assert cli.main(["new", "cloth", "a.obj", "-o", "b.usda", "--force", "--meters-per-unit", "0.01"]) == 0
    assert np.allclose(np.ptp(load("b.usda").cloths[0].motion.points(load("b.usda").cloths[0].points), axis=0), (0.01, 0, 0.01))


@pytest.mark.parametrize(("name", "said"), [("a.obj", "`wsim new cloth a.obj -o SCENE`"), ("a.urdf", "`wsim new robot a.urdf"),
                                            ("a.fbx", "export it to USD or OBJ")])
def test_other_formats_are_told_how_to_come_in(tmp_path, monkeypatch, capsys, name, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_text("x")
    assert cli.main(["check", name]) == 1
    out = capsys.readouterr()
    assert said in out.out + out.err
