"""What a recording keeps of each frame, and says of it: positions, velocities, what pins bear."""

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from wsim.gradient.reactions.adjoint import ReactionAdjoint
from wsim.kernels.math.real import types
from wsim.model.state import SimulationState, StatePart
from wsim.scene import Problem, SceneError
from wsim.simulation.simulation import Simulation


class RecordedFrames(ABC):
    """The half of `wsim.gradient.recording.Recording` that is read. Frame 0 is the start.

    states, rests, speeds   x, its rounding remainder e, and v in solver order, (frames + 1, points)
    shapes                  what each of `flowed` has become, (frames + 1, elements); none until reactions are asked for
    """

    sim: Simulation
    state: SimulationState
    frames: int
    flowed: list[tuple[wp.array, wp.array]]       # arrays over elements that outlive a frame, and how they began
    moved: StatePart | None                       # the points
    bodies: Any                                   # `wsim.physics.rigid.recorded.bodies.RecordedBodies`, or None
    fluids: Any                                   # `wsim.physics.fluid.recorded.RecordedFluids`, or None
    grains: Any                                   # `wsim.physics.mpm.adjoint.recorded.RecordedMaterialPoints`, or None
    ran = False

    @abstractmethod
    def run(self) -> None:
        """All frames, each of which `keep` is told of."""

    def allot(self) -> None:
        shape, dtype = (self.frames + 1, self.sim.model.points), types(self.sim.model.real).vec3
        self.states, self.rests, self.speeds = (wp.zeros(shape, dtype=dtype, device=self.sim.device) for _ in range(3))
        self.shapes: list[wp.array] = []
        for each in (self.bodies, self.fluids, self.grains):
            if each:
                each.allot(self.frames)

    def keep(self, frame: int) -> None:
        s = self.state
        for kept, array in ((self.states, s.x), (self.rests, s.e), (self.speeds, s.v)) if self.moved else ():
            wp.copy(kept[frame], array)
        for each in (self.bodies, self.fluids, self.grains):
            if each:
                each.keep(frame)
        for kept, (array, _) in zip(self.shapes, self.flowed, strict=False):
            wp.copy(kept[frame], array)

    def positions(self, frame: int, path: str | None = None, world: int = 0) -> np.ndarray:
        """World positions [m] of a body's points after so many frames (0: at the start), float64 (n, 3), author's order: those
        of `Simulation.positions`."""
        if grains := self.grain_path(path):
            self.reach(frame)
            return self.grains.positions(frame, grains, world)
        body = self.sim.model.body(path, world)
        x = self.state_of(self.states, frame) + self.state_of(self.rests, frame)
        return x[body.index] + body.origin

    def velocities(self, frame: int, path: str | None = None, world: int = 0) -> np.ndarray:
        """Velocities [m/s], as `positions`."""
        if grains := self.grain_path(path):
            self.reach(frame)
            return self.grains.velocities(frame, grains, world)
        return self.state_of(self.speeds, frame)[self.sim.model.body(path, world).index]

    def grain_path(self, path: str | None) -> str:
        """The path where it is that of material points, else "". None: of the only body."""
        if not self.grains:
            return ""
        only = self.grains.paths[0] if len(self.grains.paths) == 1 and not self.sim.model.bodies else ""
        return only if path is None else path if path in self.grains.paths else ""

    def reach(self, frame: int) -> None:
        """Runs, if that has not been done. Raises SceneError for frames that there are not."""
        if not 0 <= frame <= self.frames:
            raise SceneError(Problem("frame", f"found {frame}; allowed are 0 to {self.frames}"))
        if not self.ran:
            self.run()

    def state_of(self, array: wp.array, frame: int) -> np.ndarray:
        self.reach(frame)
        return array[frame].numpy().astype(np.float64)

    def poses(self, frame: int, path: str, world: int = 0) -> np.ndarray:
        """Frame of a rigid body to the world after so many frames, (4, 4) float64 [m]."""
        return self.rigid(frame).poses(frame)[self.rigid(frame).row(path, world)]

    def twists(self, frame: int, path: str, world: int = 0) -> np.ndarray:
        """Velocity of a rigid body's centre of mass [m/s] and its angular velocity [rad/s] in the world, (2, 3)."""
        return self.rigid(frame).twists(frame)[self.rigid(frame).row(path, world)]

    def rigid(self, frame: int):
        """Motions that are kept of rigid bodies. Raises SceneError where there are none, or no such frame."""
        if self.bodies is None:
            raise SceneError(Problem("poses", "the scene has no rigid bodies"))
        self.reach(frame)
        return self.bodies

    def fluid(self, frame: int, path: str, world: int = 0) -> dict[str, np.ndarray]:
        """smoke [1], temperature [K] (nx, ny, nz), velocity [m/s] (nx, ny, nz, 3) of a fluid after so many frames, at the
        cells' centres, float64; of smoke and temperature those that there are."""
        if self.fluids is None:
            raise SceneError(Problem(path, "the scene has no fluids"))
        self.reach(frame)
        return self.fluids.fields(frame, path, world)

    def reactions(self, frame: int, path: str | None = None, world: int = 0) -> np.ndarray:
        """Forces of a pin [N] after so many frames, (n, 3): `wsim.simulation.measure.reaction`."""
        self.reach(frame)
        self.pulls.at(frame)
        return self.pulls.of(path, world)

    @cached_property
    def pulls(self) -> ReactionAdjoint:
        found = ReactionAdjoint(self)
        self.shapes = [wp.zeros((self.frames + 1, a.size), dtype=a.dtype, device=a.device) for a, _ in self.flowed]
        if self.ran and self.shapes:
            self.run()
        return found
