"""Brakes on the device: after each substep of length h velocities are exp(-grip h) times what they were."""

import numpy as np
import warp as wp

from wsim.kernels.math.real import has_adjoint, types
from wsim.model.stage import Clock, Method, Stage


def build(b) -> Method:
    return Brakes(b)


class Brakes(Method):
    def __init__(self, b):
        super().__init__("brake")
        self.model, self.state = b.model, b.state
        self.bodies = [(brake, body) for brake in b.scene.things("Brake") for body in b.model.bodies if body.path == brake.body]
        grip = np.zeros(b.model.points, b.model.dtype)
        for brake, body in self.bodies:
            grip[body.first:body.last] = brake.grip
        self.grip = b.model.upload(grip, b.model.real)
        self.kernel = slow(b.model.real, b.model.module)
        self.stages.append(Stage("brake", "finish", self.slow, 1, 0, what=f"{len(self.bodies)} brakes"))

    def slow(self, clock: Clock) -> None:
        self.model.launch(self.kernel, self.model.points, [self.grip, clock.h, self.state.v], [self.state.v])

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        hit = [body for brake, body in self.bodies if brake.path == path and world in (None, body.world)]
        if name != "grip" or not hit:
            return False
        grip = self.grip.numpy()
        for body in hit:
            grip[body.first:body.last] = value
        self.grip.assign(grip)
        return True


def slow(real, module):
    vec3 = types(real).vec3

    def slow(grip: wp.array(dtype=real), h: real, v: wp.array(dtype=vec3), v_out: wp.array(dtype=vec3)):
        i = wp.tid()
        v_out[i] = wp.exp(-grip[i] * h) * v[i]

    return wp.kernel(slow, name="slow", module=module, enable_backward=has_adjoint(module))
