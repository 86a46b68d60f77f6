"""What fluids and their sources begin with and are made of, by name (`wsim.gradient.inputs.by_name`).

    /World/Air:lift, :weight, :vorticity, :smoke_decay, :cooling, :viscosity     () as of `Fluid`
    /World/Air:side_velocities                    (6, 3) [m/s]; of those the closed sides' have a derivative
    /World/Air:acceleration                       (3,) or (nx, ny, nz, 3) [m/s^2], as the fluid has it
    /World/Air:velocity, :smoke, :temperature     (nx, ny, nz, 3) [m/s], (nx, ny, nz) [1], [K] at the cells' centres, where the
                                                  recording begins; faces take the means of a change on both sides
    /World/Fire:smoke, :temperature, :expansion   () as of `Source`
    /World/Fire:velocity, :place                  (3,) [m/s], [m]: where its motion begins, all of which is shifted
    /World/Fire:strength                          (keys,) of its curve, linear between the ends of frames
    /World/Ball:surface                           (frames, 2, 3) [m/s], [rad/s], see `SurfaceInput`
"""

import numpy as np
import warp as wp

from wsim.gradient.inputs.base import PART, RecordingInput
from wsim.physics.fluid.measure import NAMES
from wsim.scene.values.coverage import gradient_refusal

SCALARS = {"smoke": "smoke", "temperature": "heat"}


class FluidValue(RecordingInput):
    """A value of a fluid or a source."""

    @property
    def method(self):
        return self.recording.fluids.method

    @property
    def own(self) -> bool:
        """True if it is a fluid's."""
        return self.row.owner == "Fluid"

    def field(self) -> bool:
        """True if it is a field where the recording begins."""
        return self.own and self.what in ("velocity", *SCALARS)

    def read_value(self, world: int = 0) -> np.ndarray:
        method = self.method
        self.recording.fluids.runs(self.path, self.what)
        if not self.own:
            return method.source_value(self.path, self.what, world)
        k = self.recording.fluids.row(self.path, world)
        if self.field():
            return self.begun(k, world)
        numbers = method.numbers[k]
        return np.array(numbers.get(self.what, getattr(method.pairs[k][0], self.what)), np.float64)

    def begun(self, k: int, world: int) -> np.ndarray:
        """A field at the centres, as written last, or as the state has it."""
        kept = self.recording.fluids.begun.get((k, self.what))
        if kept is not None:
            return kept.copy()
        (fluid, _), layout = self.method.pairs[k], self.method.layouts[k]
        if self.what != "velocity":
            return self.part(k, SCALARS[self.what]).numpy().astype(np.float64).reshape(fluid.shape)
        found = np.zeros((*fluid.shape, 3))
        for a, axis in enumerate(layout.axes):
            now = self.part(k, NAMES[a]).numpy().astype(np.float64)
            found[..., axis] = layout.component_at_centers(now, a).reshape(fluid.shape)
        return found

    def part(self, k: int, name: str) -> wp.array:
        """Part of the arrays with which the recording begins, that of a component or a scalar."""
        base = self.method.field(k, name)
        for array, begun in self.recording.flowed:
            if array.ptr <= base.ptr < array.ptr + array.capacity:
                return wp.array(ptr=begun.ptr + base.ptr - array.ptr, dtype=base.dtype, shape=base.shape, device=base.device)
        raise AssertionError(f"{name} is no part of the state")

    def set_world_value(self, value: np.ndarray, world: int) -> None:
        if not self.field():
            super().set_world_value(value, world)
            return
        k = self.recording.fluids.row(self.path, world)
        layout = self.method.layouts[k]
        if self.what == "velocity":
            change = value - self.begun(k, world)
            for a, axis in enumerate(layout.axes):
                now = self.part(k, NAMES[a])
                now.assign((now.numpy() + layout.faced(change[..., axis], a).ravel()).astype(self.model.dtype))
        else:
            self.part(k, SCALARS[self.what]).assign(value.ravel().astype(self.model.dtype))
        self.recording.fluids.begun[k, self.what] = np.array(value, np.float64)

    def difference_scale(self) -> float:
        """A part of it; of what is 0 that of one unit; of a place that of a cell."""
        if self.what == "place":
            return PART * min(fluid.cell for fluid, _ in self.method.pairs)
        return PART * (float(np.abs(self.read_value()).max()) or 1.0)


class SurfaceInput(RecordingInput):
    """An addition to the velocity and the angular velocity of an obstacle's surface in each frame, (frames, 2, 3); it is
    read as zeros, and cannot be written."""

    def read_value(self, world: int = 0) -> np.ndarray:
        fluids = self.recording.fluids
        moving = [d.obstacles.shapes for d in fluids.method.domains if d.obstacles and d.obstacles.moving] if fluids else []
        if not any(thing.path == self.path for shapes in moving for thing in shapes.things):
            raise gradient_refusal("surface", self.path)
        return np.zeros((self.recording.frames, 2, 3))
