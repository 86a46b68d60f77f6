"""What tests/gradient/test_reaction_adjoint.py shares with other tests: Run."""

import numpy as np

from tests.make.gradient.gradients import WEIGHTS
from tests.make.gradient.gradients import Run as Positions
from wsim.gradient.recording import Recording
from wsim.scene import Scene
from wsim.simulation.simulation import Simulation


class Run(Positions):
    """As that of positions, with a linear loss of reactions at two frames beside it."""

    def __init__(self, scene: Scene, frames: int = 3, **how):
        super().__init__(scene, frames, **how)
        self.pin = scene.pins[0]
        self.r = np.random.default_rng(7).normal(size=(2, len(self.pin.points), 3))
        self.at = (frames - 1, frames)
        self.gradient = self.recording.backward({frames: {self.path: self.x}}, {frames: {self.path: self.v}},
                                                {f: {self.pin.path: r} for f, r in zip(self.at, self.r, strict=True)})

    def loss(self) -> float:
        borne = sum((self.recording.reactions(f) * each).sum() for f, each in zip(self.at, self.r, strict=True))
        return super().loss() + float(borne)

    def slope(self, values, step: float) -> float:
        parts = [sign * k * step for k in range(1, 5) for sign in (1, -1)]
        solved = self.scene.solver == "implicit"
        sim = Simulation(self.scene, device="cpu", precision="float64", worlds=len(parts), gradients=solved)
        for world, s in enumerate(parts):
            sim.set(*values(s), world)
        recording, losses = Recording(sim, self.frames) if solved else None, np.zeros(len(parts))
        if recording:
            recording.run()
        for frame, r in zip(self.at, self.r, strict=True):
            if not recording:
                sim.run(frame - sim.frame)
            force = (lambda w, f=frame: recording.reactions(f, self.pin.path, w)) if recording else \
                (lambda w: sim.reactions(self.pin.path, w))
            losses += [(force(w) * r).sum() for w in range(len(parts))]
        losses += [(sim.positions(self.path, w) * self.x).sum() + (sim.velocities(self.path, w) * self.v).sum()
                   for w in range(len(parts))]
        return float(np.reshape(losses, (4, 2)) @ (1, -1) @ WEIGHTS / step)
