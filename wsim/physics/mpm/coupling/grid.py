"""The sparse grid where material points push what they meet: steps as `wsim.physics.mpm.grid` has them, but for nodes near
bodies and surfaces, and for particles, whose way ends there."""

from typing import Any

import warp as wp

from wsim.kernels.particles.mpm.transfers import cell_kernel, gather_kernel, particle_kernel, sorted_kernels
from wsim.physics.mpm.grid import SparseGrid


class PushingGrid(SparseGrid):
    """exchange: `wsim.physics.mpm.coupling.exchange.Exchange`, which is set behind."""

    exchange: Any = None
    lost: Any = None                                           # what meshes take of the velocity of nodes [m/s]

    def make_particle_room(self, count: int, blocks: int) -> None:
        super().make_particle_room(count, blocks)
        if self.exchange:
            self.exchange.make_room(count)

    def make_room(self, blocks: int) -> None:
        super().make_room(blocks)
        self.lost = wp.zeros_like(self.nodes) if "forming" in self.colliders.kinds else self.nodes

    def _make_kernels(self, laws: tuple[str, ...], kinds: tuple[str, ...]) -> None:
        real, module = self.real, self.module
        momentum = sorted_kernels(real, module)
        self.sort_momentum = momentum.sort_momentum if self.gathers else momentum.scatter_momentum
        self.sum_cells = cell_kernel(real, module)
        self.gather_nodes = gather_kernel(real, module) if self.gathers else None
        self.move_particles = particle_kernel((), laws, not self.gathers, real, module)      # the exchange holds them back

    def run_frame(self, dt: float, word: Any) -> None:
        self.exchange.begin_frame()
        super().run_frame(dt, word)
        self.exchange.end_frame(self)

    def take_step(self, dt: float, word: Any) -> None:
        self.sort_cells(word)
        g, points, materials, acts = self.grid, self.points, self.materials, self.acts
        if acts:
            acts.begin_step(self)
        self.give_momentum()
        self.exchange.push_nodes(self)
        if acts:
            acts.hold_velocity(self)
        self.launch(self.move_particles, self.count,
                    [g, self.nodes, materials, self.wall_rows, self.clock, points, word, self.pace])
        self.exchange.push_particles(self)
        if acts:
            acts.end_step(self)
        self.launch(self.by_step.next_step, 1,
                    [self.real(dt), self.blocks, self.more, self.pace, self.clock, self.going, word])
