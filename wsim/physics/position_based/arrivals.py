"""Particles that come and go in a plan: what pours in, and what sinks take. See kernels/position_based/arrivals.py.

Rows of all that comes while the scene's frames run stand in the state from the start (`Particles.body_of_run`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.kernels.math.real import types
from wsim.kernels.position_based import arrivals as kernels
from wsim.model.stage import Clock, Method, Ports, Stage
from wsim.model.state import StateField, StatePart
from wsim.model.status import FrameStatus
from wsim.model.structs import fill_struct
from wsim.physics.position_based.neighbours import ParticleLaunches
from wsim.physics.position_based.objects import Particles
from wsim.scene.samples import DROPS, ParticleSample, Sample

if TYPE_CHECKING:
    from wsim.simulation.methods import Build

CROWD_WORD = "arrivals: crowded"
FIELDS = (StateField("there", "1", True, "0: it has not come yet, 1: it is there, 2 + k: sink k has taken it", "int"),)
NEVER = 2**30            # frame of what does not come
COLORS = {True: (0.05, 0.22, 0.46), False: (0.66, 0.46, 0.24)}       # linear, of a fluid and of grains whose shape has none


def build(b: Build) -> ParticleArrivals:
    """The method of a scene whose particles come and go, or fill shapes that stay as prims."""
    return ParticleArrivals(b)


class ParticleArrivals(Method):
    """`there`: of each point of the state. `crowded`: how many have appeared where others were."""

    def __init__(self, b: Build):
        super().__init__("arrivals")
        self.model, self.state, self.points, self.status, self.fps = b.model, b.state, b.ports.points, b.status, b.scene.fps
        self.bodies = [body for body in b.model.bodies if isinstance(body.source, Particles)]
        self.sinks, self.crowded = b.scene.things("MaterialSink"), 0
        self.pouring = [body for body in self.bodies if self._source(body).pour]
        self.planned_frames = b.scene.frames
        self.part = StatePart.allocate("arrivals", FIELDS, b.model.points, b.model.real, b.model.device)
        self.part.rows = {(body.path, body.world): body.index for body in self.bodies}
        there = np.ones(b.model.points, np.int32)
        for body in self.pouring:
            there[body.index] = 0
        self.there = self.part.arrays["there"]
        self.offers = Ports(arrivals=self)
        self.arrivals: Any = None
        self.sink_table = self._make_sinks()
        if not (self.sinks or self.pouring):
            self.there.fill_(1)
            return
        self.there.assign(there)
        b.state.add(self.part)
        self.sink_kinds: tuple[str, ...] = self.sink_table.kinds if self.sinks else ()
        self.launches = ParticleLaunches(b.model, "arrivals", bool(self.pouring), *self.sink_kinds)
        self.present = self._make_present(b)
        if self.pouring:
            self.arrivals = self._make_arrivals()
        real, module = b.model.real, self.launches.module
        self.kernels: dict[str, Any] = {
            "take": kernels.departure_kernel(self.sink_kinds, real, module)}
        if self.pouring:
            self.kernels |= {"bring": kernels.arrival_kernel(real, module), "crowd": kernels.crowding_kernel(real, module)}
        b.status.reserve(CROWD_WORD)
        b.ports.points.held_worlds = self.present.held
        count = sum(body.count for body in self.bodies)
        self.stages.append(Stage("arrivals", "pose", self.launch_arrivals, 1 + bool(self.pouring), 40 * count,
                                 what=f"{count} particles that may come or go"))

    @staticmethod
    def _source(body: Any) -> Any:
        return body.source

    def _make_sinks(self) -> Any:
        """The table of the sinks, with the origin of the first body as its corner; None where there are none."""
        from wsim.physics.contact.collider.table import ColliderTable
        return ColliderTable(self.model, self.sinks, self.bodies[0].origin) if self.sinks else None

    def _make_present(self, b: Build) -> Any:
        """The table of all particles, body behind body."""
        model, S, join = b.model, kernels.arrival_structs(b.model.real), np.concatenate
        held = self.points.constants.w.numpy() <= 0.0
        point = join([np.arange(body.first, body.last) for body in self.bodies])
        inverse = np.where(held[point], 0.0, 1.0 / join([body.masses for body in self.bodies]))
        shift = join([np.tile(body.origin - self.bodies[0].origin, (body.count, 1)) for body in self.bodies])
        world = np.repeat([body.world for body in self.bodies], [body.count for body in self.bodies])
        t = types(model.real)
        return fill_struct(S.PresentTable, point=model.upload(point.astype(np.int32), int),
                           inverse=model.upload(inverse.astype(model.dtype), model.real),
                           shift=model.upload(shift.astype(model.dtype), t.vec3),
                           world=model.upload(world.astype(np.int32), int), held=self.launches.zeros(model.worlds, int))

    def _make_arrivals(self) -> Any:
        """The table of what comes, body behind body."""
        model, S, join = self.model, kernels.arrival_structs(self.model.real), np.concatenate
        point, x, v, times = [], [], [], []
        for body in self.pouring:
            source = self._source(body)
            point.append(body.index)
            x.append(body.places[body.index - body.first])
            v.append(body.velocities[body.index - body.first])
            times.append(source.arrival_times)
        time = join(times)
        frame = np.where(np.isfinite(time), np.floor(np.minimum(time, NEVER / self.fps) * self.fps + 1e-9), NEVER)
        age = np.where(np.isfinite(time), time - frame / self.fps, 0.0)
        t = types(model.real)
        return fill_struct(S.ArrivalTable, point=model.upload(join(point).astype(np.int32), int),
                           x=model.upload(join(x).astype(model.dtype), t.vec3),
                           v=model.upload(join(v).astype(model.dtype), t.vec3),
                           frame=model.upload(frame.astype(np.int32), int),
                           age=model.upload(age.astype(model.dtype), model.real),
                           fresh=self.launches.zeros(len(time), int), now=self.launches.zeros(1, int),
                           dt=model.real(1.0 / self.fps))

    def connect_ports(self, others) -> None:
        """What appears is compared with its neighbours as soon as these are known."""
        if not self.pouring:
            return
        radius = self.model.upload(self.model.stack("reach").astype(self.model.dtype), self.model.real)
        point = self.arrivals.point.numpy()
        for search in others.ports.particle_searches:
            number = np.full(self.model.points, -1, np.int32)
            number[search.rows.point.numpy()] = np.arange(search.count)
            own = self.model.upload(number[point], int)

            def launch_crowding(clock: Clock, search: Any = search, own: Any = own) -> None:
                tables = [self.arrivals, own, search.rows, search.cells, search.lists]
                self._run("crowd", len(point), [*tables, radius, self.state.x], [self.status.word(CROWD_WORD)])
            owner = next(method for method in others if search in method.offers.particle_searches)
            owner.stages.append(Stage("crowded arrivals", "collide", launch_crowding, 1, 8 * len(point), what="what appears"))

    def before_frame(self, time: float, clock: Clock) -> None:
        if self.arrivals is not None:
            self.arrivals.now.fill_(round(time * self.fps))
        if self.sink_table:
            self.sink_table.pose(time, clock.dt)

    def prepare_restart(self, fields: dict[str, dict[str, np.ndarray]]) -> None:
        """Fields of an earlier run that was planned for fewer or more frames get as many rows as there are now: what is to come
        begins as at the start. Contacts, which know grains by their numbers in that run, begin without forces."""
        counts = {b.path: (len(fields[b.path]["there"]), b.count) for b in self.pouring if "there" in fields.get(b.path, {})}
        if all(then == now for then, now in counts.values()):
            return
        for path in {path for path, _ in self.state.parts.get("grains", StatePart("", 0, 0)).rows}:
            for name in {"id", "f"} & fields.get(path, {}).keys():
                array, rows = next((a, r) for own, a, r in self.state.of(path) if own == name)
                fields[path][name] = array.numpy()[rows]
        for path, (then, now) in counts.items():
            for name, array, rows in self.state.of(path):
                given = fields[path].get(name)
                if given is not None and len(given) == then and len(rows) == now:
                    fields[path][name] = np.concatenate([given, array.numpy()[rows[then:]]])[:now]

    def launch_arrivals(self, clock: Clock) -> None:
        """Particles come and go where a substep begins."""
        s, passed = self.state, clock.k * clock.h
        if self.arrivals is not None:
            self._run("bring", len(self.arrivals.point), [self.arrivals, passed, self.there], [s.x, s.e, s.v])
        sinks = self.sink_table.rows if self.sink_table else self._no_sinks()
        self._run("take", len(self.present.point), [self.present, sinks, passed, self.there, s.x],
                  [s.v, self.points.constants.w])

    def _no_sinks(self) -> Any:
        from wsim.kernels.contact.collider.colliders import collider_type
        return collider_type(self.model.real)()

    def _run(self, name: str, count: int, inputs: list, outputs: list) -> None:
        self.launches.launch(self.kernels[name], count, inputs, outputs)

    # around a frame

    def frame_warnings(self, status: FrameStatus) -> list[tuple[tuple, float, str]]:
        found: list[tuple[tuple, float, str]] = []
        if crowded := int(status.said(CROWD_WORD)[0]):
            self.crowded += crowded
            found.append(((CROWD_WORD,), crowded, f"{self.pouring[0].path}: {{worst}} particles of a frame appeared where "
                          "others were; give a lower rate, a higher speed, or move the source away from what is there"))
        if self.arrivals is not None and int(self.arrivals.now.numpy()[0]) >= self.planned_frames:
            late = next((b.path for b in self.pouring if self._source(b).pour.end * self.fps > self.planned_frames), None)
            if late:
                found.append((("arrivals: end",), self.planned_frames, f"{late}: nothing comes after frame {{worst}}, the last "
                              "of the scene, for which there is room; give the scene more frames"))
        return found

    def which_are_there(self, path: str, world: int = 0) -> np.ndarray:
        """Which particles of a body are there, (n,) bool, in the author's order."""
        return self.there.numpy()[self.model.body(path, world).index] == 1

    def absent_places(self) -> np.ndarray:
        """Places in the state's arrays of all that is not there, (k,)."""
        return np.flatnonzero(self.there.numpy() != 1)

    def samples(self, world: int = 0) -> list[Sample]:
        x, v = (array.numpy().astype(np.float64) for array in (self.state.x, self.state.v))
        x += self.state.e.numpy()
        found: list[Sample] = []
        for body in self.bodies:
            if body.world != world:
                continue
            thing, rows = self._source(body), body.index[self.which_are_there(body.path, world)]
            numbers = np.flatnonzero(self.which_are_there(body.path, world))
            colors: Any = thing.colors if thing.colors is not None or thing.shape is None else np.array(COLORS[thing.is_fluid])
            colors = colors[numbers] if np.ndim(colors) > 1 else colors
            found.append(ParticleSample(thing.path + DROPS * (thing.shape is not None), x[rows] + body.origin,
                                        2.0 * thing.radii()[numbers], numbers, v[rows], colors))
        return found

    def indicators(self, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
        """Counts and masses [kg] of the first world: what is there, what has come, what sinks have taken; how many have
        appeared where others were."""
        if not (self.pouring or self.sinks):
            return {}
        there = self.there.numpy()
        found = dict.fromkeys(("particles", "particle_mass", "poured_particles", "poured_mass", "taken_particles",
                               "taken_mass"), 0.0)
        for body in (body for body in self.bodies if body.world == 0):
            now, m = there[body.first:body.last], body.masses
            came = (now >= 1) & bool(self._source(body).pour)
            for number, mass, chosen in (("particles", "particle_mass", now == 1), ("poured_particles", "poured_mass", came),
                                         ("taken_particles", "taken_mass", now >= 2)):
                found[number] += float(np.count_nonzero(chosen))
                found[mass] += float(m[chosen].sum())
        return found | ({"crowded_particles": float(self.crowded)} if self.pouring else {})
