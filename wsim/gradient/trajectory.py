"""What a recording keeps of each frame, and says of it: positions, velocities, what pins bear."""

from abc import ABC, abstractmethod
from functools import cached_property

import numpy as np
import warp as wp

from wsim.gradient.reactions.adjoint import ReactionAdjoint
from wsim.model.state import State
from wsim.scene import Problem, SceneError
from wsim.simulation.simulation import Simulation


class Frames(ABC):
    """The half of `wsim.gradient.recording.Recording` that is read. Frame 0 is the start.

    states, rests, speeds   x, its rounding remainder e, and v in solver order, (frames + 1, points)
    shapes                  what each of `flowed` has become, (frames + 1, elements); none until reactions are asked for
    """

    sim: Simulation
    state: State
    frames: int
    flowed: list[tuple[wp.array, wp.array]]       # arrays over elements that outlive a frame, and how they began
    ran = False

    @abstractmethod
    def run(self) -> None:
        """All frames, each of which `keep` is told of."""

    def allot(self) -> None:
        shape, dtype = (self.frames + 1, self.sim.model.points), self.state.x.dtype
        self.states, self.rests, self.speeds = (wp.zeros(shape, dtype=dtype, device=self.sim.device) for _ in range(3))
        self.shapes: list[wp.array] = []

    def keep(self, frame: int) -> None:
        s = self.state
        for kept, array in ((self.states, s.x), (self.rests, s.e), (self.speeds, s.v)):
            wp.copy(kept[frame], array)
        for kept, (array, _) in zip(self.shapes, self.flowed, strict=False):
            wp.copy(kept[frame], array)

    def positions(self, frame: int, path: str | None = None, world: int = 0) -> np.ndarray:
        """World positions [m] of a body's points after so many frames (0: at the start), float64 (n, 3), author's order: those
        of `Simulation.positions`."""
        body = self.sim.model.body(path, world)
        x = self.state_of(self.states, frame) + self.state_of(self.rests, frame)
        return x[body.index] + body.origin

    def velocities(self, frame: int, path: str | None = None, world: int = 0) -> np.ndarray:
        """Velocities [m/s], as `positions`."""
        return self.state_of(self.speeds, frame)[self.sim.model.body(path, world).index]

    def state_of(self, array: wp.array, frame: int) -> np.ndarray:
        if not 0 <= frame <= self.frames:
            raise SceneError(Problem("frame", f"found {frame}; allowed are 0 to {self.frames}"))
        if not self.ran:
            self.run()
        return array[frame].numpy().astype(np.float64)

    def reactions(self, frame: int, path: str | None = None, world: int = 0) -> np.ndarray:
        """Forces of a pin [N] after so many frames, (n, 3): `wsim.simulation.measure.reaction`."""
        self.state_of(self.states, frame)
        self.pulls.at(frame)
        return self.pulls.of(path, world)

    @cached_property
    def pulls(self) -> ReactionAdjoint:
        found = ReactionAdjoint(self)
        self.shapes = [wp.zeros((self.frames + 1, a.size), dtype=a.dtype, device=a.device) for a, _ in self.flowed]
        if self.ran and self.shapes:
            self.run()
        return found
