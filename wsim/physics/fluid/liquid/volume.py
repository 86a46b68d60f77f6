"""Volume of a liquid on the device, once a frame (kernels/particles/volume.py)."""

from typing import Any

import warp as wp

from wsim.kernels.fluid.grid import grid_structs
from wsim.kernels.particles import volume
from wsim.model.structs import fill_struct
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.threads import Threads
from wsim.physics.fluid.liquid.objects import ACROSS
from wsim.physics.fluid.liquid.order import ParticleOrder


class LiquidVolume:
    """sums: volumes [cells] of liquid, outside of obstacles, and of the particles, where the last step began, (1,) of 3."""

    def __init__(self, threads: Threads, layout: Layout, grid: Any, obstacles: Any, thin: bool):
        real, module = threads.model.real, threads.part("particles")
        self.threads, self.layout, self.grid, self.obstacles = threads, layout, grid, obstacles
        self.measure_kernel = volume.liquid_volume_kernel(layout.dim, obstacles is not None, thin, real, module)
        self.sum_kernel = volume.liquid_volume_sum_kernel(real, module)
        self.blocks = threads.blocks(layout.cells)
        self.part, self.sums = threads.zeros(self.blocks, wp.vec3d), threads.zeros(1, wp.vec3d)
        self.open = obstacles.open if obstacles else fill_struct(grid_structs(real).Faces)

    def measure(self, full: wp.array, order: ParticleOrder, words: wp.array) -> None:
        """Launches the sums over the cells; words: volumes of liquid and of particles, for the host."""
        o, real = self.obstacles, self.threads.model.real
        rest = real(float(ACROSS ** self.layout.dim))
        inputs = [self.grid, full, wp.vec3i(*self.layout.nodes()), o.phi if o else None, self.open, order.cells, rest]
        self.threads.sum(self.measure_kernel, self.blocks, inputs, [self.part])
        self.threads.sum(self.sum_kernel, 1, [self.part], [self.sums, words])
