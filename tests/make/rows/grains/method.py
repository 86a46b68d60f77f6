"""Grains on a device: positions (Mueller, Heidelberger, Hennix, Ratcliff 2007). Each substep they fall, every two that are too
near go half the way apart, each by the mean of what its neighbours want, and the velocity is what they went over h."""

import numpy as np
import warp as wp

from wsim.kernels.contact.collider.table import collider_queries, collider_type
from wsim.kernels.math.real import types
from wsim.model.stage import Clock, Method, Stage
from wsim.model.state import StateField, StatePart
from wsim.scene.samples import ParticleSample, Sample

FIELDS = (StateField("x", "m", True, "position"), StateField("v", "m/s", True, "velocity"),
          StateField("y", "m", False, "predicted"))
SWEEPS = 4


def build(b) -> Method:
    return Lying(b)


class Lying(Method):
    def __init__(self, b):
        super().__init__("loose_grains")
        self.model, self.grains = b.model, b.scene.things("Grains")
        count = sum(len(g.places) for g in self.grains)
        self.part = StatePart.allocate("loose_grains", FIELDS, count, b.model.real, b.model.device)
        first = np.cumsum([0, *[len(g.places) for g in self.grains]])
        self.part.rows = {(g.path, 0): np.arange(first[k], first[k + 1]) for k, g in enumerate(self.grains)}
        b.state.add(self.part)
        self.part.arrays["x"].assign(np.concatenate([g.places for g in self.grains]).astype(b.model.dtype))
        radii = np.concatenate([np.full(len(g.places), g.radius) for g in self.grains])
        self.radius = b.model.upload(radii.astype(b.model.dtype), b.model.real)
        self.gravity = types(b.model.real).vec3(*b.scene.gravity)
        self.colliders = b.colliders
        self.kernels = kernels(self.colliders.kinds, b.model.real, b.model.module)
        self.stages += [Stage("fall", "predict", self.fall, 1, 0), Stage("keep apart", "finish", self.settle, SWEEPS + 1, 0)]

    def before_frame(self, time: float, clock: Clock) -> None:
        self.colliders.pose(time, clock.dt)

    def fall(self, clock: Clock) -> None:
        a = self.part.arrays
        self.model.launch(self.kernels[0], self.part.count, [a["x"], a["v"], self.gravity, clock.h], [a["y"]])

    def settle(self, clock: Clock) -> None:
        a, count = self.part.arrays, self.part.count
        time = (clock.k + 1) * clock.h
        for _ in range(SWEEPS):
            self.model.launch(self.kernels[1], count, [a["x"], a["y"], self.radius, self.colliders.rows, time], [a["v"]])
            wp.copy(a["y"], a["v"])
        self.model.launch(self.kernels[2], count, [a["x"], a["y"], clock.h], [a["x"], a["v"]])

    def samples(self, world: int = 0) -> list[Sample]:
        x, v, r = (array.numpy() for array in (self.part.arrays["x"], self.part.arrays["v"], self.radius))
        return [ParticleSample(g.path, x[rows], 2.0 * r[rows], np.arange(len(rows)), v[rows])
                for g in self.grains for rows in [self.part.rows[g.path, 0]]]


def kernels(kinds, real, module) -> list:
    t, C, ask = types(real), collider_type(real), collider_queries(kinds, real)
    vectors = wp.array(dtype=t.vec3)

    def fall(x: vectors, v: vectors, g: t.vec3, h: real, y_out: vectors):
        i = wp.tid()
        y_out[i] = x[i] + h * (v[i] + h * g)

    def part(x: vectors, y: vectors, radius: wp.array(dtype=real), c: C, time: real, y_out: vectors):
        i = wp.tid()
        to = y[i]
        sum = t.vec3()
        count = real(0.0)
        for j in range(y.shape[0]):
            off = y[i] - y[j]
            far = wp.length(off)
            deep = radius[i] + radius[j] - far
            if j != i and deep > real(0.0) and far > real(0.0):
                sum += (real(0.5) * deep / far) * off
                count += real(1.0)
        if count > real(0.0):
            to = to + sum / count
        for k in range(c.kind.shape[0]):                       # a grain lies on colliders, by these five lines
            phi, n, p = ask.closest(c, k, to, time)
            deep = wp.max(radius[i] - phi, real(0.0))
            slide = (to - x[i]) - wp.dot(to - x[i], n) * n
            to = to + deep * n - wp.min(c.friction[k][1] * deep / wp.max(wp.length(slide), real(1.0e-12)), real(1.0)) * slide
        y_out[i] = to

    def arrive(x: vectors, y: vectors, h: real, x_out: vectors, v_out: vectors):
        i = wp.tid()
        v_out[i] = (y[i] - x[i]) / h
        x_out[i] = y[i]

    return [wp.kernel(f, name=f"grains_{f.__name__}_{t.name}", module=module, enable_backward=False)
            for f in (fall, part, arrive)]
