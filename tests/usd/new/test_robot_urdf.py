"""What `wsim new robot` adds to a converted URDF file: motors of transmissions, links without mass, inertia that is none."""

import pytest
from pxr import Gf, Usd, UsdGeom, UsdPhysics

from wsim.physics.rigid.mass import body_inertia
from wsim.scene import SceneError
from wsim.usd import load
from wsim.usd.new.robot.converter import converter_warnings
from wsim.usd.new.robot.urdf import author_urdf, read_urdf
from wsim.usd.stage import StageUnits

LINKS = ("base", "arm", "tool")
URDF = """<robot name="r"><link name="base"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
<link name="arm"><inertial><mass value="1"/><inertia ixx="0" iyy="0" izz="0"/></inertial></link>
<link name="tool"><collision><geometry><box size=".1 .1 .1"/></geometry></collision></link>
<joint name="elbow" type="revolute"><limit effort="60" lower="-1" upper="1"/></joint>{transmissions}</robot>"""
SIMPLE = """<transmission name="{name}"><type>transmission_interface/SimpleTransmission</type><joint name="{joint}">
<hardwareInterface>{interface}JointInterface</hardwareInterface></joint><actuator name="m"><mechanicalReduction>{reduction}
</mechanicalReduction></actuator></transmission>"""


def converted(tmp_path) -> Usd.Stage:
    """As a converter writes it: the base stands in the world, the tool is fixed to the arm."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "r.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/r").GetPrim())
    stage.SetEndTimeCode(3)
    path = "/r"
    for name in LINKS:
        path += f"/{name}"
        prim = (UsdGeom.Cube if name == "tool" else UsdGeom.Xform).Define(stage, path).GetPrim()
        UsdPhysics.RigidBodyAPI.Apply(prim)
        if name == "tool":
            UsdPhysics.CollisionAPI.Apply(prim)
        else:
            UsdPhysics.MassAPI.Apply(prim).CreateMassAttr({"base": 2.0, "arm": 1.0}[name])
        if name == "base":
            UsdPhysics.MassAPI(prim).CreateDiagonalInertiaAttr(Gf.Vec3f(1, 1, 1))
    elbow = UsdPhysics.RevoluteJoint.Define(stage, "/r/elbow")
    elbow.CreateBody0Rel().SetTargets(["/r/base"])
    elbow.CreateBody1Rel().SetTargets(["/r/base/arm"])
    fixed = UsdPhysics.FixedJoint.Define(stage, "/r/fixed")
    fixed.CreateBody0Rel().SetTargets(["/r/base/arm"])
    fixed.CreateBody1Rel().SetTargets(["/r/base/arm/tool"])
    return stage


def taken(tmp_path, transmissions: str):
    """(scene, warnings) of the robot with these transmissions."""
    file = tmp_path / "r.urdf"
    file.write_text(URDF.format(transmissions=transmissions))
    stage, notes = converted(tmp_path), []
    author_urdf(stage, str(file), read_urdf(str(file)), StageUnits(), notes)
    stage.Save()
    return load(tmp_path / "r.usda"), [problem.text for problem in notes]


def test_a_transmission_with_efforts_is_a_motor_with_its_gear(tmp_path):
    """A motor turns 50 times for the joint, which bears 60 N m: 1.2 N m of the motor."""
    scene, _ = taken(tmp_path, SIMPLE.format(name="t", joint="elbow", interface="Effort", reduction=50))
    motor, = scene.things("Actuator")
    assert (motor.joint, motor.gear, motor.gain, motor.bias) == ("/r/elbow", 50.0, 1.0, (0.0, 0.0, 0.0))
    assert abs(motor.force_range[1] - 1.2) < 1e-12 and motor.force_range[0] == -motor.force_range[1]


@pytest.mark.parametrize(("transmission", "said"), [
    (SIMPLE.format(name="t", joint="elbow", interface="Position", reduction=50), "URDF has no gains: t;"),
    (SIMPLE.format(name="t", joint="fixed", interface="Effort", reduction=50), "transmissions are left out: t;"),
    ('<transmission name="d" type="DifferentialTransmission"><joint name="elbow"/><joint name="fixed"/></transmission>',
     "transmissions are left out: d;")])
def test_other_transmissions_are_named(tmp_path, transmission, said):
    scene, notes = taken(tmp_path, transmission)
    assert not scene.things("Actuator") and any(said in note for note in notes)


def test_a_link_without_mass_is_part_of_the_link_that_it_is_fixed_to(tmp_path):
    """Its box touches things and has no mass; a link that is a point gets the inertia of a ball of 1 mm."""
    scene, notes = taken(tmp_path, "")
    bodies = {body.path: body for body in scene.things("Body")}
    assert set(bodies) == {"/r/base", "/r/base/arm"} and [joint.path for joint in scene.things("Joint")] == ["/r/elbow"]
    assert len(bodies["/r/base/arm"].colliders) == 1 and body_inertia(bodies["/r/base/arm"]).mass == 1.0
    assert abs(body_inertia(bodies["/r/base/arm"]).moments - 0.4e-6).max() < 1e-12
    assert any("arm; fix: give their inertia" in note for note in notes)


@pytest.mark.parametrize(("text", "said"), [
    ("<robot", "is no XML"), ('<robot><link name="a"><inertial><mass value="two"/></inertial></link></robot>',
                              "value of <mass> is 'two'; allowed: a finite number"),
    ('<robot><link name="a"><inertial><mass value="1"/><inertia ixx="nan"/></inertial></link></robot>',
     "ixx of <inertia> is 'nan'; allowed: a finite number"),
    (f"<robot>{SIMPLE.format(name='t', joint='elbow', interface='Effort', reduction='fifty')}</robot>",
     "mechanicalReduction of transmission t is")])
def test_bad_files_get_a_line(tmp_path, text, said):
    (tmp_path / "r.urdf").write_text(text)
    with pytest.raises(SceneError, match=said):
        read_urdf(str(tmp_path / "r.urdf"))


def test_shapes_that_a_converter_leaves_out_are_told_in_a_line():
    said = [f"[Warning] [a.b] {text}" for text in (
        "Failed to convert mesh: /far/away/hand.stl: no such file", "Failed to convert mesh: x.stl", "Unsupported texture",
        "Tendon equalities are not supported")]
    texts = [problem.text for problem in converter_warnings(said, "r.urdf")]
    assert len(texts) == 2 and "hand.stl" in texts[0] and "/far" not in texts[0] and "(and 1 more)" in texts[0]
    assert texts[1] == "the converter says: Tendon equalities are not supported"
