"""Bending in a step of Newton's method: curvatures of sheets, what their Jacobian is made of, their part of a line search."""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.cloth import curvature as kernels
from wsim.kernels.cloth import curvature_line_search, hessian
from wsim.kernels.math.real import types
from wsim.model.model import Model


class NewtonCurvature:
    """Curvatures in Newton's method, of hinges, a `wsim.physics.cloth.table.ConstraintTable`."""

    def __init__(self, model: Model, table: Any):
        self.model, self.table, self.cur = model, table, table.curvature
        self.spans = self.cur.spans(table.ids)
        self.part = model.upload(self.spans.part.astype(np.int32), int)
        self.item = model.upload(self.spans.item.astype(np.int32), wp.vec2i)
        sizes = np.bincount([model.system(r.body.number) for r in table.rows if r.body is not None], self.cur.sizes,
                            len(model.starts) - 1)
        self.first = model.upload(np.r_[0, np.cumsum(sizes)].astype(np.int32), int)
        real, module = model.real, model.step_modules[0]
        self.looks = curvature_line_search.hinge_searches(real)()
        self.looks.own = self.cur.data.own
        self.looks.found = wp.zeros((table.size, curvature_line_search.COLUMNS), dtype=wp.float64, device=model.device)
        self.hinges, self.moments, self.rows = (f(real, module)
                                                for f in (hessian.hinge_hessian_kernel, hessian.hinge_moment_kernel,
                                                          hessian.curvature_span_kernel))
        self.angles, self.change = (curvature_line_search.hinge_search_kernel(real, module),
                                    curvature_line_search.curvature_change_kernel(real, module))
        self.sums = kernels.curvature_sum_kernel(real, module)

    def room(self, element) -> None:
        """Arrays of what elements leave for their points."""
        vec3, device = types(self.model.real).vec3, self.model.device
        element.G = wp.zeros(4 * self.table.size, dtype=vec3, device=device)
        element.J = wp.zeros(3 * len(self.spans.point), dtype=vec3, device=device)

    def linearise(self, x: wp.array, d: wp.array, a: wp.array, rate: float, element) -> None:
        """Forces on the corners of hinges, and J of triangles, at x + d with the anchor a."""
        launch, data, cur = self.model.launch, self.table.data, self.cur
        launch(self.hinges, self.table.size, [data, x, d, a, rate, cur.data], [element])
        launch(self.sums, cur.triangles, [cur.data], [])
        launch(self.moments, self.table.size, [data, rate, cur.data], [element])
        launch(self.rows, len(self.spans.point), [cur.data, self.part, self.item], [element])

    def search(self, trial, of_triangles, where: list) -> None:
        """Adds what Phi changes by; trial: of hinges; where: places, displacements, anchor, direction, rate."""
        rows = trial.change.shape[0]
        self.model.launch(self.angles, rows, [trial, self.table.data, *where, self.looks], [])
        self.model.launch(self.change, rows, [of_triangles, self.cur.data, self.looks], [])
