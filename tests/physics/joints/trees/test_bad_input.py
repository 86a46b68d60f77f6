"""Trees that cannot be: one line says which joint or body, and what to do."""

from math import inf

import numpy as np
import pytest

import wsim
from tests.make.physics.joints.chains import linkage
from tests.physics.joints.trees.chains import chain_scene
from wsim.physics.rigid.joints.joint import Drive
from wsim.scene.check.scene import check_scene


@pytest.mark.parametrize("change, said", [
    (lambda body, joint: setattr(body, "mass", 0.0), "/b1: mass is 0"),
    (lambda body, joint: body.colliders.clear(), "/b1: has no mass"),
    (lambda body, joint: joint.limits.update(rotX=(1.0, -1.0)), "/j1: limits of rotX are 1 and -1, the lower above the upper"),
    (lambda body, joint: joint.drives.update(rotX=Drive(inf)), "/j1: stiffness of the drive of rotX is inf"),
    (lambda body, joint: joint.limits.update(rotX=(1.0, 1.0)), "an axis is locked away from 0")])
def test_a_tree_that_cannot_be_is_refused(change, said):
    scene = chain_scene(["revolute", "revolute"])
    change(scene.things("Body")[1], scene.things("Joint")[1])
    with pytest.raises(wsim.SceneError, match=said):
        wsim.Simulation(scene, device="cpu")


def test_a_loop_whose_joints_all_are_driven_is_refused():
    scene = linkage()
    for joint in scene.things("Joint"):
        joint.drives = {"rotX": Drive(1.0)}
    with pytest.raises(wsim.SceneError, match="/j3: it closes a loop, and all joints of that have a drive"):
        wsim.Simulation(scene, device="cpu")


def test_an_actuator_keeps_its_joint_in_the_tree():
    """The joint that would close the loop, the last, has a motor: another closes it."""
    scene = linkage()
    scene.actuator("motor", "/motor", "/j3", control=0.5)
    simulation = wsim.Simulation(scene, device="cpu")
    trees = simulation.plan.method("rigid").joints
    assert "/j3" in {trees.joints[j].path for j in trees.links.joint}


def told(scene) -> str:
    """What the checks of a scene say, before anything runs."""
    return "\n".join(str(problem) for problem in check_scene(scene))


def second(scene):
    return scene.things("Joint")[1]


HUGE = [
    (lambda scene: second(scene).drives.update(rotX=Drive(1e30)), "/j1: stiffness of the drive of rotX is 1e.30"),
    (lambda scene: second(scene).drives.update(rotX=Drive(0.0, 1e30)), "/j1: damping of the drive of rotX is 1e.30"),
    (lambda scene: second(scene).drives.update(rotX=Drive(1.0, 1.0, 1e30)), "/j1: the drive of rotX goes to 1e.30"),
    (lambda scene: second(scene).drives.update(rotX=Drive(0.0, 1.0, speed=-1e30)), "/j1: the drive of rotX goes to 0"),
    (lambda scene: second(scene).armature.update(rotX=1e30), "/j1: armature of rotX is 1e.30"),
    (lambda scene: scene.actuator("motor", "/m", "/j1", control=1e30), "/m: gear, gain, bias and control make 1e.30"),
    (lambda scene: scene.actuator("position", "/m", "/j1", stiffness=1e30), "/m: gear, gain, bias and control make 1e.30")]


@pytest.mark.parametrize("coordinates", ["reduced", "maximal"])
@pytest.mark.parametrize("change, said", HUGE)
def test_what_drives_beyond_all_numbers_is_refused(change, said, coordinates):
    scene = chain_scene(["revolute", "revolute"], coordinates=coordinates)
    change(scene)
    with pytest.raises(wsim.SceneError, match=said):
        wsim.Simulation(scene, device="cpu")


def test_a_greatest_force_of_any_size_is_no_fault():
    """Files say so that there is no limit."""
    scene = chain_scene(["revolute", "revolute"])
    second(scene).drives["rotX"] = Drive(1.0, 1.0, most=3.4e38)
    assert not told(scene)


@pytest.mark.parametrize("kind, at, axis, said", [
    ("revolute", 0.5, (0, 0.6, 0.8), "one of them locks nothing more"), ("fixed", 0.5, (1, 0, 0), "one of them locks nothing"),
    ("revolute", 0.5, (1, 0, 0), "together they leave nothing free"), ("revolute", 0.7, (0, 0.6, 0.8), "together they leave"),
    ("spherical", 0.5, (1, 0, 0), "one of them locks nothing more"), ("prismatic", 0.5, (1, 0, 0), "together they leave")])
def test_a_second_joint_of_two_bodies_is_told(kind, at, axis, said):
    scene = chain_scene(["revolute", "revolute"])
    first, last = scene.things("Body")
    other = scene.joint(kind, "/twin", last, first, at=(at, 0, 0), axis=axis)
    assert f"/twin: joins the same two bodies as /j1, and {said}" in told(scene)
    other.enabled = False
    assert not told(scene)


def test_joints_that_make_a_hinge_of_two_balls_or_add_a_string_are_not_told():
    scene = chain_scene(["revolute", "spherical"])
    first, last = scene.things("Body")
    scene.joint("spherical", "/twin", first, last, at=(0.5, 0.2, 0))
    scene.add(wsim.Joint("/string", "/b0", "/b1", limits={"distance": (0.0, 2.0)}))
    assert not told(scene)


def test_two_joints_to_the_world_count_as_two_bodies():
    scene = chain_scene(["revolute"])
    scene.joint("fixed", "/twin", None, scene.things("Body")[0], at=(0.2, 0, 0))
    assert "/twin: joins the same two bodies as /j0" in told(scene)


@pytest.mark.parametrize("coordinates", ["reduced", "maximal"])
@pytest.mark.parametrize("name, unit", [("force", "m/s.2"), ("torque", "rad/s.2"), ("velocity", "m/s"), ("spin", "rad/s")])
def test_a_body_that_starts_beyond_all_numbers_is_refused(name, unit, coordinates):
    scene = chain_scene(["revolute", "spherical"], coordinates=coordinates)
    setattr(scene.things("Body")[1], name, np.array([0.0, -1e30, 0.0]))
    with pytest.raises(wsim.SceneError, match=rf"/b1: {name} is \(0, -1e.30, 0\).*up to 1e.15 {unit}.*smaller {name}"):
        wsim.Simulation(scene, device="cpu")


def test_a_force_that_a_planet_bears_is_no_fault():
    """The sun pulls at the earth by 3.5e22 N."""
    scene = chain_scene(["revolute"])
    body = scene.things("Body")[0]
    body.mass, body.force = 6e24, np.array([3.5e22, 0.0, 0.0])
    assert "force" not in told(scene)
