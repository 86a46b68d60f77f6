"""Material points of a recording: their places and velocities after each frame, what a loss of them adds, and the frames as a
tape has them.

A frame is one entry of the tape. It keeps the state with which it began; its adjoint (`wsim.physics.mpm.adjoint.step`) runs it
once more, as the device alone knows how many steps it takes. A frame that lacks room, or took too long a step, is repeated at
once.
"""

from typing import Any

import numpy as np
import warp as wp

from wsim.model.stage import Clock
from wsim.model.tape import add_and_clear_gradient, without_gradient
from wsim.physics.mpm.adjoint.gradient import MaterialPointGradient
from wsim.physics.mpm.adjoint.refuse import refuse_underivable
from wsim.physics.mpm.adjoint.step import MaterialPointAdjoint
from wsim.scene import Problem, Scene, SceneError

SEEN = ("o", "e", "v", "i", "j", "k")         # fields of which each frame is kept
TRIES = 20                                    # times that a frame is repeated


def record_method(method: Any, scene: Scene) -> "RecordedMaterialPoints":
    """What records a method. Raises SceneError for what has no derivative."""
    refuse_underivable(method, scene)
    return RecordedMaterialPoints(method)


class RecordedMaterialPoints:
    """frames: (steps, factor on the rate of steps) of each frame."""

    def __init__(self, method: Any):
        self.method, self.model = method, method.model
        self.adjoint = MaterialPointAdjoint(method)
        self.kept: dict[str, wp.array] = {}
        self.first, self.frames = 0, {}                       # type: ignore[var-annotated]

    # frames

    @property
    def number(self) -> int:
        """Number of the frame that begins, of the recording."""
        return round(self.method.begins * self.method.fps) - self.first

    def frame(self, clock: Clock) -> None:
        """A frame, recorded."""
        tape, adjoint, dt = self.model.tape, self.adjoint, clock.dt
        tape.eager = True
        read = [tape.read(a) for a in adjoint.reals]
        wrote = [tape.write(a, True) for a in adjoint.reals]

        def run_recorded_frame() -> None:
            self._begin(read, self.model.tape is not None)
            before = [wp.clone(a) for a in adjoint.arrays]
            for _ in range(TRIES):
                self.method.grid.more.fill_(self.method.finer * self.method.more)
                self.method.status.word("mpm: grid").zero_()
                self.method.grid.run_frame(dt, self.method.status.word("mpm: grid"))
                if not self._repairs():
                    break
                for a, b in zip(adjoint.arrays, before, strict=True):
                    wp.copy(a, b)
            steps = int(self.method.status.said("mpm: grid")[3])
            self.frames[self.number] = steps, self.method.finer * self.method.more
            for base, version in zip(adjoint.reals, wrote, strict=True):
                wp.copy(without_gradient(version), base)
        tape.do(run_recorded_frame)

        def run_frame_adjoint() -> None:
            for by, version in zip(adjoint.by, wrote, strict=True):
                wp.copy(by, version.grad)
                version.grad.zero_()
            steps, more = self.frames[self.number]
            self._begin(read, False)
            self.method.grid.more.fill_(more)
            adjoint.frame_back(dt, steps)
            for by, version in zip(adjoint.by, read, strict=True):
                add_and_clear_gradient(by, version.grad)
        tape.adjoints.append(run_frame_adjoint)

    def _begin(self, read: list[wp.array], now: bool) -> None:
        """The state with which the frame begins. now: integers are those that stand there."""
        for base, version in zip(self.adjoint.reals, read, strict=True):
            wp.copy(base, without_gradient(version))
        for name in "ijk" if self.kept and not now else "":
            wp.copy(self.method.part.arrays[name], self.kept[name][self.number])

    def _repairs(self) -> bool:
        """True if the frame is to be repeated. Raises SceneError where nothing helps."""
        status = self.method.status
        status.fetch()
        for remedy in self.method.find_remedies(status):
            if remedy.kind == "stop":
                raise SceneError(Problem(self.method.things[0].path, f"frame {self.first + self.number + 1}: {remedy.why}"))
            if remedy.kind == "grow":
                remedy.act()
            return True
        return False

    # what is seen, and a loss of it

    def bytes(self, frames: int) -> int:
        """Bytes of what `allot` takes for so many frames."""
        return (frames + 1) * sum(self.method.part.arrays[name].capacity for name in SEEN)

    def allot(self, frames: int) -> None:
        arrays = self.method.part.arrays
        self.kept = {name: wp.zeros((frames + 1, arrays[name].size), dtype=arrays[name].dtype, device=arrays[name].device)
                     for name in SEEN}

    def keep(self, frame: int) -> None:
        if frame == 0:
            self.first = round(self.method.begins * self.method.fps)
        for name, array in self.kept.items():
            wp.copy(array[frame], self.method.part.arrays[name])

    @property
    def paths(self) -> list[str]:
        return [thing.path for thing in self.method.things]

    def rows(self, path: str, world: int = 0) -> np.ndarray:
        """Rows of a body's particles, in the author's order. Raises SceneError where there is no such one."""
        rows = self.method.part.rows
        if (path, world) not in rows:
            raise SceneError(Problem(path, f"is no body of material points in world {world}; there are "
                                     f"{', '.join(self.paths)}"))
        return rows[path, world]

    def positions(self, frame: int, path: str, world: int = 0) -> np.ndarray:
        """Places [m] after so many frames, (n, 3)."""
        rows = self.rows(path, world)
        node = np.stack([self.kept[name][frame].numpy()[rows] for name in "ijk"], axis=1).astype(np.float64)
        o, e = (self.kept[name][frame].numpy()[rows].astype(np.float64) for name in "oe")
        return self.method.corner + self.method.cell * (node + o + e)

    def velocities(self, frame: int, path: str, world: int = 0) -> np.ndarray:
        """Velocities [m/s], as `positions`."""
        return self.kept["v"][frame].numpy()[self.rows(path, world)].astype(np.float64)

    def losses(self, positions: dict, velocities: dict) -> "MaterialPointLosses":
        return MaterialPointLosses(self, positions, velocities)


class MaterialPointLosses:
    """Derivatives of a loss by places [1/m] and velocities [s/m], {frame: {(path, world): (n, 3)}}."""

    def __init__(self, recorded: RecordedMaterialPoints, positions: dict, velocities: dict):
        self.recorded, self.given = recorded, {}              # type: ignore[var-annotated]
        recorded.adjoint.zero_numbers()
        for name, given, factor in (("o", positions, recorded.method.cell), ("v", velocities, 1.0)):
            for frame, each in given.items():
                for (path, world), values in each.items():
                    self._add(frame, name, recorded.rows(path, world), factor * np.asarray(values, np.float64), path)

    def _add(self, frame: int, name: str, rows: np.ndarray, values: np.ndarray, path: str) -> None:
        part, dtype = self.recorded.method.part, self.recorded.model.dtype
        if values.shape != (len(rows), 3) or not np.isfinite(values).all():
            raise SceneError(Problem(path, f"derivatives must be finite with shape ({len(rows)}, 3); found {values.shape}"))
        found = self.given.setdefault(frame, np.zeros((len(part.names) * part.capacity, 3), dtype))
        found[part.names.index(name) * part.capacity + rows] += values

    def at(self, frame: int) -> list[tuple[wp.array, np.ndarray]]:
        """(array of the state, what the loss adds to its gradient) after so many frames."""
        return [(self.recorded.method.part.every, self.given[frame])] if frame in self.given else []

    def gradient(self, states: Any) -> MaterialPointGradient:
        """states: derivatives by the state where the recording begins, by address."""
        return MaterialPointGradient(self.recorded, states)
