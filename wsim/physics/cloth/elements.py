"""Membranes, hinges, elements of any other kind and tets as explicit steps have them: forces at the corners of each.
Equations: kernels/cloth/element.py, curvature.py, general.py, and those of `wsim.physics.soft.fem`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.cloth import element
from wsim.model.model import Model
from wsim.physics.cloth.constraints import Constraints
from wsim.physics.cloth.kind import SHEET, kind_row
from wsim.physics.cloth.table import constraint_table

if TYPE_CHECKING:
    pass


class CornerElements:
    """The elements of one kind of every body, on the device."""

    def __init__(self, model: Model, kind: str, rows: list[Constraints]):
        self.model, self.kind, self.rows, self.row, self.first, self.damped = model, kind, rows, kind_row(kind), 0, False
        self.table = table = constraint_table(model, kind).relax()
        self.ids, self.data = table.ids, element.force_elements(self.row.equation, model.real)()
        for name in ("point", "rest", "tau"):
            setattr(self.data, name, getattr(table.data, name))
        self.data.stiffness = model.upload(self.stiffness(), table.entry)
        self.curvature: Any = None
        if self.row.gather == SHEET:
            from wsim.physics.cloth.curvature import Curvature
            self.curvature = Curvature(model, rows, apart=True)

    def stiffness(self) -> np.ndarray:
        """alpha^-1, (m,); of a membrane (m, 4): (uu, uv, shear, vv) of plane stress."""
        alpha, _ = self.table.values()
        if alpha.ndim == 1:
            return 1.0 / alpha
        uu, uv, shear, vv = alpha.T
        det = uu * vv - uv**2
        return np.stack([vv / det, -uv / det, 1.0 / shear, uu / det], axis=1)

    def refresh(self) -> None:
        self.table.refresh()
        self.data.stiffness.assign(self.stiffness().astype(self.model.dtype))
        if self.curvature:
            self.curvature.refresh()

    def make(self, damped: bool) -> None:
        self.damped, real, module = damped, self.model.real, self.model.module
        if self.curvature:
            from wsim.kernels.cloth import curvature
            self.curvature.need(stored=True)
            self.strained, self.kernel = (curvature.hinge_strain_kernel(real, module, damped),
                                          curvature.hinge_force_kernel(real, module))
        elif self.row.equation.rows == 3:
            self.kernel = element.membrane_force_kernel(real=real, module=module, damped=damped)
        else:
            from wsim.kernels.cloth import general
            self.kernel = general.general_force_kernel(self.row.equation, real, module, damped)

    def passes(self, x: wp.array, pair: wp.array, source: int, force: wp.array | None) -> list[Callable[[], None]]:
        """Launches that evaluate the forces of the corners, in order."""
        read: list = [self.data, x, pair, source, self.first]
        launch, first = self.model.launch, list[Callable[[], None]]()
        if self.curvature:
            cur = self.curvature
            first = [partial(launch, self.strained, cur.hinges, [self.data, x, pair, source, cur.data], []), cur.launch_sums]
            read.append(cur.data)
        return [*first, partial(launch, self.kernel, len(self.ids), read, [force])]


class SolidElements:
    """Tets of one material model."""

    def __init__(self, table):
        self.table, self.ids, self.first, self.damped = table, table.ids, 0, table.damped

    def make(self, damped: bool) -> None:
        self.table.need_forces()

    def passes(self, x: wp.array, pair: wp.array, source: int, force: wp.array | None) -> list[Callable[[], None]]:
        """Launches that evaluate the forces of the corners, in order."""
        n = len(x)
        self.table.place(self.first, 0)
        return [lambda: self.table.forces(x, pair[source * n:(source + 1) * n], pair[(2 + source) * n:(3 + source) * n], force)]

    def refresh(self) -> None:
        """Live parameters are written where they are set."""
