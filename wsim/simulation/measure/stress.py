"""Stress and strain of soft bodies, by tet and by point, for who asks: see kernels/soft/stress.py. Nothing is compiled
before."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from wsim.geometry.tetra.tets import signed_tet_volumes
from wsim.kernels.soft import stress as kernels
from wsim.model import kernel_cache
from wsim.model.model import PointBody
from wsim.scene import Problem, SceneError
from wsim.simulation.plan import SimulationPlan


@dataclass
class Stress:
    """Stress of each tet of a soft body, in the author's order."""

    body: PointBody
    von_mises: np.ndarray         # of the Cauchy stress [Pa], (t,); of a cage's tet: with the stiffness that it has there
    strain: np.ndarray            # |E|, E = sym(R^T F) - 1, what is elastic of it, (t,)

    def at_points(self) -> dict[str, np.ndarray]:
        """Means over the tets of each point, weighed by their volume at rest, (n,) in the author's order: vonMises [Pa] and
        strain. 0 where there is no tet."""
        body, tets = self.body, self.body.tets[:, :4] - self.body.first
        corners, volume = tets.ravel(), np.repeat(signed_tet_volumes(body.rest, tets), 4)
        whole = np.bincount(corners, volume, body.count)
        places = body.index - body.first

        def mean_over_tets(values: np.ndarray) -> np.ndarray:
            sums = np.bincount(corners, volume * np.repeat(values, 4), body.count)
            return (sums / np.where(whole > 0.0, whole, 1.0))[places]
        return {"vonMises": mean_over_tets(self.von_mises), "strain": mean_over_tets(self.strain)}


def stress_of_soft_body(plan: SimulationPlan, path: str | None, world: int = 0) -> Stress:
    """Stress of the soft body of that path (None: the only body) now. Raises SceneError where that is no soft body."""
    body = plan.model.body(path, world)
    if not body.source.is_solid:
        raise SceneError(Problem(body.path, f"is a {body.source.noun}; stress is that of soft bodies"))
    found = np.zeros((len(body.tets), 2))
    for table in plan.solids:
        first = 0
        for part in table.parts:
            if part.body is body:
                found[part.rows] = _stress_of_table(table, plan)[first:first + len(part.rows)]
            first += len(part.rows)
    return Stress(body, *found.T)


def _stress_of_table(table, plan: SimulationPlan) -> np.ndarray:
    """(von Mises stress [Pa], |E|) of each tet of a table, (t, 2): means over its evaluation points."""
    model, state, points = plan.model, plan.state, len(table.q) // table.size
    if table.plastic:
        table.plastic.shape()
    kernel = kernels.von_mises_kernel(table.material, points, real=model.real,
                                      module=f"{model.module}_stress_{table.material}_{points}")
    out = wp.zeros(len(table.q), dtype=wp.vec2d, device=model.device)
    kernel_cache.load_module_of_kernel(kernel, model)
    model.launch(kernel, len(table.q), [table.data, state.x, state.e, table.q], [out])
    return out.numpy().reshape(table.size, points, 2).mean(axis=1)
