"""`wsim new softbody`: a bare TetMesh, or a closed mesh in a cage of tets, becomes a scene; its file stays as it is."""

import os
from types import SimpleNamespace

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdValidation, Vt

from wsim import cli
from wsim.geometry.tetra.tets import signed_tet_volumes, tet_surface_triangles
from wsim.scene import Plane, Scene, SceneError, shapes
from wsim.scene.curve import Motion
from wsim.scene.nodal.masses import soft_masses
from wsim.scene.solid import Bulk
from wsim.usd import load, save
from wsim.usd.new.softbody import author_softbody

MIRROR = Gf.Matrix4d(-2, 0, 0, 0, 0, 1, 0, 0, 0, 0.5, 1, 0, 50, 0, 100, 1)      # of row vectors; det -2


@pytest.fixture
def source(tmp_path):
    """Makes a stage in a folder of its own, in centimetres, Z up; `ball` adds a ball of 40 cm radius, `block` a TetMesh."""
    (tmp_path / "in").mkdir()
    stage = Usd.Stage.CreateNew(str(tmp_path / "in" / "mesh.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, "Z")
    return stage


def ball(stage: Usd.Stage, path: str = "/ball/mesh", at=(0.0, 0.0, 0.0)) -> UsdGeom.Mesh:
    points, counts, indices = shapes.sphere(40.0, 24)
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy((points + at).astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(counts))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(indices))
    return mesh


def block(stage: Usd.Stage, tets=None) -> UsdGeom.TetMesh:
    points, own = shapes.block((100, 100, 100), 2)
    mesh = UsdGeom.TetMesh.Define(stage, "/block")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    mesh.CreateTetVertexIndicesAttr(Vt.Vec4iArray.FromNumpy(np.ascontiguousarray(own if tets is None else tets, np.int32)))
    return mesh


def made(stage: Usd.Stage, tmp_path, *arguments, **more):
    """The scene that is made of a stage, and the warnings."""
    stage.Save()
    notes = author_softbody(tmp_path / "in" / "mesh.usda", tmp_path / "scene.usda", *arguments, **more)
    return load(tmp_path / "scene.usda"), [note.text for note in notes]


def faults(stage) -> list[str]:
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    return [e.GetMessage() for e in context.Validate(stage) if e.GetName() != "MissingExtent"]


def test_a_closed_mesh_gets_a_cage_that_weighs_what_it_encloses(source, tmp_path):
    """Twice 4/3 pi r^3 at 900 kg/m^3, in a frame that mirrors, stretches and shears. What `filled` counts is right to 0.5 % at
    12 cells, and the ball's 24 sides lack 5/12 (2 pi / 24)^2 = 2.9 % of its volume."""
    frame = UsdGeom.Xform.Define(source, "/ball").AddTransformOp()
    frame.Set(MIRROR)
    mesh = ball(source)
    material = Bulk(young=1.23456e5, poisson=0.4, density=900.0, model="neo_hookean")
    source.Save()
    before = (tmp_path / "in" / "mesh.usda").read_bytes()
    scene, notes = made(source, tmp_path, material, cells=12, ground=-0.75)
    assert (tmp_path / "in" / "mesh.usda").read_bytes() == before and sorted(os.listdir(tmp_path)) == ["in", "scene.usda"]
    (soft,), (ground,) = scene.softs, scene.colliders
    world = soft.motion.points(soft.points)
    assert soft.path == "/ball/tets" and soft.material == material and notes == []
    assert (signed_tet_volumes(world, soft.tets) > 0).all()
    exact = 2.0 * 4.0 / 3.0 * np.pi * 0.4**3
    assert 0.966 * 900.0 * exact < soft_masses(soft, world)[0].sum() < 1.005 * 900.0 * exact
    (skin,) = soft.skins
    places = np.array(mesh.GetPointsAttr().Get(), float) @ np.array(MIRROR)[:3, :3] + np.array(MIRROR)[3, :3]
    assert skin.path == "/ball/mesh" and np.abs(soft.motion.points(skin.points) - 0.01 * places).max() < 1e-6
    assert isinstance(ground.shape, Plane) and scene.gravity == (0.0, 0.0, -9.81)
    assert ground.motion.at(0.0)[2, 3] == pytest.approx(-0.75, abs=1e-6)
    assert faults(Usd.Stage.Open(str(tmp_path / "scene.usda"))) == []


@pytest.mark.parametrize("path", ["/ball", "/room/ball"])
def test_a_mesh_among_others_moves_into_a_body_of_its_own(source, tmp_path, path):
    """Else the body would take in every mesh of the room. It stays where it was, with what it is bound to."""
    if path != "/ball":
        UsdGeom.Xform.Define(source, "/room").AddTranslateOp().Set((0, 0, 30))
        ball(source, "/room/other", (200, 0, 0))
    mesh = ball(source, path)
    mesh.AddTranslateOp().Set((7, 8, 9))
    source.DefinePrim("/looks", "Material")
    mesh.GetPrim().ApplyAPI("MaterialBindingAPI")
    mesh.GetPrim().CreateRelationship("material:binding").SetTargets(["/looks"])
    mesh.GetPrim().ApplyAPI("PhysicsCollisionAPI")
    source.SetDefaultPrim(source.GetPrimAtPath(path.partition("/ball")[0] or "/ball"))
    scene, notes = made(source, tmp_path, prim=path)
    (soft,) = scene.softs
    assert notes == [] and soft.path == f"{path}_body/tets" and [s.path for s in soft.skins] == [f"{path}_body/ball"]
    up = 0.39 if path != "/ball" else 0.09
    assert np.allclose(soft.motion.points(soft.skins[0].points).mean(axis=0), (0.07, 0.08, up), atol=1e-6)
    stage = Usd.Stage.Open(str(tmp_path / "scene.usda"))
    assert not stage.GetPrimAtPath(path).IsActive() and stage.GetDefaultPrim().IsActive() and scene.colliders == []
    moved = stage.GetPrimAtPath(f"{path}_body/ball")
    assert moved.GetTypeName() == "Mesh" and moved.GetRelationship("material:binding").GetTargets() == [Sdf.Path("/looks")]
    assert faults(stage) == []


def test_a_mesh_far_from_the_origin_has_a_cage_as_exact_as_near(source, tmp_path):
    """Its own points are near, its frame is 10 km away: cells are equal to float32 of the ball's own size."""
    ball(source).AddTranslateOp().Set((1e6, 0, -1e6))
    scene, _ = made(source, tmp_path)
    world = scene.softs[0].motion.points(scene.softs[0].points)
    size = np.abs(signed_tet_volumes(world, scene.softs[0].tets) / 0.08**3)
    assert np.minimum(np.abs(size - 1 / 3), np.abs(size - 1 / 6)).max() < 20 * np.finfo(np.float32).eps


def _volume(skin) -> float:
    """[m^3] that the triangles of a skin enclose, positive where they face outwards."""
    a, b, c = skin.points.astype(float)[skin.indices.reshape(-1, 3)].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


@pytest.mark.parametrize("left", [False, True])
def test_a_tet_mesh_is_used_as_it_is(source, tmp_path, left):
    tets = shapes.block((1, 1, 1), 2)[1]
    mesh = block(source, tets[:, [0, 1, 3, 2]] if left else tets)
    mesh.CreateOrientationAttr("leftHanded" if left else "rightHanded")
    ball(source)                                                   # the TetMesh counts where there are both
    scene, notes = made(source, tmp_path, ground=-1.5)
    (soft,) = scene.softs
    assert soft.path == "/block_body/block" and np.array_equal(soft.tets, tets) and notes == [] and soft.filled is None
    assert scene.colliders[0].motion.at(0.0)[2, 3] == pytest.approx(-1.5)
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "scene.usda"))
    assert not layer.GetAttributeAtPath("/block_body/block.tetVertexIndices")
    assert not layer.GetAttributeAtPath("/block_body/block.points")
    (skin,) = soft.skins                                           # what tools without TetMesh show, and follows it
    assert skin.path == "/block_body/surface" and 2 * len(skin.counts) == 2 * 6 * 2 * 2 * 2
    assert _volume(skin) == pytest.approx(1.0) and faults(Usd.Stage.Open(str(tmp_path / "scene.usda"))) == []


def test_flaws_of_a_tet_mesh_are_mended_with_a_warning(source, tmp_path):
    """Three tets wound wrongly, one flat (four corners of a side), one given twice: afterwards it loads without a word."""
    tets = shapes.block((1, 1, 1), 2)[1]
    bad = np.concatenate([tets, [[0, 1, 3, 4]], tets[7:8, [2, 3, 0, 1]]])
    bad[:3] = bad[:3, [1, 0, 2, 3]]
    block(source, bad)
    scene, notes = made(source, tmp_path)
    assert notes == ["2 of its 42 tets are flat or given twice; they are left out",
                     "3 of its 42 tets are wound against its orientation (first: tet 0); they are turned"]
    world = scene.softs[0].motion.points(scene.softs[0].points)
    assert signed_tet_volumes(world, scene.softs[0].tets).sum() == pytest.approx(1.0) and len(scene.softs[0].tets) == 40
    assert not any("wound" in note.text for note in scene.notes)


def test_bad_requests_are_one_clear_error_and_write_nothing(source, tmp_path, capsys):
    sheet = UsdGeom.Mesh.Define(source, "/sheet")
    points, counts, indices = shapes.sheet(50, 50, 3, 3)
    sheet.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    sheet.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(counts))
    sheet.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(indices))
    ball(source, "/ball")
    block(source, [[0, 1, 2, 99]])
    for change, said in (({"prim": "/sheet"}, "/sheet: encloses nothing"), ({"prim": "/no"}, "no TetMesh or Mesh at /no"),
                         ({"prim": "/ball", "cells": 0}, "/ball: no cage of tets can be made around it: cells is 0"),
                         ({}, "/block: tet 0 is naming points that there are not"),
                         ({"prim": "/ball", "meters_per_unit": 0.0}, "allowed is a finite number > 0")):
        with pytest.raises(SceneError) as error:
            made(source, tmp_path, **change)
        assert said in str(error.value)
    wrong = ["new", "softbody", str(tmp_path / "in" / "mesh.usda"), "-o", str(tmp_path / "a.usda"), "--poisson", "0.5"]
    assert cli.main(wrong) == 1 and "poisson is 0.5; allowed is > -1 and < 0.5" in capsys.readouterr().err
    assert os.listdir(tmp_path) == ["in"]


def test_an_open_mesh_and_a_thin_one_are_warned_of(source, tmp_path):
    mesh = ball(source)
    mesh.GetFaceVertexCountsAttr().Set(list(mesh.GetFaceVertexCountsAttr().Get())[1:])
    mesh.GetFaceVertexIndicesAttr().Set(list(mesh.GetFaceVertexIndicesAttr().Get())[3:])
    mesh.AddScaleOp().Set((1, 1, 0.01))
    notes = made(source, tmp_path)[1]
    assert "is open at 3 edges" in notes[0] and "% of its cage" in notes[1] and len(notes) == 2


def test_the_command_line_makes_a_scene(source, tmp_path, capsys):
    ball(source)
    source.Save()
    out = str(tmp_path / "scene.usda")
    arguments = ["--cells", "5", "--young", "2e4", "--poisson", "0.45", "--density", "500", "--model", "neo_hookean"]
    assert cli.main(["new", "softbody", str(tmp_path / "in" / "mesh.usda"), "-o", out, *arguments]) == 0
    assert f"wsim run {out}" in capsys.readouterr().out
    assert load(out).softs[0].material == Bulk(young=2e4, poisson=0.45, density=500.0, model="neo_hookean")
    assert cli.main(["check", out]) == 0 and "1 soft body, 1 skin; " in capsys.readouterr().out


@pytest.mark.parametrize("above", ["", "/World"])
def test_a_result_shows_the_surface_of_a_body_without_skins(tmp_path, above):
    """At the points of the TetMesh, in its frame, facing outwards, frame by frame; below another prim the TetMesh itself is not
    seen twice. It is written alike where a run goes on from an earlier one."""
    scene = Scene(frames=3, substeps=2)
    soft = scene.soft(f"{above}/block", *shapes.block((1, 1, 1), 2), motion=Motion.at_place((0.0, 3.0, 0.0)))
    soft.velocities = np.tile([0.5, 0.0, 0.0], (len(soft.points), 1))
    save(scene, tmp_path / "scene.usda")
    file, outs = str(tmp_path / "scene.usda"), [str(tmp_path / f"{name}.usdc") for name in ("whole", "part", "on")]
    run = ["run", file, "--device", "cpu", "--stress"]
    assert cli.main([*run, "-o", outs[0]]) == 0 and cli.main([*run, "-o", outs[1], "--frames", "2"]) == 0
    assert cli.main([*run, "-o", outs[2], "--restart", outs[1]]) == 0
    for out in (outs[0], outs[2]):
        stage = Usd.Stage.Open(out)
        body, seen = (stage.GetPrimAtPath(f"{above}/block{end}") for end in ("", "_surface"))
        assert seen.IsA(UsdGeom.Mesh) and UsdGeom.Imageable(body).ComputePurpose() == ("guide" if above else "default")
        own = np.unique(tet_surface_triangles(soft.tets))
        for name in ("points", "velocities", "primvars:vonMises"):
            for code in range(4):
                mine, all_ = (np.array(prim.GetAttribute(name).Get(code)) for prim in (seen, body))
                assert np.array_equal(mine, all_[own])
            assert seen.GetAttribute(name).GetNumTimeSamples() == 4
        frame = np.array(UsdGeom.XformCache(3).GetLocalToWorldTransform(seen))
        points = np.array(seen.GetAttribute("points").Get(3)) @ frame[:3, :3] + frame[3, :3]
        corners = np.array(UsdGeom.Mesh(seen).GetFaceVertexIndicesAttr().Get())
        assert _volume(SimpleNamespace(points=points - points.mean(axis=0), indices=corners)) == pytest.approx(1.0, abs=0.02)
        assert points[:, 1].mean() < 3.0 and points[:, 0].mean() > 0.05
