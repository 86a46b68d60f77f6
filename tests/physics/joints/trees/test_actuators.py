"""Actuators beside MuJoCo, in both coordinates; controls; files; what is refused."""

import numpy as np
import pytest
import warp as wp
from pxr import Sdf, UsdPhysics

from tests.make.physics.joints.stacked import stage_of
from wsim import Actuator, Box, Curve, Scene, SceneError, Simulation, load, save
from wsim.scene.check.scene import check_scene

ARM = """<mujoco><compiler angle="radian"/><option gravity="0 -9.81 0" timestep="0.00025" integrator="RK4"/>
<default><geom type="box" density="1000" contype="0" conaffinity="0"/><joint type="hinge" axis="0 0 1"/></default>
<worldbody><body><joint name="a"/><geom size=".25 .02 .02" pos=".25 0 0"/>
<body pos=".5 0 0"><joint name="b"/><geom size=".2 .02 .02" pos=".2 0 0"/></body></body></worldbody>
<actuator>{}</actuator></mujoco>"""
LAWS = {            # {name: (MuJoCo's elements, wsim's (kind, joint, fields), controls)}
    "motors with a gear": ('<motor joint="a" gear="3"/><motor joint="b"/>',
                           [("motor", "/a", {"gear": 3.0}), ("motor", "/b", {})], (2.0, -0.3)),
    "servos": ('<position joint="a" kp="50" kv="3" gear="2"/><velocity joint="b" kv="2"/>',
               [("position", "/a", {"stiffness": 50.0, "damping": 3.0, "gear": 2.0}), ("velocity", "/b", {"damping": 2.0})],
               (0.5, 1.0)),
    "saturated": ('<position joint="a" kp="500" kv="3" forcerange="-3 3"/>'
                  '<motor joint="b" forcerange="-.2 .2" ctrllimited="true" ctrlrange="-1 1"/>',
                  [("position", "/a", {"stiffness": 500.0, "damping": 3.0, "force_range": (-3.0, 3.0)}),
                   ("motor", "/b", {"force_range": (-0.2, 0.2), "control_range": (-1.0, 1.0)})], (1.5, 5.0)),
    "two on a joint": ('<position joint="a" kp="30" kv="3" forcerange="-1 20"/><velocity joint="a" kv="1"/>'
                       '<general joint="b" gaintype="fixed" gainprm="2" biastype="affine" biasprm=".1 -3 -.4"/>',
                       [("position", "/a", {"stiffness": 30.0, "damping": 3.0, "force_range": (-1.0, 20.0)}),
                        ("velocity", "/a", {"damping": 1.0}), ("general", "/b", {"gain": 2.0, "bias": (0.1, -3.0, -0.4)})],
                       (1.0, 0.3, 0.3)),
}


def arm(actuators=(), controls=(), **more) -> Scene:
    """Two links that hang from /a and /b."""
    scene = Scene(fps=60, frames=30, **{"substeps": 16} | more)
    upper, lower = (scene.body(path, Box((length, 0.02, 0.02)), at=(x, 0.0, 0.0), density=1000.0)
                    for path, length, x in (("/upper", 0.25, 0.25), ("/lower", 0.2, 0.7)))
    for body in (upper, lower):
        body.colliders[0].meets = False
    scene.joint("revolute", "/a", None, upper, axis=(0, 0, 1))
    scene.joint("revolute", "/b", upper, lower, at=(0.5, 0.0, 0.0), axis=(0, 0, 1))
    for k, ((kind, joint, fields), control) in enumerate(zip(actuators, controls, strict=True)):
        scene.actuator(kind, f"/actuator{k}", joint, control=control, **fields)
    return scene


def angles(simulation: Simulation, world: int = 0) -> np.ndarray:
    """Of /a and /b [rad]."""
    joints = simulation.plan.ports.bodies.joints
    place = {joint.path: k for k, joint in enumerate(joints.joints)}
    rows = joints.linked.now.numpy()[len(place) * world:, 3]
    return np.array([rows[place["/a"]], rows[place["/b"]]])


def run(scene: Scene, frames: int = 30, **more) -> Simulation:
    simulation = Simulation(scene, device="cpu", precision="float64", **more)
    simulation.run(frames)
    return simulation


def peer(xml: str, controls, time: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """(accelerations at the start, angles at the time) of MuJoCo."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed (pip install mujoco)")
    model = mujoco.MjModel.from_xml_string(ARM.format(xml))
    data = mujoco.MjData(model)
    data.ctrl[:] = controls
    mujoco.mj_forward(model, data)
    start = data.qacc.copy()
    while data.time < time - 1e-9:
        mujoco.mj_step(model, data)
    return start, data.qpos.copy()


@pytest.mark.parametrize("law", LAWS)
def test_arm_moves_as_mujoco_has_it(law):
    xml, actuators, controls = LAWS[law]
    start, end = peer(xml, controls)
    reduced = Simulation(arm(actuators, controls, coordinates="reduced"), device="cpu", precision="float64")
    joints = reduced.plan.ports.bodies.joints
    joints.before_frame(0.0, reduced.plan.clock)
    reduced.load()
    assert np.abs(joints.accelerations() - start).max() < 1e-9
    reduced.run(30)
    assert np.abs(angles(reduced) - end).max() < 2e-7
    assert reduced.warnings == []
    errors = []
    for substeps in (16, 32):
        maximal = run(arm(actuators, controls, coordinates="maximal", substeps=substeps))
        errors.append(np.abs(angles(maximal) - end).max())
        assert maximal.warnings == []
    assert errors[1] < 2e-5 and errors[1] < 0.45 * errors[0]                    # 0.25 of order 2


@pytest.mark.parametrize("coordinates", ["maximal", "reduced"])
def test_stiff_servo_stands_at_its_limit_of_force(coordinates):
    """A servo 1000 times as stiff as a step can show, with more weight than it may lift, hangs; with less it stands."""
    weight = 9.81 * 0.25 * 1000.0 * 0.5 * 0.04**2                # torque [N m] of the upper link alone, level
    for most, level in ((0.5 * weight, False), (2.0 * weight, True)):
        scene = arm(coordinates=coordinates)
        scene.objects["Body"], scene.objects["Joint"] = scene.things("Body")[:1], scene.things("Joint")[:1]
        scene.actuator("position", "/servo", "/a", stiffness=1e7, damping=1e4, force_range=(-most, most))
        angle = run(scene, 20).poses("/upper")["/upper"][1, 0]
        assert (abs(angle) < 1e-5) == level


@pytest.mark.parametrize("coordinates", ["maximal", "reduced"])
def test_motor_follows_a_curve_between_substeps(coordinates):
    """Without weight, a torque that grows as t turns a link by t^3 / 6 I; steps of any size have it to their order."""
    scene = arm(coordinates=coordinates, gravity=(0.0, 0.0, 0.0), substeps=8)
    scene.objects["Body"], scene.objects["Joint"] = scene.things("Body")[:1], scene.things("Joint")[:1]
    scene.actuator("motor", "/motor", "/a", control=Curve([0.0, 1.0], [0.0, 1.0]))
    mass = 1000.0 * 0.5 * 0.04**2
    inertia = mass * (0.5**2 + 0.04**2) / 12.0 + mass * 0.25**2
    simulation = run(scene, 15)
    turn = simulation.poses("/upper")["/upper"]
    assert np.arctan2(turn[1, 0], turn[0, 0]) == pytest.approx(0.25**3 / 6.0 / inertia, rel=1e-3 if coordinates == "maximal"
                                                               else 1e-9)
    assert simulation.warnings == []


def test_controls_are_set_live_in_each_world_and_on_the_device():
    _, actuators, _ = LAWS["motors with a gear"]
    scene = arm(actuators, (0.0, 0.0))
    simulation = Simulation(scene, device="cpu", precision="float64", worlds=3)
    simulation.set("/actuator0", "control", [1.0, 2.0, -1.0], world=[0, 1, 2])
    controls = simulation.controls()
    assert controls.paths == ("/actuator0", "/actuator1") and controls.values.shape == (3, 2)
    assert np.array_equal(controls.values.numpy(), [[1.0, 0.0], [2.0, 0.0], [-1.0, 0.0]])
    simulation.run(5)
    wp.copy(controls.values, wp.array(np.full((3, 2), 0.5), dtype=wp.float64, device="cpu"))      # as a policy writes it
    simulation.run(5)
    for world, first in enumerate((1.0, 2.0, -1.0)):
        alone = Simulation(arm(actuators, (first, 0.0)), device="cpu", precision="float64")
        alone.run(5)
        alone.set("/actuator0", "control", 0.5)
        alone.set("/actuator1", "control", 0.5)
        alone.run(5)
        assert np.array_equal(angles(alone), angles(simulation, world))


@pytest.mark.parametrize("coordinates", ["maximal", "reduced"])
def test_scene_goes_through_a_file(coordinates, tmp_path):
    _, actuators, controls = LAWS["two on a joint"]
    scene = arm(actuators, controls, coordinates=coordinates)
    scene.actuator("motor", "/curved", "/b", control=Curve([0.0, 0.25, 0.5], [0.0, 1.0, -0.5]), control_range=(-0.4, 0.4))
    save(scene, tmp_path / "arm.usda")
    read = load(tmp_path / "arm.usda")
    assert read.notes == [] and read.things("Actuator") == scene.things("Actuator")
    assert [thing.path for thing in read.varying] == ["/curved"]
    assert np.abs(angles(run(scene)) - angles(run(read))).max() < 1e-6
    again = Simulation(read, device="cpu", precision="float64")
    first = Simulation(read, device="cpu", precision="float64")
    first.run(10)
    again.restart(10, {path: first.fields(path) for path in first.state.paths()})
    again.run(5)
    first.run(5)
    assert np.array_equal(angles(again), angles(first))


NEWTON = '''#usda 1.0
(
  metersPerUnit = 1
  kilogramsPerUnit = 1
  subLayers = [@./arm.usda@]
)
def NewtonActuator "servo" ( prepend apiSchemas = ["NewtonPDControlAPI", "NewtonMaxEffortClampingAPI"%s] )
{
  rel newton:targets = </a>
  float newton:kp = 40
  float newton:kd = 4
  float newton:maxEffort = 8
}
'''


def test_newton_actuators_are_read(tmp_path):
    scene = arm()
    save(scene, tmp_path / "arm.usda")
    (tmp_path / "robot.usda").write_text(NEWTON % "")
    found = load(tmp_path / "robot.usda").things("Actuator")
    assert found == [Actuator("/servo", "/a", gain=40.0, bias=(0.0, -40.0, -4.0), force_range=(-8.0, 8.0))]
    (tmp_path / "robot.usda").write_text(NEWTON % ', "NewtonActuatorDelayAPI"')
    read = load(tmp_path / "robot.usda")
    assert read.things("Actuator") == [] and "is left out" in str(read.notes[0])


@pytest.mark.parametrize(("fields", "said"), [
    ({"joint": "/none"}, "acts on /none, which is no joint"), ({"gain": np.inf}, "gain is inf"),
    ({"control_range": (1.0, -1.0)}, "control_range goes from 1 to -1"), ({"force_range": (1.0, -1.0)}, "force_range goes"),
    ({"gear": 0.0}, "gear is 0"), ({"bias": (0.0, -np.inf, 0.0)}, "bias is"), ({"bias": (0.0, 5.0, 0.0)}, "stiffness is -5"),
    ({"axis": "transX"}, "acts on transX of /a, which is not free"), ({"control": np.nan}, "control is nan"),
])
def test_actuators_that_make_no_sense_are_refused(fields, said):
    scene = arm()
    scene.add(Actuator(**{"path": "/wrong", "joint": "/a"} | fields))
    problems = [p for p in check_scene(scene) if p.fatal]
    assert len(problems) == 1 and said in str(problems[0]) and "fix:" in str(problems[0])


def test_kinds_and_gradients_are_refused():
    scene = arm()
    with pytest.raises(SceneError, match="kind is 'muscle'; allowed is one of motor, position"):
        scene.actuator("muscle", "/wrong", "/a")
    scene.actuator("motor", "/motor", "/a")
    with pytest.raises(SceneError, match="is an actuator, which has no derivative yet"):
        Simulation(scene, device="cpu", gradients=True)


@pytest.mark.parametrize(("acts", "axis"), [(0, 2), (1, 0)])
def test_actuator_of_one_of_two_hinges_between_bodies_turns_about_that_one(acts, axis, tmp_path):
    """Two hinges that add mobility become one joint; a motor of either turns body 1 about its own axis, and body 0 back."""
    stage = stage_of(tmp_path, [(UsdPhysics.RevoluteJoint, "Z", -90.0, 90.0), (UsdPhysics.RevoluteJoint, "X", -90.0, 90.0)])
    UsdPhysics.Scene.Define(stage, "/scene").CreateGravityMagnitudeAttr(0.0)
    motor = stage.DefinePrim("/motor", "MjcActuator")
    motor.CreateRelationship("mjc:target", False).SetTargets([f"/j{acts}"])
    motor.CreateAttribute("mjc:gear", Sdf.ValueTypeNames.DoubleArray).Set([2.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    motor.CreateAttribute("wsim:control", Sdf.ValueTypeNames.Double).Set(1000.0)
    motor.AddAppliedSchema("WsimActuatorAPI")
    scene = load(stage)
    (found,) = scene.things("Actuator")
    assert found.joint == "/j0" and found.axis in ("rotX", "rotY") and abs(found.gear) == 2.0
    spin = run(scene, 1).links().spin[0]
    turn = spin[1] - spin[0]
    assert turn[axis] > 0.0 and np.abs(np.delete(turn, axis)).max() < 0.05 * turn[axis]
