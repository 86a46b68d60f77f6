"""Plastic flow of the tets of a table (`wsim.fem`), on the device: see kernels/plastic.py."""

import numpy as np
import warp as wp

from wsim.kernels import plastic
from wsim.kernels.real import types
from wsim.soft import Part
from wsim.state import Kept


class Plastic:
    """What each tet of a table has become at rest. Made for tables with a yield strain alone."""

    def __init__(self, table):
        self.table, model = table, table.model
        t, real = types(model.real), model.real
        self.limits = [limits(p) for p in table.parts]
        self.data = plastic.plastic(real)()
        self.data.limit = model.upload(np.concatenate(self.limits), t.scalar)
        self.data.edge, self.data.gradient = wp.clone(table.data.edge), wp.clone(table.data.gradient)
        self.F = model.upload(np.tile(np.eye(3), (table.size, 1, 1)), t.mat33)
        self.shape_kernel, self.flow_kernel = plastic.shape(real, model.module), plastic.flow(real, model.module)
        starts = np.cumsum([0, *(len(p.rows) for p in table.parts)])
        self.kept = Kept(self.F, wp.clone(self.F), {
            p.body.number: first + np.argsort(p.rows) for p, first in zip(table.parts, starts[:-1], strict=True)})

    def shape(self) -> None:
        """Launches what makes edges and gradients of F_p: these alone outlive a frame."""
        data = self.table.data
        self.table.model.launch(self.shape_kernel, self.table.size, [self.data, self.F], [data.edge, data.gradient])

    def flow(self, x: wp.array, d: wp.array) -> None:
        """Launches the flow at x + d."""
        data = self.table.data
        self.table.model.launch(self.flow_kernel, self.table.size, [self.data, data, x, d, self.table.q, self.F],
                                [self.F, data.edge, data.gradient])

    def strain(self) -> float:
        """Largest |F_p - 1|."""
        return float(np.linalg.norm(self.F.numpy().astype(np.float64) - np.eye(3), axis=(1, 2)).max())

    def set(self, path: str, value: float, world: int | None) -> bool:
        """Yield strain of a soft body, of all its materials in this table."""
        hit = [k for k, p in enumerate(self.table.parts) if p.body.path == path and world in (None, p.body.world)]
        for k in hit:
            self.limits[k] = np.full(len(self.limits[k]), value)
        if hit:
            self.data.limit.assign(np.concatenate(self.limits).astype(self.table.model.dtype))
        return bool(hit)


def limits(part: Part) -> np.ndarray:
    """Yield strain of each tet, inf where there is none, (t,)."""
    return np.array([m.yield_strain for m in part.soft.materials])[part.material]
