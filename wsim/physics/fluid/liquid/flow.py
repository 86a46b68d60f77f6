"""Sources and sinks of a liquid on the device (kernels/particles/emission.py)."""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles import emission
from wsim.model.structs import fill_struct
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.shapes import FluidShapeRows
from wsim.physics.fluid.grid.threads import Threads
from wsim.physics.fluid.liquid.objects import Liquid, LiquidSource
from wsim.physics.fluid.liquid.order import ParticleOrder
from wsim.physics.fluid.liquid.rooms import LiquidRooms


class LiquidFlow:
    """numbers: rows that are used and the id of the next particle, of the state. coming.refused: word of a frame
    for each source, 1 where a closed region had no room for what it gives."""

    def __init__(self, threads: Threads, layout: Layout, grid: Any, liquid: Liquid, sources: list[LiquidSource],
                 order: ParticleOrder, numbers: wp.array, obstacles: Any):
        real, module, dim, model = threads.model.real, threads.module, layout.dim, threads.model
        self.threads, self.grid, self.sources, self.order, self.numbers = threads, grid, sources, order, numbers
        self.shapes = FluidShapeRows(model, sources, liquid.low, layout.axes, liquid.cell)
        kinds, n, walls = self.shapes.kinds, len(sources), obstacles.shapes.kinds if obstacles else ()
        self.gives, self.takes = (any((s.role == "sink") is sink for s in sources) for sink in (False, True))
        self.drain = emission.particle_drain_kernel(dim, kinds, real, module) if self.takes else None
        self.offer = emission.particle_offer_kernel(dim, kinds, walls, real, module) if self.gives else None
        self.emit = emission.particle_emission_kernel(dim, kinds, walls, order.affine, real, module) if self.gives else None
        self.used, self.come = emission.emission_count_kernels(module)
        velocity = np.zeros((n, 3), model.dtype)
        for k, s in enumerate(sources):
            if s.velocity is not None:
                velocity[k, :dim] = s.velocity[list(layout.axes)]
        self.fastest = float(np.linalg.norm(velocity, axis=1).max())
        what = np.array([emission.SINK * (s.role == "sink") for s in sources], np.int32)
        self.table = fill_struct(emission.emission_sources(real), shapes=self.shapes.table, what=model.upload(what, int),
                                 velocity=model.upload(velocity, types(real).vec3), strength=threads.zeros(n, types(real).vec2))
        if obstacles:
            self.table.walls = obstacles.shapes.table
        self.first, self.offers = threads.zeros(layout.cells + 1, int), threads.zeros(layout.cells, int)
        closed = self.gives and (obstacles is not None or layout.sealed)
        self.rooms = LiquidRooms(threads, layout, grid, obstacles) if closed else None
        self.coming = fill_struct(emission.Coming, offers=self.offers, first=self.first, numbers=numbers)

    def pose(self, time: float, dt: float) -> None:
        """A frame begins at `time` [s]."""
        self.shapes.pose(time, dt)
        self.table.strength.assign(np.array([[float(s.strength.at(t)) for t in (time, time + dt)] for s in self.sources],
                                            self.threads.model.dtype))

    def begin(self) -> None:
        """Once a frame, when the particles stand one behind the other."""
        self.threads.over(self.used, 1, [self.order.first, self.order.size], [self.numbers])

    def act(self, particles: Any, clock: wp.array, wanted: wp.array) -> None:
        """Takes and adds particles in a step; sorts the particles."""
        order, over = self.order, self.threads.over
        if self.drain:
            over(self.drain, order.room, [self.grid.dx, self.table, clock, particles], [particles.id])
        order.sort(particles)
        if self.offer:
            inputs = [self.grid, particles, order.cells, self.table, clock]
            over(self.offer, order.size, inputs, [self.offers])
            if self.rooms:
                self.rooms.limit(self.offers, order, self.first)
            else:
                order.scan(self.offers, self.first)
            over(self.emit, order.size, [*inputs, self.coming], [particles])
            over(self.come, 1, [self.first, order.size, order.room], [self.numbers, wanted])
            order.sort(particles)
