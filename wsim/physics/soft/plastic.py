"""Plastic flow of the tets of a table (`wsim.physics.soft.fem`), on the device: see kernels/soft/plastic.py."""

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.soft import plastic
from wsim.model import state
from wsim.model.vjp import beside
from wsim.physics.soft.parts import Region


class PlasticFlow:
    """Rest shapes that the tets of a table have become. Made for tables with a yield strain alone.

    While a tape records, F_p has versions as other arrays have; the edges and gradients of the table, which kernels read, are
    made of them anew wherever they are wanted, forward and backward."""

    def __init__(self, table):
        self.table, self.model = table, table.model
        model, t, real = self.model, types(table.model.real), table.model.real
        self.limits = [yield_limits(p) for p in table.parts]
        self.data = plastic.plastic_tets(real)()
        self.data.limit = model.upload(np.concatenate(self.limits), t.scalar)
        self.data.edge, self.data.gradient = wp.clone(table.data.edge), wp.clone(table.data.gradient)
        self.F = wp.array(np.tile(np.eye(3), (table.size, 1, 1)), dtype=t.mat33, device=model.device)
        self.shape_kernel, self.flow_kernel = (plastic.plastic_shape_kernel(real, model.module),
                                               plastic.plastic_flow_kernel(real, model.module))
        starts = np.cumsum([0, *(len(p.rows) for p in table.parts)])
        name = f"plastic_{table.name}"
        self.kept = state.StatePart(name, table.size, table.size, rows={
            (p.body.path, p.body.world): first + np.argsort(p.rows) for p, first in zip(table.parts, starts[:-1], strict=True)})
        self.kept.take(state.StateField(name, "", True, "F_p, what a tet has become at rest", "mat33"), self.F)
        self.adjoint = beside(model, __name__, "FlowAdjoint", self)

    def shape(self) -> None:
        """Launches what makes edges and gradients of F_p: these alone outlive a frame."""
        if not self.model.tape:
            self.shape_from_flow(self.F)

    def shape_from_flow(self, F: wp.array) -> None:
        """Shape as `shape` has it, of a version of F_p, and never recorded by itself."""
        data = self.table.data
        tape, self.model.tape = self.model.tape, None
        self.model.launch(self.shape_kernel, self.table.size, [self.data, F], [data.edge, data.gradient])
        self.model.tape = tape

    def flow(self, x: wp.array, d: wp.array) -> None:
        """Launches the flow at x + d."""
        tape = self.model.tape
        if tape:
            F = tape.read(self.F)
            tape.do(lambda: self.shape_from_flow(F))
        self.model.launch(self.flow_kernel, self.table.size, [self.data, self.table.data, x, d, self.table.q, self.F], [self.F])

    def strain(self) -> float:
        """Largest |F_p - 1|."""
        return float(np.linalg.norm(self.F.numpy().astype(np.float64) - np.eye(3), axis=(1, 2)).max())

    def set_value(self, path: str, value: float, world: int | None) -> bool:
        """Yield strain of a soft body, of all its materials in this table that have one."""
        hit = [k for k, p in enumerate(self.table.parts) if p.body.path == path and world in (None, p.body.world)]
        for k in hit:
            self.limits[k] = np.where(np.isfinite(self.limits[k]), value, np.inf)
        if hit:
            self.data.limit.assign(np.concatenate(self.limits).astype(self.table.model.dtype))
        return bool(hit)


def yield_limits(part: Region) -> np.ndarray:
    """Yield strain of each tet, inf where there is none, (t,)."""
    return np.array([m.yield_strain for m in part.soft.materials])[part.material]
