"""What converters of robots and other programs write: bodies within bodies, frames without mass, filtered pairs, meshes whose
faces do not agree, masses in every place that USD allows."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade

from tests.physics.rigid.pairs import WHERE
from wsim.cli.run import prepare_recorded_run
from wsim.geometry import rotation
from wsim.geometry.winding import wound_alike
from wsim.physics.rigid.mass import body_inertia, shape_volume
from wsim.scene import SceneError, Surface, shapes
from wsim.scene.check.scene import check_scene
from wsim.scene.solids import Box
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save
from wsim.usd.result.restart import ResultReader

ARM = """#usda 1.0
( metersPerUnit = 1; upAxis = "Z"; timeCodesPerSecond = 24; startTimeCode = 0; endTimeCode = 6 )
def PhysicsScene "scene" {}
def Xform "arm"
{
    double3 xformOp:translate = (0, 1, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Cube "upper" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"])
    {
        double size = 0.2
        vector3f physics:velocity = (0, 1, 0)
        double3 xformOp:translate = (0, 0, 1)
        double xformOp:rotateX = 40
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
        def Cube "lower" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"])
        {
            double size = 0.2
            double3 xformOp:translate = (0, 0, -0.4)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }
        def Cube "tool" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"])
        {
            double size = 0.1
            double3 xformOp:translate = (1, 0, 3)
            uniform token[] xformOpOrder = ["!resetXformStack!", "xformOp:translate"]
        }
    }
    def PhysicsRevoluteJoint "elbow"
    {
        rel physics:body0 = </arm/upper>
        rel physics:body1 = </arm/upper/lower>
        point3f physics:localPos0 = (0, 0, -0.2)
        point3f physics:localPos1 = (0, 0, 0.2)
        uniform token physics:axis = "X"
    }
}
"""


def written(path, text: str):
    path.write_text(text)
    return load(path)


def at(body) -> np.ndarray:
    return body.motion.at(0.0)


def test_bodies_within_a_body_move_by_themselves(tmp_path):
    """They start where the stage has them, and a result shows them where they are."""
    scene = written(tmp_path / "arm.usda", ARM)
    bodies = {body.path.rsplit("/", 1)[-1]: body for body in scene.things("Body")}
    R = rotation.axis_rotation_matrix(np.array([1.0, 0.0, 0.0]), np.radians(40.0))
    assert np.allclose(at(bodies["lower"])[:3, 3], np.array([0.0, 1.0, 1.0]) + R @ (0.0, 0.0, -0.4), atol=1e-7)
    assert np.allclose(at(bodies["tool"])[:3, 3], (1.0, 0.0, 3.0))
    job = prepare_recorded_run(scene, str(tmp_path / "o.usdc"), lambda s: Simulation(s, **WHERE))
    job.frames()
    poses = job.simulation.plan.method("rigid").poses()
    cache = UsdGeom.XformCache(6)
    stage = ResultReader(str(tmp_path / "o.usdc")).stage
    for k, body in enumerate(scene.things("Body")):
        M = np.array(cache.GetLocalToWorldTransform(stage.GetPrimAtPath(body.path))).T
        assert np.abs(M - poses[k]).max() < 1e-6, body.path
    assert np.linalg.norm(M[:3, 3] - at(bodies["tool"])[:3, 3]) > 0.2                 # it fell


def test_bodies_within_bodies_are_saved_in_any_order(tmp_path):
    scene = written(tmp_path / "arm.usda", ARM)
    turned = replace(scene, objects={kind: things[::-1] for kind, things in scene.objects.items()})
    for k, given in enumerate((scene, turned)):
        save(given, tmp_path / f"{k}.usda")
        again = {body.path: body for body in load(tmp_path / f"{k}.usda").things("Body")}
        assert len(again) == 3
        for body in scene.things("Body"):
            found = again[body.path]
            assert np.abs(at(found) - at(body)).max() < 1e-7, (k, body.path)
            own = found.colliders[0].motion.at(0.0)
            assert np.abs(own - np.eye(4)).max() < 1e-7 and abs(body_inertia(found).mass - body_inertia(body).mass) < 1e-6


def test_filtered_pairs_of_bodies_do_not_touch(tmp_path):
    text = """#usda 1.0
( metersPerUnit = 1; upAxis = "Z"; timeCodesPerSecond = 24; startTimeCode = 0; endTimeCode = 5 )
def PhysicsScene "scene"
{
    float physics:gravityMagnitude = 0
}
def Xform "A" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsFilteredPairsAPI"])
{
    rel physics:filteredPairs = </B>
    def Cube "Shape" (prepend apiSchemas = ["PhysicsCollisionAPI"])
    {
        double size = 0.2
    }
}
def Cube "B" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"])
{
    double size = 0.2
    double3 xformOp:translate = (0.1, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
    scene = written(tmp_path / "a.usda", text)
    save(scene, tmp_path / "b.usda")
    for given in (scene, load(tmp_path / "b.usda")):
        assert not [p for p in check_scene(given) if p.fatal]
        sim = Simulation(given, **WHERE)
        sim.run(5)
        assert np.abs(sim.plan.method("rigid").poses()[:, 0, 3] - (0.0, 0.1)).max() < 1e-6


FRAMES = """#usda 1.0
( metersPerUnit = 1; upAxis = "Z"; timeCodesPerSecond = 24; startTimeCode = 0; endTimeCode = 5 )
def PhysicsScene "scene" {}
def Xform "anchor" (prepend apiSchemas = ["PhysicsRigidBodyAPI"]) {}
def PhysicsFixedJoint "hold"
{
    rel physics:body1 = </anchor>
}
def Cube "arm" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"])
{
    def Xform "flange" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])
    {
        double3 xformOp:translate = (2, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
def PhysicsFixedJoint "weld"
{
    rel physics:body0 = </arm>
    rel physics:body1 = </arm/flange>
    point3f physics:localPos0 = (2, 0, 0)
}
def PhysicsRevoluteJoint "shoulder"
{
    rel physics:body0 = </anchor>
    rel physics:body1 = </arm>
}
def Cube "tool" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"])
{
    double3 xformOp:translate = (4, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def PhysicsRevoluteJoint "wrist"
{
    rel physics:body0 = </arm/flange>
    rel physics:body1 = </tool>
    point3f physics:localPos0 = (0.5, 0, 0)
    point3f physics:localPos1 = (-1.5, 0, 0)
}
"""


def test_bodies_without_mass_that_fixed_joints_hold_are_frames(tmp_path):
    """An anchor stands still; a flange belongs to the arm that it lies in, and a joint of the tool holds on to that arm."""
    scene = written(tmp_path / "a.usda", FRAMES)
    assert [body.path for body in scene.things("Body")] == ["/arm", "/tool"]
    joints = {joint.path: joint for joint in scene.things("Joint")}
    assert set(joints) == {"/shoulder", "/wrist"}
    assert joints["/shoulder"].body0 == "" and joints["/wrist"].body0 == "/arm"
    assert np.allclose(joints["/wrist"].at0, (2.5, 0.0, 0.0))


def test_frames_that_hold_each_other_alone_have_no_mass(tmp_path):
    """Nothing holds the two of them but themselves: they are bodies, and refused by name."""
    text = """#usda 1.0
( metersPerUnit = 1; upAxis = "Z"; timeCodesPerSecond = 24; startTimeCode = 0; endTimeCode = 5 )
def Xform "outer" (prepend apiSchemas = ["PhysicsRigidBodyAPI"])
{
    def Xform "inner" (prepend apiSchemas = ["PhysicsRigidBodyAPI"]) {}
}
def PhysicsFixedJoint "weld"
{
    rel physics:body0 = </outer>
    rel physics:body1 = </outer/inner>
}
"""
    with pytest.raises(SceneError, match="/outer: has no mass"):
        written(tmp_path / "a.usda", text)


def cube(stage, path: str, size: float):
    found = UsdGeom.Cube.Define(stage, path)
    found.CreateSizeAttr(size)
    UsdPhysics.CollisionAPI.Apply(found.GetPrim())
    return found.GetPrim()


def given(prim, rng, names: dict) -> None:
    """Half of the attributes of PhysicsMassAPI, at random."""
    api = UsdPhysics.MassAPI.Apply(prim)
    for name, value in names.items():
        if rng.uniform() < 0.5:
            getattr(api, f"Create{name}Attr")(value)


@pytest.mark.parametrize("seed", range(8))
def test_masses_are_those_of_usd_core_wherever_they_are_authored(seed, tmp_path):
    """Two cubes of 0.6 and 1.1 m with masses, densities, centres, inertias and materials at random; without an own inertia of
    the whole, whose axes usd-core takes from the colliders."""
    rng, stage = np.random.default_rng(seed), Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    body = UsdGeom.Xform.Define(stage, "/body").GetPrim()
    UsdPhysics.RigidBodyAPI.Apply(body)
    given(body, rng, {"Mass": 7.0, "Density": 300.0, "CenterOfMass": Gf.Vec3f(0.1, 0.2, 0.0)})
    material = UsdShade.Material.Define(stage, "/material")
    UsdPhysics.MaterialAPI.Apply(material.GetPrim()).CreateDensityAttr(50.0)
    for k, size in enumerate((0.6, 1.1)):
        prim = cube(stage, f"/body/c{k}", size)
        UsdGeom.Xformable(prim).AddTranslateOp().Set((1.5 * k, 0.3, 0.1))
        UsdGeom.Xformable(prim).AddRotateZOp().Set(30.0)
        given(prim, rng, {"Mass": 3.0 + k, "Density": 200.0, "CenterOfMass": Gf.Vec3f(0.0, 0.1, 0.0)})
        if rng.uniform() < 0.5:
            UsdShade.MaterialBindingAPI.Apply(prim).Bind(material, materialPurpose="physics")
    stage.Save()
    by_path = {c.path: shape_volume(c.shape).moved(c.motion.at(0.0)) for c in load(stage).things("Body")[0].colliders}

    def information(prim, *_):
        found, own = UsdPhysics.RigidBodyAPI.MassInformation(), by_path[str(prim.GetPath())]
        M = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prim)).T
        found.volume, found.centerOfMass = own.volume, Gf.Vec3f(0.0)
        found.inertia = Gf.Matrix3f(*(M[:3, :3].T @ own.inertia @ M[:3, :3]).ravel().tolist())
        found.localPos = Gf.Vec3f(*M[:3, 3].tolist())
        found.localRot = Gf.Quatf(float(np.cos(np.pi / 12)), Gf.Vec3f(0.0, 0.0, float(np.sin(np.pi / 12))))
        return found
    mass, moments, center, _ = UsdPhysics.RigidBodyAPI(body).ComputeMassProperties(information)
    found = body_inertia(load(stage).things("Body")[0])
    assert abs(found.mass / mass - 1.0) < 1e-5 and np.allclose(found.center, center, atol=1e-5)
    assert np.allclose(found.moments, sorted(moments), rtol=1e-4)


def test_axes_are_the_prims_where_none_are_authored_and_light_bodies_keep_their_inertia(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    bare = UsdGeom.Xform.Define(stage, "/bare").GetPrim()
    api = UsdPhysics.MassAPI.Apply(bare)
    api.CreateMassAttr(1.0)
    api.CreateDiagonalInertiaAttr(Gf.Vec3f(0.1, 0.2, 0.25))
    light = cube(stage, "/light", 1e-3)
    for prim in (bare, light):
        UsdPhysics.RigidBodyAPI.Apply(prim)
    stage.Save()
    bodies = {body.path: body_inertia(body) for body in load(stage).things("Body")}
    assert np.array_equal(bodies["/bare"].axes, (0.0, 0.0, 0.0, 1.0)) and np.allclose(bodies["/bare"].moments, (0.1, 0.2, 0.25))
    assert np.allclose(bodies["/light"].moments, 1e-6 * 1e-6 / 6.0, rtol=1e-6)


BOX = shapes.box((0.5, 0.5, 0.5))


def turned(indices: np.ndarray, faces) -> np.ndarray:
    found = np.array(indices).reshape(-1, 4)
    found[list(faces)] = found[list(faces), ::-1]
    return found.ravel()


@pytest.mark.parametrize("faces", [(), (2,), (0, 3), (0, 1, 2, 3, 4, 5)])
@pytest.mark.parametrize("shared", [True, False])
def test_a_closed_mesh_has_its_volume_however_its_faces_are_wound(faces, shared):
    points, counts, indices = BOX
    indices = turned(indices, faces)
    if not shared:
        points, indices = points[indices], np.arange(len(indices))
    found, true = shape_volume(Surface(points + np.array([3.0, 0.0, 0.0]), counts, indices)), shape_volume(Box((0.5, 0.5, 0.5)))
    assert abs(found.volume - 1.0) < 1e-6 and np.allclose(found.center, (3.0, 0.0, 0.0), atol=1e-6)
    assert np.allclose(found.inertia, true.inertia, atol=1e-6)


def test_a_hollow_stays_hollow_and_what_has_one_side_stays_as_it_is():
    points, counts, indices = BOX
    inner = turned(indices, range(6)) + len(points)                       # wound inward: a hollow of an eighth
    both = Surface(np.concatenate([points, 0.5 * points]), np.concatenate([counts, counts]),
                   np.concatenate([turned(indices, (1,)), turned(inner, (4,))]))
    assert abs(shape_volume(both).volume - 0.875) < 1e-6
    angle = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    side = np.stack([np.cos(angle / 2) * np.cos(angle), np.cos(angle / 2) * np.sin(angle), np.sin(angle / 2)], 1)
    middle = 3.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], 1)
    k, last = np.arange(12), np.append(np.arange(1, 12), 12)
    low, high = last % 12 + 12 * (last // 12), (last + 12) % 24           # the seam joins one rim to the other
    strip = np.concatenate([np.stack([k, low, k + 12], 1), np.stack([low, high, k + 12], 1)])
    found = np.concatenate([middle + side, middle - side])
    assert np.array_equal(wound_alike(found, strip), strip)


@pytest.mark.parametrize("approximation, mass", [("convexHull", 1000.0), ("boundingCube", 1000.0), ("boundingSphere",
                                                 1000.0 * np.pi * np.sqrt(0.75)), ("none", None)])
def test_an_open_mesh_has_the_mass_of_what_it_is_met_as(approximation, mass, tmp_path):
    """A cube of 1 m without its lid; as it is it encloses nothing, and is refused."""
    stage, (points, counts, indices) = Usd.Stage.CreateNew(str(tmp_path / "a.usda")), BOX
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    mesh = UsdGeom.Mesh.Define(stage, "/body")
    mesh.CreatePointsAttr([Gf.Vec3f(*p) for p in points.tolist()])
    mesh.CreateFaceVertexCountsAttr(counts[1:].tolist())
    mesh.CreateFaceVertexIndicesAttr(indices[4:].tolist())
    for api in (UsdPhysics.RigidBodyAPI, UsdPhysics.CollisionAPI):
        api.Apply(mesh.GetPrim())
    UsdPhysics.MeshCollisionAPI.Apply(mesh.GetPrim()).CreateApproximationAttr(approximation)
    if mass is None:
        with pytest.raises(SceneError, match="/body: has no mass"):
            load(stage)
        return
    (body,) = load(stage).things("Body")
    assert abs(body_inertia(body).mass / mass - 1.0) < 1e-5 and np.abs(body_inertia(body).center).max() < 1e-6


def test_a_joint_frame_is_made_a_unit_and_said(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.RigidBodyAPI.Apply(cube(stage, "/b", 1.0))
    joint = UsdPhysics.FixedJoint.Define(stage, "/joint")
    joint.CreateBody1Rel().SetTargets([Sdf.Path("/b")])
    joint.CreateLocalRot1Attr(Gf.Quatf(1.0, Gf.Vec3f(-0.3, 0.0, 0.0)))
    stage.Save()
    scene = load(stage)
    assert any("length 1.04403" in note.text and "/joint" in note.path for note in scene.notes)
    assert abs(np.linalg.norm(scene.things("Joint")[0].turn1) - 1.0) < 1e-12


def test_limits_whose_schema_is_not_applied_are_said(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.RigidBodyAPI.Apply(cube(stage, "/b", 1.0))
    joint = UsdPhysics.Joint.Define(stage, "/joint")
    joint.CreateBody1Rel().SetTargets([Sdf.Path("/b")])
    UsdPhysics.LimitAPI.Apply(joint.GetPrim(), "transX").CreateLowAttr(0.0)
    joint.GetPrim().CreateAttribute("limit:rotX:physics:low", Sdf.ValueTypeNames.Float).Set(0.0)
    stage.Save()
    said = [note.text for note in load(stage).notes if "PhysicsLimitAPI" in note.text]
    assert len(said) == 1 and "PhysicsLimitAPI:rotX" in said[0]
