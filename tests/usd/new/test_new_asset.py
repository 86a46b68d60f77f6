"""What `wsim new` adds: pins, colliders, a physics material; all below the default prim, so that the scene is an asset."""

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade, UsdValidation, Vt

from wsim.scene import Plane, SceneError, Sphere, Surface, shapes
from wsim.usd import load
from wsim.usd.new.cloth import author_cloth
from wsim.usd.new.softbody import author_softbody


def mesh(stage: Usd.Stage, path: str, points, counts, indices) -> UsdGeom.Mesh:
    found = UsdGeom.Mesh.Define(stage, path)
    found.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.asarray(points, np.float32)))
    found.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(counts))
    found.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(indices))
    return found


@pytest.fixture
def sheet(tmp_path) -> Usd.Stage:
    """A vertical sheet of 5 x 5 points, 1 m wide, from -0.5 m to 0.5 m, in metres, Y up."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "sheet.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, "Y")
    mesh(stage, "/World/Sheet", *shapes.sheet(1.0, 1.0, 4, 4))
    UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(stage.GetPrimAtPath("/World"))
    return stage


def ball(tmp_path, metres: float = 1.0, up: str = "Y") -> str:
    """A file with a ball that moves from x = 1 m to -1 m in 24 frames, at a height of 0.25 m."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "ball.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    UsdGeom.SetStageUpAxis(stage, up)
    sphere = UsdGeom.Sphere.Define(stage, "/Ball")
    sphere.CreateRadiusAttr(0.2 / metres)
    op = sphere.AddTranslateOp()
    for code, x in ((0, 1.0), (24, -1.0)):
        op.Set(tuple(np.array((x, 0.25, 0.0) if up == "Y" else (x, 0.0, 0.25)) / metres), code)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(24)
    stage.SetDefaultPrim(sphere.GetPrim())
    stage.Save()
    return str(tmp_path / "ball.usda")


def cloth(sheet: Usd.Stage, tmp_path, *arguments, **more):
    sheet.Save()
    notes = author_cloth(tmp_path / "sheet.usda", tmp_path / "scene.usda", *arguments, **more)
    return load(tmp_path / "scene.usda"), [note.text for note in notes]


def faults(path) -> list[str]:
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    return [e.GetMessage() for e in context.Validate(Usd.Stage.Open(str(path))) if e.GetName() != "MissingExtent"]


@pytest.mark.parametrize("spec, held", [
    ("top", range(5)), ("bottom", range(20, 25)), ("0.75..1@y", range(10)), ("0..0.25@x", [0, 1, 5, 6, 10, 11, 15, 16, 20, 21]),
    ("0,4", [0, 4]), ("0,20..22", [0, 20, 21, 22]), ("collar", [0, 5, 6]), ("edge", [2, 3])])
def test_a_pin_holds_the_points_that_are_meant(sheet, tmp_path, spec, held):
    for name, kind, indices in (("collar", "face", [0]), ("edge", "point", [2, 3])):
        subset = UsdGeom.Subset.Define(sheet, f"/World/Sheet/{name}")
        subset.CreateElementTypeAttr(kind)
        subset.CreateIndicesAttr(indices)
    scene, notes = cloth(sheet, tmp_path, pins=(spec,))
    (pin,) = scene.pins
    assert sorted(pin.points) == list(held) and notes == []
    assert pin.places is None and pin.body == "/World/Sheet" and pin.target == ""


@pytest.mark.parametrize("spec, said", [
    ("25", "names point 25; allowed is 0 to 24"), ("2..3@y", "holds no point"), ("sleeve", "a GeomSubset of the mesh"),
    ("0.9..1@w", "a band as 0.9..1@z")])
def test_a_pin_that_means_nothing_is_refused_with_what_may_be_given(sheet, tmp_path, spec, said):
    with pytest.raises(SceneError, match=said):
        cloth(sheet, tmp_path, pins=(spec,))
    assert not (tmp_path / "scene.usda").exists()


def test_a_pin_is_where_its_points_are_below_a_turned_and_scaled_root(sheet, tmp_path):
    root = UsdGeom.Xformable(sheet.GetPrimAtPath("/World"))
    root.AddTranslateOp().Set((1, 2, 3))
    root.AddRotateXYZOp().Set((20, 30, 40))
    root.AddScaleOp().Set((2, 2, 2))
    scene, _ = cloth(sheet, tmp_path, pins=("0..4",), ground=-9.5)
    (pin,), (sheet_,), (ground,) = scene.pins, scene.cloths, scene.colliders
    start = sheet_.motion.points(sheet_.points)
    held = start[pin.points] if pin.places is None else pin.motion.points(pin.places)
    assert np.abs(held - start[:5]).max() < 1e-6
    assert np.allclose(ground.motion.at(0.0)[:3, 2], (0, 1, 0)) and isinstance(ground.shape, Plane)
    assert ground.motion.at(0.0)[1, 3] == pytest.approx(-9.5, abs=1e-6)


@pytest.mark.parametrize("metres, up", [(1.0, "Y"), (0.01, "Y"), (1.0, "Z"), (0.01, "Z")])
def test_a_collider_of_another_file_keeps_its_size_and_its_motion(sheet, tmp_path, metres, up):
    """The ball's path along x at 0.25 m is the same whatever unit and axis its file has; the sheet's file has no range."""
    scene, _ = cloth(sheet, tmp_path, colliders=(ball(tmp_path, metres, up),))
    (collider,) = scene.colliders
    assert isinstance(collider.shape, Sphere) and collider.shape.radius == pytest.approx(0.2)
    for t, x in ((0.0, 1.0), (0.5, 0.0), (1.0, -1.0)):
        assert np.allclose(collider.motion.at(t)[:3, 3], (x, 0.25, 0.0), atol=1e-9)
    assert scene.frames == 24 and faults(tmp_path / "scene.usda") == []


def test_a_mesh_that_reaches_below_the_ground_is_said(sheet, tmp_path):
    """The sheet spans -0.5 to 0.5 m: a ground at 0 is warned of, one above it refused, one below it is right."""
    _, notes = cloth(sheet, tmp_path, ground=0.0)
    assert any("is at 0 m, and the mesh reaches 0.5 m below it; give a height up to -0.5" in note for note in notes)
    _, notes = cloth(sheet, tmp_path, ground=-0.5)
    assert not any("below it" in note for note in notes)
    with pytest.raises(SceneError, match="ground: is at 2 m, and the mesh lies below: it reaches from -0.5 to 0.5 m"):
        cloth(sheet, tmp_path, ground=2.0)


def test_a_prim_of_the_same_file_collides(sheet, tmp_path):
    mesh(sheet, "/World/Set/Table", *shapes.box((0.1, 0.1, 0.1)))
    UsdGeom.Sphere.Define(sheet, "/World/Set/Knob").CreateRadiusAttr(0.05)
    scene, _ = cloth(sheet, tmp_path, prim="Sheet", colliders=("Set",))
    assert {c.path: type(c.shape) for c in scene.colliders} == {"/World/Set/Table": Surface, "/World/Set/Knob": Sphere}
    for given, said in (("Chair", "no prim of the mesh's file; its shapes: /World/Set/Table"), ("pin", "no prim"),
                        ("none.usda", "there is no such file")):
        with pytest.raises(SceneError, match=said):
            author_cloth(tmp_path / "sheet.usda", tmp_path / "other.usda", prim="Sheet", colliders=(given,))


def test_a_bound_physics_material_is_kept_and_a_fabric_or_another_replaces_it(sheet, tmp_path):
    for name, density in (("felt", 111.0), ("foil", 222.0)):
        material = UsdShade.Material.Define(sheet, f"/Library/{name}").GetPrim()
        material.AddAppliedSchema("PhysicsMaterialAPI")
        material.CreateAttribute("physics:density", Sdf.ValueTypeNames.Float).Set(density)
    plain = UsdShade.Material.Define(sheet, "/Library/paint")
    UsdShade.MaterialBindingAPI.Apply(sheet.GetPrimAtPath("/World/Sheet")).Bind(
        UsdShade.Material.Get(sheet, "/Library/felt"), materialPurpose="physics")
    assert cloth(sheet, tmp_path)[0].cloths[0].material.density == 111.0
    assert cloth(sheet, tmp_path, bound="foil")[0].cloths[0].material.density == 222.0
    assert cloth(sheet, tmp_path, "denim")[0].cloths[0].material.density == pytest.approx(0.324 / 0.99e-3, rel=1e-6)
    for name, said in ((str(plain.GetPath()), "says nothing of physics"), ("tin", "is no material of the mesh's file")):
        with pytest.raises(SceneError, match=f"{said}.*; physics materials there: /Library/felt, /Library/foil"):
            cloth(sheet, tmp_path, bound=name)


def test_a_bound_material_of_a_sheet_that_only_shows_it_is_not_physics(sheet, tmp_path):
    UsdShade.MaterialBindingAPI.Apply(sheet.GetPrimAtPath("/World/Sheet")).Bind(UsdShade.Material.Define(sheet, "/World/red"))
    assert cloth(sheet, tmp_path)[0].cloths[0].material.stretch == pytest.approx(0.5 * (2016.6 + 2035.0))


@pytest.mark.parametrize("kind", ["cloth", "mesh at the root", "softbody", "tets"])
def test_a_scene_that_another_stage_refers_to_still_runs(sheet, tmp_path, kind):
    """Below /Shot/asset, moved by 5 m: the body, its material, pin, collider and ground are all there, and step alike."""
    import wsim
    file, out = ball(tmp_path), tmp_path / "scene.usda"
    if kind in ("cloth", "mesh at the root"):
        if kind == "mesh at the root":
            mesh(sheet, "/Alone", *shapes.sheet(1.0, 1.0, 4, 4))
            sheet.SetDefaultPrim(sheet.GetPrimAtPath("/Alone"))
        sheet.Save()
        author_cloth(tmp_path / "sheet.usda", out, "denim", prim="Sheet" if kind == "cloth" else "Alone", pins=("top",),
                     colliders=(file,), ground=-1.1)
    else:
        if kind == "softbody":
            mesh(sheet, "/World/Block", *shapes.box((0.1, 0.1, 0.1)))
        else:
            points, tets = shapes.block((0.2, 0.2, 0.2), 2)
            block = UsdGeom.TetMesh.Define(sheet, "/World/Block")
            block.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
            block.CreateTetVertexIndicesAttr(Vt.Vec4iArray.FromNumpy(np.ascontiguousarray(tets, np.int32)))
        sheet.Save()
        author_softbody(tmp_path / "sheet.usda", out, prim="Block", cells=3, pins=("top",), colliders=(file,), ground=-1.1)
    assert faults(out) == []
    shot = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    UsdGeom.SetStageMetersPerUnit(shot, 1.0)
    UsdGeom.SetStageUpAxis(shot, "Y")
    above = UsdGeom.Xform.Define(shot, "/Shot")
    asset = UsdGeom.Xform.Define(shot, "/Shot/asset")
    asset.GetPrim().GetReferences().AddReference("./scene.usda")
    above.AddTranslateOp().Set((5, 0, 0))
    shot.Save()
    own, referred = load(out), load(tmp_path / "shot.usda")
    for name in ("cloths", "softs", "pins", "colliders"):
        assert len(getattr(own, name)) == len(getattr(referred, name)), name
    assert own.bodies()[0].material == referred.bodies()[0].material and len(own.colliders) == 2 and len(own.pins) == 1
    ends = []
    for scene in (own, referred):
        sim = wsim.Simulation(scene, device="cpu")
        sim.run(2)
        ends.append(sim.positions(scene.bodies()[0].path))
    assert np.abs(ends[1] - ends[0] - (5.0, 0.0, 0.0)).max() < 1e-5
    assert np.ptp(ends[0] - own.bodies()[0].motion.points(own.bodies()[0].points)) > 1e-4
