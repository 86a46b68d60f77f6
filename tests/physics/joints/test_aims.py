"""Targets and speeds of drives that vary in time: samples and splines of UsdPhysics, both ways, and where they take a body."""

import numpy as np
import pytest
from pxr import Ts, Usd, UsdPhysics

from tests.make.physics.joints.aims import WAY, slider
from tests.make.physics.rigid.contact import box
from tests.physics.joints.make import rod, scene
from wsim.physics.rigid.joints.joint import Drive, joint_between, locked_limits_except, prismatic_joint, revolute_joint
from wsim.scene import Plane, SceneError, Varying
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Curve
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save


@pytest.mark.parametrize("name", ["target", "speed"])
def test_a_body_follows_the_target_of_its_drive(name):
    """A critically damped drive of 200/s is 2 / 200 s behind a target that goes on; of a speed alone, no spring, 1 / 400 s.
    """
    made = slider(name)
    if name == "speed":
        made.things("Joint")[0].drives["transX"] = Drive(0.0, 4e2)
    sim, found = Simulation(made, device="cpu", precision="float64"), []
    for _ in range(30):
        sim.step()
        found.append((sim.time, sim.plan.method("rigid").poses()[0, 0, 3], sim.plan.method("rigid").velocities()[0, 0]))
    t, x, v = np.array(found).T
    behind = 0.01 if name == "target" else 1.0 / 400.0
    want = WAY.sampled(np.maximum(t - behind, 0.0))
    assert np.abs((x if name == "target" else v) - want).max() < 0.01
    assert np.ptp(x) > 0.05


def driven_by_scipy(name: str) -> tuple[float, float]:
    """Place and velocity of the slider at the end of WAY, by the equation m x'' = k (target - x) + c (speed - x')."""
    integrate = pytest.importorskip("scipy.integrate")
    k, c = (400.0, 20.0) if name == "target" else (0.0, 40.0)

    def rate(t: float, y: np.ndarray) -> list:
        goal = WAY.at(t)
        return [y[1], k * ((goal - y[0]) if name == "target" else 0.0) + c * ((goal if name == "speed" else 0.0) - y[1])]
    y = [0.0, 0.0]
    for a, b in zip(WAY.times[:-1], WAY.times[1:], strict=True):
        y = integrate.solve_ivp(rate, (a, b), y, rtol=1e-12, atol=1e-14, method="DOP853").y[:, -1]
    return y[0], y[1]


@pytest.mark.parametrize(("name", "beside"), [("target", False), ("speed", False),
                                              pytest.param("target", True, marks=pytest.mark.slow)])
def test_what_a_drive_moves_along_a_curve_converges_with_its_steps(name, beside):
    """Order 2, at five frames a half second. beside: contacts of other bodies share the steps."""
    x, v = driven_by_scipy(name)
    errors = []
    for substeps in (8, 16, 32):
        made = slider(name, fps=10.0, substeps=substeps)
        made.things("Joint")[0].drives["transX"] = Drive(400.0, 20.0) if name == "target" else Drive(0.0, 40.0)
        if beside:
            made.add(box("/c", (0.0, 3.0, 0.0)))
            made.collider("/floor", Plane(), at=(0.0, 2.5, 0.0))
        sim = Simulation(made, device="cpu", precision="float64")
        sim.run(5)
        rigid = sim.plan.method("rigid")
        errors.append((abs(rigid.poses()[0, 0, 3] - x), abs(rigid.velocities()[0, 0] - v)))
    seen = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    assert seen.min() > 1.8, (errors, seen)


def test_a_target_that_is_set_by_hand_stays_in_its_world():
    sim = Simulation(slider(), device="cpu", precision="float64", worlds=2)
    sim.step()
    sim.set("/rail", "target", -0.3, world=1)
    sim.run(40)
    x = sim.plan.method("rigid").poses()[:, 0, 3]
    np.testing.assert_allclose(x, [0.1, -0.3], atol=1e-6)


@pytest.mark.parametrize("angle", [False, True])
def test_splines_of_targets_are_written_and_read(tmp_path, angle):
    """Metres and degrees of a float attribute: seven digits."""
    body = rod("/b", (0.0, 0.0, 0.0))
    joint = (revolute_joint if angle else prismatic_joint)("/j", None, body,
                                                           drives={"rotX" if angle else "transX": Drive(30.0, 2.0)})
    made = scene(body, joint, frames=30)
    made.varying.append(Varying("/j", "target", WAY))
    save(made, tmp_path / "a.usda")
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    attribute = UsdPhysics.DriveAPI(stage.GetPrimAtPath("/j"), "angular" if angle else "linear").GetTargetPositionAttr()
    assert attribute.HasSpline() and not attribute.GetTimeSamples()
    (found,) = load(tmp_path / "a.usda").varying
    t = np.linspace(-0.1, 0.7, 41)
    assert (found.path, found.name) == ("/j", "target")
    np.testing.assert_allclose(found.curve.sampled(t), WAY.sampled(t), atol=1e-7)


def test_samples_of_one_drive_of_several_are_read_and_written_again(tmp_path):
    b = [rod(f"/b{k}", (float(k), 0.0, 0.0)) for k in range(2)]
    six = joint_between("/j", b[0], b[1], limits=locked_limits_except("rotX", "transZ"), drives={"rotX": Drive(3.0, 1.0, 0.5),
                                                                                "transZ": Drive(4.0, 1.0, 0.25)})
    save(scene(*b, six, frames=30), tmp_path / "a.usda")
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    target = UsdPhysics.DriveAPI(stage.GetPrimAtPath("/j"), "rotX").GetTargetPositionAttr()
    target.Set(0.0, 0.0), target.Set(90.0, 30.0)
    stage.Save()
    first = load(tmp_path / "a.usda")
    (found,) = first.varying
    np.testing.assert_allclose(found.curve.at(0.25), [np.pi / 4.0 if a == "rotX" else 0.25 for a in six.driven()], atol=1e-6)
    assert not [p for p in check_scene(first) if p.fatal]
    save(first, tmp_path / "b.usda")
    (again,) = load(tmp_path / "b.usda").varying
    np.testing.assert_allclose(again.curve.sampled(np.array([0.1, 0.5])), found.curve.sampled(np.array([0.1, 0.5])), atol=1e-6)


def test_a_joint_without_a_drive_has_no_target_that_varies():
    body = rod("/b", (0.0, 0.0, 0.0))
    made = scene(body, prismatic_joint("/rail", None, body))
    made.varying.append(Varying("/rail", "target", WAY))
    assert any("/rail: target varies in time, and the joint has no drive" in str(p) for p in check_scene(made))
    with pytest.raises(SceneError, match="allowed: finite numbers"):
        raise SceneError([p for p in check_scene(slider(curve=Curve([0.0, 1.0], np.zeros((2, 3))))) if p.fatal])


def test_a_spline_of_usd_moves_a_hinge_as_its_own_curve(tmp_path):
    body = rod("/b", (0.0, 0.0, 0.0))
    save(scene(body, revolute_joint("/j", None, body, drives={"rotX": Drive(30.0, 2.0)}), frames=30), tmp_path / "a.usda")
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    attribute = UsdPhysics.DriveAPI(stage.GetPrimAtPath("/j"), "angular").GetTargetVelocityAttr()
    spline = Ts.Spline("float")
    for time, value, slope in ((0.0, 10.0, 3.0), (20.0, 50.0, -2.0)):
        knot = Ts.Knot(typeName="float", time=time, value=value)
        knot.SetNextInterpolation(Ts.InterpCurve)
        knot.SetPreTanWidth(5.0), knot.SetPostTanWidth(5.0)
        knot.SetPreTanSlope(slope), knot.SetPostTanSlope(slope)
        spline.SetKnot(knot)
    attribute.SetSpline(spline)
    stage.Save()
    (found,) = load(tmp_path / "a.usda").varying
    fps = stage.GetTimeCodesPerSecond()
    want = np.radians([attribute.Get(code) for code in (0.0, 7.3, 15.0, 24.0)])
    np.testing.assert_allclose(found.curve.sampled(np.array([0.0, 7.3, 15.0, 24.0]) / fps), want, rtol=1e-6)


def test_a_spline_of_one_drive_of_several_is_followed_exactly_and_other_samples_are_told(tmp_path):
    b = [rod(f"/b{k}", (float(k), 0.0, 0.0)) for k in range(2)]
    six = joint_between("/j", b[0], b[1], limits=locked_limits_except("rotX", "transZ"), drives={"rotX": Drive(3.0, 1.0, 0.5),
                                                                                "transZ": Drive(4.0, 1.0, 0.25)})
    save(scene(*b, six, frames=30), tmp_path / "a.usda")
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    drive, spline = UsdPhysics.DriveAPI(stage.GetPrimAtPath("/j"), "rotX"), Ts.Spline("float")
    for time, value, slope in ((0.0, 10.0, 3.0), (20.0, 50.0, -2.0)):
        spline.SetKnot(Ts.Knot(typeName="float", time=time, value=value, nextInterp=Ts.InterpCurve, preTanSlope=slope,
                               postTanSlope=slope, preTanWidth=5.0, postTanWidth=7.0))
    spline.SetPostExtrapolation(Ts.Extrapolation(Ts.ExtrapLoopOscillate))
    drive.GetTargetPositionAttr().SetSpline(spline)
    drive.GetStiffnessAttr().Set(30.0, 1.0), drive.GetStiffnessAttr().Set(60.0, 9.0)
    stage.Save()
    found = load(tmp_path / "a.usda")
    (aim,), codes = found.varying, np.array([-4.0, 0.0, 3.3, 19.0, 31.0, 77.7])
    want = np.radians([drive.GetTargetPositionAttr().Get(code) for code in codes])
    got = aim.curve.sampled(codes / stage.GetTimeCodesPerSecond())
    np.testing.assert_allclose(got, [[x if a == "rotX" else 0.25 for a in six.driven()] for x in want], rtol=1e-6)
    assert any("drive:rotX:physics:stiffness: is sampled in time" in str(note) for note in found.notes)
