"""The particles of a liquid by cell, on the device (kernels/particles/sort.py)."""

from typing import Any

from wsim.kernels.particles import sort
from wsim.model.structs import fill_struct
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.threads import Threads


class ParticleOrder:
    """`cells`: what kernels read. room: rows that there are."""

    def __init__(self, threads: Threads, layout: Layout, grid: Any, affine: bool, room: int):
        real, module, dim = threads.model.real, threads.part("particles"), layout.dim
        self.threads, self.grid, self.affine, self.size = threads, grid, affine, layout.cells
        self.count_kernel, self.place = (sort.particle_count_kernel(dim, real, module),
                                         sort.particle_order_kernel(dim, real, module))
        self.parts, self.starts, self.first_kernel = sort.prefix_sum_kernels(module)
        self.settle = sort.insertion_sort_kernel(module) if threads.cuda else None
        self.gather_kernel = sort.particle_gather_kernel(affine, real, module)
        self.tables = sort.particle_structs(real)
        self.blocks = threads.blocks(self.size)
        self.count, self.first = threads.zeros(self.size, int), threads.zeros(self.size + 1, int)
        self.part, self.start = threads.zeros(self.blocks, int), threads.zeros(self.blocks, int)
        self.grow(room)

    def grow(self, room: int) -> None:
        """Arrays for so many rows."""
        from wsim.kernels.math.real import types
        t, zeros = types(self.threads.model.real), self.threads.zeros
        self.room, self.rank, self.order = room, zeros(room, int), zeros(room, int)
        self.seen, self.reach = zeros(room, int), zeros(room)  # of particles beside thin walls (kernels/particles/walls.py)
        self.cells = fill_struct(self.tables.Cells, first=self.first, order=self.order)
        self.aside = fill_struct(self.tables.Particles, x=zeros(room, t.vec3), v=zeros(room, t.vec3), id=zeros(room, int),
                                 **({"C": zeros(room, t.mat33)} if self.affine else {}))

    def scan(self, count: Any, first: Any) -> None:
        """first[c]: sum of count before c, (cells + 1,)."""
        self.threads.sum(self.parts, self.blocks, [count, self.blocks, None], [self.part])
        self.threads.sum(self.starts, 1, [self.part, self.blocks, None], [self.start])
        self.threads.sum(self.first_kernel, self.blocks, [count, self.start, self.blocks, None], [first])

    def sort(self, particles: Any) -> None:
        threads, cells = self.threads, self.cells
        self.count.zero_()
        threads.over(self.count_kernel, self.room, [self.grid, particles], [self.count, self.rank])
        self.scan(self.count, self.first)
        threads.over(self.place, self.room, [self.grid, particles, self.first, self.rank], [cells.order])
        if self.settle:
            threads.over(self.settle, self.size, [self.first], [cells.order])

    def pack(self, particles: Any) -> None:
        """Puts the particles themselves into that order, one behind the other; then they are to be sorted anew."""
        import warp as wp
        self.threads.over(self.gather_kernel, self.room, [self.order, self.first, self.size, particles, self.aside], [])
        for name in ("x", "v", "id", *["C"] * self.affine):
            wp.copy(getattr(particles, name), getattr(self.aside, name))

    @property
    def launches(self) -> int:
        return 5 + bool(self.settle)
