"""Balls on a device."""

import numpy as np

from tests.make.balls import kernel
from wsim.kernels.math.real import types
from wsim.model.stage import Clock, Method, Remedy, Stage
from wsim.model.state import Field, Part
from wsim.model.status import Status
from wsim.model.structs import filled
from wsim.physics.carrier.carriers import Carrier
from wsim.physics.carrier.pairs import Pairs

FIELDS = (Field("x", "m", True, "place"), Field("v", "m/s", True, "velocity"), Field("d", "m", False, "displacement"),
          Field("a", "m", False, "anchor"))
ROOM = 8               # pairs at first: less than a ball meets
WARM = False           # whether pairs begin with the impulses of the last substep


def build(b) -> Method:
    return Balls(b)


class BallCarrier(Carrier):
    formulas = staticmethod(kernel.balls)

    def __init__(self, owner):
        self.owner, self.vertices = owner, owner.part.count

    def at(self, clock: Clock, base: int):
        data = self.owner.data(clock)
        data.base = base
        return data, self.owner.moving()


class Balls(Method):
    def __init__(self, b):
        super().__init__("balls")
        self.model, self.state, self.points, t = b.model, b.state, b.methods.find("points"), types(b.model.real)
        balls, model = b.scene.things("Ball"), b.model
        self.part = Part.allocate("balls", FIELDS, len(balls), model.real, model.device)
        self.part.rows = {(ball.path, 0): np.array([k]) for k, ball in enumerate(balls)}
        b.state.add(self.part)
        self.part.arrays["x"].assign(np.array([ball.place for ball in balls], model.dtype))
        self.part.arrays["v"].assign(np.array([ball.velocity for ball in balls], model.dtype))
        self.own = {"w": model.upload([1.0 / ball.mass for ball in balls], model.real),
                    "radius": model.upload([ball.radius for ball in balls], model.real),
                    "friction": model.upload([ball.friction for ball in balls], t.vec2),
                    "restitution": model.upload([ball.restitution for ball in balls], model.real)}
        self.origin = model.upload(np.array([body.origin for body in model.bodies], model.dtype), t.vec3)
        self.reach = model.upload(model.stack("reach").astype(model.dtype), model.real)
        self.kernels = [make(model.real, model.module) for make in (kernel.fly, kernel.land, kernel.meet)]
        self.pairs = Pairs(model, b.status, [(b.carriers()["points"], BallCarrier(self))], name="pairs of balls",
                           capacity=ROOM, colours=4, warm=b.state if WARM else None)
        self.stages = [Stage("fly", "predict", self.fly, 1, 0), *self.pairs.stages(self.search, b.choice.solver == "xpbd"),
                       Stage("land", "finish", self.land, 1, 0)]

    def data(self, clock: Clock):
        return filled(kernel.structs(self.model.real).Balls, h=clock.h, **self.own, **self.part.arrays)

    def moving(self):
        return filled(kernel.structs(self.model.real).Moved, **{name: self.part.arrays[name] for name in ("d", "a")})

    def fly(self, clock: Clock) -> None:
        self.model.launch(self.kernels[0], self.part.count, [self.data(clock)], [self.moving()])

    def land(self, clock: Clock) -> None:
        a = self.part.arrays
        self.model.launch(self.kernels[1], self.part.count, [self.data(clock)], [a["x"], a["v"]])

    def search(self, clock: Clock) -> None:
        s = self.state
        cloth = filled(kernel.structs(self.model.real).Cloth, x=s.x, d=s.d, v=s.v, object=self.points.constants.object,
                       origin=self.origin, reach=self.reach)
        self.model.launch(self.kernels[2], (self.model.points, self.part.count), [cloth, self.data(clock)], [self.pairs.found])

    def indicators(self, x, v) -> dict[str, float]:
        return self.pairs.indicators()

    def retry(self, status: Status) -> list[Remedy]:
        return self.pairs.retry(status)
