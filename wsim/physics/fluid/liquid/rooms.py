"""Closed regions of a liquid's domain, and how many particles each holds (kernels/particles/rooms.py)."""

from typing import Any

import warp as wp

from wsim.kernels.fluid.grid import grid_structs
from wsim.kernels.fluid.pressure import pressure_levels
from wsim.kernels.fluid.solver import islands
from wsim.kernels.math.real import types
from wsim.kernels.particles import rooms
from wsim.model.structs import fill_struct
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.multigrid import AXES
from wsim.physics.fluid.grid.threads import Threads
from wsim.physics.fluid.liquid.order import ParticleOrder


class LiquidRooms:
    """obstacles: `wsim.physics.fluid.grid.obstacles.FluidObstacles`, or None."""

    def __init__(self, threads: Threads, layout: Layout, grid: Any, obstacles: Any):
        real, module, n = threads.model.real, threads.module, layout.cells
        self.threads, self.layout, self.grid, self.obstacles = threads, layout, grid, obstacles
        vec3, zeros = types(real).vec3, threads.zeros
        self.find_kernels = islands.island_finder_kernels(layout.dim, False, real, module) if obstacles else None
        self.kernels = rooms.room_counter_kernels(layout.dim, obstacles is not None, real, module)
        arrays = {name: zeros(n, int) for name in ("parent", "label", "vented", "count")}
        self.forest = fill_struct(islands.Forest, sum=zeros(1, wp.int64), **arrays)
        self.table = fill_struct(rooms.ParticleRooms, capacity=zeros(n, wp.int64), held=zeros(n, int), wanted=zeros(n, int))
        self.none, self.given = zeros(n, int), zeros(n, int)
        open_ = obstacles.open if obstacles else fill_struct(grid_structs(real).Faces)
        self.level = fill_struct(pressure_levels(real), n=wp.vec3i(*layout.n), periodic=wp.vec3i(*layout.periodic),
                                 k=vec3(1.0, 1.0, 1.0), low=vec3(*layout.low), high=vec3(*layout.high),
                                 **{AXES[a]: getattr(open_, AXES[a]) for a in range(layout.dim if obstacles else 0)})

    @property
    def launches(self) -> int:
        return 7 + (5 if self.obstacles and self.obstacles.moving else 0)

    def find(self) -> None:
        """Finds the regions, and measures them; again where obstacles have moved."""
        k, n, o = self.find_kernels, self.layout.cells, self.obstacles
        for kernel in (k.plant, k.join, k.settle) if k else ():
            self.threads.over(kernel, n, [self.level, self.forest], [])
        self.table.capacity.zero_()
        inputs = [self.grid, wp.vec3i(*self.layout.nodes()), o.phi if o else None, self.forest]
        self.threads.over(self.kernels.measure, n, inputs, [self.table])

    def limit(self, offers: wp.array, order: ParticleOrder, first: wp.array) -> None:
        """first becomes the sums of those offers that find room."""
        k, n, over = self.kernels, self.layout.cells, self.threads.over
        if self.obstacles and self.obstacles.moving:
            self.find()
        over(k.clear, n, [self.forest], [self.table, offers])
        over(k.count, n, [order.first, offers, self.forest], [self.table])
        over(k.limit, n, [offers, self.none, self.forest, self.table], [order.count])      # rooms that are full give up theirs
        order.scan(order.count, first)
        over(k.limit, n, [order.count, first, self.forest, self.table], [self.given])
        order.scan(self.given, first)
