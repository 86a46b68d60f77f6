"""What can be wrong with an actuator. NumPy only."""

from collections.abc import Iterator
from math import inf, isfinite, isnan

from wsim.physics.rigid.joints.actuators.actuator import Actuator
from wsim.physics.rigid.joints.check import LARGEST
from wsim.physics.rigid.joints.joint import AXES
from wsim.scene import Problem, Scene
from wsim.scene.check.objects import object_warning, thing_error


def check(actuator: Actuator, scene: Scene) -> Iterator[Problem]:
    yield from _check_numbers(actuator)
    joints = {joint.path: joint for joint in scene.things("Joint")}
    joint = joints.get(actuator.joint)
    if joint is None:
        there = ", ".join(joints) or "none"
        yield thing_error(actuator.path, f"acts on {actuator.joint or 'nothing'}, which is no joint that moves a rigid body",
                          there, "name a joint of these")
        return
    free = [name for name in AXES if not joint.locked(name)]
    if actuator.axis and actuator.axis not in free or not free:
        yield thing_error(actuator.path, f"acts on {actuator.axis or 'a coordinate'} of {joint.path}, which is not free",
                          ", ".join(free) or "no coordinate of it", "name a free one, or give it limits that leave it room")
    elif not actuator.axis and len(free) > 1:
        yield thing_error(actuator.path, f"acts on {joint.path}, which has {len(free)} free coordinates", ", ".join(free),
                          "name one of them as its axis")
    if not joint.enabled:
        yield object_warning(actuator.path, f"acts on {joint.path}, which is not enabled, so that it does nothing",
                             "a joint that is enabled", "enable the joint, or take the actuator away")


def _check_numbers(actuator: Actuator) -> Iterator[Problem]:
    path = actuator.path
    for name in ("gear", "gain"):                    # the control is a value, and checked as such
        if not isfinite(getattr(actuator, name)):
            yield thing_error(path, f"{name} is {getattr(actuator, name):g}", "a finite number", f"author another {name}")
    gear, gain = max(1.0, abs(actuator.gear)), abs(actuator.gain) * max(1.0, abs(actuator.control))
    most = gear * max(gain, *(gear * abs(b) for b in actuator.bias))
    if LARGEST < most < inf:
        yield thing_error(path, f"gear, gain, bias and control make {most:g} of a coordinate of 1", f"up to {LARGEST:g}",
                          "author smaller ones; a joint that is not to move has two equal limits")
    if actuator.gear == 0.0:
        yield thing_error(path, "gear is 0, so that it moves nothing", "a number other than 0", "author another gear")
    if not all(map(isfinite, actuator.bias)):
        yield thing_error(path, f"bias is {actuator.bias}", "finite numbers", "author other gains; a limit of the force is a "
                          "force range")
    for k, what in ((1, "stiffness"), (2, "damping")):
        if actuator.bias[k] > 0.0:
            yield thing_error(path, f"{what} is {-actuator.bias[k]:g} (bias[{k}] is {actuator.bias[k]:g})", ">= 0",
                              f"give bias[{k}] the other sign: a servo that pushes away is unstable")
    for name in ("control_range", "force_range"):
        low, high = getattr(actuator, name)
        if isnan(low) or isnan(high) or low > high:
            yield thing_error(path, f"{name} goes from {low:g} to {high:g}", "a lower number, then a higher one", "swap them")
    low, high = actuator.force_range
    if low == high == 0.0:
        yield object_warning(path, "force_range is 0 to 0, so that it does nothing", "a range", "author another range, or none")
