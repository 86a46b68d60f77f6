"""`wsim new fluid`: a closed mesh becomes a scene in which it smokes; its file stays as it is."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom, Vt

from wsim import cli
from wsim.scene import Plane, SceneError, Surface, shapes
from wsim.scene.check.scene import check
from wsim.usd import load
from wsim.usd.new.fluid import author_fluid


@pytest.fixture
def source(tmp_path):
    """A ball of 40 cm radius about (1, 0, 2) m in a file of its own, in centimetres, Z up."""
    (tmp_path / "in").mkdir()
    stage = Usd.Stage.CreateNew(str(tmp_path / "in" / "mesh.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, "Z")
    points, counts, indices = shapes.sphere(40.0, 24)
    mesh = UsdGeom.Mesh.Define(stage, "/ball")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy((points + [100.0, 0.0, 200.0]).astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(counts))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(indices))
    stage.GetRootLayer().Save()
    return str(tmp_path / "in" / "mesh.usda")


def test_a_ball_smokes_in_a_box_with_room_above_it(source, tmp_path):
    before = Path(source).read_bytes()
    assert author_fluid(source, tmp_path / "s.usda", cells=40) == []
    scene = load(str(tmp_path / "s.usda"))
    (fluid,), (burner,) = scene.things("Fluid"), scene.things("Source")
    assert isinstance(burner.shape, Surface) and burner.hold and (burner.smoke, burner.temperature) == (1.0, 100.0)
    assert max(fluid.shape) == 40 and np.allclose((fluid.high - fluid.low) / fluid.cell, fluid.shape)
    assert (fluid.low < [0.6, -0.4, 1.6]).all() and (fluid.high > [1.4, 0.4, 2.4]).all()
    assert fluid.high[2] - 2.4 > 2.0 and np.allclose(0.5 * (fluid.low + fluid.high)[:2], [1.0, 0.0])
    assert fluid.sides == ("open",) * 6 and check(scene) == [] and Path(source).read_bytes() == before


def test_a_ground_is_the_floor_of_the_box(source, tmp_path):
    author_fluid(source, tmp_path / "s.usda", ground=0.3, frames=7, cells=24)
    scene = load(str(tmp_path / "s.usda"))
    (fluid,), (plane,) = scene.things("Fluid"), scene.colliders
    assert isinstance(plane.shape, Plane) and scene.frames == 7
    assert np.isclose(fluid.low[2], 1.3) and fluid.sides[4] == "closed" and fluid.sides.count("closed") == 1


def test_what_cannot_smoke_is_said(source, tmp_path):
    stage = Usd.Stage.Open(source)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/ball"))
    for given, said in (({"pins": ("top",)}, "pins: smoke has none"), ({"bound": "/m"}, "material: smoke has none"),
                        ({"cells": 4}, "cells: 4 along the longest edge")):
        with pytest.raises(SceneError, match=said):
            author_fluid(source, tmp_path / "s.usda", **given)
    counts = list(mesh.GetFaceVertexCountsAttr().Get())
    mesh.GetFaceVertexIndicesAttr().Set(list(mesh.GetFaceVertexIndicesAttr().Get())[counts[0]:])
    mesh.GetFaceVertexCountsAttr().Set(counts[1:])
    stage.GetRootLayer().Save()
    with pytest.raises(SceneError, match=f"/ball: is open at {counts[0]} edges"):
        author_fluid(source, tmp_path / "s.usda")
    assert not (tmp_path / "s.usda").exists()


def test_the_command_line_makes_the_same_scene(source, tmp_path, capsys):
    assert cli.main(["new", "fluid", source, "-o", str(tmp_path / "a.usda"), "--cells", "32", "--ground", "0"]) == 0
    author_fluid(source, tmp_path / "b.usda", cells=32, ground=0.0)
    assert "wsim run" in capsys.readouterr().out
    assert (tmp_path / "a.usda").read_text() == (tmp_path / "b.usda").read_text()
    assert cli.main(["check", str(tmp_path / "a.usda")]) == 0 and "1 source" in capsys.readouterr().out
