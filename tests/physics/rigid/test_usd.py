"""Rigid bodies in files: what is read, saved, written as results and restarted; what is wrong with them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdPhysics

from tests.make.physics.rigid.contact import ball, box, world
from tests.physics.rigid.pairs import WHERE
from wsim.cli.run import prepare_recorded_run
from wsim.geometry import rotation
from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Collider, Plane, Scene, SceneError, Sphere
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save
from wsim.usd.result.restart import ResultReader

ASSETS = Path(__file__).parents[3] / "scenes" / "assets"


def alike(some: list[Collider], others: list[Collider]) -> bool:
    """Equal but for the rounding of frames, which are products on a stage."""
    near = all(np.abs(a.motion.values - b.motion.values).max() < 1e-14 for a, b in zip(some, others, strict=True))
    return near and [replace(c, motion=None) for c in some] == [replace(c, motion=None) for c in others]


def test_a_scene_is_saved_and_loaded(tmp_path):
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = rotation.axis_rotation_matrix(np.array([0.6, 0.0, 0.8]), 0.7), (1.0, 2.0, 3.0)
    part = Collider("/World/body/part", Box((0.25, 0.5, 1.0)), Motion.at_place((0.5, 0.0, 0.0)), restitution=0.5)
    scene = Scene()
    scene.add(Body("/World/body", [part], Motion.still(M), velocity=(1.0, 2.0, 3.0), spin=(0.0, 2.0, 0.0), mass=2.0,
                   center=(0.25, 0.0, 0.0), inertia=(1.0, 2.0, 2.5), force=(0.0, 1.0, 0.0), drag=0.5))
    save(scene, tmp_path / "a.usda")
    (again,) = load(tmp_path / "a.usda").things("Body")
    (body,) = scene.things("Body")
    assert np.abs(again.motion.at(0.0) - M).max() < 1e-15 and alike(again.colliders, body.colliders)
    for name in ("velocity", "spin", "mass", "center", "inertia", "axes", "force", "torque", "drag", "spin_drag"):
        assert np.allclose(getattr(again, name), getattr(body, name), rtol=3e-7, atol=1e-7), name
    save(load(tmp_path / "a.usda"), tmp_path / "b.usda")
    assert alike(load(tmp_path / "b.usda").things("Body")[0].colliders, body.colliders)


def test_masses_are_those_of_usd_whatever_the_unit(tmp_path):
    """A cube of 20 cm in centimetres at the default density is 8 kg; one of 2 g/cm^3 16 kg; a given mass counts most."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    for name, given in (("plain", {}), ("dense", {"density": 0.002}), ("given", {"density": 0.002, "mass": 5.0})):
        prim = UsdGeom.Xform.Define(stage, f"/{name}").GetPrim()
        UsdPhysics.RigidBodyAPI.Apply(prim)
        api = UsdPhysics.MassAPI.Apply(prim)
        for key, value in given.items():
            getattr(api, f"Create{key.capitalize()}Attr")(value)
        cube = UsdGeom.Cube.Define(stage, f"/{name}/cube")
        cube.CreateSizeAttr(20.0)
        UsdPhysics.CollisionAPI.Apply(cube.GetPrim())
    stage.Save()
    masses = {b.path: (b.mass, b.inertia) for b in load(tmp_path / "a.usda").things("Body")}
    for path, mass in (("/plain", 8.0), ("/dense", 16.0), ("/given", 5.0)):
        assert abs(masses[path][0] / mass - 1.0) < 1e-6 and np.allclose(masses[path][1], mass * 0.04 / 6.0, rtol=1e-6)


def test_velocities_are_in_the_space_above_the_prim_and_in_degrees(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.Xform.Define(stage, "/World").AddRotateZOp().Set(90.0)
    sphere = UsdGeom.Sphere.Define(stage, "/World/ball")
    sphere.AddRotateZOp().Set(33.0)
    UsdPhysics.CollisionAPI.Apply(sphere.GetPrim())
    api = UsdPhysics.RigidBodyAPI.Apply(sphere.GetPrim())
    api.CreateVelocityAttr(Gf.Vec3f(1.0, 0.0, 0.0))
    api.CreateAngularVelocityAttr(Gf.Vec3f(0.0, 180.0, 0.0))
    stage.Save()
    (body,) = load(tmp_path / "a.usda").things("Body")
    assert np.allclose(body.velocity, (0.0, 1.0, 0.0), atol=1e-12) and np.allclose(body.spin, (-np.pi, 0.0, 0.0), atol=1e-12)
    assert [c.path for c in body.colliders] == ["/World/ball"]


def test_kinematic_bodies_stay_colliders_of_the_scene(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    for name, kinematic in (("free", False), ("driven", True)):
        sphere = UsdGeom.Sphere.Define(stage, f"/{name}")
        UsdPhysics.CollisionAPI.Apply(sphere.GetPrim())
        UsdPhysics.RigidBodyAPI.Apply(sphere.GetPrim()).CreateKinematicEnabledAttr(kinematic)
    stage.Save()
    scene = load(tmp_path / "a.usda")
    assert [b.path for b in scene.things("Body")] == ["/free"] and [c.path for c in scene.colliders] == ["/driven"]


@pytest.mark.parametrize("name, bodies, mass", [("simple_physics_scene", 3, 4.5), ("box_on_plane", 1, 1.0)])
def test_scenes_of_others_run_and_come_to_rest(name, bodies, mass):
    """4.5 of the 5.5 kg are dynamic."""
    scene = load(ASSETS / f"{name}.usda")
    assert len(scene.things("Body")) == bodies and abs(sum(b.mass for b in scene.things("Body")) - mass) < 1e-6
    sim = Simulation(replace(scene, substeps=8 if scene.fps > 100.0 else 20), **WHERE)
    sim.run(int(4.0 * scene.fps) if scene.fps < 100.0 else 200)
    assert np.abs(sim.plan.method("rigid").velocities()).max() < 5e-2


def test_the_humanoid_has_the_masses_of_its_table_and_all_of_its_joints():
    scene = load(ASSETS / "humanoid.usda")
    assert len(scene.things("Body")) == 16 and abs(sum(b.mass for b in scene.things("Body")) - 40.844) < 1e-3
    assert len(scene.things("Joint")) == 15 and len(scene.things("Group")) == 20


def test_results_are_transforms_that_keep_the_authored_scale(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.Xform.Define(stage, "/World").AddTranslateOp().Set((0.0, 1.0, 0.0))
    cube = UsdGeom.Cube.Define(stage, "/World/box")
    cube.AddTranslateOp().Set((1.0, 0.0, 0.0))
    cube.AddScaleOp().Set((1.0, 2.0, 3.0))
    UsdPhysics.CollisionAPI.Apply(cube.GetPrim())
    UsdPhysics.RigidBodyAPI.Apply(cube.GetPrim()).CreateVelocityAttr(Gf.Vec3f(1.0, 0.0, 0.0))
    stage.Save()
    scene = replace(load(tmp_path / "a.usda"), frames=2, gravity=(0.0, 0.0, 0.0))
    prepare_recorded_run(scene, str(tmp_path / "o.usdc"), lambda s: Simulation(s, **WHERE)).frames()
    result = ResultReader(str(tmp_path / "o.usdc"))
    prim = result.stage.GetPrimAtPath("/World/box")
    assert prim.GetAttribute("xformOp:transform").GetNumTimeSamples() == 3
    M = np.array(UsdGeom.XformCache(2.0).GetLocalToWorldTransform(prim)).T
    assert np.allclose(M[:3, :3], np.diag([1.0, 2.0, 3.0]), atol=1e-6) and np.allclose(M[:3, 3], (1.0 + 2.0 / 24.0, 1.0, 0.0))


def test_a_run_goes_on_to_the_bit(tmp_path):
    scene = world(*[box(f"/World/box{k}", (0.1 * k, 0.6 + 1.1 * k, 0.0)) for k in range(3)]).given
    save(replace(scene, frames=40), tmp_path / "s.usda")
    whole, half, rest = (str(tmp_path / f"{name}.usdc") for name in ("whole", "half", "rest"))

    def run(output: str, frames: int, restart: str | None = None):
        scene = replace(load(tmp_path / "s.usda"), frames=frames)
        job = prepare_recorded_run(scene, output, lambda s: Simulation(s, **WHERE), restart=restart)
        job.frames()
        return job.simulation
    one = run(whole, 40)
    run(half, 20)
    two = run(rest, 40, half)
    assert not any("bit for bit" in w for w in two.warnings)
    for name in ("x", "e", "q", "o", "p", "L"):
        assert np.array_equal(one.plan.method("rigid").get(name), two.plan.method("rigid").get(name)), name


@pytest.mark.parametrize("change, said", [
    ({"mass": 0.0}, "mass is 0"), ({"mass": -1.0}, "mass is -1"), ({"inertia": (0.0, 1.0, 1.0)}, "moments of inertia"),
    ({"axes": (0.0, 0.0, 0.0, 2.0)}, "quaternion of length 2"), ({"velocity": (np.nan, 0.0, 0.0)}, "velocity is"),
    ({"drag": -1.0}, "drag is -1"), ({"colliders": []}, "has no mass"),
    ({"colliders": [Collider("/b/c", Plane())]}, "is a plane"),
    ({"colliders": [Collider("/else", Sphere(1.0))]}, "no prim of it"),
    ({"motion": Motion.still(np.diag([2.0, 2.0, 2.0, 1.0]))}, "scale")])
def test_what_is_wrong_is_said_in_a_line_with_its_path_and_a_mend(change, said):
    scene = Scene()
    scene.add(replace(ball("/b", (0.0, 0.0, 0.0)), **change))
    problems = [p for p in check_scene(scene) if p.fatal]
    assert any(said in p.text and "fix: " in p.text and p.path in ("/b", "/b/c", "/else") for p in problems), problems
    with pytest.raises(SceneError, match="/b|/else"):
        Simulation(scene, **WHERE)


def test_moments_that_no_solid_has_are_a_warning():
    scene = Scene()
    scene.add(replace(ball("/b", (0.0, 0.0, 0.0)), inertia=(1.0, 1.0, 3.0)))
    (problem,) = [p for p in check_scene(scene) if "no solid has" in p.text]
    assert not problem.fatal


def test_gradients_are_refused_by_path():
    scene = Scene()
    scene.add(ball("/b", (0.0, 0.0, 0.0)))
    scene.add(ball("/c", (5.0, 0.0, 0.0)))
    with pytest.raises(SceneError, match="/b: can meet /c"):
        Simulation(scene, gradients=True, **WHERE)


def test_an_approximation_is_read_and_saved_and_an_unknown_one_is_told(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    for name, said in (("hull", "convexHull"), ("plain", None), ("field", "sdf"), ("odd", "star")):
        mesh = UsdGeom.Mesh.Define(stage, f"/{name}")
        mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
        mesh.CreateFaceVertexCountsAttr([3, 3, 3, 3])
        mesh.CreateFaceVertexIndicesAttr([0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3])
        UsdPhysics.CollisionAPI.Apply(mesh.GetPrim())
        if said:
            UsdPhysics.MeshCollisionAPI.Apply(mesh.GetPrim()).CreateApproximationAttr(said)
    UsdPhysics.CollisionAPI.Apply(UsdGeom.Sphere.Define(stage, "/ball").GetPrim())
    UsdPhysics.RigidBodyAPI.Apply(stage.GetPrimAtPath("/ball"))
    stage.Save()
    scene = load(tmp_path / "a.usda")
    assert {c.path: c.approximation for c in scene.colliders} == {"/hull": "convexHull", "/plain": "none", "/field": "sdf",
                                                            "/odd": "none"}
    assert any("is star" in p.text and p.path.startswith("/odd") for p in scene.notes)
    save(scene, tmp_path / "b.usda")
    assert {c.path: c.approximation for c in load(tmp_path / "b.usda").colliders}["/hull"] == "convexHull"
