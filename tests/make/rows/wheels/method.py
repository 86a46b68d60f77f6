"""Wheels on the device, exact in every substep; whole turns are logged in a list that grows."""

import numpy as np
import warp as wp

from wsim.model.stage import Clock, Method, Remedy, Stage
from wsim.model.state import StateField, StatePart
from wsim.model.status import FrameStatus
from wsim.scene.samples import QuantitySample, Sample, TransformSample

ROOM = "wheels: turns"
FIELDS = (StateField("angle", "rad", True, "since the start", "scalar"),
          StateField("rate", "rad/s", True, "of the angle", "scalar"),
          StateField("turned", "", False, "whole turns in this frame", "int"))

SUBDIVIDE = 1          # steps in a substep


def build(b) -> Method:
    return Wheels(b)


class Wheels(Method):
    def __init__(self, b):
        super().__init__("wheels")
        self.model, self.status, self.room = b.model, b.status, 1
        self.wheels = [(w, world) for world in range(b.model.worlds) for w in b.scene.things("Wheel")]
        self.part = StatePart.allocate("wheels", FIELDS, len(self.wheels), b.model.real, b.model.device)
        self.part.rows = {(w.path, world): np.array([k]) for k, (w, world) in enumerate(self.wheels)}
        b.state.add(self.part)
        for name in ("angle", "rate"):
            self.part.arrays[name].assign(np.array([getattr(w, name) for w, _ in self.wheels], b.model.dtype))
        self.drag = b.model.upload(np.array([w.drag for w, _ in self.wheels], b.model.dtype), b.model.real)
        b.status.reserve(ROOM)
        self.subdivide = SUBDIVIDE
        self.kernel = spin(b.model.real, b.model.module)
        self.stages.append(Stage("spin", "predict", self.spin, 1, 0, what=f"{len(self.wheels)} wheels"))

    def spin(self, clock: Clock) -> None:
        a = self.part.arrays
        if clock.k == clock.j == 0:
            a["turned"].zero_()
        self.model.launch(self.kernel, self.part.count, [self.drag, clock.h / self.subdivide, self.room, a["angle"], a["rate"]],
                          [a["angle"], a["rate"], a["turned"], self.status.word(ROOM)])

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        wanted = int(status.said(ROOM)[0])

        def grow() -> str:
            self.room = wanted
            return f"a wheel turned {wanted} times, more than there was room for"
        return [Remedy("grow", grow)] if wanted > self.room else []

    def indicators(self, x, v) -> dict[str, float]:
        return {"spin": float(np.abs(self.part.arrays["rate"].numpy()).max())}

    def samples(self, world: int = 0) -> list[Sample]:
        found: list[Sample] = []
        angle = self.part.arrays["angle"].numpy().astype(np.float64)
        for (w, of), theta in zip(self.wheels, angle, strict=True):
            if of == world:
                M = np.eye(4)
                M[:2, :2] = [[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]]
                found += [TransformSample(w.path, M), QuantitySample(w.path, "toy:turns", float(theta / (2.0 * np.pi)))]
        return found

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        hit = [k for k, (w, of) in enumerate(self.wheels) if w.path == path and world in (None, of)]
        if name != "drag" or not hit:
            return False
        values = self.drag.numpy()
        values[hit] = value
        self.drag.assign(values)
        return True


def spin(real, module):
    def spin(drag: wp.array(dtype=real), h: real, room: int, angle: wp.array(dtype=real), rate: wp.array(dtype=real),
             angle_out: wp.array(dtype=real), rate_out: wp.array(dtype=real), turned: wp.array(dtype=int),
             wanted: wp.array(dtype=int)):
        k = wp.tid()
        c, w = drag[k], rate[k]
        left = wp.exp(-c * h)
        way = w * h
        if c * h > real(1.0e-4):
            way = w * (real(1.0) - left) / c
        theta = angle[k] + way
        whole = wp.abs(int(wp.floor(theta / real(6.283185307179586))) - int(wp.floor(angle[k] / real(6.283185307179586))))
        turned[k] = turned[k] + whole
        if turned[k] > room:
            wp.atomic_max(wanted, 0, turned[k])
        angle_out[k] = theta
        rate_out[k] = w * left

    return wp.kernel(spin, name="spin", module=module, enable_backward=False)
