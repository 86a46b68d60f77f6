"""Shape matching in a plan: clusters are projected in each XPBD iteration. Equations: kernels/soft/clusters/shape_matching.py.

Stages: multipliers are zeroed once a substep; each iteration projects colour by colour, behind the constraints of cloths and
nets and before contacts. Where a substep ends, clusters may flow, and backward Euler gives back the angular momentum that
it took (kernels/soft/clusters/spin.py). A colour takes one launch; three on a GPU where blocks share a large cluster.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.soft.clusters import shape_matching as kernels
from wsim.model.stage import Clock, Method, Ports, Stage, value_of_world
from wsim.model.state import StateField, StatePart
from wsim.model.structs import fill_struct
from wsim.physics.soft.clusters.tables import (
    ClusterTable,
    build_cluster_table,
    chunk_starts,
    cluster_bodies,
    cluster_sources,
    compliance_of_stiffness,
)

if TYPE_CHECKING:
    from wsim.simulation.methods import Build

LARGE = 8192           # members of a cluster from which blocks of a GPU share it
FEW = 64               # members up to which a warp takes a cluster
POSE = (StateField("q", "1", True, "rotation of each cluster (x, y, z, w)", "quat"),)
FLOW = (StateField("flow", "1", True, "plastic part of each cluster's deformation", "mat33"),)


def build(b: Build) -> ShapeMatching:
    return ShapeMatching(b)


class ShapeMatching(Method):
    """Projects clusters. shares: blocks share clusters, on a GPU where one is LARGE."""

    alike = True

    def __init__(self, b: Build, shares: bool | None = None):
        super().__init__("shape_matching", by_world=True)
        self.model, self.state, self.points = b.model, b.state, b.ports.points
        model, cuda = b.model, b.model.device.is_cuda
        self.table: ClusterTable = build_cluster_table(model)
        most = int(self.table.sizes.max(initial=0))
        self.shares = (cuda and most > LARGE) if shares is None else shares
        self.threads = (32 if most <= FEW else 128) if cuda else 1
        sources = cluster_sources(model).values()
        self.flows, self.damps = any(s.flows for s in sources), any(s.damping > 0.0 for s in sources)
        kind = self.flows, self.damps, self.shares, self.threads
        self.module = model.shared_module("shape_matching", *kind, threads=self.threads)
        self.add_state(b.state)
        self.data = self.upload_clusters()
        self.lam = wp.zeros(len(self.table.point), dtype=types(model.real).vec3, device=model.device)
        self.make_kernels()
        colours, members = len(self.table.starts) - 1, len(self.table.point)
        size = members * (8 + 9 * np.dtype(model.dtype).itemsize)
        self.stages = [Stage("zero clusters", "collide", self.zero, 1, self.lam.capacity, what="multipliers"),
                       Stage("clusters", "solve", self.project, (3 if self.shares else 1) * colours, 2 * size, "iteration",
                             f"{len(self.table.sizes)} of {members} points in {colours} colours")]
        self.spin: Any = None
        if b.clock.integrator.name == "backward_euler":
            from wsim.physics.soft.clusters.spin import SpinReturn
            self.spin = SpinReturn(model, b.state, b.ports.points, self.table, self.lam)
            self.stages += self.spin.stages
        if self.damps:
            self.add_damping()
        if self.flows:
            from wsim.kernels.soft.clusters.flow import cluster_flow_kernel
            self.flow_kernel = cluster_flow_kernel(model.real, self.module)
            self.stages.append(Stage("plastic clusters", "deform", self.flow, 1, size, what="clusters that may flow"))
        self.swept = b.choice.solver == "implicit" and any(body.meets_as_balls for body in b.scene.bodies())
        self.energy: Any = None
        self.rigid: Any = None               # `wsim.physics.soft.clusters.rigid_contacts.RigidClusterContacts`
        self.offers = Ports(shape_matching=None if self.swept else self, energy_terms=[self.make_energy_term])

    def connect_ports(self, others) -> None:
        """Beside particles Newton steps take turns with projections."""
        if self.swept:
            others.ports.newton_sweeps.append(self.project)
            self.stages = [stage for stage in self.stages if stage.name != "clusters"]
        elif (contact := others.ports.contact) is not None and not self.model.gradients and np.any(self.kappa == 0.0):
            from wsim.physics.soft.clusters.rigid_contacts import RigidClusterContacts, whole_clusters
            if (whole := whole_clusters(self)).any():
                self.rigid = RigidClusterContacts(self, contact, whole)
                if self.spin:
                    self.spin.leave_whole(whole)

    def add_damping(self) -> None:
        """Stage that damps velocities."""
        from wsim.kernels.soft.clusters.damping import cluster_damping_kernel
        model, of = self.model, cluster_sources(self.model)
        self.tau = np.array([of[k].damping for k in self.table.body], np.float64)
        self.taus = model.upload(self.tau, wp.float64)
        self.damping_kernel = cluster_damping_kernel(model.real, self.module)
        members = len(self.table.point)
        self.stages.append(Stage("cluster damping", "finish", self.damp, len(self.table.starts) - 1, members * 40,
                                 what=f"{int((self.tau > 0.0).sum())} clusters"))

    def damp(self, clock: Clock) -> None:
        """Velocities go towards those of rigid motions, colour by colour."""
        s, starts = self.state, self.table.starts.tolist()
        for begin, end in zip(starts[:-1], starts[1:], strict=True):
            self.blocks(self.damping_kernel, end - begin, [self.data, begin, clock.h, self.taus, s.x], [s.v])

    def add_state(self, state) -> None:
        """Rotations and plastic parts, which outlive a frame."""
        model, n = self.model, len(self.table.sizes)
        self.part = StatePart.allocate("clusters", POSE + FLOW * self.flows, n, model.real, model.device)
        self.part.rows = self.table.rows
        self.part.arrays["q"].assign(np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)).astype(model.dtype))
        if self.flows:
            self.part.arrays["flow"].assign(np.tile(np.eye(3), (n, 1, 1)).astype(model.dtype))
        state.add(self.part)

    def upload_clusters(self):
        """Struct of the table on the device."""
        table, model = self.table, self.model
        of = cluster_sources(model)
        self.kappa = np.array([compliance_of_stiffness(of[k].stiffness) for k in table.body])
        more: dict = {}
        if self.flows:
            creep = [of[k].creep if of[k].flows and solid else 0.0 for k, solid in zip(table.body, ~table.flat, strict=True)]
            limits = [(of[k].yield_strain, c, of[k].max_strain) for k, c in zip(table.body, creep, strict=True)]
            more = {"limits": model.upload(np.array(limits), wp.vec3d),
                    "spread": model.upload(np.linalg.pinv(table.spread, hermitian=True), wp.mat33d)}
        return fill_struct(kernels.shape_clusters(model.real), first=model.upload(table.first.astype(np.int32), int),
                           point=model.upload(table.point.astype(np.int32), int),
                           owner=model.upload(table.owner.astype(np.int32), int),
                           rest=model.upload(table.rest.astype(model.dtype), types(model.real).vec3),
                           w=self.points.constants.w, heavy=model.upload(table.heavy, wp.float64),
                           kappa=model.upload(self.kappa, wp.float64), **more)

    def make_kernels(self) -> None:
        """Kernels of a projection, and arrays that they share."""
        model, real, n = self.model, self.model.real, len(self.table.sizes)
        pose: dict = {name: self.part.arrays[name] for name in ("q", "flow") if name in self.part.arrays}
        if self.shares:
            self.chunk, self.first = chunk_starts(self.table.first, kernels.CHUNK)
            more = {"turn": wp.zeros(n, dtype=wp.mat33d, device=model.device),
                    "shift": wp.zeros(n, dtype=wp.vec3d, device=model.device)}
            self.moments = wp.zeros(len(self.chunk) - 1, dtype=wp.mat44d, device=model.device)
            self.chunks = [model.upload(a.astype(np.int32), int) for a in (self.chunk, self.first)]
            self.sum, self.fit, self.move = (make(real, self.module) for make in (
                kernels.chunk_moment_kernel, kernels.cluster_fit_kernel, kernels.member_projection_kernel))
            pose |= more
        else:
            self.kernel = kernels.cluster_projection_kernel(real, self.module)
        self.pose = fill_struct(kernels.cluster_poses(real), **pose)

    def blocks(self, kernel, count: int, inputs: list, outputs: list) -> None:
        """Launches a block of threads for each of so many; on a CPU a thread."""
        if self.model.device.is_cuda:
            self.model.launch_blocks(kernel, count, self.threads, inputs, outputs)
        else:
            self.model.launch(kernel, count, inputs, outputs)

    def zero(self, clock: Clock) -> None:
        self.model.zero(self.lam)

    def project(self, clock: Clock) -> None:
        """One projection of each cluster, and contacts of rigid ones."""
        self.project_shapes(clock)
        if self.rigid and not clock.free:
            self.rigid.project(clock)

    def project_shapes(self, clock: Clock) -> None:
        """One projection of each cluster, colour by colour."""
        s, rate, table = self.state, 1.0 / clock.effective_step, self.table
        for begin, end in zip(table.starts[:-1].tolist(), table.starts[1:].tolist(), strict=True):
            if not self.shares:
                self.blocks(self.kernel, end - begin, [self.data, begin, rate, s.x, self.lam], [s.d, self.pose])
                continue
            chunk, first = self.chunks
            a, b = int(self.first[begin]), int(self.first[end])
            self.blocks(self.sum, b - a, [self.data, chunk, a, s.x, s.d, self.lam], [self.moments])
            self.blocks(self.fit, end - begin, [begin, first, self.moments], [self.pose])
            j, last = int(table.first[begin]), int(table.first[end])
            self.spread(self.move, last - j, [self.data, j, rate, s.x, self.lam], [s.d, self.pose])

    def spread(self, kernel, count: int, inputs: list, outputs: list) -> None:
        """Launches so many threads, in blocks of the module's size."""
        if self.model.device.is_cuda:
            wp.launch(kernel, count, inputs, outputs, device=self.model.device, block_dim=self.threads)
        else:
            self.model.launch(kernel, count, inputs, outputs)

    def flow(self, clock: Clock) -> None:
        """Rest shapes flow, where a step has ended."""
        s = self.state
        if clock.ends:
            self.blocks(self.flow_kernel, len(self.table.sizes), [self.data, clock.h, s.x, s.e, None], [self.pose])

    def make_energy_term(self, threads: int):
        """Function (rows) that launches the energy of clusters for the balance, of so many threads a world."""
        from wsim.physics.soft.clusters.energy import ClusterEnergy
        self.energy = ClusterEnergy(self, threads)
        return self.energy.launch_term

    def indicators(self, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
        """shape_energy [J] of deformable clusters."""
        return {"shape_energy": self.energy.total()} if self.energy else {}

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        """stiffness [1/s^2] of a body's clusters; damping [s], where some are damped at the start."""
        found = [b for b in cluster_bodies(self.model) if b.path == path and world in (None, b.world)]
        if not (name == "stiffness" or name == "damping" and self.damps):
            return False
        for b in found:
            rows, own = self.table.rows[b.path, b.world], float(value_of_world(value, b.world))
            if name == "stiffness":
                self.kappa[rows] = compliance_of_stiffness(own)
            else:
                self.tau[rows] = own
        self.data.kappa.assign(self.kappa)
        if self.damps:
            self.taus.assign(self.tau)
        return bool(found)
