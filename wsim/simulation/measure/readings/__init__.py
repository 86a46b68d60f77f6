"""What a simulation says of itself now, besides positions and poses: contacts, forces, stress, errors."""

from typing import Any

import numpy as np

from wsim.model.kernel_cache import GATE
from wsim.scene.samples import ContactPoints, Controls, ImuReadings, JointStates, LinkStates
from wsim.simulation.measure import indicators as measure


class Readings:
    """Measures of a `wsim.simulation.simulation.Simulation`, which derives from this class."""

    plan: Any
    model: Any
    state: Any
    worlds: int
    sensors: Any

    def contacts(self, path: str | None = None, world: int | None = None) -> ContactPoints:
        """Contact points now, with the forces of the last substep of the frame: places and forces are of one time, as in other
        engines, and at rest both forces of a pair balance. See `wsim.scene.samples.ContactPoints` for its arrays.

        path     contacts of this prim alone, which is then at path0 of every row; None: of all
        world    of one world; None: of all
        Of rigid bodies with each other and with colliders, and of cloth, nets and soft bodies with rigid bodies and colliders;
        not of ropes and hair, self-contact, liquids and material points. Blows that throw bodies back by a restitution are left
        out. Raises SceneError for a path or a world that there is not."""
        from wsim.simulation.measure.readings.contact_points import contacts_of_path
        return contacts_of_path(self, path, world)

    def controls(self) -> Controls:
        """Controls of the actuators, as an array on the device that may be written in place between frames: no copy to the host
        is made. Raises SceneError where there is no actuator."""
        from wsim.simulation.measure.readings.joints import controls_of_actuators
        return controls_of_actuators(self)

    def joints(self, device: bool = False) -> JointStates:
        """Coordinates of all joints and their rates now, in all worlds. device: as arrays on the device, without a copy to the
        host. Compiles kernels when first called. Raises SceneError where there is no joint."""
        from wsim.simulation.measure.readings.joints import read_joint_states
        with GATE.alone():
            return read_joint_states(self, device)

    def links(self, device: bool = False) -> LinkStates:
        """Poses, velocities and contact forces of all rigid bodies now, in all worlds; as `joints`."""
        from wsim.simulation.measure.readings.joints import read_link_states
        with GATE.alone():
            return read_link_states(self, device)

    def imu(self, path: str, at=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0, 1.0), device: bool = False) -> ImuReadings:
        """Readings of an inertial measurement unit on a rigid body, means over the last frame, in all worlds.

        path    prim path of the body
        at      place in the body's frame (3,) [m]
        turn    quaternion (x, y, z, w) from the unit's axes to the body's frame
        device  as arrays on the device, without a copy to the host
        Raises SceneError where there is no such body, or before the first frame."""
        from wsim.simulation.measure.readings.joints import read_inertial_unit
        with GATE.alone():
            return read_inertial_unit(self, path, at, turn, device)

    def indicators(self) -> dict[str, float]:
        """Error indicators and energies now: strain, residual, penetration, energy [J]."""
        x = v = np.zeros((0, 3))
        if self.model.bodies:
            x, v = (a.numpy().astype(np.float64) for a in (self.state.x, self.state.v))
            x += self.state.e.numpy()
        if self.model.alias is not None:
            x = x[self.model.alias]
        with GATE.alone():
            return measure.gather_indicators(self.plan, x, v)

    def stress(self, path: str | None = None, world: int = 0):
        """`wsim.simulation.measure.stress.Stress` of a soft body now: `von_mises` [Pa] and `strain` of each tet. Compiles a
        kernel when first called. Raises SceneError where the body is none."""
        from wsim.simulation.measure import stress
        with GATE.alone():
            return stress.stress_of_soft_body(self.plan, path, world)

    def reactions(self, path: str | None = None, world: int = 0) -> np.ndarray:
        """Forces of a pin (None: the only one), or of a rope's tie, on its points now [N], world, (n, 3) in their order; their
        sum is what it holds. See `wsim.simulation.measure.reaction`; compiles kernels when first called. Raises SceneError
        where there is none."""
        from wsim.simulation.measure.reaction import reactions_of_pin
        with GATE.alone():
            return reactions_of_pin(self, path, world)
