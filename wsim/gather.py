"""Tables by which points gather forces: springs of each point in slices, and elements with their corners."""

import numpy as np
import warp as wp

from wsim.cloth import Rows
from wsim.kernels import corner
from wsim.kernels.real import types
from wsim.kernels.spring import SLICE
from wsim.model import Model
from wsim.topology import incident


def sliced(ids: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Springs (m, 2) between n points as sliced ELLPACK: first entry of each slice of 32 points; springs of each point;
    and for each entry its place in a list of half springs (-1: padding), the point at the other end, and its spring."""
    size = SLICE
    starts, row = incident(ids, n)
    count = np.diff(starts).astype(np.int32)
    point = np.repeat(np.arange(n), count)
    width = np.maximum.reduceat(count, np.arange(0, n, size)) if n else np.zeros(0, int)
    start = np.concatenate([[0], np.cumsum(width * size)])
    place = start[point // size] + (np.arange(len(point)) - starts[point]) * size + point % size
    entry = np.full(start[-1], -1, np.int64)
    entry[place] = np.arange(len(point))
    other, spring = np.zeros(start[-1], np.int32), np.zeros(start[-1], np.int64)
    spring[place] = row
    other[place] = ids[row].sum(1) - point
    return start[:-1].astype(np.int32), count, entry, other, spring


class Elements:
    """Membranes or hinges of every body, on the device."""

    def __init__(self, model: Model, kind: str, rows: list[Rows]):
        self.model, self.kind, self.rows, self.first = model, kind, rows, 0
        t, real = types(model.real), model.real
        self.ids = np.concatenate([r.ids for r in rows]).astype(np.int32)
        self.data = corner.elements(kind, real)()
        self.data.point = model.upload(self.ids, wp.types.vector(self.ids.shape[1], int))
        self.data.rest = model.upload(np.concatenate([r.rest for r in rows]), t.mat22 if kind == "membrane" else real)
        self.data.stiffness = model.upload(self.stiffness(), t.vec3 if kind == "membrane" else real)
        self.data.tau = model.upload(self.tau(), real)

    def stiffness(self) -> np.ndarray:
        """alpha^-1, (m,); of a membrane (m, 3): (uu, uv, shear) of plane stress."""
        alpha = np.concatenate([np.broadcast_to(r.alpha, (len(r.ids), *r.alpha.shape[1:])) for r in self.rows])
        if self.kind != "membrane":
            return 1.0 / alpha
        uu, uv, shear = alpha.T
        return np.stack([uu, -uv, np.zeros_like(uu)], axis=1) / (uu**2 - uv**2)[:, None] + np.stack(
            [np.zeros_like(uu), np.zeros_like(uu), 1.0 / shear], axis=1)

    def tau(self) -> np.ndarray:
        return np.concatenate([np.full(len(r.ids), r.tau) for r in self.rows])

    def refresh(self) -> None:
        self.data.stiffness.assign(self.stiffness().astype(self.model.dtype))
        self.data.tau.assign(self.tau().astype(self.model.dtype))

    def corners(self, damped: bool):
        return corner.corners(self.kind, real=self.model.real, module=self.model.module, damped=damped)
