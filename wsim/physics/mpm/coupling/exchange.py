"""What material points push, and are pushed by: rows of one collider table, and the launches of a frame
(kernels/particles/mpm/coupling). Only scenes with such things have any of it.

Particles go through a frame first. Bodies go with them, step by step, and take what particles have given them in all as a force
in the frame that their own method does then. Where that ends elsewhere, particles are set aside."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.geometry.rotation import matrix_quat, quat_conjugate, quat_product, quat_rotate
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.coupling.bodies import body_kernels
from wsim.kernels.particles.mpm.coupling.settle import settle_kernel
from wsim.kernels.particles.mpm.coupling.tables import SUMS, push_tables
from wsim.kernels.particles.mpm.coupling.transfers import push_kernels
from wsim.kernels.particles.mpm.tables import CELLS
from wsim.model.state import StateField, StatePart
from wsim.model.structs import fill_struct
from wsim.physics.contact.collider.shells import body_shells, obstacle_sheets
from wsim.physics.contact.collider.table import ColliderTable
from wsim.scene.solids import shape_row

if TYPE_CHECKING:
    from wsim.simulation.methods import Build

HELD = (StateField("held", "1", True, "direction in which others hold a body against a push, times the root of the part"),
        StateField("turned", "1", True, "that of torques"))
SHARES = 64                # of a sum on CUDA: threads seldom wait for each other
ROUNDS = 3                 # of the bodies' velocity and of what presses on them


class Exchange:
    """`colliders`: the table, of the scene's colliders too. grid: `wsim.physics.mpm.grid.SparseGrid`, which launches."""

    def __init__(self, b: Build, corner: np.ndarray, cell: float, laws: tuple[str, ...], mass: float):
        """corner of the grid's node 0 [m], cell [m]; mass: of all particles of a world [kg]."""
        self.model, self.rigid, self.cell = b.model, b.ports.bodies, cell
        model, rigid, scene = b.model, b.ports.bodies, b.scene
        shells = body_shells(scene) if rigid else []
        count = len(scene.things("Body"))
        things: list[Any] = list(scene.colliders)
        self.world = [-1] * len(scene.colliders)
        for world in range(model.worlds):
            own = [*(replace(shell, body=world * count + shell.body) for shell in shells), *obstacle_sheets(model, world)]
            things += own
            self.world += [world] * len(own)
        self.colliders = ColliderTable(model, things, corner, screw=False)
        self.colliders.state = b.state
        self.tables = push_tables(model.real)
        self.bodies = sorted({thing.body for thing in things if getattr(thing, "body", -1) >= 0})
        if rigid:
            mass += sum(rigid.masses[thing.body].mass for thing in shells)
        self.own: Any = None                                   # of bodies, where there are any
        self._fill_walls(mass, cell, b.clock.dt)
        if self.bodies:
            self._fill_bodies(b, corner)
        kinds, real, module = self.colliders.kinds, model.real, self.module
        self.by_node = push_kernels(kinds, laws, not model.device.is_cuda, real, module)
        self.settle = settle_kernel(kinds, laws, real, module) if self.bodies or "solid" in kinds else None
        self.surfaces: Any = None
        if self.colliders.points:
            from wsim.physics.mpm.coupling.surfaces import SurfaceExchange
            self.surfaces = SurfaceExchange(b, self, laws)

    def _fill_walls(self, mass: float, cell: float, dt: float) -> None:
        model, things = self.model, self.colliders.things
        number = {body: k for k, body in enumerate(self.bodies)}
        first = [number.get(getattr(thing, "body", -1), -1) for thing in things]
        self.colliders.rows.owner.assign(np.array(first, np.int32))      # bodies by number here
        points = 0
        for k, thing in enumerate(things):
            if getattr(thing, "rows", None) is not None:
                first[k] = points
                points += len(thing.rows)
        t, n, zeros = types(model.real), len(self.bodies), self._zeros
        pushed = fill_struct(
            self.tables.Pushed, world=model.upload(np.array(self.world, np.int32), int),
            first=model.upload(np.array(first, np.int32), int), center=zeros(n, t.vec3),
            reach=model.upload(self._reaches(cell).astype(model.dtype), model.real), point=zeros(3 * points, "int64"),
            turning=zeros((len(things), 13), "int64"),
            sums=zeros((SHARES if model.device.is_cuda else 1, int(SUMS) * max(n, 1)), "int64"), mass=model.real(mass),
            dx=model.real(cell), dt=model.real(dt))
        self.walls = fill_struct(self.tables.Walls, table=self.colliders.rows, pushed=pushed)

    def _zeros(self, shape: Any, dtype: Any) -> Any:
        import warp as wp
        types64 = {"int64": wp.int64, "vec3d": wp.vec3d}
        return wp.zeros(shape, dtype=types64.get(dtype, dtype), device=self.model.device)

    def _frames(self) -> list[tuple[int, int, np.ndarray]]:
        """(row of the table, number of its body, its frame in the body's principal axes) of shells."""
        found = []
        for k, thing in enumerate(self.colliders.things):
            if getattr(thing, "body", -1) >= 0:
                body, mass = self.rigid.bodies[thing.body][0], self.rigid.masses[thing.body]
                M = np.linalg.inv(body.motion.at(0.0)) @ thing.motion.at(0.0)
                back = quat_conjugate(mass.axes)
                place = quat_rotate(back, M[:3, 3] - mass.center)
                found.append((k, self.bodies.index(thing.body), np.concatenate([place, quat_product(back,
                                                                                                    matrix_quat(M[:3, :3]))])))
        return found

    def _reaches(self, cell: float) -> np.ndarray:
        reach = np.full(max(len(self.bodies), 1), cell)
        for k, b, frame in self._frames():
            shape = self.colliders.things[k].shape
            ball = np.linalg.norm(shape.points, axis=1).max() if hasattr(shape, "points") else shape_row(shape).ball(shape)
            reach[b] = max(reach[b], np.linalg.norm(frame[:3]) + float(ball))
        return reach

    @property
    def module(self) -> str:
        """Of its kernels, which need no blocks of their own size."""
        return self.model.module

    def _fill_bodies(self, b: Build, corner: np.ndarray) -> None:
        model, rigid, rows = self.model, self.rigid, self.bodies
        t, dtype, n = types(model.real), model.dtype, len(self.bodies)
        shapes = np.tile([0.0, 0, 0, 0, 0, 0, 1], (len(self.colliders.things), 1))
        for k, _, frame in self._frames():
            shapes[k] = frame
        self.by_body, self.given = body_kernels(model.real, self.module), rigid.lend()
        part = StatePart.allocate("mpm bodies", HELD, n, model.real, model.device)
        for k, row in enumerate(rows):
            body, world = rigid.bodies[row]
            part.rows[body.written, world] = np.append(part.rows.get((body.written, world), np.zeros(0, int)), k)
        b.state.add(part)
        self.own = fill_struct(
            self.tables.PushedBodies, row=model.upload(np.array(rows, np.int32), int),
            base=model.upload((rigid.origin[rows] - corner).astype(dtype), t.vec3), turn=self._zeros(n, t.quat),
            place=model.upload(shapes[:, :3].astype(dtype), t.vec3), axes=model.upload(shapes[:, 3:].astype(dtype), t.quat),
            **{name: self._zeros(n, t.vec3) for name in ("start", "before_p", "before_L", "p", "L", "v", "spin")},
            **{name: self._zeros(n, "vec3d") for name in ("given_p", "given_L")}, **part.arrays)

    def set_grid(self, grid: Any) -> None:
        """grid: `wsim.physics.mpm.coupling.grid.PushingGrid`, whose steps push."""
        grid.exchange = self
        self.make_room(grid.count)

    def make_room(self, count: int) -> None:
        """Arrays for so many particles."""
        if self.surfaces:
            self.surfaces.make_room(count)

    # a frame

    def _over_bodies(self, kernel: Any, *more: Any) -> None:
        self.model.launch(kernel, len(self.bodies), [self.given, *more], [])

    def begin_frame(self) -> None:
        """Launches what finds the bodies where a frame begins."""
        if self.bodies:
            self._over_bodies(self.by_body.take_bodies, self.rigid.moving(), self.own, self.walls)

    def _place_shapes(self, clock: Any) -> None:
        self.model.launch(self.by_body.place_shapes, len(self.colliders.things), [self.own, self.walls, clock], [])

    def push_nodes(self, grid: Any) -> None:
        """Launches what moves the nodes of a step: bodies first find the velocity that they have with what presses on them."""
        k, clock, step = self.by_node, grid.clock, [self.own, self.walls, grid.clock]
        over = CELLS * grid.blocks
        if self.bodies:
            self._over_bodies(self.by_body.begin_bodies, *step)
            self._place_shapes(clock)
            for _ in range(ROUNDS):
                grid.launch(k.sense_nodes, over, [grid.grid, grid.materials, self.walls, clock, grid.nodes])
                self._over_bodies(self.by_body.solve_bodies, *step)
                self._place_shapes(clock)
        grid.launch(k.push_nodes, over, [grid.grid, grid.materials, self.walls, clock, grid.nodes, grid.nodes, grid.lost])
        if self.bodies:
            self._over_bodies(self.by_body.kick_bodies, *step)
            self._place_shapes(clock)

    def push_particles(self, grid: Any) -> None:
        """Launches what stops the particles of a step, which have moved."""
        grid.launch(self.by_node.push_particles, grid.count,
                    [grid.grid, grid.nodes, grid.lost, grid.materials, self.walls, grid.clock, grid.points])
        if self.bodies:
            self._over_bodies(self.by_body.end_bodies, self.own, self.walls, grid.clock)

    def end_frame(self, grid: Any) -> None:
        """Launches what hands on the impulses of a frame."""
        if self.bodies:
            to = self.rigid.table
            self._over_bodies(self.by_body.give_bodies, self.own, self.walls, to.push, to.torque)
        if self.surfaces:
            self.surfaces.load(grid)

    def settle_frame(self, grid: Any, dt: float) -> None:
        """Launches what sets particles aside where bodies and surfaces have gone another way."""
        if self.surfaces:
            self.surfaces.unload()
            self.colliders.reach_points(dt)
            self.surfaces.release(grid)
        if self.bodies:
            now, own = self.rigid.moving(), [self.own, self.walls]
            self.model.launch(self.by_body.hold_bodies, len(self.bodies), [self.rigid.table, now, *own], [])
            self._place_shapes(grid.clock)
        if self.settle:
            grid.launch(self.settle, grid.count, [grid.points, grid.materials, self.walls])
        if self.bodies:
            self.model.launch(self.by_body.correct_bodies, len(self.bodies), [*own, now, now], [])
