"""Reactions of a recording, and the gradient of a loss by them: see `wsim.reaction`.

    R = m (a + k v - g) - f(x, v),  r = dL/dR:    by x and every parameter of f: -(df/d..)^T r    by v: m k r - (df/dv)^T r
                                                  by m: r.(a + k v - g)    by g: -m r    by k: m r.v

Positions and velocities pass what they get on to the frames before. Not covered, and refused: soft pins, wind, muscles, XPBD;
by where a pin goes, where its own reaction is observed while it moves (a).
"""

from dataclasses import dataclass
from math import isfinite

import numpy as np
import warp as wp

from wsim.force_adjoint import Forces
from wsim.reaction import Reactions
from wsim.scene import Problem, SceneError
from wsim.tape import give


@dataclass
class Inertia:
    """Gradients by what is not on the device for pinned points: mass [1/kg], (points,), gravity [s^2/m], (points, 3), decay
    [s], (points,). paths: (pin, world) that moved."""

    mass: np.ndarray
    gravity: np.ndarray
    decay: np.ndarray
    paths: set[tuple[str, int]]


class ReactionAdjoint(Reactions):
    """Of a `wsim.recording.Recording`. Raises SceneError for what has no adjoint."""

    def __init__(self, recording):
        self.recording, plan = recording, recording.plan
        wrong = [(p.path, "is a soft pin", "make it hard") for p in plan.model.scene.pins if isfinite(p.stiffness)]
        wrong += [("/", "wind blows", "leave drag and lift out")] * (plan.method("aero") is not None)
        wrong += [("/", "muscles act", "leave the actuation out")] * (plan.method("muscles") is not None)
        wrong += [("/", "the solver is xpbd", "set wsim:solver = explicit or implicit")] * (recording.parameters.pull is None)
        wrong += [(s.path, "flows beyond its yield", "give it no yield strain") for s in plan.model.scene.softs
                  if any(isfinite(m.yield_strain) for m in s.materials)]
        if wrong:
            raise SceneError([Problem(path, f"{what}, and reactions have no adjoint there; {mend}, or fit numbers alone, by "
                                      "copies") for path, what, mend in wrong])
        super().__init__(plan)

    def make(self) -> None:
        self.forces = Forces(self.model, self.recording.parameters.pull, f"{self.model.module}_reactions")
        wp.load_module(f"{self.model.module}_reactions", device=self.model.device,
                       block_dim=self.model.block if self.model.device.is_cuda else None)

    def elastic(self, x: wp.array, e: wp.array | None, v: wp.array) -> np.ndarray:
        f = self.forces
        wp.copy(f.x, x)
        f.pair.zero_()
        wp.copy(f.pair, v, 2 * self.model.points, 0, self.model.points)
        f.evaluate()
        return f.f.numpy().astype(np.float64)

    def at(self, frame: int) -> None:
        """The state after so many frames."""
        r = self.recording
        self.see(r.states[frame], None, r.speeds[frame], (r.start + frame) / r.sim.scene.fps)

    # backward

    def begin(self, given: dict) -> "ReactionAdjoint":
        """given: {frame: {pin: (n, 3)}, or {(pin, world): (n, 3)}} [1/N]. Raises SceneError for those that are none."""
        n = self.model.points
        self.inertia = Inertia(np.zeros(n), np.zeros((n, 3)), np.zeros(n), set())
        self.given = {}
        for frame, pins in given.items():
            if not 0 <= frame <= self.recording.frames:
                raise SceneError(Problem("reactions", f"found frame {frame}; allowed are 0 to {self.recording.frames}"))
            self.given[frame] = r = np.zeros((n, 3))
            for key, values in pins.items():
                path, world = key if isinstance(key, tuple) else (key, 0)
                h, each = self.find(path, world), np.asarray(values, np.float64)
                if each.shape != (len(h.share), 3) or not np.isfinite(each).all():
                    raise SceneError(Problem(path, f"derivatives must be finite with shape ({len(h.share)}, 3); found "
                                             f"{each.shape}"))
                np.add.at(r, h.places, h.spread(each))
                if h.pin.motion.moves:
                    self.inertia.paths.add((path, world))
        return self

    def back(self, frame: int) -> None:
        """What the reactions after so many frames add to the gradients of that state, and of everything else."""
        if frame not in self.given:
            return
        r, f, n, real = self.given[frame], self.forces, self.model.points, self.model.dtype
        self.at(frame)
        f.x.grad.zero_()
        f.transposed(wp.array(-r.astype(real), dtype=f.f.dtype, device=self.model.device), True)
        own = self.inertia
        a = self.drive.copy()
        for h in self.held:
            a[h.places] += h.acceleration(self.time, self.plan.clock.dt)
        own.mass += (r * a).sum(axis=1)
        own.gravity -= self.masses[:, None] * r
        own.decay += self.masses * (r * self.v).sum(axis=1)
        decay = self.constants.decay.numpy()[self.constants.object.numpy()].astype(np.float64)
        v = (self.masses * decay)[:, None] * r + f.pair.grad.numpy()[2 * n:3 * n]
        for base, by in ((self.plan.state.x, f.x.grad.numpy()), (self.plan.state.v, v)):
            root = next(root for root in self.recording.roots if root.base.ptr == base.ptr)
            give(wp.array(by.astype(real), dtype=base.dtype, device=self.model.device), root.carried)
