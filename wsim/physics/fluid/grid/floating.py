"""Rigid bodies in a domain (kernels/fluid/solver/floating.py, immersed_bodies.py): obstacles that the pressure moves.

A frame of a fluid comes before that of the bodies: they are carried along as the pressure and their weight have it, and what
the pressure gave them in all is a force on them in the frame that their own method then does, with contacts and joints.
"""

from typing import Any

import numpy as np
import warp as wp

from wsim.geometry.rotation import matrix_quat, quat_conjugate, quat_product, quat_rotate
from wsim.kernels.fluid import conjugate as sums
from wsim.kernels.fluid.solver import floating as kernels
from wsim.kernels.fluid.solver import immersed_bodies, leaning
from wsim.kernels.math.real import types
from wsim.model.structs import fill_struct
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.multigrid import AXES
from wsim.physics.fluid.grid.threads import Threads

PARTS = 16               # blocks of a body's sum on CUDA


class Floating:
    """rigid: the method of rigid bodies; obstacles: `wsim.physics.fluid.grid.obstacles.FluidObstacles`, with shells among its
    shapes; density [kg/m^3]."""

    def __init__(self, threads: Threads, layout: Layout, grid: Any, obstacles: Any, rigid: Any, world: int, density: float):
        self.threads, self.layout, self.grid, self.obstacles, self.rigid = threads, layout, grid, obstacles, rigid
        self.given, real = rigid.lend(), threads.model.real
        rows = [k for k, (_, of) in enumerate(rigid.bodies) if of == world]
        self.count = len(rows)
        self.scale = real(density * obstacles.shapes.cell ** 3)
        self._place_bodies(rows)
        n = self.count * (PARTS if threads.cuda else 1)
        self.force, self.torque = threads.zeros(n, wp.vec3d), threads.zeros(n, wp.vec3d)
        self.dv, self.spin = (threads.zeros(self.count, types(real).vec3) for _ in range(2))
        body = dict(zip(AXES, obstacles.body, strict=False))
        self.cover = fill_struct(kernels.body_covers(real), open=obstacles.open, mark=threads.zeros(layout.cells, int),
                                 axes=obstacles.shapes.table.axes, **body)
        self.q, self.rest, self.aside = (threads.zeros(layout.cells) for _ in range(3))
        self._make_kernels(layout.dim, real, threads.module)

    def _place_bodies(self, rows: list[int]) -> None:
        """Bodies, and their shapes in the frames of their principal axes."""
        rigid, shapes, t = self.rigid, self.obstacles.shapes, types(self.threads.model.real)
        dtype, upload, zeros = self.threads.model.dtype, self.threads.model.upload, self.threads.zeros
        n = len(rows)
        place, reach = np.zeros((len(shapes.things), 3)), np.zeros(n)
        turn = np.tile([0.0, 0.0, 0.0, 1.0], (len(shapes.things), 1))
        for k, thing in enumerate(shapes.things):
            b = getattr(thing, "body", -1)
            if b >= 0:
                mass = rigid.masses[rows[b]]
                M = np.linalg.inv(rigid.bodies[rows[b]][0].motion.at(0.0)) @ thing.motion.at(0.0)
                back = quat_conjugate(mass.axes)
                place[k] = quat_rotate(back, M[:3, 3] - mass.center)
                turn[k] = quat_product(back, matrix_quat(M[:3, :3]))
                reach[b] = max(reach[b], np.linalg.norm(place[k]) + shapes.ball(k))
        self.place, self.turn = upload(place.astype(dtype), t.vec3), upload(turn.astype(dtype), t.quat)
        names = ("center", "at", "p", "L", "v", "spin", "given_p", "given_L")
        self.table = fill_struct(
            immersed_bodies.immersed_structs(self.threads.model.real).Afloat, row=upload(np.array(rows, np.int32), int),
            base=upload((rigid.origin[rows] - shapes.corner).astype(dtype), t.vec3),
            reach=upload(reach.astype(dtype), t.scalar), turn=zeros(n, t.quat), seen=zeros(n, t.quat),
            **{name: zeros(n, t.vec3) for name in names})

    def _make_kernels(self, dim: int, real: Any, module: str) -> None:
        self.take_kernel, self.swim_kernel = (immersed_bodies.immersed_read_kernel(real, module),
                                              immersed_bodies.immersed_step_kernel(real, module))
        self.carry = immersed_bodies.immersed_shape_kernel(real, module)
        self.pushed, self.goes, self.give_kernel = (make(real, module)
                                                    for make in (immersed_bodies.fluid_impulse_kernel,
                                                                 immersed_bodies.immersed_move_kernel,
                                                                 immersed_bodies.fluid_force_kernel))
        self.rates_kernel, self.gather, self.spread = (make(dim, real, module)
                                                       for make in (kernels.body_rate_kernel, kernels.pressure_force_kernel,
                                                                    kernels.body_motion_kernel))
        self.respond, self.both = kernels.body_response_kernel(real, module), leaning.cell_addition_kernel(real, module)
        self.at_rest, self.found = leaning.surface_pressure_kernels(dim, real, module)
        self.mark_kernel: Any = None
        self.dot = sums.grid_dot_kernel(real, module)

    def mark_by(self, fractions: int) -> None:
        """fractions: of the equation of the pressure, see `wsim.kernels.fluid.pressure.poisson_stencil`."""
        self.mark_kernel = kernels.body_mark_kernel(self.layout.dim, fractions, self.threads.model.real, self.threads.module)

    # a frame

    def take(self, speed: wp.array) -> None:
        """A frame begins; speed: greatest one [m/s]."""
        self.threads.over(self.take_kernel, self.count, [self.given, self.rigid.moving(), self.table], [self.table, speed])

    def give(self, clock: wp.array) -> None:
        """A frame has ended."""
        to = self.rigid.table
        self.threads.over(self.give_kernel, self.count, [clock, self.table], [to.push, to.torque])

    # a step, or a part of one

    def drift_bodies(self, clock: wp.array, part: float = 1.0) -> None:
        """Weight over a part of the step, and where the grid sees the bodies."""
        shapes = self.obstacles.shapes
        self._kick_bodies(clock, part, 1)
        self.threads.over(self.carry, len(shapes.things), [self.place, self.turn, self.table, shapes.table], [shapes.table])

    def _kick_bodies(self, clock: wp.array, part: float, moves: int) -> None:
        real, table = self.threads.model.real, self.table
        self.threads.over(self.swim_kernel, self.count, [self.given, clock, real(part), moves, table], [table])

    def rates(self) -> None:
        """Velocities of bodies where they cover faces, into those of the obstacles."""
        for a in range(self.layout.dim):
            out = getattr(self.obstacles.solid, AXES[a])
            inputs = [self.grid, a, self.cover, self.obstacles.body[a], self.table]
            self.threads.over(self.rates_kernel, out.size, inputs, [out])

    def begin(self, level: Any, phi: wp.array | None, gravity: wp.array, clock: wp.array) -> None:
        """The equation of a step is known: which cells it is about, and the impulse that it lacks in a fluid at rest."""
        over, n = self.threads.over, self.layout.cells
        self.mark(level, phi)
        over(self.at_rest, n, [self.grid, self.cover, self._node_shape(), self.obstacles.phi, gravity, clock], [self.rest])
        self.sum(self.rest)
        self._pushed_velocity()
        self.rates()

    def mark(self, level: Any, phi: wp.array | None = None) -> None:
        """Finds the cells whose equation knows a body."""
        self.threads.over(self.mark_kernel, self.layout.cells, [self.grid, level, self.cover, phi], [self.cover.mark])

    def _node_shape(self) -> Any:
        return wp.vec3i(*self.layout.nodes())

    def sum(self, q: wp.array) -> None:
        """J^T q into `force` and `torque`."""
        self.threads.sum(self.gather, self.force.size, [self.grid, self.cover, self.table, q], [self.force, self.torque])

    def add(self, p: wp.array, w: wp.array) -> None:
        """w += s J M^-1 J^T p."""
        self.sum(p)
        self._spread(1.0, w)

    def _spread(self, sign: float, w: wp.array) -> None:
        """w += sign J V, V what the sums that were taken last do to the velocities."""
        over, real = self.threads.over, self.threads.model.real
        over(self.respond, self.count, [self.given, self.table, self.scale, self.force, self.torque], [self.dv, self.spin])
        over(self.spread, self.layout.cells, [self.grid, self.cover, real(sign), self.table, self.dv, self.spin], [w])

    def lean(self, p: wp.array, phi: wp.array | None, r: wp.array) -> None:
        """Gives what else the pressure p lacks; r becomes the right-hand side of what that changes."""
        self.threads.over(self.found, self.layout.cells, [self.grid, self.cover, self._node_shape(), self.obstacles.phi, phi, p,
                                                          self.rest], [self.q])
        self.sum(self.q)
        r.zero_()
        self._spread(-1.0, r)
        self._pushed_velocity()
        wp.copy(self.aside, p)

    def whole(self, p: wp.array) -> None:
        """p, of the second solve, becomes that of both."""
        self.threads.over(self.both, p.size, [self.aside], [p])

    def push(self, p: wp.array) -> None:
        """The bodies take the pressure p."""
        self.sum(p)
        self._pushed_velocity()
        self.rates()

    def _pushed_velocity(self) -> None:
        self.threads.over(self.pushed, self.count, [self.given, self.scale, self.force, self.torque, self.table], [self.table])

    def reflect(self, clock: wp.array) -> None:
        """Between two projections: what the first has given is given again, and half a step's weight, as to the fluid (Zehnder,
        Narain, Thomaszewski 2018)."""
        self._pushed_velocity()
        self._kick_bodies(clock, 0.5, 0)

    def go(self, clock: wp.array, part: float = 1.0) -> None:
        """A step ends."""
        self.threads.over(self.goes, self.count, [clock, self.threads.model.real(part), self.table], [self.table])

    @property
    def launches(self) -> int:
        """Number of launches of a step whose pressure takes one iteration."""
        return 2 + 2 * self.layout.dim + 1 + 2 * 4 + 10

