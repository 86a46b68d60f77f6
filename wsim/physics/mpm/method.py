"""The material point method on the device: a part "mpm", whose rows are particles in the order of cells at the start, and the
steps of a frame (`wsim.physics.mpm.grid`). All bodies of all worlds share the grid; worlds do not see each other."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.kernels.particles.mpm.blocks import CROWD
from wsim.kernels.particles.mpm.steps import MOST, WORDS
from wsim.kernels.particles.mpm.tables import point_tables
from wsim.model.stage import Clock, Method, Methods, Remedy, Stage
from wsim.model.state import StateField, StatePart
from wsim.model.status import FrameStatus
from wsim.model.structs import fill_struct
from wsim.physics.mpm.coupling.choice import grid_class, law_names, make_actions, make_walls, pushed_things
from wsim.physics.mpm.coupling.choice import signature as signature
from wsim.physics.mpm.grid import MORE
from wsim.physics.mpm.measure import find_crowd, find_fastest, particle_sample
from wsim.physics.mpm.memory import refuse_large_bodies
from wsim.physics.mpm.seeding import PlacedPoints, count_blocks, locality_order, nearest_nodes, place_particles, place_poured
from wsim.physics.mpm.sources.flow import MaterialFlow, fit_restored_rows, reserve_further_rows
from wsim.scene.samples import Sample

if TYPE_CHECKING:
    from wsim.simulation.methods import Build

FIELDS = (
    StateField("o", "1", True, "offset from the nearest node in cells"),
    StateField("e", "1", True, "rounding remainder of o"),
    StateField("v", "m/s", True, "velocity"),
    StateField("b", "1", True, "xx, yy, zz of the left Cauchy-Green tensor less 1"),
    StateField("s", "1", True, "yz, zx, xy of it"),
    StateField("T", "Pa", True, "xx, yy, zz of the Kirchhoff stress"),
    StateField("S", "Pa", True, "yz, zx, xy of it"),
    StateField("C", "1/s", True, "rows: gradient of each component of v", "mat33"),
    StateField("q", "1", True, "inner variable of the law", "scalar"),
    StateField("a", "Pa", True, "stiffness of the fastest wave", "scalar"),
    StateField("i", "1", True, "nearest node along x", "int"),
    StateField("j", "1", True, "nearest node along y", "int"),
    StateField("k", "1", True, "nearest node along z", "int"),
)
WORD, SOLVE_WORD = "mpm: grid", "mpm: solve"
SOLVE_WORDS = 3            # iterations, steps whose residual was missed, worst residual [% of the tolerance]
THERE = StateField("there", "1", True, "0: it has not come yet, 1: it is there, 2 + k: sink k has taken it", "int")
POURED = 128               # particles of what pours that a block of cells is reserved for; a full one holds 512
SPARE = 2.0                # room for blocks over those at the start, and over those that a frame lacks at first
FALLING = 512              # blocks beside those, where something pours: a stream that falls fills few cells of a block
EACH = 8                   # blocks that the 27 nodes about a particle lie in, at most


def build(b: Build) -> Method:
    """The method of a scene."""
    return MaterialPointMethod(b)


class MaterialPointMethod(Method):
    """`part`: the particles. `grid`: what they meet on."""

    def __init__(self, b: Build):
        super().__init__("mpm")
        self.model, self.status, self.things = b.model, b.status, b.scene.things("MaterialPoints")
        self.cell, sinks = float(self.things[0].cell), b.scene.things("MaterialSink")
        self.flow = (MaterialFlow(b.model, self.things, sinks, b.scene.fps, b.scene.frames)
                     if sinks or any(thing.pour for thing in self.things) else None)
        refuse_large_bodies(self.things, b)
        placed = [self._place_thing(k) for k in range(len(self.things))]
        x = np.concatenate([each.x for each in placed])
        make_grid = grid_class(self.things, b.scene, b.model, bool(pushed_things(b.model)))
        self.corner = self.cell * (np.round(0.5 * (x.min(axis=0) + x.max(axis=0)) / self.cell) + make_grid.shift)
        self.node, offset = nearest_nodes(x, self.corner, self.cell)
        self.times = np.concatenate([each.times for each in placed])
        self.order = locality_order(self.node, self.times)
        self.volume = np.concatenate([each.volume for each in placed])
        counts = [len(each.x) for each in placed]
        self.thing_of = np.repeat(np.arange(len(placed)), counts)
        self.materials = [material for thing in self.things for material in thing.materials]
        self.now = [list(self.materials) for _ in range(b.model.worlds)]       # of each world, with what was set
        self.first = first = np.cumsum([0, *(len(thing.materials) for thing in self.things)])
        self.material_of = np.concatenate([first[k] + (np.zeros(n, int) if thing.which is None else thing.which)
                                           for k, (thing, n) in enumerate(zip(self.things, counts, strict=True))])
        self.laws, self.scene_colliders = law_names(self.things), b.scene.colliders
        v, C = (np.concatenate([getattr(each, name) for each in placed]) for name in "vC")
        self.part = self._allocate({"o": offset, "v": v, "C": C})
        b.state.add(self.part)
        self.exchange, colliders = make_walls(self, b)
        blocks = b.model.worlds * (count_blocks(self.node) + np.count_nonzero(np.isfinite(self.times)) // POURED)
        room = int(SPARE * blocks) + (FALLING if self.flow else make_grid.least_blocks)
        self.acts = acts = make_actions(self, b)
        self.grid = make_grid(b.model, self.part.count, self.cell, self.laws, colliders, room, self.flow, acts)
        self._fill_tables(b)
        if self.exchange:
            self.exchange.set_grid(self.grid)
        if self.flow:
            self.flow.make_kernels(self.laws, self.grid, self.corner)
            self._fill_births()
        self.grid.complete_kernels()
        b.status.reserve(WORD, WORDS)
        b.status.reserve(SOLVE_WORD, SOLVE_WORDS)
        self.more, self.spare, self.time, self.begins, self.fps = MORE, SPARE, 0.0, 0.0, b.scene.fps
        self.base, self.recorded = b.clock.substeps, None       # type: int, Any
        self._add_mpm_stages(b)

    def _add_mpm_stages(self, b: Build) -> None:
        phase = "pose" if self.exchange else "predict"         # before that of what is pushed
        self.stages.append(Stage("material points", phase, self.run_stage, 12, self.part.bytes + self.grid.bytes, "frame",
                                 f"{self.part.count} particles, {self.grid.blocks} blocks of cells, {', '.join(self.laws)}"))
        if b.model.gradients:
            from wsim.physics.mpm.adjoint.recorded import record_method
            self.offers.recorded_points = self.recorded = record_method(self, b.scene)

    def _place_thing(self, k: int) -> PlacedPoints:
        """Particles of a body, or those that it pours."""
        return place_poured(self.flow.plan(k)) if self.flow and k in self.flow.shapes else place_particles(self.things[k])

    def _fill_births(self) -> None:
        """The table of what comes, of all worlds."""
        assert self.flow is not None
        if self.flow.shapes:
            waits = [(self.part.rows[self.things[k].path, world], self.times[self.thing_of == k])
                     for k in self.flow.shapes for world in range(self.model.worlds)]
            self.flow.fill_births(*(np.concatenate(each) for each in zip(*waits, strict=True)))

    def _allocate(self, start: dict[str, np.ndarray]) -> StatePart:
        """The particles of all worlds, world behind world."""
        worlds, n, order = self.model.worlds, len(self.order), self.order
        part = StatePart.allocate("mpm", (*FIELDS, *[THERE] * bool(self.flow)), worlds * n, self.model.real, self.model.device)
        self.place = np.empty(n, np.int64)                     # row of each particle of a world
        self.place[order] = np.arange(n)
        mu_lam = np.array([material.numbers()[:2] for material in self.materials])
        stiff = (2.0 * mu_lam[:, 0] + mu_lam[:, 1])[self.material_of]
        for name, values in (start | {"a": stiff}).items():
            part.arrays[name].assign(np.concatenate([values[order]] * worlds).astype(self.model.dtype))
        for axis, name in enumerate("ijk"):
            part.arrays[name].assign(np.tile(self.node[order, axis], worlds).astype(np.int32))
        if self.flow:
            part.arrays["there"].assign(np.tile(np.isneginf(self.times[order]), worlds).astype(np.int32))
        for k, thing in enumerate(self.things):
            own = self.place[self.thing_of == k]
            part.rows |= {(thing.path, world): world * n + own for world in range(worlds)}
        return part

    def _fill_tables(self, b: Build) -> None:
        model, tables = self.model, point_tables(self.model.real)
        worlds, count = model.worlds, len(self.materials)
        self.gravity = np.tile(np.asarray(b.scene.gravity, np.float64), (worlds, 1))
        rows = (np.arange(worlds)[:, None] * count + self.material_of[self.order]).ravel()
        t, materials, vec3 = self.model.dtype, self.materials, self.part.arrays["v"].dtype
        self._fill_points(rows, np.tile(self.volume[self.order], worlds))
        numbers = np.array([m.numbers() for m in materials] * worlds, t)
        self.grid.materials = fill_struct(
            tables.MaterialRows, numbers=model.upload(numbers, tables.vec8),
            law=model.upload(np.array([self.laws.index(m.law) for m in materials] * worlds, np.int32), int),
            world=model.upload(np.repeat(np.arange(worlds), count).astype(np.int32), int),
            density=model.upload(np.array([m.density for m in materials] * worlds, t), model.real),
            gravity=model.upload(self.gravity.astype(t), vec3))

    def _fill_points(self, rows: np.ndarray, volume: np.ndarray) -> None:
        """The table of particles: material rows and volumes of all rows."""
        model, self.constants = self.model, (rows, volume)
        self.grid.points = fill_struct(self.grid.tables.PointRows, row=model.upload(rows.astype(np.int32), int),
                                       volume=model.upload(volume.astype(model.dtype), model.real), **self.part.arrays)

    def connect_ports(self, others: Methods) -> None:
        if self.exchange and self.exchange.surfaces:
            self.exchange.surfaces.connect_loads(others.ports.loads)

    # frames

    def choose_frame_form(self, clock: Clock) -> None:
        self.more, self.spare = MORE, SPARE

    def before_frame(self, time: float, clock: Clock) -> None:
        self.begins, self.time = time, time + clock.dt         # where the frame ends [s]
        if self.grid.colliders:
            self.grid.colliders.pose(time, clock.dt)
            self.evaluates["poses"] = list(self.grid.colliders.moved)
        if self.flow:
            frame = round(time * self.flow.fps)
            if self.flow.lacks_rows(frame):
                reserve_further_rows(self, frame)
                self.moved = True
            self.flow.pose(time, clock.dt)
        _ = self.acts and self.acts.aim(time)
        self.finer = clock.substeps / self.base                # steps of a frame that is asked for in smaller ones
        self.grid.more.fill_(self.finer * self.more)
        self.grid.send_helpers()

    def prepare_restart(self, fields: dict[str, dict[str, np.ndarray]]) -> None:
        if self.flow:
            fit_restored_rows(self, fields)

    def run_stage(self, clock: Clock) -> None:
        self.grid.solve_word = self.status.word(SOLVE_WORD)
        if self.recorded and self.model.tape:
            self.recorded.frame(clock)
        else:
            self.grid.run_frame(clock.dt, self.status.word(WORD))

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        blocks, crowd, gone, steps, excess = (int(n) for n in status.said(WORD))
        self.grid.look_back(steps)
        if blocks > self.grid.blocks:
            return [Remedy("grow", lambda: self._make_room(blocks))]
        if crowd > int(CROWD):
            return [self._give_up(find_crowd(self), f"shares its cell of {self.cell:g} m with {crowd - 1} others, at most "
                                  f"{int(CROWD) - 1} may; fix: give smaller cells, a stiffer material, or room")]
        if gone:
            return [self._give_up(gone - 1, "left the range of the grid; fix: give a floor, or larger cells")]
        if steps >= int(MOST):
            return [self._give_up(find_fastest(self), f"needs steps of {float(self.grid.clock.numpy()[0]):.2g} s, more "
                                  f"than {int(MOST)} a frame; fix: give a softer "
                                  "material, a lower speed, larger cells, or more frames a second")]
        if excess:
            self.more *= max(excess / 100.0, 2.0)              # what jumps once may jump again
            self.grid.more.fill_(self.more)
            return [Remedy("again")]
        return []

    def frame_warnings(self, status: FrameStatus) -> list[tuple[tuple, float, str]]:
        sweeps, missed, worst = (int(n) for n in status.said(SOLVE_WORD))
        if not missed:
            return []
        return [((SOLVE_WORD,), worst / 100.0,
                 f"{self.things[0].path}: implicit steps of material points leave {{worst}} times the residual that they may; "
                 "give more frames a second, or larger cells")]

    def _give_up(self, row: int, why: str) -> Remedy:
        arrays = self.part.arrays
        node = np.array([arrays[name].numpy()[row] for name in "ijk"], np.float64)
        x = self.corner + self.cell * (node + arrays["o"].numpy()[row])
        return Remedy("stop", part="mpm", row=row, why=f"at ({', '.join(f'{c:.4g}' for c in x)}) m {why}")

    def _make_room(self, blocks: int) -> str:
        self.grid.make_room(min(int(self.spare * blocks), EACH * self.part.count))
        self.spare *= 2.0                                      # few repeats for a frame that lacks more and more
        return f"particles spread over {blocks} blocks of cells, more than there was room for"

    # what is told and set

    def read_particles(self, k: int, world: int = 0) -> dict[str, np.ndarray]:
        """Particles of body k of a world in the author's order: x (n, 3) [m], v (n, 3) [m/s], m (n,) [kg], float64."""
        rows, arrays, there = self.part.rows[self.things[k].path, world], self.part.arrays, self.which_are_there(k, world)
        rows = rows if there is None else rows[there]
        node = np.stack([arrays[name].numpy()[rows] for name in "ijk"], axis=1).astype(np.float64)
        x = self.corner + self.cell * (node + arrays["o"].numpy()[rows].astype(np.float64))
        mass = self.masses(k)
        return {"x": x, "v": arrays["v"].numpy()[rows].astype(np.float64), "m": mass if there is None else mass[there]}

    def masses(self, k: int) -> np.ndarray:
        """Masses of all particles of body k [kg], those that are to come and that have gone too."""
        own = self.thing_of == k
        return np.array([material.density for material in self.materials])[self.material_of[own]] * self.volume[own]

    def which_are_there(self, k: int, world: int = 0) -> np.ndarray | None:
        """Which particles of body k are there, (n,) bool; None: all."""
        rows = self.part.rows[self.things[k].path, world]
        return self.part.arrays["there"].numpy()[rows] == 1 if self.flow else None

    def samples(self, world: int = 0) -> list[Sample]:
        found: list[Sample] = []
        for k, thing in enumerate(self.things):
            now = self.read_particles(k, world)
            found.append(particle_sample(thing, now, self.volume[self.thing_of == k], self.which_are_there(k, world)))
        return found

    def indicators(self, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
        """Indicators of the first world: energies [J], momentum [kg m/s], steps of the last frame, most particles of a cell,
        penetration of colliders [m]."""
        from wsim.physics.mpm.measure import measure_bodies
        return measure_bodies(self)

    def elastic_energy(self) -> np.ndarray:
        """Elastic energy of each row [J]."""
        out = self.grid.zeros(self.part.count)
        self.grid.launch(self.grid.measure_energy, self.part.count, [self.grid.points, self.grid.materials, out])
        found = out.numpy().astype(np.float64)
        return found if not self.flow else np.where(self.part.arrays["there"].numpy() == 1, found, 0.0)

    def set_value(self, path: str, name: str, value: Any, world: int | None = None) -> bool:
        if self.acts and self.acts.set_value(path, name, value, world):
            return True
        if path == "/" and name == "gravity":
            self.gravity[slice(None) if world is None else world] = value
            self.grid.materials.gravity.assign(self.gravity.astype(self.model.dtype))
            return True
        found = next((k for k, thing in enumerate(self.things) if thing.path == path), None)
        if found is None or self.things[found].further or not hasattr(self.things[found].material, name):
            return False
        for of in range(self.model.worlds) if world is None else [world]:
            row = self.first[found]
            self.now[of][row] = now = replace(self.now[of][row], **{name: float(value)})
            self.grid.set_material(of * len(self.materials) + row, now, self.part.rows[path, of])
        return True

    def material_now(self, k: int, world: int = 0) -> Any:
        """First material of body k in a world, with what was set."""
        return self.now[world][self.first[k]]
