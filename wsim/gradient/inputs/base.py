"""One named value of a recording, which can be read, written and differentiated by: see `wsim.gradient.inputs.by_name`."""

from abc import ABC, abstractmethod

import numpy as np

from wsim.model.midnodes import places_with_midnodes, with_midnode_values
from wsim.model.model import edge_lengths
from wsim.scene import Problem, SceneError
from wsim.scene.values.coverage import differentiable_row

PART = 0.05            # of a value, that a derivative by differences may move it


class RecordingInput(ABC):
    """One named value of a recording. `difference_scale`: by how much it may change, at most, for a difference to be a
    derivative. shared: worlds do not have their own."""

    shared = False

    def __init__(self, recording, name: str):
        self.recording, self.sim, self.model, self.name = recording, recording.sim, recording.sim.model, name
        self.path, _, self.what = name.rpartition(":")
        self.row = differentiable_row(recording.sim.scene, self.path or "/", self.what)

    def value_shapes(self) -> list[tuple[int, ...]]:
        """Shapes that a value of one world may have."""
        return [self.read_value().shape]

    def values_by_world(self, value) -> np.ndarray:
        """A given value for every world, (worlds, ...). Raises SceneError for other shapes and what is no finite number."""
        value, worlds, shapes = np.asarray(value, np.float64), self.sim.worlds, self.value_shapes()
        allowed = shapes + [(worlds, *s) for s in shapes] * (worlds > 1)
        if value.shape not in allowed:
            raise SceneError(Problem(self.name, f"found shape {value.shape}; allowed are {', '.join(map(str, allowed))}"))
        if not np.isfinite(value).all():
            raise SceneError(Problem(self.name, "found a value that is no finite number"))
        return np.broadcast_to(value, (worlds, *value.shape)) if value.shape in shapes else value

    def write_value(self, value) -> None:
        """Raises SceneError for values that the table of values does not allow."""
        values = self.values_by_world(value)
        if not (good := self.allowed_numbers(values)).all():
            raise SceneError(Problem(self.name, self.row.range.wrong(self.what, values[~good][0])))
        for world, each in enumerate(values):
            self.set_world_value(each, world)

    def set_world_value(self, value: np.ndarray, world: int) -> None:
        """Sets a live parameter; the number of substeps stays as it is."""
        path = self.path or "/"
        given = value if value.shape else float(value)
        if not any([m.set_value(path, self.what, given, world) for m in self.sim.plan.methods]):
            raise SceneError(Problem(self.name, "is no live parameter here, and takes no values"))
        key = path, self.what, world
        self.sim.changes = [c for c in self.sim.changes if (c[0], c[1], c[3]) != key] + [(path, self.what, value, world)]

    def bounds(self) -> tuple[float, float]:
        """Bounds of the value."""
        return self.row.range.low, self.row.range.high

    def allowed_numbers(self, value: np.ndarray) -> np.ndarray:
        """Mask of the numbers that may be."""
        return np.asarray(self.row.range.holds(value))

    def allows_value(self, value: np.ndarray) -> bool:
        return bool(self.allowed_numbers(value).all())

    @abstractmethod
    def read_value(self, world: int = 0) -> np.ndarray:
        """Present value of the input."""

    def gradient(self, gradient, world: int, shape: tuple[int, ...]) -> np.ndarray:
        """Gradient of one world, of a value of that shape, from a `wsim.gradient.gradient.Gradient`."""
        return np.asarray(gradient.value(self.path or "/", self.what, world))

    def difference_scale(self) -> float:
        return PART * float(np.abs(self.read_value()).max())


class StartInput(RecordingInput):
    """positions or velocities of a body where the recording begins. What an earlier step has left of a run that was already
    under way (BDF2, leapfrog among contacts) stays as it is."""

    def field(self, name: str) -> slice:
        """Place of a field in `Recording.initial`."""
        kept = self.sim.state.points.names
        return slice(kept.index(name) * self.model.points, (kept.index(name) + 1) * self.model.points)

    def read_value(self, world: int = 0) -> np.ndarray:
        every, body = self.recording.initial.numpy().astype(np.float64), self.model.body(self.path, world)
        if self.what == "velocities":
            return every[self.field("v")][body.index]
        return (every[self.field("x")] + every[self.field("e")])[body.index] + body.origin

    def write_value(self, value) -> None:
        every = self.recording.initial.numpy().copy()
        for world, each in enumerate(self.values_by_world(value)):
            body = self.model.body(self.path, world)
            where = places_with_midnodes(body)
            if self.what == "velocities":
                every[self.field("v")][where] = with_midnode_values(each, body.ends)
            else:
                exact = with_midnode_values(each - body.origin, body.ends)
                every[self.field("x")][where] = exact
                every[self.field("e")][where] = exact - every[self.field("x")][where]
        self.recording.initial.assign(every)

    def difference_scale(self) -> float:
        """A part of a mean edge; velocities: that change a place by as much in the time of the recording."""
        body = self.model.body(self.path)
        edge = PART * float(edge_lengths(body).mean()) if len(body.edges) else PART * 0.1
        return edge if self.what == "positions" else edge * self.sim.scene.fps / self.recording.frames
