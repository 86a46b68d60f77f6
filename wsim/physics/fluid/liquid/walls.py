"""Sides of walls on the device: particles stop at every shape, and of thin walls no face and no particle knows the other side
(kernels/particles/walls.py, shares.py, sides.py)."""

from typing import Any

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles import shares, sides, walls
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.multigrid import AXES
from wsim.physics.fluid.grid.threads import Threads
from wsim.physics.fluid.liquid.order import ParticleOrder


class Walls:
    """clear: of each cell, to the nearest shape and thin wall [m]; share: its room for particles; cut: of the faces."""

    def __init__(self, threads: Threads, layout: Layout, grid: Any, obstacles: Any):
        real, module, dim, n = threads.model.real, threads.part("walls"), layout.dim, layout.cells
        self.threads, self.grid, self.obstacles, kinds = threads, grid, obstacles, obstacles.shapes.kinds
        self.thin = bool(obstacles.shapes.thin.any())
        self.clear = threads.zeros(n, types(real).vec2)
        self.clearance, self.keep_kernel = (make(dim, kinds, real, module)
                                            for make in (walls.wall_clearance_kernel, sides.side_keeping_kernel))
        if self.thin:
            self.share = threads.zeros(n)
            self.open = [getattr(obstacles.open, AXES[a]) for a in range(dim)]
            self.cut = [threads.zeros(open_.size, int) for open_ in self.open]
            self.shut, self.part, self.see = (make(dim, kinds, real, module)
                                              for make in (walls.wall_closure_kernel, shares.cell_share_kernel,
                                                           walls.particle_view_kernel))

    def update(self, clock: wp.array) -> None:
        """The obstacles are where they are at the end of the step."""
        over, table, n = self.threads.over, self.obstacles.shapes.table, self.clear.size
        over(self.clearance, n, [self.grid, table, clock], [self.clear])
        if self.thin:
            for a, open_ in enumerate(self.open):
                over(self.shut, open_.size, [self.grid, a, table, clock, self.clear], [open_, self.cut[a]])
            over(self.part, n, [self.grid, table, clock, self.clear, self.obstacles.open], [self.share])

    def look(self, particles: Any, order: ParticleOrder, clock: wp.array) -> None:
        """Which rows of the grid each particle sees."""
        particles.seen, particles.reach = order.seen, order.reach
        order.cells.clear, order.cells.share = self.clear, self.share
        inputs = [self.grid, self.obstacles.shapes.table, clock, self.clear, self.share, particles]
        self.threads.over(self.see, order.room, inputs, [order.seen, order.reach])

    def keep(self, particles: Any, order: ParticleOrder, clock: wp.array) -> None:
        """Particles that came from `order.aside` stay on their side."""
        inputs = [self.grid, self.obstacles.shapes.table, clock, self.clear, order.aside.x, particles]
        self.threads.over(self.keep_kernel, order.room, inputs, [particles.x])

    @property
    def launches(self) -> int:
        """Number of launches of a step."""
        return 2 + self.thin + (1 + self.thin * (1 + len(self.cut)) if self.obstacles.moving else 0)
