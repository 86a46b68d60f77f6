"""Joints and links of a simulation as arrays: controls of actuators, sensors."""

from typing import Any

import numpy as np

from wsim.scene import Problem, SceneError
from wsim.scene.samples import Controls, ImuReadings, JointStates, LinkStates


def controls_of_actuators(sim) -> Controls:
    """Controls as `Simulation.controls` returns them."""
    rigid = sim.plan.ports.bodies
    actuators = rigid.joints.actuators if rigid is not None and rigid.joints else None
    if actuators is None:
        raise SceneError(Problem("controls", "the scene has no actuator on a joint that is enabled; fix: add one, as "
                                 'scene.actuator("motor", PATH, JOINT)'))
    return Controls(tuple(a.path for a in actuators.each), actuators.table.control.reshape((sim.worlds, -1)))


def sensors_of_bodies(sim) -> Any:
    """`wsim.physics.rigid.joints.actuators.sensors.RigidSensors` of the plan. Raises SceneError where there is no body."""
    rigid = sim.plan.ports.bodies
    if rigid is None:
        raise SceneError(Problem("links", "the scene has no rigid body; fix: add one, as scene.body(PATH, SHAPE)"))
    if sim.sensors is None or sim.sensors.method is not rigid:
        from wsim.physics.rigid.joints.actuators.sensors import RigidSensors
        sim.sensors = RigidSensors(rigid)
    return sim.sensors


def read_joint_states(sim, device: bool) -> JointStates:
    """Joint coordinates as `Simulation.joints` returns them."""
    sensors = sensors_of_bodies(sim)
    if not sensors.coordinates:
        raise SceneError(Problem("joints", "the scene has no joint that is enabled and moves; fix: add one, as "
                                 'scene.joint("revolute", PATH, BODY, BODY)'))
    paths, axes = zip(*sensors.coordinates, strict=True)
    found = sensors.joints(sim.plan.clock)
    return JointStates(paths, axes, *(found if device else [array.numpy() for array in found]))


def read_link_states(sim, device: bool) -> LinkStates:
    """Bodies as `Simulation.links` returns them."""
    sensors = sensors_of_bodies(sim)
    paths = tuple(body.path for body, world in sensors.method.bodies if world == 0)
    found = sensors.links(sim.plan.clock.h)
    return LinkStates(paths, **(found if device else {name: array.numpy() for name, array in found.items()}))


def read_inertial_unit(sim, path: str, at, turn, device: bool) -> ImuReadings:
    """An inertial unit as `Simulation.imu` reads it."""
    sensors = sensors_of_bodies(sim)
    paths = [body.path for body, world in sensors.method.bodies if world == 0]
    if path not in paths:
        raise SceneError(Problem(path, f"is no rigid body that moves; there are {', '.join(paths)}; fix: name one of them"))
    if sim.frame == 0:
        raise SceneError(Problem(path, "an inertial unit reads means over the last frame, and there was none; fix: step first"))
    place, q = np.array(at, np.float64), np.array(turn, np.float64)
    if place.shape != (3,) or q.shape != (4,) or not np.isfinite(place).all() or not abs(np.linalg.norm(q) - 1.0) < 1e-4:
        raise SceneError(Problem(path, f"at is {at} and turn {turn}; allowed: three finite numbers [m], and a unit quaternion "
                                 "(x, y, z, w); fix: divide turn by its length"))
    found = sensors.unit(paths.index(path), place, q / np.linalg.norm(q), sim.plan.clock.dt)
    return ImuReadings(*(found if device else [array.numpy() for array in found]))
