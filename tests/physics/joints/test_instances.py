"""Instances of PointInstancers and roots of native instances as rigid bodies."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, Vt

from wsim.cli.run import prepare_recorded_run
from wsim.scene import SceneError
from wsim.simulation.simulation import Simulation
from wsim.usd import load
from wsim.usd.result.restart import ResultReader

CPU = {"device": "cpu"}
AT = [(0.0, 100.0, 0.0), (300.0, 100.0, 0.0), (600.0, 100.0, 0.0)]
TURN = Gf.Quath(float(np.cos(0.3)), 0.0, 0.0, float(np.sin(0.3)))


def stage_of(path, scales=None):
    """Three instances in centimetres below a turned and moved frame; the second prototype is none that moves."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, "Y")
    stage.SetStartTimeCode(0.0)
    stage.SetEndTimeCode(12.0)
    world = UsdGeom.Xform.Define(stage, "/World")
    world.AddTranslateOp().Set((0.0, 50.0, 0.0))
    world.AddRotateYOp().Set(90.0)
    many = UsdGeom.PointInstancer.Define(stage, "/World/many")
    cube = UsdGeom.Cube.Define(stage, "/World/many/Prototypes/box")
    cube.CreateSizeAttr(20.0)
    cube.AddScaleOp().Set((1.0, 2.0, 1.0))
    UsdPhysics.CollisionAPI.Apply(cube.GetPrim())
    UsdPhysics.RigidBodyAPI.Apply(cube.GetPrim())
    UsdGeom.Sphere.Define(stage, "/World/many/Prototypes/dot")
    many.CreatePrototypesRel().SetTargets([cube.GetPath(), Sdf.Path("/World/many/Prototypes/dot")])
    many.CreateProtoIndicesAttr(Vt.IntArray([0, 1, 0]))
    many.CreatePositionsAttr(Vt.Vec3fArray([Gf.Vec3f(*p) for p in AT]))
    many.CreateOrientationsAttr(Vt.QuathArray([TURN] * 3))
    many.CreateVelocitiesAttr(Vt.Vec3fArray([Gf.Vec3f(100.0, 0.0, 0.0)] * 3))
    if scales:
        many.CreateScalesAttr(Vt.Vec3fArray([Gf.Vec3f(*s) for s in scales]))
    stage.Save()


def frames(path, code) -> np.ndarray:
    stage = path if isinstance(path, Usd.Stage) else Usd.Stage.Open(str(path))
    many = UsdGeom.PointInstancer(stage.GetPrimAtPath("/World/many"))
    found = many.ComputeInstanceTransformsAtTime(code, code)
    W = UsdGeom.XformCache(code).GetLocalToWorldTransform(many.GetPrim())
    return np.array([np.array(M * W).T for M in found])


def test_instances_are_bodies_where_the_instancer_has_them(tmp_path):
    stage_of(tmp_path / "a.usda")
    bodies = load(tmp_path / "a.usda").things("Body")
    assert [b.path for b in bodies] == ["/World/many/box_0", "/World/many/box_2"]
    given = frames(tmp_path / "a.usda", 0.0)
    for body, M in zip(bodies, given[[0, 2]], strict=True):
        assert np.allclose(body.motion.at(0.0)[:3, 3], 0.01 * M[:3, 3], atol=1e-7) and abs(body.mass - 16.0) < 1e-5
        assert np.allclose(body.motion.at(0.0)[:3, :3] @ body.stretch, M[:3, :3], atol=1e-3)
        assert np.allclose(body.velocity, (0.0, 0.0, -1.0), atol=1e-6)
        assert np.allclose(body.colliders[0].shape.half, (0.1, 0.2, 0.1))


def test_results_are_positions_and_orientations_of_the_instancer_and_go_on_to_the_bit(tmp_path):
    stage_of(tmp_path / "a.usda")

    def run(name: str, count: int, restart: str | None = None):
        scene = replace(load(tmp_path / "a.usda"), frames=count)
        scene.things("Body")[0].spin = np.array([0.0, 2.0, 0.0])
        job = prepare_recorded_run(scene, str(tmp_path / name), lambda s: Simulation(s, **CPU), restart=restart)
        job.frames()
        return job.simulation
    one = run("whole.usdc", 12)
    run("half.usdc", 6)
    two = run("rest.usdc", 12, str(tmp_path / "half.usdc"))
    m = one.plan.method("rigid")
    for name in ("x", "q", "p", "L"):
        assert np.array_equal(m.get(name), two.plan.method("rigid").get(name)), name
    stage = ResultReader(str(tmp_path / "whole.usdc")).stage
    many = UsdGeom.PointInstancer(stage.GetPrimAtPath("/World/many"))
    assert many.GetPositionsAttr().GetNumTimeSamples() == 13
    given, now, poses = frames(tmp_path / "a.usda", 0.0), frames(stage, 12.0), m.poses()
    assert np.abs(now[1] - given[1]).max() < 1e-3                            # nothing moves it
    for k, row in ((0, 0), (2, 1)):
        stretch = one.scene.things("Body")[row].stretch
        assert np.allclose(now[k][:3, :3], poses[row][:3, :3] @ stretch, atol=1e-5)
        assert np.allclose(now[k][:3, 3], 100.0 * poses[row][:3, 3], atol=1e-3)
    fallen = 0.01 * (now[2] - given[2])[:3, 3]
    assert np.allclose(fallen, (0.0, -0.5 * 9.81 * 0.25, -0.5), atol=1e-4)
    rates = np.array(many.GetVelocitiesAttr().Get(12.0))
    assert np.allclose(rates[2], (100.0, -981.0 * 0.5, 0.0), atol=0.05) and np.allclose(rates[1], (100.0, 0.0, 0.0))
    x, y, z = np.degrees(m.spins()[0])                                  # the frame above is turned by a right angle about y
    assert np.allclose(np.array(many.GetAngularVelocitiesAttr().Get(12.0))[0], (-z, y, x), atol=1e-3) and abs(x) > 1.0


def test_a_larger_instance_is_as_dense_and_one_scaled_by_axis_is_refused(tmp_path):
    stage_of(tmp_path / "a.usda", [(2.0, 2.0, 2.0), (1.0, 1.0, 1.0), (1.0, 1.0, 1.0)])
    big, same = load(tmp_path / "a.usda").things("Body")
    assert abs(big.mass / same.mass - 8.0) < 1e-5 and np.allclose(big.inertia, 32.0 * same.inertia, rtol=1e-5)
    assert np.allclose(big.colliders[0].shape.half, (0.2, 0.4, 0.2))
    stage_of(tmp_path / "b.usda", [(2.0, 1.0, 1.0)] * 3)
    with pytest.raises(SceneError, match="/World/many: instance 0 is scaled"):
        load(tmp_path / "b.usda")


def test_the_root_of_an_instance_is_written_over_and_what_is_within_is_refused(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.CreateClassPrim("/_ball")
    ball = UsdGeom.Sphere.Define(stage, "/_ball/shape")
    UsdPhysics.CollisionAPI.Apply(ball.GetPrim())
    for k in range(2):
        prim = UsdGeom.Xform.Define(stage, f"/b{k}").GetPrim()
        prim.GetReferences().AddInternalReference("/_ball")
        prim.SetInstanceable(True)
        UsdPhysics.RigidBodyAPI.Apply(prim)
        UsdGeom.Xformable(prim).AddTranslateOp().Set((5.0 * k, 0.0, 0.0))
    stage.Save()
    scene = replace(load(tmp_path / "a.usda"), frames=2)
    assert [len(b.colliders) for b in scene.things("Body")] == [1, 1]
    prepare_recorded_run(scene, str(tmp_path / "o.usdc"), lambda s: Simulation(s, **CPU)).frames()
    result = ResultReader(str(tmp_path / "o.usdc"))
    moved = result.stage.GetPrimAtPath("/b1")
    assert moved.IsInstance() and moved.GetAttribute("xformOp:transform").GetNumTimeSamples() == 3
    UsdPhysics.RigidBodyAPI.Apply(ball.GetPrim())
    for k in range(2):
        stage.GetPrimAtPath(f"/b{k}").RemoveAPI(UsdPhysics.RigidBodyAPI)
    stage.Save()
    with pytest.raises(SceneError, match="/b0/shape: .*author instanceable = false"):
        load(tmp_path / "a.usda")
