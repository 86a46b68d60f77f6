"""Sparks on the device, exact in every substep."""

import numpy as np
import warp as wp

from tests.make.rows.sparks.objects import GRAVITY, WIDTH
from wsim.kernels.math.real import types
from wsim.model.stage import Clock, Method, Stage
from wsim.model.state import StateField, StatePart
from wsim.scene.samples import ParticleSample, PointSample, QuantitySample, Sample, TransformSample, VolumeSample

FIELDS = (StateField("x", "m", True, "position"), StateField("v", "m/s", True, "velocity"),
          StateField("frames", "", True, "frames that have passed", "int"))


def build(b) -> Method:
    return Flying(b)


class Flying(Method):
    def __init__(self, b):
        super().__init__("sparks")
        self.model, self.sparks = b.model, [(s, world) for world in range(b.model.worlds) for s in b.scene.things("Sparks")]
        counts = np.concatenate([[0], np.cumsum([s.count for s, _ in self.sparks])])
        self.part = StatePart.allocate("sparks", FIELDS, int(counts[-1]), b.model.real, b.model.device)
        self.part.rows = {(s.path, world): np.arange(counts[k], counts[k + 1]) for k, (s, world) in enumerate(self.sparks)}
        b.state.add(self.part)
        self.part.arrays["v"].assign(np.concatenate([s.velocities() for s, _ in self.sparks]).astype(b.model.dtype))
        self.kernel = fly(b.model.real, b.model.module)
        self.stages.append(Stage("fly", "predict", self.fly, 1, 0, what=f"{self.part.count} sparks"))

    def fly(self, clock: Clock) -> None:
        a = self.part.arrays
        self.model.launch(self.kernel, self.part.count, [a["x"], a["v"], clock.h, int(clock.k == clock.j == 0)],
                          [a["x"], a["v"], a["frames"]])

    def samples(self, world: int = 0) -> list[Sample]:
        found: list[Sample] = []
        x, v, frames = (self.part.arrays[name].numpy() for name in ("x", "v", "frames"))
        for sparks, of in self.sparks:
            if of == world:
                rows = self.part.rows[sparks.path, world]
                lit = rows[:sparks.lit * int(frames[rows[0]])]
                M = np.eye(4)
                M[:3, 3] = x[rows].mean(axis=0)
                density = np.histogram(x[rows, 2], bins=8)[0].astype(np.float32).reshape(1, 1, 8)
                field = np.concatenate([density[..., None], 0.0 * density[..., None], 2.0 * density[..., None]], 3)
                found += [ParticleSample(f"{sparks.path}/Lit", x[lit], np.full(len(lit), WIDTH), lit - rows[0], v[lit]),
                          PointSample(f"{sparks.path}/Trace", x[rows], v[rows]), TransformSample(f"{sparks.path}/Middle", M),
                          QuantitySample(sparks.path, "toy:speeds", np.linalg.norm(v[rows[:5]], axis=1)),
                          VolumeSample(f"{sparks.path}/Smoke", np.full(3, 0.5), 0.25, {"density": density, "speed": field},
                                       {"speed": "m/s"})]
        return found


def fly(real, module):
    t = types(real)

    def fly(x: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3), h: real, first: int, x_out: wp.array(dtype=t.vec3),
            v_out: wp.array(dtype=t.vec3), frames_out: wp.array(dtype=int)):
        k = wp.tid()
        fall = t.vec3(real(0.0), real(0.0), real(GRAVITY) * h)
        x_out[k] = x[k] + h * v[k] - real(0.5) * h * fall
        v_out[k] = v[k] - fall
        frames_out[k] = frames_out[k] + first

    return wp.kernel(fly, name="fly", module=module, enable_backward=False)
