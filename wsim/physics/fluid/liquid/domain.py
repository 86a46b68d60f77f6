"""One liquid of one world on the device, and a step of it:

    particles by cell;  v -> u on faces;  u += h g;  u = P u;  u into the air;  u -> v, C;
    x += h u (third order) + d,  d: displacement by which what is packed spreads
"""

from math import ceil, prod
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.fluid import pressure, steps
from wsim.kernels.fluid.grid import grid_structs
from wsim.kernels.fluid.pressure import FREE
from wsim.kernels.math.real import types
from wsim.kernels.particles import extend, fill, motion, transfers
from wsim.kernels.particles.liquid_mask import wet_surface_kernel
from wsim.model.structs import fill_struct
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.multigrid import AXES
from wsim.physics.fluid.grid.obstacles import FluidObstacles
from wsim.physics.fluid.grid.shapes import FluidShapeRows
from wsim.physics.fluid.grid.threads import Threads
from wsim.physics.fluid.liquid.flow import LiquidFlow
from wsim.physics.fluid.liquid.objects import ACROSS, GIVEN, WAVE, Liquid
from wsim.physics.fluid.liquid.order import ParticleOrder
from wsim.physics.fluid.liquid.surface import LiquidSurface
from wsim.physics.fluid.liquid.volume import LiquidVolume
from wsim.physics.fluid.liquid.walls import Walls

SPREAD = 1e-2            # tolerance of the displacement: what it leaves the next step finds
HOLES = 3                # cells that a hole beside a body may be wide
MARGIN = 2               # layers of faces beyond those that a particle may cross
THREADS = 1 << 14        # that look for the fastest particle


class LiquidDomain:
    """particles: `Particles` of the state. afloat: makes what moves the bodies among the obstacles, of this and them.
    words: of the frame's status: solves, missed, steps, room, volume."""

    def __init__(self, threads: Threads, liquid: Liquid, world: int, obstacles: list, sources: list, particles: Any,
                 numbers: wp.array, afloat: Any = None):
        self.threads, self.liquid, self.world, self.layout = threads, liquid, world, Layout.of(liquid)
        self.particles, self.words = particles, {}
        layout, real, module, dim = self.layout, threads.model.real, threads.part("particles"), self.layout.dim
        self.clock, self.going, self.done = threads.zeros(4), threads.zeros(1, int), threads.zeros(1, int)
        self.speed, self.more, self.wave, self.gravity = (threads.zeros(n) for n in (1, 1, 1, 3))
        self.weighed: tuple = ()                 # what `weigh` has uploaded
        self.grid = self._make_grid()
        self.obstacles: Any = None
        if obstacles:
            shapes = FluidShapeRows(threads.model, obstacles, liquid.low, layout.axes, liquid.cell, "thin", liquid.high)
            self.obstacles = FluidObstacles(threads, layout, self.grid, shapes, self.clock)
        self.walls: Any = Walls(threads, layout, self.grid, self.obstacles) if self.obstacles else None
        self.thin = bool(self.walls and self.walls.thin)
        self.sizes = [prod(layout.faces(a)) for a in range(dim)]
        self.u, self.d = self.faces(), self.faces()
        self.before = self.faces() if liquid.transfer == "flip" else fill_struct(grid_structs(real).Faces)
        self.mass, self.known = ([threads.zeros(n, dtype) for n in self.sizes] for dtype in (real, int))
        self.phi, self.full = threads.zeros(layout.cells), threads.zeros(layout.cells)
        self.order = ParticleOrder(threads, layout, self.grid, liquid.transfer == "apic", particles.id.shape[0])
        self.flow = (LiquidFlow(threads, layout, self.grid, liquid, sources, self.order, numbers, self.obstacles) if sources
                     else None)
        self.volume = LiquidVolume(threads, layout, self.grid, self.obstacles, self.thin)
        self.floating: Any = afloat(self, self.obstacles) if afloat else None
        self.surface = LiquidSurface(threads, layout, self.grid, self.obstacles, self.phi, self.full, self.words)
        if self.floating:
            self.floating.mark_by(FREE)
        self._make_kernels(dim, real, module)

    def _make_kernels(self, dim: int, real: Any, module: str) -> None:
        some, affine = self.obstacles is not None, self.liquid.transfer == "apic"
        thin = self.thin
        self.to_faces = transfers.particle_to_grid_kernel(dim, affine, thin, real, module)
        self.to_particles = transfers.grid_to_particle_kernel(dim, self.liquid.transfer, thin, real, module)
        self.fill = fill.cell_fill_kernel(dim, some, thin, real, module)
        self.wet = wet_surface_kernel(dim, real, module) if self.floating else None
        self.pull = motion.liquid_gravity_kernel(real, module)
        self.sides = [pressure.closed_side_kernel(dim, a, real, module) for a in range(dim)]
        self.extend = extend.velocity_extension_kernel(dim, thin, real, module)
        self.move = motion.particle_motion_kernel(dim, some, thin, real, module)
        self.fastest = motion.fastest_particle_kernel(real, module)
        self.begin, self.next = steps.frame_clock_kernel(real, module), steps.next_step_kernel(real, module)

    def _make_grid(self) -> Any:
        layout, model = self.layout, self.threads.model
        outside = [0, 0, 0]
        for a, axis in enumerate(layout.axes):
            kinds = self.liquid.sides[2 * axis:2 * axis + 2]
            outside[a] = sum(bit for bit, kind in zip((1, 2), kinds, strict=True) if kind == "open")
        return fill_struct(grid_structs(model.real).Grid, n=wp.vec3i(*layout.n), periodic=wp.vec3i(*layout.periodic),
                           outside=wp.vec3i(*outside), air=self.threads.zeros(7, types(model.real).vec3),
                           dx=model.real(self.liquid.cell))

    def faces(self) -> Any:
        """Zeros on the faces."""
        arrays = {AXES[a]: self.threads.zeros(n) for a, n in enumerate(self.sizes)}
        return fill_struct(grid_structs(self.threads.model.real).Faces, **arrays)

    def weigh(self, gravity: np.ndarray, dt: float) -> None:
        """Uploads gravity [m/s^2], what it adds to a speed in a frame, and the speed that wants as many steps as waves do."""
        along, cell = np.zeros(3), self.liquid.cell
        along[:self.layout.dim] = np.asarray(gravity, np.float64)[list(self.layout.axes)]
        given = self.flow.fastest if self.flow else 0.0
        if self.weighed == (now := (*along, dt, given)):
            return
        self.weighed = now
        self.gravity.assign(along.astype(self.threads.model.dtype))
        self.more.assign(np.array([np.abs(along).max() * dt], self.threads.model.dtype))
        waves = np.sqrt(np.pi * np.abs(along).max() / cell)
        self.wave.assign(np.array([self.liquid.cfl * max(cell * waves / WAVE, given / GIVEN)], self.threads.model.dtype))

    def settle(self) -> None:
        """Prepares the first frame, once kernels are there: obstacles that stand."""
        if self.obstacles and not self.obstacles.moving:
            self.obstacles.update()
            self.walls.update(self.clock)
        if self.flow and self.flow.rooms:
            self.flow.rooms.find()

    @property
    def launches(self) -> int:
        """Number of launches of a step whose pressure takes one iteration."""
        dim, volume = self.layout.dim, self.liquid.volume
        return (self.order.launches + (5 + self.layers) * dim + self.surface.launches + 5
                + volume * (self.surface.launches + self.layers * dim) + (self.floating.launches if self.floating else 0)
                + (3 if self.surface.islands else 0))

    @property
    def layers(self) -> int:
        """Number of layers of faces beyond the liquid that velocities are extended to."""
        return ceil(self.liquid.cfl) + MARGIN

    # a frame

    def frame(self, dt: float, least: int, most: int) -> None:
        """Launches all steps of a frame [s]: least .. most of them."""
        threads, liquid = self.threads, self.liquid
        self.order.sort(self.particles)
        self.order.pack(self.particles)
        if self.flow:
            self.flow.begin()
        wp.copy(self.speed, self.wave)
        self.done.zero_()
        count = min(self.order.room, THREADS if threads.cuda else 1)
        threads.over(self.fastest, count, [self.particles, count, self.more], [self.speed])
        if self.floating:
            self.floating.take(self.speed)
        threads.over(self.begin, 1, [self.speed, threads.model.real(dt), threads.model.real(liquid.cfl * liquid.cell), least,
                                     most], [self.clock, self.going, self.words["steps"]])
        wp.capture_while(self.going, self._step)
        self.volume.measure(self.full, self.order, self.words["volume"])
        if self.floating:
            self.floating.give(self.clock)

    def _step(self) -> None:
        o, threads, floating = self.obstacles, self.threads, self.floating
        if floating:
            floating.drift_bodies(self.clock)
        if o and o.moving:
            o.update()
            self.walls.update(self.clock)
        if self.flow:
            self.flow.act(self.particles, self.clock, self.words["room"])
        else:
            self.order.sort(self.particles)
        if self.thin:
            self.walls.look(self.particles, self.order, self.clock)
        self._to_grid()
        self.surface.refresh()
        self.surface.project(self.u, self.known, self.liquid.tolerance, floating, (self.gravity, self.clock))
        if floating:
            floating.go(self.clock)
        self._extend_velocity_layers(self.u)
        inputs = [self.grid, self.u, self.before, threads.model.real(self.liquid.flip), self.particles]
        threads.over(self.to_particles, self.order.room, inputs, [self.particles])
        if self.liquid.volume:
            for a in range(self.layout.dim):
                getattr(self.d, AXES[a]).zero_()
            self.surface.spread(self.d, self.known, SPREAD, self.walls.share if self.thin else None)
            self._extend_velocity_layers(self.d)
        if self.walls:
            wp.copy(self.order.aside.x, self.particles.x)
        inputs = [self.grid, self.u, self.d, self.clock, self._node_shape(), o.phi if o else None, self.particles]
        threads.over(self.move, self.order.room, inputs, [self.particles])
        if self.walls:
            self.walls.keep(self.particles, self.order, self.clock)
        threads.over(self.next, 1, [self.done], [self.clock, self.going])

    def _node_shape(self) -> Any:
        return wp.vec3i(*self.layout.nodes())

    def _to_grid(self) -> None:
        """Velocities and gravity on faces, and how full cells are."""
        over, o = self.threads.over, self.obstacles
        for a in range(self.layout.dim):
            u = getattr(self.u, AXES[a])
            over(self.to_faces, u.size, [self.grid, a, self.particles, self.order.cells], [u, self.mass[a]])
            if self.liquid.transfer == "flip":
                wp.copy(getattr(self.before, AXES[a]), u)
            over(self.pull, u.size, [a, self.gravity, self.clock, self.mass[a]], [u])
            if not self.layout.periodic[a]:
                over(self.sides[a], 2 * self.layout.cells // self.layout.n[a],
                     [self.grid, self.surface.low, self.surface.high], [u])
        rest = self.threads.model.real(float(ACROSS ** self.layout.dim))
        over(self.fill, self.layout.cells, [self.grid, self.particles, self.order.cells, rest, self._node_shape(),
                                            o.phi if o else None], [self.full, self.phi])
        for _ in range(HOLES if self.wet else 0):
            wp.copy(self.floating.q, self.phi)
            over(self.wet, self.layout.cells, [self.grid, self._node_shape(), o.phi, o.open, self.floating.q], [self.phi])

    def _extend_velocity_layers(self, u: Any) -> None:
        for a in range(self.layout.dim):
            out = getattr(u, AXES[a])
            for layer in range(2, 2 + self.layers):
                cut = self.walls.cut[a] if self.thin else None
                self.threads.over(self.extend, out.size, [self.grid, a, layer, self.mass[a], cut], [out, self.known[a]])
