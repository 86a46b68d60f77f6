"""`wsim new fluid`, `new liquid`: a closed mesh becomes a scene in which it smokes or is water; its file stays as it is."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom, Vt

from wsim import cli
from wsim.scene import Plane, SceneError, Sphere, Surface, shapes
from wsim.scene.check.scene import check_scene
from wsim.simulation.simulation import Simulation
from wsim.usd import load
from wsim.usd.new.fluid import author_fluid, author_liquid


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
    assert fluid.sides == ("open",) * 6 and check_scene(scene) == [] and Path(source).read_bytes() == before


def test_a_ground_is_the_floor_of_the_box(source, tmp_path):
    author_fluid(source, tmp_path / "s.usda", ground=1.3, frames=7, cells=24)
    scene = load(str(tmp_path / "s.usda"))
    (fluid,), (plane,) = scene.things("Fluid"), scene.colliders
    assert isinstance(plane.shape, Plane) and scene.frames == 7
    assert np.isclose(fluid.low[2], 1.3) and fluid.sides[4] == "closed" and fluid.sides.count("closed") == 1


def test_a_ball_of_water_has_a_tank_to_fall_in(source, tmp_path):
    """Its volume, 2.8 % less than a ball's as the mesh has it, is that of the particles, to what cells of a fifth of its radius
    resolve."""
    before = Path(source).read_bytes()
    assert author_liquid(source, tmp_path / "s.usda", cells=24, frames=3) == []
    scene = load(str(tmp_path / "s.usda"))
    (tank,), (water,) = scene.things("Liquid"), scene.things("LiquidSource")
    assert isinstance(water.shape, Surface) and water.role == "start" and tank.sides == ("closed",) * 6
    assert np.allclose(tank.low[:2], [-0.2, -1.2]) and np.isclose(tank.low[2], 1.2) and tank.high[2] >= 2.8 - 1e-6
    assert check_scene(scene) == [] and Path(source).read_bytes() == before
    stage = Usd.Stage.Open(str(tmp_path / "s.usda"))
    assert UsdGeom.Imageable(stage.GetPrimAtPath(water.path)).ComputePurpose() == "guide"
    sim = Simulation(scene, device="cpu")
    ball, particle = 0.26052, tank.cell**3 / 8.0                        # [m^3] of the mesh: sum of its tets from its middle
    assert sim.indicators()["liquid_particles"] * particle == pytest.approx(ball, rel=0.02)
    sim.run()
    assert sim.indicators()["liquid_volume"] == pytest.approx(ball, rel=0.05)


def test_water_stands_on_a_ground(source, tmp_path):
    author_liquid(source, tmp_path / "s.usda", ground=1.6, cells=24)
    scene = load(str(tmp_path / "s.usda"))
    assert np.isclose(scene.things("Liquid")[0].low[2], 1.6) and isinstance(scene.colliders[0].shape, Plane)
    assert check_scene(scene) == []


def test_a_ball_that_moves_smokes_in_a_box_about_all_of_its_way(tmp_path):
    """A Sphere of 10 cm from x = 0 to 1 m: room for it beside both ends. Points with widths likewise."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "ball.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(10)
    ball = UsdGeom.Sphere.Define(stage, "/ball")
    ball.CreateRadiusAttr(0.1)
    move = ball.AddTranslateOp()
    move.Set((0, 0, 0), 0)
    move.Set((1, 0, 0), 10)
    sparks = UsdGeom.Points.Define(stage, "/sparks")
    sparks.CreatePointsAttr([(5, 0, 0), (5, 0.5, 0)])
    sparks.CreateWidthsAttr([0.2])
    stage.Save()
    assert author_fluid(tmp_path / "ball.usda", tmp_path / "a.usda", cells=24, prim="ball") == []
    scene = load(str(tmp_path / "a.usda"))
    (air,) = scene.things("Fluid")
    assert air.low[0] < -0.5 and air.high[0] > 1.5 and scene.things("Source")[0].shape == Sphere(0.1)
    assert check_scene(scene) == []
    assert author_liquid(tmp_path / "ball.usda", tmp_path / "b.usda", cells=24, prim="sparks") == []
    scene = load(str(tmp_path / "b.usda"))
    (tank,) = scene.things("Liquid")
    assert tank.low[0] < 4.7 and tank.high[1] > 0.6 and check_scene(scene) == []
    assert len(scene.things("LiquidSource")[0].shape.points) == 2


def test_what_cannot_smoke_is_said(source, tmp_path):
    stage = Usd.Stage.Open(source)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/ball"))
    for given, said in (({"pins": ("top",)}, "pins: smoke has none"), ({"bound": "/m"}, "material: smoke has none"),
                        ({"cells": 4}, "cells: 4 along the longest edge")):
        with pytest.raises(SceneError, match=said):
            author_fluid(source, tmp_path / "s.usda", **given)
        with pytest.raises(SceneError, match=said.replace("smoke", "liquid")):
            author_liquid(source, tmp_path / "s.usda", **given)
    counts = list(mesh.GetFaceVertexCountsAttr().Get())
    mesh.GetFaceVertexIndicesAttr().Set(list(mesh.GetFaceVertexIndicesAttr().Get())[counts[0]:])
    mesh.GetFaceVertexCountsAttr().Set(counts[1:])
    stage.GetRootLayer().Save()
    for author in (author_fluid, author_liquid):
        with pytest.raises(SceneError, match=f"/ball: is open at {counts[0]} edges"):
            author(source, tmp_path / "s.usda")
    assert not (tmp_path / "s.usda").exists()


@pytest.mark.parametrize(("kind", "author"), [("fluid", author_fluid), ("liquid", author_liquid)])
def test_the_command_line_makes_the_same_scene(kind, author, source, tmp_path, capsys):
    assert cli.main(["new", kind, source, "-o", str(tmp_path / "a.usda"), "--cells", "32", "--ground", "0"]) == 0
    author(source, tmp_path / "b.usda", cells=32, ground=0.0)
    assert "wsim run" in capsys.readouterr().out
    assert (tmp_path / "a.usda").read_text() == (tmp_path / "b.usda").read_text()
    assert cli.main(["check", str(tmp_path / "a.usda")]) == 0
    assert {"fluid": "1 source, 1 fluid", "liquid": "1 liquid source, 1 liquid"}[kind] in capsys.readouterr().out
