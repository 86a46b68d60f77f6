"""Save and load give the same scene, for scenes with every kind of object at random."""

from dataclasses import fields, replace
from math import inf

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdPhysics, UsdValidation

from wsim.geometry.rotation import axis_rotation_matrix
from wsim.scene import (
    Box,
    Capsule,
    Cloth,
    Collider,
    Cone,
    Cylinder,
    Pin,
    Plane,
    Scene,
    SceneError,
    Sphere,
    Springs,
    Surface,
)
from wsim.scene.bodies import equal_values
from wsim.scene.curve import Curve, Motion
from wsim.scene.fabric import Fabric
from wsim.scene.integrator import INTEGRATORS, SOLVERS
from wsim.usd import load, names, save
from wsim.usd.stage import StageUnits


def _turned(rng) -> np.ndarray:
    axis = rng.normal(size=3)
    return axis_rotation_matrix(axis / np.linalg.norm(axis), rng.uniform(0.0, 3.0))


def _matrix(rng, rigid: bool, far: float) -> np.ndarray:
    M = np.eye(4)
    M[:3, :3] = _turned(rng)
    if not rigid:                       # scaled, sheared and, half of the time, mirrored
        M[:3, :3] = M[:3, :3] @ np.diag(rng.uniform(0.5, 2.0, 3) * rng.choice([-1.0, 1.0])) @ _turned(rng)
    M[:3, 3] = rng.normal(size=3) + far
    return M


def _motion(rng, rigid: bool = True) -> Motion:
    far = rng.choice([0.0, 1000.0])
    kind = rng.integers(4)
    if kind == 0:
        return Motion.still()
    if kind == 1:
        return Motion.at_place(rng.normal(size=3) + far)
    keys = 1 if kind == 2 else int(rng.integers(2, 5))
    times = np.zeros(1) if keys == 1 else np.sort(rng.uniform(-0.2, 3.0, keys))
    return Motion(times, [_matrix(rng, rigid, far) for _ in range(keys)])


def _fabric(rng) -> Fabric:
    return Fabric(*rng.uniform(1e-6, 1e3, 3), thickness=rng.uniform(1e-4, 1e-2), density=rng.uniform(10, 900),
                  poisson=rng.choice([0.0, rng.uniform(-0.9, 0.49)]), damping=rng.uniform(0.0, 0.1),
                  strain_limit=rng.choice([inf, 0.1]), static_friction=rng.uniform(), dynamic_friction=rng.uniform())


def _sheet(rng):
    points = rng.normal(size=(9, 3)).astype(np.float32)       # two quads, a triangle, a pentagon
    return points, [4, 4, 3, 5], [0, 1, 4, 3, 1, 2, 5, 4, 3, 4, 7, 4, 5, 8, 7, 6]


def _cloth(rng, path: str) -> Cloth:
    def maybe(value):
        return value if rng.uniform() < 0.5 else None

    return Cloth(path, *_sheet(rng), material=_fabric(rng), motion=_motion(rng, rigid=False),
                 velocities=maybe(rng.normal(size=(9, 3))), rest_points=maybe(rng.normal(size=(9, 3))),
                 masses=maybe(rng.uniform(0.1, 1.0, 9)), mass=maybe(rng.uniform()),
                 thicknesses=maybe(rng.uniform(1e-3, 2e-3, 9)),
                 model=str(rng.choice(["membrane", "springs"])), flat=bool(rng.integers(2)), weld=rng.uniform(0.0, 0.1),
                 tethers=bool(rng.integers(2)), drag=rng.uniform(), lift=rng.uniform())


def _net(rng, path: str) -> Springs:
    edges = [(0, 1), (1, 2), (2, 0), (2, 4), (1, 4)]           # points shared; point 3 is held by nothing
    return Springs(path, rng.normal(size=(5, 3)), edges, rng.uniform(1.0, 9.0, rng.choice([1, 5])),
                   rng.uniform(0.1, 1.0, rng.choice([1, 5])),
                   lengths=rng.uniform(0.5, 1.0, 5) if rng.integers(2) else None,
                   damping=rng.uniform(), radius=rng.choice([0.0, 0.01]), motion=_motion(rng, rigid=False),
                   velocities=rng.normal(size=(5, 3)) if rng.integers(2) else None, static_friction=rng.uniform(),
                   **_muscles(rng))


def _muscles(rng) -> dict:
    """None, one group of all springs that does not change, or two of some that do, at keys that are no frames."""
    if not rng.integers(3):
        return {}
    if not rng.integers(2):
        return {"actuation": Curve(rng.choice([[0.0], [0.2]]), rng.uniform(0.5, 1.5, (1, 1)))}
    return {"actuation": Curve(np.cumsum(rng.uniform(0.01, 0.3, 4)), rng.uniform(0.5, 1.5, (4, 2))),
            "muscles": np.array([0, -1, 1, 1, -1])}


def _shapes(rng) -> list:
    points, counts, indices = _sheet(rng)
    poses = Curve([0.0, 0.31, 1.7], rng.normal(size=(3, 9, 3)).astype(np.float32))
    return [Plane(), Sphere(rng.uniform()), Box(tuple(rng.uniform(0.1, 1.0, 3))), Capsule(rng.uniform(), rng.uniform()),
            Cylinder(rng.uniform(), rng.uniform()), Cone(rng.uniform(), rng.uniform()),
            Surface(points, counts, indices), Surface(points, counts, indices, poses)]


def _scene(seed: int) -> Scene:
    rng = np.random.default_rng(seed)
    solver, integrator = rng.choice([("auto", "auto"), ("explicit", "rk4"), ("auto", "bdf2"), ("implicit", "auto")])
    scene = Scene(gravity=tuple(rng.normal(size=3)), wind=tuple(rng.normal(size=3)), air_density=rng.uniform(),
                  air_drag=rng.uniform(), up=str(rng.choice(["Y", "Z"])), fps=float(rng.choice([24.0, 29.97, 1000.0])),
                  start=float(rng.choice([0.0, 1.0, 1001.5])), frames=int(rng.integers(0, 50)),
                  substeps=int(rng.integers(1, 30)), iterations=int(rng.integers(1, 9)),
                  solver=str(solver), integrator=str(integrator), error=rng.uniform(1e-4, 0.1))
    scene.cloths = [_cloth(rng, "/World/a/cloth"), _cloth(rng, "/cloth"), _cloth(rng, "/World/b")]
    scene.springs = [_net(rng, "/net"), _net(rng, "/World/a/net")]
    scene.colliders = [Collider(f"/World/collider{i}", shape, _motion(rng), *rng.uniform(size=2),
                                thickness=rng.choice([0.0, 0.01]))
                       for i, shape in enumerate(_shapes(rng))]
    frame = _motion(rng)
    scene.pins = [Pin("/pins", "/cloth", [0, 3, 8], motion=_motion(rng)),
                  Pin("/cloth/pin", "/cloth", [5], target="/World/hook", motion=frame, places=rng.normal(size=(1, 3))),
                  Pin("/World/pin", "/net", [4, 3, 0], target="/World/hook", motion=frame, stiffness=rng.uniform(),
                      damping=rng.uniform())]
    return scene


def _difference(a, b, where="scene") -> str:
    """Path of the first field that differs, for a readable failure."""
    if hasattr(a, "__dataclass_fields__") and type(a) is type(b):
        for f in fields(a):
            if f.compare and f.name != "parts":
                found = _difference(getattr(a, f.name), getattr(b, f.name), f"{where}.{f.name}")
                if found:
                    return found
        return ""
    if isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        pairs = enumerate(zip(a, b, strict=True))
        return next(filter(None, (_difference(x, y, f"{where}[{i}]") for i, (x, y) in pairs)), "")
    return "" if equal_values(a, b) else f"{where}: {a!r} is not {b!r}"


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
