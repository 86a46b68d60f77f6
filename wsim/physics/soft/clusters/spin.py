"""Angular momentum that backward Euler takes from clusters, given back where a substep ends: kernels/soft/clusters/spin.py."""

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.soft.clusters import spin as kernels
from wsim.kernels.soft.clusters.shape_matching import CHUNK
from wsim.model.model import Model
from wsim.model.stage import Clock, Stage
from wsim.model.structs import fill_struct
from wsim.physics.soft.clusters.groups import group_starts
from wsim.physics.soft.clusters.tables import ClusterTable, chunk_starts, cluster_bodies

BLOCK = 128            # threads that sum a chunk on a GPU


class SpinReturn:
    """Keeps predicted velocities, and corrects those at the end of a substep. Clusters that share points are one body here;
    bodies with pinned points are left alone. lam: multipliers of the clusters' members [kg m]."""

    def __init__(self, model: Model, state, points, table: ClusterTable, lam: wp.array):
        self.model, self.state, self.points, self.lam, self.table = model, state, points, lam, table
        members = pieces_of_clusters(model, table)
        first = group_starts(np.array([len(m) for m in members]))
        chunk, ends = chunk_starts(first, CHUNK)
        self.count, self.bodies, self.chunks = int(first[-1]), len(members), len(chunk) - 1
        self.threads = BLOCK if model.device.is_cuda else 1
        real, module = model.real, model.shared_module("spin", self.threads, threads=self.threads)
        device, upload = model.device, model.upload
        self.sums = fill_struct(
            kernels.spin_sums(real), w=points.constants.w,
            point=upload(np.concatenate(members).astype(np.int32), int), chunk=upload(chunk.astype(np.int32), int),
            first=upload(ends.astype(np.int32), int),
            owner=upload(np.repeat(np.arange(len(members)), np.diff(first)).astype(np.int32), int),
            whole=wp.zeros(len(members), dtype=int, device=device), **self.entries(np.concatenate(members)),
            before=wp.zeros(self.count, dtype=types(real).vec3, device=device),
            sums=wp.zeros((2, self.chunks), dtype=wp.mat44d, device=device),
            centre=wp.zeros(len(members), dtype=wp.vec3d, device=device),
            omega=wp.zeros(len(members), dtype=wp.vec3d, device=device))
        self.members = members
        self.keep, self.free, self.sum, self.find, self.give = (make(real, module) for make in (
            kernels.predicted_velocity_kernel, kernels.free_velocity_kernel, kernels.chunk_spin_kernel,
            kernels.body_spin_kernel, kernels.spin_return_kernel))
        size = self.count * np.dtype(model.dtype).itemsize
        self.stages = [Stage("predicted spin", "collide", self.keep_velocities, 1, 9 * size, what=f"{self.bodies} bodies"),
                       Stage("spin", "finish", self.give_back, 4, 18 * size, what="angular momentum that Euler's steps take")]

    def entries(self, point: np.ndarray) -> dict:
        """Members of the clusters that each point is."""
        order = np.argsort(self.table.point, kind="stable")
        ends = np.searchsorted(self.table.point[order], np.stack([point, point + 1]))
        first = group_starts(ends[1] - ends[0])
        held = np.concatenate([order[a:b] for a, b in ends.T.tolist()])
        return {"entry": self.model.upload(first.astype(np.int32), int), "held": self.model.upload(held.astype(np.int32), int)}

    def leave_whole(self, whole: np.ndarray) -> None:
        """Bodies of these clusters (clusters,) bool are moved by colliders as a whole."""
        points = self.table.point[np.repeat(whole, self.table.sizes)]
        self.sums.whole.assign(np.array([np.isin(own[0], points) for own in self.members], np.int32))

    def blocks(self, kernel, count: int, inputs: list, outputs: list) -> None:
        """Launches a block of threads for each of so many; on a CPU a thread."""
        if self.model.device.is_cuda:
            self.model.launch_blocks(kernel, count, self.threads, inputs, outputs)
        else:
            self.model.launch(kernel, count, inputs, outputs)

    def over(self, kernel, inputs: list, outputs: list) -> None:
        """Launches a thread for each member."""
        if self.model.device.is_cuda:
            wp.launch(kernel, self.count, inputs, outputs, device=self.model.device, block_dim=self.threads)
        else:
            self.model.launch(kernel, self.count, inputs, outputs)

    def keep_velocities(self, clock: Clock) -> None:
        self.over(self.keep, [self.sums, self.state.d, self.points.anchor, clock.effective_step], [self.sums.before])

    def give_back(self, clock: Clock) -> None:
        s = self.state
        self.over(self.free, [self.sums, s.v, self.lam, float(clock.effective_step)], [self.sums.before])
        self.blocks(self.sum, self.chunks, [self.sums, s.x, s.v], [])
        self.blocks(self.find, self.bodies, [self.sums, clock.effective_step], [])
        self.over(self.give, [self.sums, s.x], [s.v])


def pieces_of_clusters(model: Model, table: ClusterTable) -> list[np.ndarray]:
    """Places of the points of each piece of a body that clusters hold together."""
    from wsim.geometry.topology import labels_of_islands
    found = []
    for body in cluster_bodies(model):
        mine = np.flatnonzero(table.body == body.number)
        groups = [table.point[table.first[c]:table.first[c + 1]] for c in mine]
        pairs = np.concatenate([np.stack([np.full(len(g), g[0]), g], axis=1) for g in groups])
        place, at = np.unique(pairs, return_inverse=True)
        label = labels_of_islands(len(place), at.reshape(pairs.shape))
        order = np.argsort(label, kind="stable")
        found += np.split(place[order], np.flatnonzero(np.diff(label[order])) + 1)
    return found
