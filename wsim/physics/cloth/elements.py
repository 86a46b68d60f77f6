"""Membranes and hinges as explicit steps have them: forces at the corners of each. Equations: kernels/cloth/element.py,
kernels/cloth/curvature.py."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.cloth import element
from wsim.kernels.math.real import types
from wsim.model.model import Model
from wsim.physics.cloth.constraints import Constraints

if TYPE_CHECKING:
    pass


class Elements:
    """Membranes or hinges of every body, on the device."""

    def __init__(self, model: Model, kind: str, rows: list[Constraints]):
        self.model, self.kind, self.rows, self.first, self.damped = model, kind, rows, 0, False
        t, real = types(model.real), model.real
        self.ids = model.shared(np.concatenate([r.ids for r in rows]).astype(np.int32))
        self.data = element.elements(kind, real)()
        self.data.point = model.upload(self.ids, wp.types.vector(self.ids.shape[1], int))
        self.data.rest = model.upload(np.concatenate([r.rest for r in rows]), t.mat22 if kind == "membrane" else real)
        self.data.stiffness = model.upload(self.stiffness(), t.vec4 if kind == "membrane" else real)
        self.data.tau = model.upload(self.tau(), real)
        self.curvature: Any = None
        if kind == "dihedral":
            from wsim.physics.cloth.curvature import Curvature
            self.curvature = Curvature(model, rows, stored=True)

    def stiffness(self) -> np.ndarray:
        """alpha^-1, (m,); of a membrane (m, 4): (uu, uv, shear, vv) of plane stress."""
        alpha = np.concatenate([np.broadcast_to(r.alpha, (len(r.ids), *r.alpha.shape[1:])) for r in self.rows])
        if self.kind != "membrane":
            return 1.0 / alpha
        uu, uv, shear, vv = alpha.T
        det = uu * vv - uv**2
        return np.stack([vv / det, -uv / det, 1.0 / shear, uu / det], axis=1)

    def tau(self) -> np.ndarray:
        return np.concatenate([np.full(len(r.ids), r.tau) for r in self.rows])

    def refresh(self) -> None:
        self.data.rest.assign(np.concatenate([r.rest for r in self.rows]).astype(self.model.dtype))
        self.data.stiffness.assign(self.stiffness().astype(self.model.dtype))
        self.data.tau.assign(self.tau().astype(self.model.dtype))
        if self.curvature:
            self.curvature.refresh()

    def make(self, damped: bool) -> None:
        self.damped, real, module = damped, self.model.real, self.model.module
        if self.curvature:
            from wsim.kernels.cloth import curvature
            self.strained, self.kernel = curvature.strained(real, module, damped), curvature.corners(real, module)
        else:
            self.kernel = element.corners(real=real, module=module, damped=damped)

    def launch(self, x: wp.array, pair: wp.array, source: int, force: wp.array | None) -> None:
        read: list = [self.data, x, pair, source, self.first]
        if self.curvature:
            cur = self.curvature
            self.model.launch(self.strained, cur.hinges, [self.data, x, pair, source, cur.data], [])
            cur.launch_sums()
            read.append(cur.data)
        self.model.launch(self.kernel, len(self.ids), read, [force])
