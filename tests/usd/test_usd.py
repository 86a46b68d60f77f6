"""Save and load give the same scene, for scenes with every kind of object at random."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdPhysics, UsdValidation

from tests.make.usd.usd import _difference, _matrix, _scene, _sheet
from wsim.scene import (
    Cloth,
    Scene,
    SceneError,
    Sphere,
)
from wsim.scene.curve import Motion
from wsim.scene.integrator import INTEGRATORS, SOLVERS
from wsim.usd import load, names, save
from wsim.usd.stage import StageUnits


@pytest.mark.parametrize("suffix", ["usda", "usdc"])
@pytest.mark.parametrize("seed", range(12))
def test_save_then_load_gives_an_equal_scene(tmp_path, seed, suffix):
    scene, path = _scene(seed), tmp_path / f"scene.{suffix}"
    save(scene, path)
    back = load(path)
    assert _difference(scene, back) == ""
    assert scene == back
    assert [note for note in back.notes if "metersPerUnit" not in note.text] == []


def test_save_and_load_twice_writes_the_same_bytes(tmp_path):
    save(_scene(3), tmp_path / "a.usda")
    save(load(tmp_path / "a.usda"), tmp_path / "b.usda")
    assert (tmp_path / "a.usda").read_text() == (tmp_path / "b.usda").read_text()


def test_defaults_survive(tmp_path):
    scene = Scene()
    scene.cloth("/flag", *_sheet(np.random.default_rng(0)))
    save(scene, tmp_path / "s.usda")
    assert load(tmp_path / "s.usda") == scene


def test_usd_cores_validators_pass_on_a_saved_scene(tmp_path):
    save(_scene(1), tmp_path / "s.usda")
    stage = Usd.Stage.Open(str(tmp_path / "s.usda"))
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    assert [(e.GetName(), e.GetMessage()) for e in context.Validate(stage)] == []


def test_saved_stage_authors_every_unit_and_what_usdphysics_reads_of_it(tmp_path):
    scene = replace(_scene(2), gravity=(0.0, 0.0, -9.81))
    save(scene, tmp_path / "s.usda")
    stage = Usd.Stage.Open(str(tmp_path / "s.usda"))
    assert UsdGeom.StageHasAuthoredMetersPerUnit(stage) and UsdPhysics.StageHasAuthoredKilogramsPerUnit(stage)
    assert stage.GetRootLayer().HasTimeCodesPerSecond() and stage.HasDefaultPrim()
    found = UsdPhysics.UsdPhysicsLoadStageFromPrimRange(stage, ["/"])
    desc = found[UsdPhysics.ObjectType.Scene][1][0]
    assert tuple(desc.gravityDirection) == (0.0, 0.0, -1.0) and desc.gravityMagnitude == np.float32(9.81)
    radius = found[UsdPhysics.ObjectType.SphereShape][1][0].radius          # UsdPhysics as an independent reader
    assert radius == np.float32(scene.colliders[1].shape.radius)
    box = found[UsdPhysics.ObjectType.CubeShape][1][0].halfExtents
    assert np.allclose(box, scene.colliders[2].shape.half, rtol=1e-6)


def test_animated_motion_reads_right_to_other_programs_at_every_frame(tmp_path):
    """USD interpolates the matrix by elements; at the frames the samples hold the turn itself."""
    rng = np.random.default_rng(5)
    motion = Motion([0.01, 0.9], [_matrix(rng, True, 0.0), _matrix(rng, True, 0.0)])
    scene = Scene(frames=24, start=7.0)
    scene.cloth("/flag", *_sheet(rng))
    scene.collider("/ball", Sphere(1.0), motion=motion)
    save(scene, tmp_path / "s.usda")
    stage = Usd.Stage.Open(str(tmp_path / "s.usda"))
    prim = UsdGeom.Xformable(stage.GetPrimAtPath("/ball"))
    for frame in range(25):
        seen = np.array(prim.ComputeLocalToWorldTransform(Usd.TimeCode(7.0 + frame))).T
        assert np.abs(seen - motion.at(frame / 24.0)).max() < 1e-12


def test_every_wsim_row_of_the_table_is_in_the_registered_schema():
    registry = Usd.SchemaRegistry()
    for row in names.TABLE:
        if row.attribute.startswith("wsim:"):
            definition = registry.FindAppliedAPIPrimDefinition(row.schema)
            assert definition, row.schema
            attribute = definition.GetAttributeDefinition(row.attribute)
            assert attribute, row.attribute
            assert str(attribute.GetTypeName()) == row.type
            assert (attribute.GetVariability() == Sdf.VariabilityUniform) == row.uniform


def test_fallbacks_of_the_schema_are_the_defaults_of_the_scene():
    registry = Usd.SchemaRegistry()
    for owner, default in (("Scene", Scene()), ("Cloth", Cloth("/a", [], [], []))):
        for row in names.TABLE:
            if row.owner == owner and row.attribute.startswith("wsim:") and row.field != "air_density":
                definition = registry.FindAppliedAPIPrimDefinition(row.schema)
                value = definition.GetAttributeDefinition(row.attribute).GetFallbackValue()
                value = tuple(value) if row.type == "vector3d" else value
                assert value == getattr(default, row.field), row.attribute


def test_allowed_tokens_of_the_schema_are_the_tables_of_solvers_and_integrators():
    definition = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(names.WSIM_SCENE)
    for field, allowed in (("solver", SOLVERS), ("integrator", INTEGRATORS)):
        attribute = definition.GetAttributeDefinition(names.attribute_entry("Scene", field).attribute)
        assert tuple(attribute.GetMetadata("allowedTokens")) == allowed


def test_units_turn_stage_values_into_si():
    units = StageUnits(metres=0.01, kilograms=0.001)
    assert units.factor("N/m") == 0.001
    assert units.factor("Pa") == pytest.approx(0.1)            # g/(cm s^2) = 0.1 Pa
    assert units.factor("kg/m^3") == pytest.approx(1000.0)     # g/cm^3


def test_a_broken_scene_is_not_saved_and_every_problem_is_named(tmp_path):
    scene = Scene(substeps=0)
    points, counts, indices = _sheet(np.random.default_rng(0))
    points[4, 1] = np.nan
    scene.cloth("/flag", points, counts, indices)
    scene.net("/net", np.zeros((2, 3)), [(0, 5)], [-1.0], [0.0])
    scene.pin("/pin", "/flagg", [0])
    with pytest.raises(SceneError) as error:
        save(scene, tmp_path / "s.usda")
    text = str(error.value)
    for part in ("substeps is 0", "/flag: 1 point (number 4)", "/net: spring 0 joins points [0, 5]",
                 "stiffnesses are too small, first -1", "masses are too small, first 0", "/pin: it holds '/flagg'"):
        assert part in text
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["s.txt", "nowhere/s.usda"])
def test_a_place_that_cannot_be_written_is_one_clear_error(tmp_path, name):
    scene = Scene()
    scene.cloth("/flag", *_sheet(np.random.default_rng(0)))
    with pytest.raises(SceneError, match="allowed is|does not exist"):
        save(scene, tmp_path / name)
    assert list(tmp_path.iterdir()) == []
