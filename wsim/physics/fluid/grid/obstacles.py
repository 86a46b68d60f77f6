"""Obstacles of a fluid: colliders of the scene as openings of faces (kernels/fluid/fractions.py), and their velocities where
they move."""

from math import prod
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.fluid import fractions as kernels
from wsim.kernels.fluid.grid import grid_structs
from wsim.model.structs import fill_struct
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.multigrid import AXES
from wsim.physics.fluid.grid.shapes import FluidShapeRows
from wsim.physics.fluid.grid.threads import Threads


class FluidObstacles:
    """open: part of each face that is free; solid: velocity of what covers it [m/s], None where nothing moves."""

    def __init__(self, threads: Threads, layout: Layout, grid: Any, shapes: FluidShapeRows, clock: wp.array):
        real, module, dim = threads.model.real, threads.module, layout.dim
        self.threads, self.layout, self.grid, self.shapes, self.clock = threads, layout, grid, shapes, clock
        Faces, sizes = grid_structs(real).Faces, [prod(layout.faces(a)) for a in range(dim)]
        self.moving = shapes.moving
        self.open = fill_struct(Faces, **{AXES[a]: threads.zeros(n) for a, n in enumerate(sizes)})
        self.solid = fill_struct(Faces, **{AXES[a]: threads.zeros(n) for a, n in enumerate(sizes)}) if self.moving else None
        self.phi = threads.zeros(prod(layout.nodes()))
        self.nodes = kernels.node_distance_kernel(dim, shapes.kinds, real, module)
        self.faces = [kernels.face_opening_kernel(dim, a, real, module) for a in range(dim)]
        axes = range(dim if self.moving else 0)
        self.covers = [kernels.cover_velocity_kernel(dim, a, shapes.kinds, shapes.bodies, real, module) for a in axes]
        self.body = [threads.zeros(n, int) for n in sizes] if shapes.bodies else [None] * dim       # of each face; -1: none's

    def pose(self, time: float, dt: float) -> None:
        """A frame begins at `time` [s]."""
        if self.moving:
            self.shapes.pose(time, dt)

    def update(self) -> None:
        """Moves the obstacles to where they are at the end of the step."""
        shape = wp.vec3i(*self.layout.nodes())
        self.threads.over(self.nodes, self.phi.size, [shape, self.shapes.table, self.clock], [self.phi])
        for a, kernel in enumerate(self.faces):
            out = getattr(self.open, AXES[a])
            self.threads.over(kernel, out.size, [self.grid, shape, self.phi], [out])
        for a, kernel in enumerate(self.covers):
            out = getattr(self.solid, AXES[a])
            self.threads.over(kernel, out.size, [self.grid, self.shapes.table, self.clock], [out, self.body[a]])

    def solids(self) -> list[np.ndarray]:
        """Velocities [m/s] of what covers the faces of each axis now, on the host."""
        return [getattr(self.solid, AXES[a]).numpy() for a in range(self.layout.dim)]

    def host_openings(self) -> list[np.ndarray]:
        """Open parts of the faces of each axis now, on the host."""
        return [getattr(self.open, AXES[a]).numpy() for a in range(self.layout.dim)]
