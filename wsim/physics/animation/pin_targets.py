"""Targets of pins that a GPU evaluates: in frames of many substeps, those of pins whose prims move by linear keys. The host
evaluates the others (`wsim.physics.motion.pins`), from which these differ in the last bits of float64."""

from __future__ import annotations

import numpy as np
import warp as wp

from wsim.kernels.animation import pinned
from wsim.kernels.math.real import types
from wsim.model import kernel_cache
from wsim.physics.contact.poses import LONG, Linear
from wsim.scene import Motion


class Targets:
    """Keys and points of the pins of a group, and what is made of them."""

    def __init__(self, device, real):
        module = f"wsim_pins_{types(real).name}"
        self.device, self.keys, self.place = device, Linear(device, module), pinned.place(real, module)
        self.points = pinned.Pinned()
        kernel_cache.load(module, device)

    def take(self, group: list, own: list[bool], rows: int) -> None:
        """Uploads those of the pins of a group that are `own`, for so many rows of targets."""
        first = np.cumsum([0, *(len(p.places) for p in group)])
        mine = [(k, p) for k, p in enumerate(group) if own[k]]
        each = [len(p.places) for _, p in mine]

        def array(values, dtype) -> wp.array:
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)
        c = self.points
        c.column = array(np.concatenate([np.arange(first[k], first[k + 1]) for k, _ in mine]).astype(np.int32), int)
        c.motion = array(np.repeat(np.arange(len(mine)), each).astype(np.int32), int)
        c.local = array(np.concatenate([p.locals for _, p in mine]), wp.vec3d)
        c.origin = array(np.repeat([p.body.origin for _, p in mine], each, axis=0), wp.vec3d)
        self.keys.take([p.motion for _, p in mine])
        self.A = wp.zeros((len(mine), rows + 1), dtype=wp.mat33d, device=self.device)
        self.p = wp.zeros((len(mine), rows + 1), dtype=wp.vec3d, device=self.device)

    def launch(self, time: float, dt: float, target: wp.array) -> None:
        """Targets of the frame of dt [s] that starts at a time [s]."""
        self.keys.launch(self.A, self.p, time, dt)
        wp.launch(self.place, (self.A.shape[1] - 1, len(self.points.column)), [self.points, self.A, self.p], [target],
                  device=self.device)


def evaluated(group: list, at: np.ndarray, dt: float) -> list[bool]:
    """Which pins of a group a GPU evaluates, where targets are wanted at these times of a frame of dt [s]."""
    even = len(at) >= LONG and bool(np.allclose(at, dt * np.arange(1, len(at) + 1) / len(at), rtol=0.0, atol=1e-9 * dt))
    return [even and type(p.motion) is Motion and p.motion.plain and p.motion.moves for p in group]
