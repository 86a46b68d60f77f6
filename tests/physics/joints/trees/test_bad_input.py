"""Trees that cannot be: one line says which joint or body, and what to do."""

from math import inf

import pytest

import wsim
from tests.make.physics.joints.chains import linkage
from tests.physics.joints.trees.chains import chain_scene
from wsim.physics.rigid.joints.joint import Drive


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
