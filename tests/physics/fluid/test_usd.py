"""Fluids in USD: saved and loaded equal, in any units, with every value of the schema; what is wrong is said with its prim."""

from dataclasses import fields as columns

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from wsim.physics.fluid.objects import ADVECTION, KINDS, PRESSURE, SCALARS, Fluid, Source
from wsim.scene import Box, Cone, Plane, Scene, SceneError, Sphere, Surface
from wsim.scene.curve import Curve, Motion
from wsim.usd import load, names, save

LOW, HIGH = (0.1, 0.2, 0.3), (0.9, 1.0, 1.1)
TETRAHEDRON = Surface([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [3] * 4, [0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2])


def scene_of(*things) -> Scene:
    scene = Scene(wind=(1.0, 0.0, 0.0), frames=10)
    for thing in things:
        scene.add(thing)
    return scene


def again(scene: Scene, path) -> Scene:
    save(scene, str(path))
    return load(str(path))


def everything() -> tuple[Fluid, list[Source]]:
    rng = np.random.default_rng(1)
    moving = Motion(np.array([0.0, 0.3]), np.stack([np.eye(4), np.eye(4)]))
    moving.values[:, :3, 3] = [(0.5, 0.6, 0.7), (0.6, 0.6, 0.7)]
    still = Motion.still(moving.values[0])
    fluid = Fluid("/World/air", LOW, HIGH, 0.1, ("periodic", "periodic", "closed", "open", "wind", "wind"),
                  rng.normal(size=(6, 3)) * (np.arange(6) == 2)[:, None], False, True, 1.1, 0.01, 0.004, 0.3, 0.5, 0.1, 0.2,
                  "cubic", "bfecc", "multigrid", 1e-5, 3.0, 7, 0.5, False, 9,
                  *(rng.random(n).astype(np.float32) for n in ((8, 8, 8, 3), (8, 8, 8), (8, 8, 8))))
    return fluid, [
        Source("/World/ball", Sphere(0.1), moving, "/World/air", 2.0, 30.0, True, (0.1, 0.0, -0.3), -0.5,
               Curve(np.array([0.0, 0.1, 0.25]), np.array([0.0, 1.0, 0.3]))),
        Source("/World/box", Box((0.1, 0.2, 0.1)), still, smoke=1.0, strength=0.7),
        Source("/World/cone", Cone(0.1, 0.2), still, temperature=-3.0, velocity=(0.0, 0.0, 0.0)),
        Source("/World/ground", Plane(), still, expansion=0.1), Source("/World/mesh", TETRAHEDRON, still, smoke=0.1)]


@pytest.mark.parametrize("ending", [".usda", ".usdc"])
def test_a_fluid_and_its_sources_come_back_equal(tmp_path, ending):
    """Every field of theirs is another than its default."""
    fluid, sources = everything()
    plain = Fluid("/a", LOW, HIGH, 0.0)
    for column in columns(Fluid)[3:]:                        # on their own: conserve below, forces in test_forces.py
        same = np.array_equal(getattr(fluid, column.name), getattr(plain, column.name))
        assert not same or column.name in ("conserve", "acceleration"), column.name
    scene = scene_of(fluid, *sources)
    found = again(scene, tmp_path / f"s{ending}")
    assert found.things("Fluid") == [fluid] and found.things("Source") == sources and found == scene
    assert not found.notes


def test_what_is_default_is_not_written(tmp_path):
    scene = scene_of(Fluid("/air", (0, 0, 0), (1, 1, 1), 0.125), Source("/ball", Sphere(0.5), smoke=1.0))
    assert again(scene, tmp_path / "s.usda") == scene
    stage = Usd.Stage.Open(str(tmp_path / "s.usda"))
    written = [[a.GetName() for a in stage.GetPrimAtPath(p).GetAuthoredAttributes() if a.GetName().startswith("wsim:")]
               for p in ("/air", "/ball")]
    assert written == [["wsim:fluid:cellSize"], ["wsim:fluid:smoke"]]
    assert UsdGeom.Imageable(stage.GetPrimAtPath("/air")).ComputePurpose() == "guide"


def authored(path, metres: float = 0.01, kind: str = "Cube") -> Usd.Stage:
    """A domain from (-1, -1, -1) to (1, 3, 1) m and a ball in it, on a stage in centimetres and grams."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    stage.SetMetadata("kilogramsPerUnit", 0.001)
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.Xform.Define(stage, "/World")
    prim = stage.DefinePrim("/World/air", kind)
    place = UsdGeom.Xformable(prim)
    place.AddTranslateOp().Set(Gf.Vec3d(0.0, 100.0, 0.0))
    place.AddScaleOp().Set(Gf.Vec3f(100.0, 200.0, 100.0))
    if kind != "Cube":
        prim.CreateAttribute("extent", Sdf.ValueTypeNames.Float3Array).Set([(-1, -1, -1), (1, 1, 1)])
    prim.AddAppliedSchema(names.WSIM_DOMAIN)
    ball = UsdGeom.Sphere.Define(stage, "/World/ball")
    ball.CreateRadiusAttr(20.0)
    ball.GetPrim().AddAppliedSchema(names.WSIM_SOURCE)
    return stage


def put(stage: Usd.Stage, path: str, **values) -> Scene:
    prim = stage.GetPrimAtPath(path)
    for name, value in values.items():
        prim.GetAttribute(f"wsim:fluid:{name}").Set(value)
    stage.GetRootLayer().Save()
    return load(stage.GetRootLayer().realPath)


@pytest.mark.parametrize("kind", ["Cube", "Xform", "Volume"])
def test_a_domain_in_centimetres_and_grams_is_in_si(tmp_path, kind):
    stage = authored(tmp_path / "s.usda", kind=kind)
    put(stage, "/World/air", density=0.0012, viscosity=100.0, cellSize=20.0, sideVelocities=[(0, 0, 0)] * 5 + [(50, 0, 0)],
        sides=["closed"] * 6, startVelocity=[(100.0, 0.0, 0.0)] * 2000)
    scene = put(stage, "/World/ball", velocity=Gf.Vec3d(0.0, 100.0, 0.0), smoke=2.0, expansion=3.0)
    fluid, source = scene.things("Fluid")[0], scene.things("Source")[0]
    assert np.allclose(fluid.low, (-1, -1, -1)) and np.allclose(fluid.high, (1, 3, 1)) and fluid.shape == (10, 20, 10)
    assert np.isclose(fluid.density, 1.2) and np.isclose(fluid.viscosity, 0.01) and np.isclose(fluid.cell, 0.2)
    assert np.allclose(fluid.side_velocities[5], (0.5, 0, 0)) and np.allclose(fluid.velocity, (1.0, 0.0, 0.0))
    assert np.isclose(source.shape.radius, 0.2) and np.allclose(source.velocity, (0.0, 1.0, 0.0)) and source.fluid == ""
    assert (source.smoke, source.expansion, source.temperature) == (2.0, 3.0, 0.0)


def test_a_domain_without_a_cell_size_has_64_along_its_longest_edge(tmp_path):
    stage = authored(tmp_path / "s.usda")
    fluid = put(stage, "/World/ball", smoke=1.0).things("Fluid")[0]
    assert fluid.shape == (32, 64, 32)


def test_a_domain_of_a_stage_with_another_axis_up_is_still_a_box(tmp_path):
    """A quarter turn above it changes its axes; an eighth is refused."""
    for turn, wanted in ((90.0, ((-1, -1, -1), (1, 1, 3))), (45.0, None)):
        stage = authored(tmp_path / f"s{turn:g}.usda")
        UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddRotateXOp().Set(turn)
        if wanted:
            fluid = put(stage, "/World/ball", smoke=1.0).things("Fluid")[0]
            assert np.allclose([fluid.low, fluid.high], wanted)
        else:
            with pytest.raises(SceneError, match="/World/air: is turned or sheared .*; take the rotation out"):
                put(stage, "/World/ball", smoke=1.0)


@pytest.mark.parametrize("wrong, said", [
    (dict(density=-1.0), "/World/air: density"), (dict(cellSize=-1.0), "/World/air: cell"),
    (dict(sides=["open"] * 5), "wsim:fluid:sides has 5 entries"), (dict(sides=["door"] * 6), "/World/air: sides are"),
    (dict(sideVelocities=[(0, 0, 0)]), "wsim:fluid:sideVelocities has 1 entries"),
    (dict(advection="upwind"), "/World/air: advection is 'upwind'"),
    (dict(startSmoke=[1.0, 2.0]), "startSmoke has 2 entries, and the domain 32x64x32 cells"), (dict(cellSize=1e-9), "cells")])
def test_values_that_cannot_be_are_said_of_the_domain(tmp_path, wrong, said):
    stage = authored(tmp_path / "s.usda")
    stage.GetPrimAtPath("/World/ball").GetAttribute("wsim:fluid:smoke").Set(1.0)
    with pytest.raises(SceneError, match=said):
        put(stage, "/World/air", **wrong)


def bare(stage: Usd.Stage) -> None:
    stage.DefinePrim("/World/air", "Xform").GetAttribute("xformOp:scale").Set(Gf.Vec3f(1.0))


def two(stage: Usd.Stage) -> None:
    stage.GetPrimAtPath("/World/ball").CreateRelationship(names.INTO).SetTargets(["/World/air", "/World/ball"])


@pytest.mark.parametrize("harm, said", [
    (bare, "/World/air: is a Xform with WsimFluidDomainAPI and no extent; make it a Cube"),
    (two, "/World/ball: wsim:fluid:domain"),
    (lambda s: s.GetPrimAtPath("/World/air").AddAppliedSchema(names.COLLISION), "/World/air: .*fills its own domain"),
    (lambda s: s.GetPrimAtPath("/World/ball").AddAppliedSchema(names.COLLISION), "/World/ball: .*no air within an obstacle"),
    (lambda s: s.GetPrimAtPath("/World/air").AddAppliedSchema(names.WSIM_SOURCE), "/World/air: has .* and "),
    (lambda s: s.GetPrimAtPath("/World/ball").SetTypeName("Xform"), "/World/ball: is a Xform .*a source has a shape"),
    (lambda s: s.GetPrimAtPath("/World/air").GetAttribute("xformOp:scale").Set(Gf.Vec3f(1.0, 0.0, 1.0)),
     "/World/air: .*flattened by a scale of 0"),
    (lambda s: s.RemovePrim("/World/air"), "/World/ball: it is a source, and there is no fluid")])
def test_prims_that_cannot_be_are_said_with_the_mend(tmp_path, harm, said):
    stage = authored(tmp_path / "s.usda")
    stage.GetPrimAtPath("/World/ball").GetAttribute("wsim:fluid:smoke").Set(1.0)
    harm(stage)
    with pytest.raises(SceneError, match=said):
        put(stage, "/World/ball")


def test_an_emitter_outside_and_an_animated_domain_are_warned_of(tmp_path):
    from wsim.scene.check.scene import check_scene
    stage = authored(tmp_path / "s.usda")
    UsdGeom.Xformable(stage.GetPrimAtPath("/World/ball")).AddTranslateOp().Set(Gf.Vec3d(0.0, 0.0, 500.0))
    for code in (0.0, 10.0):
        stage.GetPrimAtPath("/World/air").GetAttribute("xformOp:translate").Set(Gf.Vec3d(0.0, 100.0 + code, 0.0), code)
    scene = put(stage, "/World/ball", smoke=1.0)
    assert [n.text for n in scene.notes if n.path == "/World/air"] == [
        "is animated and a domain of a fluid: it stays where the animation starts"]
    assert [p.text for p in check_scene(scene) if p.path == "/World/ball" and "outside" in p.text]


def test_a_fluid_that_conserves_comes_back_so(tmp_path):
    fluid = Fluid("/World/air", LOW, HIGH, 0.1, ("closed",) * 6, conserve=True, smoke=np.ones((8, 8, 8), np.float32))
    assert again(scene_of(fluid), tmp_path / "s.usda").things("Fluid") == [fluid]


def test_a_misspelt_name_of_a_fluid_is_told(tmp_path):
    stage = authored(tmp_path / "s.usda")
    stage.GetPrimAtPath("/World/air").CreateAttribute("wsim:fluid:cellsize", Sdf.ValueTypeNames.Double).Set(3.0)
    notes = [n.text for n in put(stage, "/World/ball", smoke=1.0).notes]
    assert any("did you mean wsim:fluid:cellSize?" in text for text in notes)


def test_fallbacks_and_tokens_of_the_schemas_are_those_of_the_objects():
    registry = Usd.SchemaRegistry()
    plain = {"Fluid": Fluid("/a", LOW, HIGH, 0.0, density=0.0), "Source": Source("/a", Sphere(1.0))}
    rows = [row for row in names.TABLE if row.owner in plain]
    assert len(rows) == 25 + 6
    for row in rows:
        attribute = registry.FindAppliedAPIPrimDefinition(row.schema).GetAttributeDefinition(row.attribute)
        value, wanted = attribute.GetFallbackValue(), getattr(plain[row.owner], row.field)
        if isinstance(wanted, Curve):
            wanted = wanted.values[0]
        assert value is None and not np.any(wanted) or np.array_equal(value, wanted), row.attribute
        tokens = {"sides": KINDS, "advection": ADVECTION, "scalar_advection": SCALARS, "pressure": PRESSURE}.get(row.field)
        assert tokens is None or tuple(attribute.GetMetadata("allowedTokens")) == tokens
