"""One fluid of one world on the device: its fields, and a step of them.

    sources, forces: as of the step's begin;   v = A(u) u + h/2 a,   w = P v,   scalars carried by w,
    v' = A (2 w - v) + h/2 a,   u' = P v'                        (kernels/fluid/passes/reflection.py)

or, of the other schemes, v = A(u) u + h a,  u' = P v, scalars carried by u'. Viscosity acts before each projection.
"""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.fluid import forces, pressure, steps
from wsim.kernels.fluid.forces import NUMBERS
from wsim.kernels.fluid.grid import grid_structs
from wsim.kernels.fluid.passes import reflection
from wsim.kernels.math.real import types
from wsim.model.structs import fill_struct
from wsim.physics.fluid.grid.direct import MOST
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.multigrid import AXES
from wsim.physics.fluid.grid.obstacles import FluidObstacles
from wsim.physics.fluid.grid.pressure import PressureProjection, label_sealed_regions
from wsim.physics.fluid.grid.shapes import FluidShapeRows
from wsim.physics.fluid.grid.sources import SmokeSources
from wsim.physics.fluid.grid.threads import BLOCK, Threads
from wsim.physics.fluid.grid.tiles import Tiles
from wsim.physics.fluid.grid.transport import PAIRS, AdvectionScheme, Transport
from wsim.physics.fluid.grid.viscosity import Viscosity
from wsim.physics.fluid.objects import Fluid, Source

LIVE = {"lift": forces.LIFT, "weight": forces.WEIGHT, "vorticity": forces.VORTICITY, "smoke_decay": forces.SMOKE_DECAY,
        "cooling": forces.COOLING, "viscosity": forces.VISCOSITY}


class FluidDomain:
    """u: `Faces` of the state; scalars: smoke and heat of the state, of those that there are. words: of the frame's status,
    once there is one: solves (iterations of the pressure, most of one solve), missed (solves), steps."""

    def __init__(self, threads: Threads, fluid: Fluid, world: int, obstacles: list, sources: list[Source], u: Any,
                 scalars: dict[str, wp.array]):
        model = threads.model
        self.threads, self.fluid, self.world, self.layout = threads, fluid, world, Layout.of(fluid)
        self.scalars, self.u = scalars, u
        self.words: dict[str, wp.array] = {}
        self.floating: Any = None                              # bodies that it pushes, see `float`
        self.trace: Any = None                                 # of a recorded frame, `wsim.physics.fluid.adjoint.trace.Trace`
        layout, real, module = self.layout, model.real, threads.module
        self.sizes = [getattr(u, AXES[a]).size for a in range(layout.dim)]
        self.clock, self.going, self.done = threads.zeros(4), threads.zeros(1, int), threads.zeros(1, int)
        self.speed, self.live = threads.zeros(1), threads.zeros(NUMBERS)
        self.grid = self._make_grid()
        room = max(*self.sizes, layout.cells)
        direct = fluid.pressure == "direct" or fluid.pressure == "auto" and not obstacles and sum(layout.n) <= MOST
        self.work = {name: threads.zeros(room) for name in ("p", "r", "z", "d", "w", *["free"] * direct)}
        self.v, self.half = self.faces(), self.faces()
        corner = fluid.low
        self.obstacles: Any = None
        if obstacles:
            shapes = FluidShapeRows(model, obstacles, corner, layout.axes, fluid.cell, "thick")
            self.obstacles = FluidObstacles(threads, layout, self.grid, shapes, self.clock)
        self.fastest = steps.fastest_speed_kernel(layout.dim, real, module)
        self.tiles = self._tiles() if scalars and fluid.scalar_advection not in PAIRS else None
        self.sources = (SmokeSources(threads, layout, self.grid, sources, corner, fluid.cell, scalars, self.tiles)
                        if sources else None)
        expansion = self.sources.expansion if self.sources else None
        self.pressure = PressureProjection(threads, layout, self.grid, self.obstacles, expansion, self.work, self.words)
        self.pressure.tolerance = fluid.tolerance
        self.viscosity = (Viscosity(threads, self.pressure, (fluid.slip, fluid.layers), self.work, self.sizes, self.words)
                          if fluid.viscosity > 0.0 else None)
        self.reflects = fluid.advection == "reflection"
        scheme = "cubic" if self.reflects else fluid.advection
        self.swirling, self.lifts = fluid.vorticity > 0.0, "_".join(name for name in ("smoke", "heat") if name in scalars)
        self.lifting = fill_struct(forces.buoyancy_inputs(real), live=self.live, **scalars)
        self.field = (None if fluid.acceleration is None else threads.zeros(layout.cells, types(real).vec3))
        still = not self.swirling and self.field is None
        self.pushed = bool(self.lifts) and still and scheme not in PAIRS                       # on the way
        sharp = fluid.layers and fluid.viscosity > 0.0 and not fluid.slip and scheme == "cubic" and layout.dim == 2
        how = AdvectionScheme(scheme, not self.reflects, sharp=sharp, pushed=self.lifts * self.pushed, lifting=self.lifting)
        self.carry = [Transport(threads, layout, self.grid, a, how, self.work) for a in range(layout.dim)]
        self.carry_scalar: Any = (Transport(threads, layout, self.grid, -1, AdvectionScheme(fluid.scalar_advection), self.work)
                                  if scalars and not self.tiles else self.tiles)
        self._make_kernels(real, module)

    def _make_kernels(self, real: Any, module: str) -> None:
        dim, o = self.layout.dim, self.obstacles
        some = (o is not None, o is not None and o.moving)
        self.reflect = [reflection.reflection_kernel(dim, a, *some, real, module) for a in range(dim if self.reflects else 0)]
        self.sides = [pressure.closed_side_kernel(dim, a, real, module) for a in range(dim)]
        at_cells = self.swirling or self.field is not None
        pushes = (self.lifts or at_cells) and not self.pushed
        self.push = [forces.air_force_kernel(dim, a, self.lifts, at_cells, real, module) for a in range(dim if pushes else 0)]
        if self.swirling:
            vec3 = types(real).vec3
            self.curl, self.confine = (forces.vorticity_kernel(dim, real, module),
                                       forces.confinement_kernel(dim, self.field is not None, real, module))
            self.swirl, self.whirl = (self.threads.zeros(self.layout.cells, vec3) for _ in range(2))
        self.begin, self.next = steps.frame_clock_kernel(real, module), steps.next_step_kernel(real, module)
        from wsim.kernels.fluid import sources
        self.decay = {name: sources.scalar_decay_kernel(LIVE["smoke_decay" if name == "smoke" else "cooling"], real, module)
                      for name in (self.scalars if self.sources is None else ())}

    def _tiles(self) -> Tiles:
        make = Tiles
        if self.fluid.conserve:
            from wsim.physics.fluid.grid.conserve import Conserved
            make = Conserved
        return make(self.threads, self.layout, self.grid, self.fluid.scalar_advection, list(self.scalars.values()),
                    self.fastest, [self.work[name] for name in "pzdw"])

    def _make_grid(self) -> Any:
        layout, model = self.layout, self.threads.model
        outside = [0, 0, 0]
        for a, axis in enumerate(layout.axes):
            kinds = self.fluid.sides[2 * axis:2 * axis + 2]
            outside[a] = sum(bit for bit, kind in zip((1, 2), kinds, strict=True) if kind in ("open", "wind"))
        return fill_struct(grid_structs(model.real).Grid, n=wp.vec3i(*layout.n), periodic=wp.vec3i(*layout.periodic),
                           outside=wp.vec3i(*outside), air=self.threads.zeros(7, types(model.real).vec3),
                           dx=model.real(self.fluid.cell))

    def faces(self) -> Any:
        """Zeros on the faces."""
        arrays = {AXES[a]: self.threads.zeros(n) for a, n in enumerate(self.sizes)}
        return fill_struct(grid_structs(self.threads.model.real).Faces, **arrays)

    def along(self, vector) -> np.ndarray:
        """A vector of the world along the grid's axes, 0 where there is none."""
        found = np.zeros(3)
        found[:self.layout.dim] = np.asarray(vector, np.float64)[list(self.layout.axes)]
        return found

    def blow(self, wind: np.ndarray, gravity: np.ndarray, numbers: dict[str, Any]) -> None:
        """Uploads wind [m/s], gravity [m/s^2] and the live numbers of the fluid; side velocities where there are new ones."""
        rows, walls = np.zeros((7, 3)), numbers.get("side_velocities", self.fluid.side_velocities)
        rows[0] = self.along(wind)
        for a, axis in enumerate(self.layout.axes):
            for side in (0, 1):
                wall = walls[2 * axis + side]
                rows[1 + 2 * a + side] = self.along(wind if self.fluid.sides[2 * axis + side] == "wind" else wall)
        live = np.zeros(NUMBERS)
        live[:3] = self.along(gravity)
        for name, k in LIVE.items():
            live[k] = numbers[name]
        if self.field is not None:
            given = np.asarray(numbers.get("acceleration", self.fluid.acceleration), np.float64)
            given = np.broadcast_to(given, (*self.fluid.shape, 3)).reshape(-1, 3)
            along = np.zeros((self.layout.cells, 3))
            along[:, :self.layout.dim] = given[:, list(self.layout.axes)]
            self.field.assign(along.astype(self.threads.model.dtype))
        self.grid.air.assign(rows.astype(self.threads.model.dtype))
        self.live.assign(live.astype(self.threads.model.dtype))

    def float(self, rigid: Any) -> None:
        """Pushes the bodies of that method among its obstacles."""
        from wsim.physics.fluid.grid.floating import Floating
        self.floating = self.pressure.bodies = Floating(self.threads, self.layout, self.grid, self.obstacles, rigid, self.world,
                                                        self.fluid.density)
        self.floating.mark_by(1)

    def settle(self) -> None:
        """Prepares the first frame, once kernels are there: obstacles that stand, and the regions that they seal."""
        p, o = self.pressure, self.obstacles
        if o is None:
            p.set_sealed_regions(None, int(self.layout.sealed))
            return
        if o.moving:
            p.set_sealed_regions(self.threads.zeros(self.layout.cells, int) if self.layout.sealed else None,
                                 int(self.layout.sealed))
            return
        o.update()
        p.multigrid.refresh()
        region, count = label_sealed_regions(self.layout, o.host_openings())
        p.set_sealed_regions(wp.array(region, dtype=int, device=self.threads.model.device), count)

    @property
    def launches(self) -> int:
        """Number of launches of a step whose pressure takes one iteration."""
        p, dim = self.pressure, self.layout.dim
        solve = p.direct.launches + 5 if p.direct else p.multigrid.launches + 12
        scalars = self.tiles.launches if self.tiles else 2 * len(self.scalars)
        return (5 * dim + 2 * solve if self.reflects else 4 * dim + solve) + scalars + 4

    # a frame

    def frame(self, dt: float, least: int, most: int) -> None:
        """Launches all steps of a frame [s]: least .. most of them."""
        threads, real = self.threads, self.threads.model.real
        self.speed.zero_()
        self.done.zero_()
        if self.tiles:
            self.tiles.mark()
        blocks = threads.blocks(max(self.sizes))
        threads.sum(self.fastest, blocks, [self.u, blocks * (BLOCK if threads.cuda else 1)], [self.speed])
        if self.floating:
            self.floating.take(self.speed)
        threads.over(self.begin, 1, [self.speed, real(dt), real(self.fluid.cfl * self.fluid.cell), least, most],
                     [self.clock, self.going, self.words["steps"]])
        wp.capture_while(self.going, self._step)
        self._keep_field("u", self.u)
        if self.floating:
            self.floating.give(self.clock)

    def _keep_field(self, name: str, u: Any) -> None:
        if self.trace:
            self.trace.keep(name, u)

    def _step(self) -> None:
        self._keep_field("u", self.u)
        self._enter()
        if self.reflects:
            self._step_by_reflection()
        else:
            self._step_by_splitting()
        if self.floating:
            self.floating.go(self.clock)
        self.threads.over(self.next, 1, [self.done], [self.clock, self.going])

    def _enter(self) -> None:
        """Obstacles, sources, decay."""
        if self.floating:
            self.floating.drift_bodies(self.clock, 0.5 if self.reflects else 1.0)
        if self.obstacles and self.obstacles.moving:
            self.obstacles.update()
            self.pressure.multigrid.refresh()
            self.pressure.find_region()
        if self.floating:
            self.floating.mark(self.pressure.multigrid.grids[0].table)
        if self.sources:
            self.sources.emit(self.live, self.clock, self.u)
        for name, kernel in self.decay.items():
            q = self.scalars[name]
            self.threads.over(kernel, q.size, [self.live, self.clock], [q])

    def _step_by_reflection(self) -> None:
        self._carried_quantity(self.u, self.u, 0.5, self.v)
        self._diffuse_and_project(self.v, 0.5)
        self._keep_field("v", self.v)
        p, Faces = self.pressure, grid_structs(self.threads.model.real).Faces
        for a, kernel in enumerate(self.reflect):
            v, u, w = (getattr(f, AXES[a]) for f in (self.v, self.u, self.half))
            both = fill_struct(Faces, x=getattr(p.open, AXES[a]), y=getattr(p.solid, AXES[a]))
            self.threads.over(kernel, v.size, [self.grid, p.low, p.high, p.p, both], [v, u, w])
        self._keep_field("w", self.half)
        if self.floating:
            self.floating.reflect(self.clock)
        self._carry_scalars(self.half)
        self._carried_quantity(self.u, self.v, 0.5, self.half)
        self._diffuse_and_project(self.half, 0.5)
        self._keep_field("y", self.half)
        p.project(self.half, self.u)

    def _step_by_splitting(self) -> None:
        self._carried_quantity(self.u, self.u, 1.0, self.v)
        self._diffuse_and_project(self.v, 1.0)
        self._keep_field("v", self.v)
        self.pressure.project(self.v, self.u)
        self._carry_scalars(self.u)

    def _carried_quantity(self, u: Any, q: Any, part: float, out: Any) -> None:
        """q carried by u, with forces, over `part` of the step."""
        for a, transport in enumerate(self.carry):
            transport.carry(u, getattr(q, AXES[a]), self.clock, part, getattr(out, AXES[a]))
        if self.swirling:
            n = self.layout.cells
            self.threads.over(self.curl, n, [self.grid, out], [self.whirl])
            self.threads.over(self.confine, n, [self.grid, self.live, self.whirl, self.field], [self.swirl])
        for a, kernel in enumerate(self.push):
            q_out = getattr(out, AXES[a])
            self.threads.over(kernel, q_out.size, [self.grid, self.lifting, self.swirl if self.swirling else self.field,
                                                   self.clock, self.threads.model.real(part)], [q_out])

    def _diffuse_and_project(self, v: Any, part: float) -> None:
        """Viscosity and the pressure of v, whose closed sides are set."""
        for a, kernel in enumerate(self.sides):
            if not self.layout.periodic[a]:
                out = getattr(v, AXES[a])
                n = 2 * self.layout.cells // self.layout.n[a]
                self.threads.over(kernel, n, [self.grid, self.pressure.low, self.pressure.high], [out])
        if self.viscosity:
            self.viscosity.spread(v, self.live, self.clock, part)
        self.pressure.solve(v)

    def _carry_scalars(self, u: Any) -> None:
        if self.tiles:
            self.tiles.carry(u, self.clock)
            return
        for q in self.scalars.values():
            out = self.work["d"][:q.size]
            self.carry_scalar.carry(u, q, self.clock, 1.0, out)
            wp.copy(q, out)
