"""Joints of a simulation as arrays: controls of actuators."""

from wsim.scene import Problem, SceneError
from wsim.scene.samples import Controls


def controls_of_actuators(sim) -> Controls:
    """Controls as `Simulation.controls` returns them."""
    rigid = sim.plan.ports.bodies
    actuators = rigid.joints.actuators if rigid is not None and rigid.joints else None
    if actuators is None:
        raise SceneError(Problem("controls", "the scene has no actuator on a joint that is enabled; fix: add one, as "
                                 'scene.actuator("motor", PATH, JOINT)'))
    return Controls(tuple(a.path for a in actuators.each), actuators.table.control.reshape((sim.worlds, -1)))
