"""Energy that clusters store, for the balance of a run and for reports: kernels/soft/clusters/flow.py."""

import numpy as np
import warp as wp

from wsim.kernels.math import ledger
from wsim.kernels.soft.clusters.flow import cluster_energy_kernel, cluster_row_kernel


class ClusterEnergy:
    """energies: (0, 0, E [J]) of each cluster; sums: of each thread of a world."""

    def __init__(self, method, threads: int):
        self.method, model, table = method, method.model, method.table
        self.energies = wp.zeros(len(table.sizes), dtype=wp.vec3d, device=model.device)
        self.sums = wp.zeros(model.worlds * threads, dtype=wp.vec3d, device=model.device)
        world = np.array([b.world for b in model.bodies])[table.body]
        self.order = model.upload(np.argsort(world, kind="stable").astype(np.int32), int)
        self.first = model.upload(np.searchsorted(np.sort(world), np.arange(model.worlds + 1)).astype(np.int32), int)
        self.measure, self.gather = cluster_energy_kernel(model.real, method.module), cluster_row_kernel(method.module)

    def launch_term(self, rows: wp.array) -> None:
        """Launches the term of the energy balance."""
        self.launch()
        self.method.spread(self.gather, self.sums.size, [self.energies, self.order, self.first], [self.sums])
        self.method.model.launch(ledger.store_energy, self.sums.size, [self.sums, 0, 1.0], [rows])

    def launch(self) -> None:
        m = self.method
        m.blocks(self.measure, len(self.energies), [m.data, m.state.x, m.state.e, None, m.pose], [self.energies])

    def total(self) -> float:
        """Sum over all clusters now [J]."""
        self.launch()
        return float(self.energies.numpy()[:, 2].sum())
