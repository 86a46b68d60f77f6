"""Splines of USD in what a scene reads over time: as USD itself evaluates them at any time, and back."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Ts, Usd, UsdGeom

from wsim.scene import Scene, Sphere, Varying
from wsim.scene.curve import Curve, Motion, Stack
from wsim.usd import load, save
from wsim.usd.stage import StageUnits
from wsim.usd.transforms.splines import curve_from_spline, spline_from_curve

FPS, START = 24.0, 1.0
CODES = np.linspace(-30.0, 90.0, 241) + 0.013


def spline(seed, size=1.0, outside=Ts.ExtrapLoopOscillate, kind="double") -> Ts.Spline:
    rng, found = np.random.default_rng(seed), Ts.Spline(kind)
    for t in (2.0, 14.5, 27.0, 49.0):
        found.SetKnot(Ts.Knot(typeName=kind, time=t, value=size * rng.normal(), nextInterp=Ts.InterpCurve,
                              preTanSlope=size * rng.normal() / 9, postTanSlope=size * rng.normal() / 9, preTanWidth=4.0,
                              postTanWidth=7.0))
    found.SetPreExtrapolation(Ts.Extrapolation(outside))
    found.SetPostExtrapolation(Ts.Extrapolation(outside))
    return found


def stage(path="") -> Usd.Stage:
    made = Usd.Stage.CreateNew(path) if path else Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(made, 0.01)
    UsdGeom.SetStageUpAxis(made, "Z")
    made.SetTimeCodesPerSecond(FPS)
    made.SetStartTimeCode(START)
    made.SetEndTimeCode(49)
    return made


def arm(made: Usd.Stage, path="/World") -> UsdGeom.Sphere:
    """A ball on a turning arm: splines above samples above splines, a pivot and a turned constant."""
    world = UsdGeom.Xform.Define(made, path)
    made.SetDefaultPrim(made.GetPrimAtPath("/World"))
    world.AddTranslateXOp().GetAttr().SetSpline(spline(1, 40.0))
    world.AddRotateZOp(UsdGeom.XformOp.PrecisionDouble).GetAttr().SetSpline(spline(2, 90.0, Ts.ExtrapLinear))
    mid = UsdGeom.Xform.Define(made, f"{path}/Arm")
    shift, turn = mid.AddTranslateOp(), mid.AddRotateXYZOp(UsdGeom.XformOp.PrecisionDouble)
    for code, k in ((1.0, 0), (20.0, 1), (40.0, 2)):
        shift.Set(Gf.Vec3d(10 * k, -5 * k, 3), code)
        turn.Set(Gf.Vec3d(30 * k, -50 * k, 80 * k), code)
    ball = UsdGeom.Sphere.Define(made, f"{path}/Arm/Ball")
    ball.CreateRadiusAttr(5.0)
    ball.AddTranslateOp(opSuffix="pivot").Set(Gf.Vec3d(1, 2, 3))
    ball.AddRotateYOp(UsdGeom.XformOp.PrecisionDouble).GetAttr().SetSpline(spline(3, 70.0, Ts.ExtrapHeld))
    ball.AddTranslateOp(opSuffix="pivot", isInverseOp=True)
    ball.GetPrim().AddAppliedSchema("PhysicsCollisionAPI")
    sheet = UsdGeom.Mesh.Define(made, f"{path}/Sheet")         # so that something can move
    sheet.CreatePointsAttr([(0, 0, 0), (9, 0, 0), (9, 9, 0)])
    sheet.CreateFaceVertexCountsAttr([3])
    sheet.CreateFaceVertexIndicesAttr([0, 1, 2])
    for api in ("PhysicsDeformableBodyAPI", "PhysicsSurfaceDeformableSimAPI"):
        sheet.GetPrim().AddAppliedSchema(api)
    return ball


def world_of(prim: Usd.Prim, metres=0.01) -> np.ndarray:
    found = []
    for code in CODES.tolist():
        M = np.array(UsdGeom.XformCache(Usd.TimeCode(code)).GetLocalToWorldTransform(prim)).T
        M[:3, 3] *= metres
        found.append(M)
    return np.array(found)


def times() -> np.ndarray:
    return StageUnits(fps=FPS, start=START).time(CODES)


def test_a_collider_under_splines_is_where_usd_has_it_at_any_time(tmp_path):
    made = stage(str(tmp_path / "arm.usda"))
    ball = arm(made)
    made.Save()
    motion = load(str(tmp_path / "arm.usda")).colliders[0].motion
    np.testing.assert_allclose(motion.sampled(times()), world_of(ball.GetPrim()), rtol=0, atol=1e-12)
    h = 1e-6
    np.testing.assert_allclose(motion.rate(times()), (motion.sampled(times() + h) - motion.sampled(times() - h)) / (2 * h),
                               rtol=1e-5, atol=1e-5)


def test_layers_that_are_offset_and_scaled_in_time_move_splines_and_samples(tmp_path):
    inner, outer = stage(str(tmp_path / "inner.usda")), stage(str(tmp_path / "outer.usda"))
    arm(inner)
    inner.Save()
    UsdGeom.Xform.Define(outer, "/Scene").GetPrim().GetReferences().AddReference("inner.usda", Sdf.LayerOffset(7.0, 0.6))
    outer.Save()
    found = load(str(tmp_path / "outer.usda")).colliders[0].motion
    expected = world_of(outer.GetPrimAtPath("/Scene/Arm/Ball"))
    np.testing.assert_allclose(found.sampled(times()), expected, rtol=0, atol=1e-12)


def test_a_scene_writes_its_splines_back(tmp_path):
    made = stage(str(tmp_path / "arm.usda"))
    arm(made)
    made.Save()
    scene = load(str(tmp_path / "arm.usda"))
    save(scene, str(tmp_path / "again.usda"))
    again = load(str(tmp_path / "again.usda"))
    np.testing.assert_allclose(again.colliders[0].motion.sampled(times()), scene.colliders[0].motion.sampled(times()),
                               rtol=0, atol=1e-12)
    written = Usd.Stage.Open(str(tmp_path / "again.usda"))
    prim = written.GetPrimAtPath(scene.colliders[0].path)
    assert sum(op.GetAttr().HasSpline() for op in UsdGeom.Xformable(prim).GetOrderedXformOps()) == 3
    found = world_of(prim, UsdGeom.GetStageMetersPerUnit(written))
    np.testing.assert_allclose(found, scene.colliders[0].motion.sampled(times()), rtol=0, atol=1e-12)


@pytest.mark.parametrize("motion", [
    Motion.through([0.0, 0.7, 2.0], np.eye(3), np.eye(4)[[3, 0, 1]], "catmull_rom", after="oscillate", alpha=0.5),
    Motion.through([0.0, 0.7, 2.0], np.eye(3), np.eye(4)[[3, 0, 1]], "eased", easing=["bounce-out", (0.1, 0.2, 0.3, 1.4)]),
    Motion.through([0.0, 0.7, 2.0], np.eye(3), None, "hermite", leave=np.ones((3, 3)))], ids=("squad", "eased", "hermite"))
def test_a_motion_of_any_kind_comes_back_from_a_file(tmp_path, motion):
    scene = Scene()
    scene.cloth("/Sheet", np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1]]), [3], [0, 1, 2])
    scene.collider("/Ball", Sphere(0.1), motion=motion)
    save(scene, str(tmp_path / "one.usda"))
    assert load(str(tmp_path / "one.usda")).colliders[0].motion == motion


CURVES = [Curve([0.0, 0.5, 2.0], [1.0, 3.0, -2.0], "catmull_rom", "linear", "repeat"),
          Curve([0.0, 0.5, 2.0], [1.0, 3.0, -2.0], "kochanek_bartels", tension=0.3, bias=0.1, continuity=-0.4),
          Curve([0.0, 0.5, 2.0], [1.0, 3.0, -2.0], "monotone", "reset", 2.5), Curve([0.0, 0.5, 2.0], [1.0, 3.0, -2.0], "hold"),
          Curve([0.0, 0.5, 2.0], [1.0, 3.0, -2.0], "linear", "oscillate", "linear"),
          Curve([0.0, 0.5, 2.0], [1.0, 3.0, -2.0], "eased", easing=["ease", (0.3, -0.5, 0.6, 1.4)]),
          Curve([0.0, 0.5, 2.0], [1.0, 3.0, -2.0], "hermite", leave=[1.0, 2.0, 3.0], form=["curve", "hold"], until=[1, 4, -2])]


@pytest.mark.parametrize("curve", CURVES, ids=[c.kind for c in CURVES])
def test_a_curve_of_numbers_is_a_spline_and_back(curve):
    units = StageUnits(fps=FPS, start=START)
    spline = spline_from_curve(curve, units, 2.0)
    t = np.linspace(-3.0, 5.0, 161) + 1e-3
    np.testing.assert_allclose(2.0 * np.array([spline.Eval(c) for c in units.code(t)]), curve.sampled(t), rtol=0, atol=1e-12)
    np.testing.assert_allclose(curve_from_spline(spline, units, 2.0).sampled(t), curve.sampled(t), rtol=0, atol=1e-12)


def test_what_no_spline_says_is_none():
    units = StageUnits()
    assert spline_from_curve(Curve([0.0, 1.0], [0.0, 1.0], "eased", easing="bounce-out"), units) is None
    assert spline_from_curve(Curve([0.0, 1.0], np.eye(2), "catmull_rom"), units) is None
    with pytest.raises(ValueError, match="no knots"):
        curve_from_spline(Ts.Spline(), units)
    assert isinstance(Stack([np.eye(4)]), Motion)


@pytest.mark.parametrize(("path", "name"), [("/", "air_drag"), ("/Sheet", "stretch"), ("/Sheet", "density"),
                                            ("/Ball", "dynamic_friction")])
def test_live_values_over_time_are_written_as_splines(tmp_path, path, name):
    """Floats: seven digits. What is no spline (an easing by its name) has samples where frames have their values."""
    smooth = Curve([0.0, 0.25, 1.0], [1.0, 3.0, 2.0], "catmull_rom", after="linear")
    for curve, splines in ((smooth, 1), (Curve([0.0, 0.25, 1.0], [1.0, 3.0, 2.0], "eased", easing="bounce-out"), 0)):
        scene = Scene(frames=24, fps=24.0)
        scene.cloth("/Sheet", np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1]]), [3], [0, 1, 2])
        scene.collider("/Ball", Sphere(0.1))
        scene.varying.append(Varying(path, name, curve))
        save(scene, str(tmp_path / "one.usda"))
        written = Usd.Stage.Open(str(tmp_path / "one.usda"))
        assert sum(a.HasSpline() for prim in written.Traverse() for a in prim.GetAttributes()) == splines
        (found,) = load(str(tmp_path / "one.usda")).varying
        t = (np.arange(24) + 0.5) / 24.0
        np.testing.assert_allclose(found.curve.sampled(t), curve.sampled(t), rtol=1e-6)
        assert (found.path, found.name) == (path, name)
