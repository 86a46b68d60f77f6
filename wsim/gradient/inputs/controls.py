"""Controls over time as inputs of a recording: muscles, loads, and where pins put their points. See
`wsim.gradient.inputs.by_name`."""

from math import ceil

import numpy as np

from wsim.gradient.inputs.base import PART, RecordingInput, StartInput
from wsim.scene.values.coverage import gradient_refusal


class ActuationInput(RecordingInput):
    """Factors of the rest lengths of a net's muscles, at the keys of their curve."""

    def muscle_of_world(self, world: int):
        muscles = self.recording.parameters.muscles
        if not muscles:
            raise gradient_refusal("actuation", self.path)
        return muscles.muscles[muscles.find(self.path, world)]

    def read_value(self, world: int = 0) -> np.ndarray:
        return self.muscle_of_world(world).curve.values.copy()


class LoadInput(RecordingInput):
    """Force or traction of a load: (3,) where it stays, (keys, 3) of its curve over time."""

    def curve(self, world: int):
        loads = self.recording.parameters.loads
        return loads.borne[loads.find(self.path, world)].curve

    def read_value(self, world: int = 0) -> np.ndarray:
        curve = self.curve(world)
        return curve.values.copy() if curve.moves else curve.values[0].copy()

    def gradient(self, gradient, world: int, shape: tuple[int, ...]) -> np.ndarray:
        return gradient.load(self.path, world).reshape(shape)

    def difference_scale(self) -> float:
        return PART * (float(np.abs(self.read_value()).max()) or 1.0)


class TabledTargets:
    """Places where a pin's points belong, by a table (frames, rows, points, 3) or (points, 3) [m]: in the place of a `Motion`.
    at: parts of a frame of its rows."""

    def __init__(self, table: np.ndarray, start: int, fps: float, at: np.ndarray):
        self.table, self.start, self.fps, self.at, self.moves = table, start, fps, at, table.ndim == 4

    def points(self, local: np.ndarray, time: float) -> np.ndarray:
        if not self.moves:
            return self.table
        t = time * self.fps - self.start
        frame = min(max(ceil(t - 1e-6) - 1, 0), len(self.table) - 1)
        return self.table[frame, np.argmin(np.abs(self.at - (t - frame)))]


class TargetsInput(RecordingInput):
    """The places where a pin puts its points, or pulls them to. Where no pin of the scene moves, it stands still."""

    def __init__(self, recording, name: str):
        super().__init__(recording, name)
        self.pins = recording.parameters.pins

    def pin(self, world: int):
        """(the pin of that world, whether it is a hard one)."""
        for kind, group in self.pins.groups.items():
            for p in group:
                if p.pin.path == self.path and p.body.world == world:
                    return p, kind == "hard"
        raise AssertionError(self.path)

    def read_value(self, world: int = 0) -> np.ndarray:
        (p, hard), r, clock = self.pin(world), self.recording, self.sim.plan.clock
        if not self.pins.moves:
            return p.targets(r.start / self.sim.scene.fps) + p.body.origin
        return np.stack([[p.targets((r.start + f) / self.sim.scene.fps + moment) + p.body.origin
                          for moment in clock.moments(hard)] for f in range(r.frames)])

    def set_world_value(self, value: np.ndarray, world: int) -> None:
        (p, hard), clock = self.pin(world), self.sim.plan.clock
        p.motion = TabledTargets(value, self.recording.start, self.sim.scene.fps, clock.moments(hard) / clock.dt)
        self.pins.changed = True
        self.sim.graphs.forget("pins move otherwise")

    def difference_scale(self) -> float:
        return StartInput(self.recording, f"{self.pin(0)[0].pin.body}:positions").difference_scale()
