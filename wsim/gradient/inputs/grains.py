"""What bodies of material points begin with and are made of, by name (`wsim.gradient.inputs.by_name`).

    /World/Heap:young, :poisson, :density, :friction_angle ...     () as of its material
    /World/Heap:positions, :velocities                             (n, 3) [m], [m/s], where the recording begins
"""

import numpy as np
import warp as wp

from wsim.gradient.inputs.base import PART, RecordingInput
from wsim.scene.values.coverage import gradient_refusal

FIELDS = {"velocities": "v", "positions": "o"}


class MaterialPointValue(RecordingInput):
    """A value of a body of material points."""

    def read_value(self, world: int = 0) -> np.ndarray:
        recorded = self.recording.grains
        rows = recorded.rows(self.path, world)
        if self.what == "velocities":
            return self._begun("v").numpy()[rows].astype(np.float64)
        if self.what == "positions":
            node = np.stack([self._begun(name).numpy()[rows] for name in "ijk"], axis=1).astype(np.float64)
            offset = self._begun("o").numpy()[rows].astype(np.float64) + self._begun("e").numpy()[rows]
            return recorded.method.corner + recorded.method.cell * (node + offset)
        k = recorded.paths.index(self.path)
        if recorded.method.things[k].further:
            raise gradient_refusal("mixed", self.path, name=self.what)
        material = recorded.method.material_now(k, world)
        if not hasattr(material, self.what):
            raise gradient_refusal("law", self.path, name=self.what, law=material.law)
        return np.array(getattr(material, self.what), np.float64)

    def set_world_value(self, value: np.ndarray, world: int) -> None:
        if self.what not in FIELDS:
            super().set_world_value(value, world)
            return
        method, rows = self.recording.grains.method, self.recording.grains.rows(self.path, world)
        if self.what == "velocities":
            self._write("v", rows, value)
            return
        at = (value - method.corner) / method.cell
        node = np.floor(at + 0.5)
        for axis, name in enumerate("ijk"):
            self._write(name, rows, node[:, axis].astype(np.int32))
        self._write("o", rows, at - node)
        self._write("e", rows, np.zeros_like(at))

    def _begun(self, name: str) -> wp.array:
        """A field as the recording begins with it."""
        field = self.recording.grains.method.part.arrays[name]
        for array, begun in self.recording.flowed:
            if array.ptr <= field.ptr < array.ptr + array.capacity:
                place = begun.ptr + field.ptr - array.ptr
                return wp.array(ptr=place, dtype=field.dtype, shape=field.shape, device=field.device)
        raise AssertionError(f"{name} is no part of the state")

    def _write(self, name: str, rows: np.ndarray, values: np.ndarray) -> None:
        array = self._begun(name)
        every = array.numpy()
        every[rows] = values
        array.assign(every)

    def difference_scale(self) -> float:
        """A part of a cell; velocities: that change a place by as much in the time of the recording; else a part of it."""
        cell = PART * self.recording.grains.method.cell
        if self.what == "positions":
            return cell
        if self.what == "velocities":
            return cell * self.sim.scene.fps / self.recording.frames
        return PART * (float(np.abs(self.read_value()).max()) or 1.0)
