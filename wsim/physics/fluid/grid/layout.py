"""Where the numbers of a fluid stand: cells and faces along the axes of its grid. NumPy only.

A flat fluid has two axes; its third one counts as one cell, and its arrays have the same order in memory as those of the box.
"""

from dataclasses import dataclass
from math import prod

import numpy as np

from wsim.physics.fluid.objects import Cubes

OPEN, CLOSED, AROUND = 2.0, 0.0, 1.0        # factors on the coupling at a side, see kernels/fluid/pressure.py


@dataclass(frozen=True)
class Layout:
    """axes: of the world, of each axis of the grid; n: cells; periodic: 1 or 0; low, high: factors at the sides."""

    axes: tuple[int, ...]
    n: tuple[int, int, int]
    periodic: tuple[int, int, int]
    low: tuple[float, float, float]
    high: tuple[float, float, float]

    @staticmethod
    def of(fluid: Cubes) -> "Layout":
        axes = fluid.axes
        kinds = [fluid.sides[2 * a:2 * a + 2] for a in axes]
        factor = {"open": OPEN, "closed": CLOSED, "wind": CLOSED, "periodic": AROUND}
        fill = 3 - len(axes)
        n = (*(fluid.shape[a] for a in axes), *(1,) * fill)
        periodic = (*(int(k[0] == "periodic") for k in kinds), *(0,) * fill)
        low, high = ((*(factor[k[side]] for k in kinds), *(0.0,) * fill) for side in (0, 1))
        return Layout(axes, n, periodic, low, high)  # type: ignore[arg-type]  # three of each

    @property
    def dim(self) -> int:
        return len(self.axes)

    @property
    def cells(self) -> int:
        return prod(self.n)

    @property
    def sealed(self) -> bool:
        """No side is open."""
        return OPEN not in (*self.low[:self.dim], *self.high[:self.dim])

    def faces(self, axis: int) -> tuple[int, ...]:
        """Rows of a component along the grid's axes."""
        return tuple(m + (a == axis and not self.periodic[a]) for a, m in enumerate(self.n))

    def nodes(self) -> tuple[int, ...]:
        """Corners of cells; of a flat fluid in its plane."""
        return tuple(m + (a < self.dim) for a, m in enumerate(self.n))

    def component_at_centers(self, u: np.ndarray, axis: int) -> np.ndarray:
        """A component (faces,) at the centres (n), float64."""
        on = np.asarray(u, np.float64).reshape(self.faces(axis))
        ahead = np.roll(on, -1, axis=axis) if self.periodic[axis] else np.delete(on, 0, axis=axis)
        behind = on if self.periodic[axis] else np.delete(on, -1, axis=axis)
        return 0.5 * (ahead + behind)

    def outflow(self, u: np.ndarray, axis: int) -> np.ndarray:
        """Difference of a component (faces) across each cell (n)."""
        return np.roll(u, -1, axis) - u if self.periodic[axis] else np.diff(u, axis=axis)

    def faced(self, values: np.ndarray, axis: int) -> np.ndarray:
        """Values at the centres (n) on the faces of an axis: means of both sides."""
        values = np.asarray(values, np.float64).reshape(self.n)
        if self.periodic[axis]:
            return 0.5 * (values + np.roll(values, 1, axis=axis))
        pad = np.concatenate([np.take(values, [0], axis), values, np.take(values, [-1], axis)], axis)
        return 0.5 * (np.delete(pad, 0, axis) + np.delete(pad, -1, axis))

    def transpose_centered(self, values: np.ndarray, axis: int) -> np.ndarray:
        """The transpose of `component_at_centers`: of values (n) on the faces."""
        half = 0.5 * np.asarray(values, np.float64).reshape(self.n)
        if self.periodic[axis]:
            return half + np.roll(half, 1, axis=axis)
        none = np.zeros_like(np.take(half, [0], axis))
        return np.concatenate([half, none], axis) + np.concatenate([none, half], axis)

    def transpose_faced(self, values: np.ndarray, axis: int) -> np.ndarray:
        """The transpose of `faced`: of values on the faces at the centres (n)."""
        on = 0.5 * np.asarray(values, np.float64).reshape(self.faces(axis))
        if self.periodic[axis]:
            return on + np.roll(on, -1, axis=axis)
        found = np.delete(on, -1, axis) + np.delete(on, 0, axis)
        ends = [slice(None)] * 3
        for face, cell in ((0, 0), (-1, -1)):
            here, there = list(ends), list(ends)
            here[axis], there[axis] = slice(cell, cell + 1 or None), slice(face, face + 1 or None)
            found[tuple(here)] += on[tuple(there)]
        return found
