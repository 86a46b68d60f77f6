"""What a rigid body begins with and is made of, by name (`wsim.gradient.inputs.by_name`).

    /World/Racket:velocity, :spin       (3,) [m/s] of its centre of mass, [rad/s], world, where the recording begins
    /World/Racket:force, :torque        (3,) [N], [N m], world
    /World/Racket:mass, :inertia        () [kg]; (3,) [kg m^2]; velocity and spin stay as they are
    /World/Racket:drag, :spin_drag      () [1/s]
    /World/Racket:dynamic_friction, :restitution     () of all its colliders, where bodies meet
    /World/Hinge:stiffness, :damping, :target        of the drives of a joint: (), or (n,) in the order of its coordinates
"""

import numpy as np
import warp as wp

from wsim.gradient.inputs.base import PART, RecordingInput


class BodyValue(RecordingInput):
    """A value of a rigid body. To write one takes the simulation back to where the recording begins."""

    def read_value(self, world: int = 0) -> np.ndarray:
        r = self.recording
        return np.asarray(r.bodies.now(self.path, self.what, world, [(a, b.numpy()) for a, b in r.flowed]), np.float64)

    def set_world_value(self, value: np.ndarray, world: int) -> None:
        self.recording.rewind()
        super().set_world_value(value, world)
        for array, begun in self.recording.flowed:
            wp.copy(begun, array)

    def difference_scale(self) -> float:
        """A part of it; of what is 0 that of one unit."""
        return PART * (float(np.abs(self.read_value()).max()) or 1.0)
