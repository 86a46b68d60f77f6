"""Fluids by constraints in a plan: walls and pressures that last in phase collide, densities in every iteration. See
kernels/position_based/density.py."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.position_based import density as kernels
from wsim.kernels.position_based import density_errors, flow, packets, tension
from wsim.model.stage import Clock, Method, Remedy, Stage
from wsim.model.state import StateField, StatePart
from wsim.model.status import FrameStatus
from wsim.model.structs import fill_struct
from wsim.physics.position_based.neighbours import NeighbourSearch, ParticleLaunches, SearchedPoints

if TYPE_CHECKING:
    from wsim.simulation.methods import Build

# Of the distance at rest: what a pair may come nearer before lists are made anew. A million particles that move, 4 x 4 on an
# H200: 15.3 ms a frame at 0.12, 16.5 at 0.2, 18.2 at 0.3; lists are made in each substep, and shorter ones pay
SKIN = 0.12
NEIGHBOURS = 56                  # entries of a list that there is room for at first; a lattice has 32 within its reach
NEAR_WORD, DENSE_WORD = "fluid: neighbours wanted", "fluid: density"
FIELDS = (StateField("p", "Pa", True, "pressure", "scalar"),)


def build(b: Build) -> DensityConstraints:
    """The method of a scene with a fluid by constraints."""
    return DensityConstraints(b)


class DensityConstraints(Method):
    """`search`: who is near whom. `part`: pressures."""

    def __init__(self, b: Build):
        super().__init__("density")
        self.model, self.state, self.points, self.status = b.model, b.state, b.ports.points, b.status
        self.bodies = [body for body in b.model.bodies if getattr(body.source, "is_fluid", False)]
        self.distance = d = 2.0 * float(self.bodies[0].reach[0])
        self.colliders = self._make_colliders(b)
        launches = self.launches = ParticleLaunches(b.model, "fluid", self.colliders.kinds)
        far = [np.full(body.count, 0.5 * kernels.REACHED * d) for body in self.bodies]
        points = SearchedPoints.of(self.bodies, far, [-1] * len(self.bodies))
        self.search = NeighbourSearch(launches, points, SKIN * d, NEIGHBOURS, b.ports.arrivals)
        self.offers.particle_searches, self.offers.energy_terms = [self.search], [self.make_energy_term]
        self.count = n = self.search.count
        real, zeros = b.model.real, launches.zeros
        t, S = types(real), kernels.fluid_structs(real)
        self.part = StatePart.allocate("fluid", FIELDS, n, real, b.model.device)
        first = 0
        for body in self.bodies:
            self.part.rows[body.path, body.world] = first + body.index - body.first
            first += body.count
        b.state.add(self.part)
        scratch = {"y": zeros(n, t.vec4), "at": zeros(n, t.vec4), "push": zeros(n, t.vec3)}
        scratch |= {name: zeros(n) for name in ("lam", "tight", "start", "lasting")}
        scratch |= {"wall": zeros(kernels.WALLS * n, t.vec4), "rate": zeros(kernels.WALLS * n, t.vec3)}
        self.table = fill_struct(S.FluidTable, d=d, w=self.points.constants.w, pressure=self.part.arrays["p"], **scratch)
        self.flow, self.flows = self._make_flow(b)
        self.tension = self._make_tension(b)
        self._make_kernels()
        for word in (NEAR_WORD, DENSE_WORD):
            b.status.reserve(word)
        size, drawn = n * np.dtype(b.model.dtype).itemsize, self.tension is not None
        last = 1 + (self.flows or drawn) + self.flows + 2 * drawn
        self.stages += [Stage("fluid", "collide", self.begin, self.search.launch_count + 5, 60 * size,
                              what=f"{n} particles"),
                        Stage("densities", "solve", self.solve, 3, 300 * size, "iteration", f"of {n} particles"),
                        Stage("pressures", "finish", self.keep, last, 3 * size, what="for the next substep")]

    def _make_kernels(self) -> None:
        """`kernels` by name; on a CPU a thread of those that are `packed` takes several particles."""
        real, module = self.model.real, self.launches.module
        makers = {"gather": kernels.fluid_gather_kernel, "motion": kernels.fluid_motion_kernel,
                  "start": kernels.fluid_wall_push_kernel, "keep": density_errors.fluid_keep_kernel,
                  "flow": flow.flow_gather_kernel, "energy": density_errors.fluid_energy_kernel}
        packed = {"errors": density_errors.fluid_error_kernel, "pressure": kernels.fluid_pressure_kernel,
                  "push": kernels.fluid_push_kernel, "viscosity": flow.flow_viscosity_kernel}
        if self.tension is not None:
            makers |= {"tension": tension.tension_kernel}
            packed |= {"normals": tension.tension_normal_kernel}
        self.lanes = 1 if self.launches.cuda else packets.LANES
        self.kernels: dict[str, Any] = {name: make(real, module) for name, make in makers.items()}
        self.kernels |= {name: make(self.lanes, real, module) for name, make in packed.items()}
        self.packed = {name: -(-self.count // self.lanes) for name in packed}
        self.kernels["walls"] = kernels.fluid_wall_kernel(self.colliders.kinds, real, module)

    def _make_colliders(self, b: Build) -> Any:
        from wsim.physics.contact.collider.table import ColliderTable
        return ColliderTable(b.model, b.scene.colliders, self.bodies[0].origin)

    def _make_flow(self, b: Build) -> tuple[Any, bool]:
        """Viscosity over density [m^2/s] and smoothing [1] of each particle; whether there is some."""
        h, radius = b.clock.h, 0.5 * self.distance
        materials: list[Any] = [body.source.material for body in self.bodies]          # type: ignore[attr-defined]
        each = [(min(m.viscosity, m.viscosity_limit(radius, h)) / m.density, m.smoothing) for m in materials]
        rows = np.repeat(np.array(each), [body.count for body in self.bodies], axis=0)
        return b.model.upload(rows.astype(b.model.dtype), types(b.model.real).vec2), bool(np.any(rows))

    def _make_tension(self, b: Build) -> Any:
        """Surface tension of each particle [N/m]; None: there is none."""
        h, radius = b.clock.h, 0.5 * self.distance
        materials: list[Any] = [body.source.material for body in self.bodies]          # type: ignore[attr-defined]
        each = [min(m.surface_tension, m.tension_limit(radius, h)) for m in materials]
        if not any(each):
            return None
        return b.model.upload(np.repeat(np.array(each), [body.count for body in self.bodies]), b.model.real)

    def connect_ports(self, others) -> None:
        self.search.lists.wanted = self.status.word(NEAR_WORD)
        if others.ports.newton_sweeps is not None:
            others.ports.newton_sweeps.append(self.solve)
            self.stages = [stage for stage in self.stages if stage.name != "densities"]

    def before_frame(self, time: float, clock: Clock) -> None:
        self.colliders.pose(time, clock.dt)

    # stages

    def begin(self, clock: Clock) -> None:
        """Neighbours, walls, and the pressures of the substep before."""
        s, search, table = self.state, self.search, self.table
        search.update(s.x, s.d, clock.k == 0)
        self._run("gather", [search.rows, search.cells, table, s.x, s.d, clock.h])
        self._run("walls", [table, self.colliders.rows, (clock.k + 1) * clock.h])
        self._run("errors", [search.rows, search.cells, search.lists, table])
        self._run("start", [table])
        self._run("push", [search.rows, search.cells, search.lists, table], [s.d])

    def solve(self, clock: Clock) -> None:
        """One iteration of all densities."""
        s, search, table = self.state, self.search, self.table
        self._run("motion", [search.rows, search.cells, table, int(clock.i == 0), s.d])
        corrected = kernels.CORRECTED if clock.i == clock.iterations - 1 else 0.0
        self._run("pressure", [search.rows, search.cells, search.lists, table, *kernels.iteration_weights(clock.i), corrected])
        self._run("push", [search.rows, search.cells, search.lists, table], [s.d])

    def keep(self, clock: Clock) -> None:
        """Pressures, for the next substep; viscosity and surface tension."""
        s, search, table = self.state, self.search, self.table
        self._run("keep", [search.cells, table, clock.h], [self.status.word(DENSE_WORD)])
        if self.flows or self.tension is not None:
            self._run("flow", [search.rows, search.cells, table, self.flow, s.x, clock.h], [s.v])
        if self.flows:
            self._run("viscosity", [search.rows, search.cells, search.lists, table, clock.h], [s.v])
        if self.tension is not None:
            self._run("normals", [search.lists, table])
            self._run("tension", [search.rows, search.cells, search.lists, table, self.tension, clock.h], [s.v])

    def make_energy_term(self, threads: int) -> Any:
        """Function (rows) that launches the energy that density errors hold, for the balance, of so many threads a world."""
        def sum_fluid_energy(rows: wp.array) -> None:
            inputs = [self.search.cells, self.table, self.model.worlds]
            self.launches.launch(self.kernels["energy"], self.model.worlds * threads, inputs, [rows])
        return sum_fluid_energy

    def _run(self, name: str, inputs: list, outputs: list | None = None) -> None:
        self.launches.launch(self.kernels[name], self.packed.get(name, self.count), inputs, outputs or [])

    # around a frame

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        near = int(status.said(NEAR_WORD)[0])

        def lengthen_lists() -> str:
            if near <= self.search.lists.room:
                return ""
            self.search.make_room(near + near // 4)
            return f"a particle of a fluid has {near} others near it, more than there was room for"
        return [Remedy("grow", lengthen_lists)] if near > self.search.lists.room else []

    def frame_warnings(self, status: FrameStatus) -> list[tuple[tuple, float, str]]:
        dense = int(status.said(DENSE_WORD)[0]) / 1e4
        said = (f"{self.bodies[0].path}: the fluid is pressed together, by {{worst}} % of its density where it is worst; give "
                "more substeps, or more iterations")
        return [((DENSE_WORD,), dense, said)] if dense else []

    def indicators(self, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
        """density_error: of the last iteration, mean and greatest of what exceeds the density at rest, over that [1]."""
        tight = np.maximum(self.table.tight.numpy(), 0.0)
        return {"density_error": float(tight.mean()), "most_density_error": float(tight.max(initial=0.0))}
