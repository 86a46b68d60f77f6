"""Constraints of cloths and nets on the device, a table for each kind: what an implicit solver reads."""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.cloth import hessian
from wsim.kernels.cloth.terms import batch_of
from wsim.kernels.math.real import types
from wsim.model.model import Model
from wsim.physics.cloth.constraints import Constraints
from wsim.physics.cloth.kind import CORNERS, SHEET, SPRINGS, named, row

ORDER = (SPRINGS, SHEET, CORNERS)      # of kinds in a step of Newton's method


class Table:
    """All constraints of one kind, on the device, in the order of the bodies."""

    def __init__(self, kind: str, rows: list[Constraints], model: Model):
        self.kind, self.rows, self.model, self.row, self.stale = kind, rows, model, row(kind), False
        self.ids = model.shared(np.concatenate([r.ids for r in rows]).astype(np.int32))
        self.size = len(self.ids)
        systems = [model.system(r.body.number) for r in rows if r.body is not None]
        sizes = np.bincount(systems, [len(r.ids) for r in rows], len(model.starts) - 1)
        self.first = model.upload(np.r_[0, np.cumsum(sizes)].astype(np.int32), int)
        self.most = int(sizes.max())
        t = types(model.real)
        self.lengths: wp.array | None = None          # rest lengths before muscles shorten them
        self.data = batch_of(self.row.equation, model.real)()
        self.data.point = model.upload(self.ids, wp.types.vector(self.ids.shape[1], int))
        rest = np.concatenate([r.rest for r in rows])
        self.data.rest = model.upload(rest, t.mat22 if rest.ndim == 3 else t.scalar)
        alpha, tau = self.values()
        self.data.alpha = model.upload(alpha, t.vec4 if alpha.ndim == 2 else t.scalar)
        self.data.tau = model.upload(tau, t.scalar)
        self.kernel = self.at = None              # type: Any
        self.curvature: Any = None
        if self.row.gather == SHEET:
            from wsim.physics.cloth.curvature import Curvature
            self.curvature = Curvature(model, rows)

    def values(self) -> tuple[np.ndarray, np.ndarray]:
        """Compliance and relaxation time [s] of each constraint."""
        return (np.concatenate([np.broadcast_to(r.alpha, (len(r.ids), *r.alpha.shape[1:])) for r in self.rows]),
                np.concatenate([np.full(len(r.ids), r.tau) for r in self.rows]))

    def given(self, lengths: wp.array) -> None:
        """Rest lengths as they are without muscles."""
        self.lengths = lengths

    def refresh(self) -> None:
        """Uploads the rows' rest values, compliances and relaxation times anew, into the same arrays."""
        if self.stale:
            alpha, tau = self.values()
            (self.lengths or self.data.rest).assign(np.concatenate([r.rest for r in self.rows]).astype(self.model.dtype))
            self.data.alpha.assign(alpha.astype(self.model.dtype))
            self.data.tau.assign(tau.astype(self.model.dtype))
            if self.curvature:
                self.curvature.refresh()
            self.stale = False


    def place(self, force: int, block: int) -> None:
        """Where elements leave forces on corners and blocks of pairs (kernels/solver/newton.py)."""
        equation, real, module = self.row.equation, self.model.real, self.model.module
        if equation.rows == 3:
            self.kernel, self.at = hessian.triangles(real, module), force
            return
        from wsim.kernels.cloth import general
        self.kernel, self.at = general.element(equation, real, module), wp.vec2i(force, block)

    def linearise(self, x: wp.array, d: wp.array, a: wp.array, rate: float, element) -> None:
        """Forces on the corners of elements and blocks of pairs, at x + d with the anchor a."""
        self.model.launch(self.kernel, self.size, [self.data, x, d, a, rate, self.at], [element])


def tables_of(model: Model, rows: list[Constraints]) -> dict[str, Table]:
    """A table for each kind: springs, hinges, then elements, membranes first."""
    kinds = sorted(named({r.kind for r in rows}), key=lambda kind: (ORDER.index(kind.gather), kind.equation.rows == 1))
    return {kind.name: Table(kind.name, [r for r in rows if r.kind == kind.name], model) for kind in kinds}


def bending_of(model: Model, tables: list[Table]) -> Any:
    """`wsim.physics.cloth.curvature_newton.NewtonCurvature` of the table of hinges, or None."""
    if not tables:
        return None
    from wsim.physics.cloth.curvature_newton import NewtonCurvature
    return NewtonCurvature(model, tables[0])
