"""Reactions of a recording, and the gradient of a loss by them: see `wsim.simulation.measure.reaction`. With r = dL/dR,

    hard, R = m (a + k v - g) - f(x, v):    by x and every parameter of f: -(df/d..)^T r    by v: m k r - (df/dv)^T r
                                            by m: r.(a + k v - g)    by g: -m r    by k: m r.v
    soft, R = s (X - x) - c v:              by x: -s r    by v: -c r    by X: s r    by s: r.(X - x)    by c: -r.v
    hard, of a load F of the point: by F: -r

Positions and velocities pass what they get on to the frames before. f is `wsim.gradient.reactions.law`. Not covered, and
refused: by where a pin goes, where its own reaction is observed while it moves (a, X).
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp

from wsim.gradient.reactions.law import ReactionLaw
from wsim.model.tape import add_and_clear_gradient
from wsim.scene import Problem, SceneError
from wsim.simulation.measure.reaction import HeldPoints, PinReactions


@dataclass
class PinnedPointGradients:
    """Gradients by what is not on the device for pinned points: mass [1/kg], (points,), gravity [s^2/m], (points, 3), decay
    [s], (points,). moved: (pin, world) that did; soft: of such a pin by stiffness, damping and targets, (places, 3). tables:
    of XPBD, by their address; muscles, loads: by the keys of each net and load, as
    `wsim.gradient.tables.GradientTables.take_targets`."""

    mass: np.ndarray
    gravity: np.ndarray
    decay: np.ndarray
    moved: set[tuple[str, int]] = field(default_factory=set)
    soft: dict[tuple[str, int], dict] = field(default_factory=dict)
    tables: dict[int, np.ndarray] = field(default_factory=dict)
    muscles: list[np.ndarray] = field(default_factory=list)
    loads: list[np.ndarray] = field(default_factory=list)


class ReactionAdjoint(PinReactions):
    """The adjoint of reaction forces of a `wsim.gradient.recording.Recording`. Raises SceneError as `PinReactions` does."""

    def __init__(self, recording):
        self.recording = recording
        super().__init__(recording.plan)

    def make(self) -> None:
        self.law = ReactionLaw(self.recording)

    def felt(self, x: wp.array, e: wp.array | None, v: wp.array) -> np.ndarray:
        return self.law.evaluate(self.frame, x, e, v, self.time)

    def at(self, frame: int) -> None:
        """The state after so many frames."""
        r, self.frame = self.recording, frame
        self.see(r.states[frame], r.rests[frame], r.speeds[frame], (r.start + frame) / r.sim.scene.fps)

    # backward

    def begin(self, given: dict) -> "ReactionAdjoint":
        """given: {frame: {pin: (n, 3)}, or {(pin, world): (n, 3)}} [1/N]. Raises SceneError for those that are none."""
        n = self.model.points
        self.law.zero()
        self.inertia = PinnedPointGradients(np.zeros(n), np.zeros((n, 3)), np.zeros(n))
        self.given: dict[int, list[tuple[HeldPoints, np.ndarray]]] = {}
        for frame, pins in given.items():
            if not 0 <= frame <= self.recording.frames:
                raise SceneError(Problem("reactions", f"found frame {frame}; allowed are 0 to {self.recording.frames}"))
            self.given[frame] = []
            for key, values in pins.items():
                path, world = key if isinstance(key, tuple) else (key, 0)
                h, each = self.find(path, world), np.asarray(values, np.float64)
                if each.shape != (len(h.share), 3) or not np.isfinite(each).all():
                    raise SceneError(Problem(path, f"derivatives must be finite with shape ({len(h.share)}, 3); found "
                                             f"{each.shape}"))
                self.given[frame].append((h, h.spread(each)))
                if h.pin.motion.moves:
                    self.inertia.moved.add((path, world))
                elif not h.hard:
                    self.inertia.soft[path, world] = {"stiffness": 0.0, "damping": 0.0, "targets": np.zeros((len(h.places), 3))}
        return self

    def back(self, frame: int) -> None:
        """Adds what reaction forces after so many frames give to the gradients of that state, and of everything else."""
        if frame not in self.given:
            return
        self.at(frame)
        p, by_x, by_v = np.zeros((3, self.model.points, 3))
        for h, r in self.given[frame]:
            if h.hard:
                np.add.at(p, h.places, -r)
                np.add.at(by_v, h.places, self.hard(h, r))
            else:
                np.add.at(by_x, h.places, -h.pin.part * h.pin.pin.stiffness * r)
                np.add.at(by_v, h.places, -h.pin.part * h.pin.pin.damping * r)
                self.soft(h, r)
        loads: Any = self.plan.ports.loads
        if loads:
            by = loads.transposed(p, self.time)
            self.inertia.loads = [a + b for a, b in zip(self.inertia.loads, by, strict=True)] if self.inertia.loads else by
        of_x, of_v = self.law.transposed(p)
        for base, by in ((self.plan.state.x, by_x + of_x), (self.plan.state.v, by_v + of_v)):
            root = next(root for root in self.recording.roots if root.base.ptr == base.ptr)
            add_and_clear_gradient(wp.array(by.astype(self.model.dtype), dtype=base.dtype, device=base.device), root.carried)

    def end(self) -> PinnedPointGradients:
        """The part that comes after the last frame."""
        self.inertia.tables, self.inertia.muscles = self.law.by_batches(), self.law.by_keys()
        return self.inertia

    def hard(self, h: HeldPoints, r: np.ndarray) -> np.ndarray:
        """Gradients with respect to v of what is not f; by masses, gravity and drag of the air into `inertia`."""
        own, m, at = self.inertia, self.masses[h.places, None], h.places
        np.add.at(own.mass, at, (r * (h.acceleration(self.time, self.plan.clock.dt) + self.drive[at])).sum(axis=1))
        np.add.at(own.gravity, at, -m * r)
        np.add.at(own.decay, at, (m * r * self.v[at]).sum(axis=1))
        return m * self.constants.decay.numpy()[self.constants.object.numpy()[at], None] * r

    def soft(self, h: HeldPoints, r: np.ndarray) -> None:
        """Gradients with respect to stiffness, damping and targets into `inertia`, of pins that stand still."""
        own, part = self.inertia.soft.get((h.pin.pin.path, h.pin.body.world)), h.pin.part
        if own:
            own["stiffness"] += part * float((r * (h.pin.targets(self.time) - self.x[h.places])).sum())
            own["damping"] -= part * float((r * self.v[h.places]).sum())
            own["targets"] += part * h.pin.pin.stiffness * r
