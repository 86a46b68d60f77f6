"""Joints of robots that add mobility, one behind the other between the same bodies, and their passive springs and dampers."""

from math import radians

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdPhysics

from tests.make.physics.joints.stacked import stage_of
from wsim.geometry import rotation
from wsim.physics.rigid.joints.joint import AXES, LOCKED, Joint
from wsim.scene import SceneError
from wsim.usd import load

X, Y = np.eye(3)[0], np.eye(3)[1]


def free(joint: Joint) -> set[str]:
    return {name for name in AXES if joint.limits.get(name) != LOCKED}


@pytest.mark.parametrize("outer, inner", [("X", "Y"), ("Z", "X"), ("Y", "Z")])
def test_two_turns_have_the_freedom_of_one_behind_the_other(outer, inner, tmp_path):
    """R = R(outer, s) R(inner, t) is a twist about x by t and then a swing about y by s, up to signs, for any angles."""
    hinge = UsdPhysics.RevoluteJoint
    (joint,) = load(stage_of(tmp_path, [(hinge, outer, -10.0, 20.0), (hinge, inner, -30.0, 40.0)])).things("Joint")
    assert joint.path == "/j0" and free(joint) == {"rotX", "rotY"}
    axes = dict(zip("XYZ", np.eye(3), strict=True))
    for s, t in ((0.3, 0.4), (-2.0, 1.5)):
        R = rotation.axis_rotation_matrix(axes[outer], s) @ rotation.axis_rotation_matrix(axes[inner], t)
        between = rotation.quaternion_to_matrix(joint.turn0).T @ R @ rotation.quaternion_to_matrix(joint.turn1)
        own = rotation.quaternion_to_matrix(joint.turn1).T
        signs = [float(np.sign((own @ axes[a])[k])) for k, a in enumerate((inner, outer))]
        expected = rotation.axis_rotation_matrix(Y, signs[1] * s) @ rotation.axis_rotation_matrix(X, signs[0] * t)
        assert np.abs(between - expected).max() < 1e-6
    for name, low, high, sign in (("rotX", -30.0, 40.0, signs[0]), ("rotY", -10.0, 20.0, signs[1])):
        assert np.allclose(np.degrees(joint.limits[name]), (low, high) if sign > 0 else (-high, -low), atol=1e-4)


def test_a_planar_root_slides_twice_and_turns_once(tmp_path):
    slide, hinge = UsdPhysics.PrismaticJoint, UsdPhysics.RevoluteJoint
    endless = (-np.inf, np.inf)
    stage = stage_of(tmp_path, [(slide, "X", *endless), (slide, "Z", *endless), (hinge, "Y", *endless)])
    (joint,) = load(stage).things("Joint")
    assert len(free(joint)) == 3
    R = rotation.quaternion_to_matrix(joint.turn0)
    assert {tuple(np.abs(R[:, k]).round(6)) for k in range(3) if AXES[k] in free(joint)} == {(1.0, 0.0, 0.0), (0.0, 0.0, 1.0)}
    assert np.allclose(np.abs(R[:, 0]), Y) and "rotX" in free(joint)


def test_without_that_attribute_joints_constrain(tmp_path):
    hinge = UsdPhysics.RevoluteJoint
    assert len(load(stage_of(tmp_path, [(hinge, "X", -10.0, 10.0), (hinge, "Y", -10.0, 10.0)], False)).things("Joint")) == 2


def test_axes_that_are_not_orthogonal_are_refused(tmp_path):
    hinge = UsdPhysics.RevoluteJoint
    stage = stage_of(tmp_path, [(hinge, "X", -10.0, 10.0), (hinge, "X", -10.0, 10.0)])
    turn = Gf.Quatf(float(np.cos(0.3)), Gf.Vec3f(0.0, 0.0, float(np.sin(0.3))))
    for side in "01":
        stage.GetPrimAtPath("/j1").GetAttribute(f"physics:localRot{side}").Set(turn)
    with pytest.raises(SceneError, match="/j0: 2 joints .* add mobility along axes that are not orthogonal"):
        load(stage)


def test_passive_springs_and_dampers_are_drives_beside_armature_and_friction(tmp_path):
    """Newton's damping is per degree, MuJoCo's stiffness per radian."""
    stage = stage_of(tmp_path, [(UsdPhysics.RevoluteJoint, "X", -10.0, 10.0)])
    for name, value in (("newton:damping", 0.5), ("mjc:stiffness", 3.0), ("newton:armature", 0.25), ("newton:friction", 0.5)):
        stage.GetPrimAtPath("/j0").CreateAttribute(name, Sdf.ValueTypeNames.Float).Set(value)
    (joint,) = load(stage).things("Joint")
    drive = joint.drives["rotX"]
    assert abs(drive.damping / (0.5 * 180.0 / np.pi) - 1.0) < 1e-6 and drive.stiffness == 3.0
    assert joint.armature == {"rotX": 0.25} and joint.friction == {"rotX": 0.5}


@pytest.mark.parametrize("kind, name, unit, ref, springref", [
    (UsdPhysics.RevoluteJoint, "rotX", np.pi / 180.0, 30.0, 35.0),
    (UsdPhysics.RevoluteJoint, "rotX", np.pi / 180.0, radians(30.0), radians(35.0)),
    (UsdPhysics.PrismaticJoint, "transX", 1.0, 30.0, 35.0)])
def test_a_joint_of_mujoco_stands_at_its_reference(tmp_path, kind, name, unit, ref, springref):
    """At 30 in a range of -10 to 40, with a spring that rests at 35: 40 below to 10 above, and 5 to the rest."""
    stage = stage_of(tmp_path, [(kind, "X", -10.0, 40.0)])
    for key, value in (("mjc:ref", ref), ("mjc:springref", springref), ("mjc:stiffness", 3.0)):
        stage.GetPrimAtPath("/j0").CreateAttribute(key, Sdf.ValueTypeNames.Double).Set(value)
    if ref < 1.0:
        UsdPhysics.Scene.Define(stage, "/scene").GetPrim().CreateAttribute("mjc:compiler:angle", Sdf.ValueTypeNames.Token).Set(
            "radian")
    (joint,) = load(stage).things("Joint")
    assert np.allclose(joint.limits[name], np.array([-40.0, 10.0]) * unit)
    assert abs(joint.drives[name].target - 5.0 * unit) < 1e-9


def test_a_drive_that_varies_and_a_slide_behind_a_turn_are_said(tmp_path):
    slide, hinge = UsdPhysics.PrismaticJoint, UsdPhysics.RevoluteJoint
    stage = stage_of(tmp_path, [(hinge, "Y", -10.0, 10.0), (slide, "X", -1.0, 1.0)])
    assert any("turns with a hinge before it" in note.text for note in load(stage).notes)
    drive = UsdPhysics.DriveAPI.Apply(stage.GetPrimAtPath("/j1"), "linear")
    drive.CreateStiffnessAttr(1.0)
    for code in (0.0, 10.0):
        drive.CreateTargetPositionAttr().Set(0.1 * code, code)
    with pytest.raises(SceneError, match="/j0: is one of 2 joints .* varies in time"):
        load(stage)
