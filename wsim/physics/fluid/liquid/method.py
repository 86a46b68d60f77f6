"""Liquids on the device: for each liquid of each world a part "liquid k", whose rows are particles, and the steps of a frame
(`wsim.physics.fluid.liquid.domain`)."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.kernels.particles.sort import particle_structs
from wsim.model.stage import Clock, Method, Remedy, Stage
from wsim.model.state import StateField, StatePart
from wsim.model.status import FrameStatus
from wsim.model.structs import fill_struct
from wsim.physics.contact.collider.shells import body_shells, obstacle_sheets
from wsim.physics.contact.collider.table import kind_names
from wsim.physics.fluid.grid.shapes import is_thin_wall
from wsim.physics.fluid.grid.threads import Threads
from wsim.physics.fluid.liquid import memory
from wsim.physics.fluid.liquid.domain import LiquidDomain
from wsim.physics.fluid.liquid.measure import CHANGED, liquid_measures, liquid_sample, volume_change, volume_error
from wsim.physics.fluid.liquid.objects import Liquid, LiquidSource
from wsim.physics.fluid.liquid.seeds import particle_seeds, sources_of_role
from wsim.physics.fluid.start import cut_step_warnings
from wsim.scene.samples import Sample

if TYPE_CHECKING:
    from wsim.simulation.methods import Build

FIELDS = (StateField("x", "m", True, "from the low corner, along the axes of the grid"),
          StateField("v", "m/s", True, "velocity"))
AFFINE = StateField("C", "1/s", True, "rows: gradient of each component of v", "mat33")
ID = StateField("id", "1", True, "stays with a particle; below 0: there is none", "int")
NUMBERS = StateField("numbers", "1", True, "rows that are used, the next id", "int")
WORDS = {"solves": 2, "missed": 1, "steps": 2, "room": 1, "volume": 2}
REFUSED = "liquid: refused"
SPARE = 1 << 13          # rows more than particles at the start, where there are sources; a frame that lacks some is repeated


def build(b: Build) -> Method:
    return Liquids(b)


def acting_sources(liquid: Liquid, scene) -> list[LiquidSource]:
    return sources_of_role(liquid, scene, "source") + sources_of_role(liquid, scene, "sink")


class Liquids(Method):
    """`domains`: one for each liquid of each world."""

    def __init__(self, b: Build):
        super().__init__("liquid")
        self.model, self.scene, self.status, self.state, self.base = b.model, b.scene, b.status, b.state, b.clock.substeps
        self.more = 1
        self.rigid = b.ports.bodies if body_shells(b.scene) else None
        liquids = b.scene.things("Liquid")
        self.pairs = [(liquid, world) for world in range(b.model.worlds) for liquid in liquids]
        memory.refuse_large_liquids([liquid for liquid, _ in self.pairs], b)
        self.threads = Threads(b.model)
        self.gravity = np.tile(np.asarray(b.scene.gravity, np.float64), (b.model.worlds, 1))
        starts = {id(liquid): particle_seeds(liquid, b.scene) for liquid in liquids}
        self.parts, self.numbers = [], []
        for k, (liquid, world) in enumerate(self.pairs):
            part, numbers = self._parts(k, liquid, world, *starts[id(liquid)])
            b.state.add(part, numbers)
            self.parts.append(part)
            self.numbers.append(numbers)
        for name, count in WORDS.items():
            b.status.reserve(f"liquid: {name}", count * len(self.pairs))
        self.domains = [self._make_domain(k) for k in range(len(self.pairs))]
        b.status.reserve(REFUSED, sum(len(d.flow.sources) for d in self.domains if d.flow))
        self.settled = False
        count = sum(part.count for part in self.parts)
        cells = sum(liquid.cells for liquid, _ in self.pairs)
        # before that of the bodies, which liquids push; else behind that of cloth, whose way through the frame is then known
        self.behind = not self.rigid and bool(obstacle_sheets(b.model))
        phase = "pose" if self.rigid else "deform" if self.behind else "predict"
        self.stages.append(Stage("liquids", phase, self.advance, sum(d.launches for d in self.domains),
                                 sum(p.bytes for p in self.parts), "frame", f"{count} particles, {cells} cells, "
                                 f"{', '.join(sorted({liquid.transfer for liquid, _ in self.pairs}))}"))

    # what there is

    def _parts(self, k: int, liquid: Liquid, world: int, x: np.ndarray, v: np.ndarray) -> tuple[StatePart, StatePart]:
        """Particles at the start, and their numbers."""
        real, device = self.model.real, self.model.device
        room = max(1, len(x) + (SPARE if acting_sources(liquid, self.scene) else 0))
        fields = (*FIELDS, *[AFFINE] * (liquid.transfer == "apic"), ID)
        part = StatePart.allocate(f"liquid {k}", fields, len(x), real, device, room)
        numbers = StatePart.allocate(f"liquid {k} numbers", (NUMBERS,), 2, real, device)
        axes, dim = list(liquid.axes), len(liquid.axes)
        for name, values in (("x", x - liquid.low), ("v", v)):
            rows = np.zeros((room, 3), self.model.dtype)
            rows[:len(x), :dim] = values[:, axes]
            part.arrays[name].assign(rows)
        part.arrays["id"].assign(np.where(np.arange(room) < len(x), np.arange(room), -1).astype(np.int32))
        numbers.arrays["numbers"].assign(np.full(2, len(x), np.int32))
        for each in (part, numbers):
            each.rows = {(liquid.path, world): np.arange(each.capacity)}
        return part, numbers

    def _particle_struct(self, k: int) -> Any:
        return fill_struct(particle_structs(self.model.real).Particles, **self.parts[k].arrays)

    def _make_domain(self, k: int) -> LiquidDomain:
        liquid, world = self.pairs[k]
        obstacles = [*self.scene.colliders, *body_shells(self.scene), *obstacle_sheets(self.model, world)]
        domain = LiquidDomain(self.threads, liquid, world, obstacles, acting_sources(liquid, self.scene),
                              self._particle_struct(k),
                      self.numbers[k].arrays["numbers"], self._floating_bodies if self.rigid else None)
        if domain.obstacles:
            domain.obstacles.shapes.state = self.state
        return domain

    def _floating_bodies(self, domain: LiquidDomain, obstacles: Any) -> Any:
        """The bodies of a domain."""
        from wsim.physics.fluid.grid.floating import Floating
        return Floating(self.threads, domain.layout, domain.grid, obstacles, self.rigid, domain.world, domain.liquid.density)

    # frames

    def before_frame(self, time: float, clock: Clock) -> None:
        if not self.settled:
            for j, domain in enumerate(self.domains):
                for name, count in WORDS.items():
                    domain.words[name] = self.status.word(f"liquid: {name}")[count * j:count * (j + 1)]
                domain.settle()
            first = 0
            for flow in (d.flow for d in self.domains if d.flow):
                flow.coming.refused = self.status.word(REFUSED)[first:first + len(flow.sources)]
                first += len(flow.sources)
            self.settled = True
        for domain in self.domains:
            domain.weigh(self.gravity[domain.world], clock.dt)
            for group in filter(None, (domain.obstacles, domain.flow)):
                group.pose(time, clock.dt)
        each = [group for domain in self.domains for group in (domain.obstacles, domain.flow) if group]
        self.evaluates["poses"] = list(dict.fromkeys(path for group in each for path in group.shapes.moved))

    def advance(self, clock: Clock) -> None:
        self.more = more = max(1, clock.substeps // self.base)   # of a frame that is repeated with smaller steps
        for domain in self.domains:
            if self.behind:
                domain.obstacles.shapes.reach_points(clock.dt)
            steps = domain.liquid.steps
            domain.frame(clock.dt, more * max(1, steps), more * (steps or domain.liquid.most_steps))

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        wanted = status.said("liquid: room")
        return [Remedy("grow", partial(self._make_more_room, k, int(n))) for k, n in enumerate(wanted)
                if n > self.parts[k].capacity]

    def _make_more_room(self, k: int, wanted: int) -> str:
        self.grow(k, wanted + wanted // 4)
        return f"{self.pairs[k][0].path} took {wanted} particles, more than there was room for"

    def grow(self, k: int, room: int) -> None:
        """Room for so many particles; those that there are stay."""
        part, before = self.parts[k], self.parts[k].capacity
        part.enlarge_part(room, self.model.real, self.model.device)
        for array in (part.arrays["id"], part.saved["id"][1]):
            array[before:].fill_(-1)
        part.rows = {key: np.arange(room) for key in part.rows}
        self.domains[k].particles = self._particle_struct(k)
        self.domains[k].order.grow(room)

    def prepare_restart(self, fields) -> None:
        for k, (liquid, _) in enumerate(self.pairs):
            rows = len(fields.get(liquid.path, {}).get("id", ()))
            if rows > self.parts[k].capacity:
                self.grow(k, rows)

    def frame_warnings(self, status: FrameStatus) -> list[tuple[tuple, float, str]]:
        missed = status.said("liquid: missed")
        found = cut_step_warnings([(d.liquid, d.world) for d in self.domains], status.said("liquid: steps"), self.more)
        found += [
            (("liquid", domain.liquid.path, domain.world), float(n),
             f"{domain.liquid.path}: {{worst}} solves of a frame missed the tolerance of the pressure; give a larger one, or "
             "float64")
            for domain, n in zip(self.domains, missed, strict=True) if n]
        given = [(s, d) for d in self.domains if d.flow for s in d.flow.sources]
        for domain, (volume, held) in zip(self.domains, status.said("liquid: volume").reshape(-1, 2), strict=True):
            error = volume_error(float(volume) / 8.0, float(held) / 8.0)
            if abs(error) > CHANGED:
                found.append((("liquid: volume", error < 0.0, domain.liquid.path, domain.world), 100.0 * abs(error),
                              volume_change(domain.liquid, error)))
        return found + [((REFUSED, source.path, domain.liquid.path, domain.world), 1.0,
                         f"{source.path} stopped: the part of {domain.liquid.path} that it fills is closed and full; give that "
                         "an open side or a sink, or end the strength of the source")
                        for (source, domain), no in zip(given, status.said(REFUSED), strict=False) if no]

    # what is told and set

    def particles(self, k: int) -> dict[str, np.ndarray]:
        """Particles of liquid k now, by id: id (n,), x world (n, 3) [m], v world (n, 3) [m/s], float64."""
        liquid, arrays = self.pairs[k][0], self.parts[k].arrays
        ids = arrays["id"].numpy()
        order = np.argsort(ids, kind="stable")[np.count_nonzero(ids < 0):]
        x, v = (np.zeros((len(order), 3)) for _ in range(2))
        axes, dim = list(liquid.axes), len(liquid.axes)
        x[:] = 0.5 * (liquid.low + liquid.high)
        x[:, axes] = liquid.low[axes] + arrays["x"].numpy()[order][:, :dim].astype(np.float64)
        v[:, axes] = arrays["v"].numpy()[order][:, :dim]
        return {"id": ids[order], "x": x, "v": v}

    def samples(self, world: int = 0) -> list[Sample]:
        return [liquid_sample(liquid, self.particles(k)) for k, (liquid, of) in enumerate(self.pairs) if of == world]

    measures_worlds = True

    def indicators(self, x, v, world: int | None = None) -> dict[str, float]:
        """Indicators of a world (None: the first): kinetic energy and that in gravity [J], greatest speed [m/s], particles, and
        the volume [m^3] where the last step began; of the last frame: most iterations of one solve of the pressure, steps."""
        found: dict[str, float] = {}
        for k, domain in enumerate(self.domains):
            if domain.world == (world or 0):
                volume = float(domain.volume.sums.numpy()[0, 0]) if self.settled else None
                g = self.gravity[domain.world]
                for name, value in liquid_measures(domain.liquid, self.particles(k), g, volume).items():
                    found[name] = max(found.get(name, 0.0), value) if name == "liquid_speed" else found.get(name, 0.0) + value
        own = [domain.world == (world or 0) for domain in self.domains]
        solves, steps = (self.status.said(f"liquid: {name}").reshape(-1, 2)[own] for name in ("solves", "steps"))
        return found | {"liquid_iterations": float(solves[:, 1].max()), "liquid_steps": float(steps[:, 0].max())}

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        if path == "/" and name == "gravity":
            self.gravity[slice(None) if world is None else world] = value
            return True
        return False


def signature(b) -> list:
    """Part of the liquids that decides their kernels."""
    liquids = [(len(x.axes), x.transfer, x.volume, kind_names(acting_sources(x, b.scene)),
                sorted({s.role for s in acting_sources(x, b.scene)}),
                [side == "open" for side in x.sides], [side == "periodic" for side in x.sides])
               for x in b.scene.things("Liquid")]
    moved, own = any(c.motion.moves for c in b.scene.colliders), body_shells(b.scene)
    things = [*b.scene.colliders, *own, *obstacle_sheets(b.model)]
    parted = [any(is_thin_wall(thing, x.low, x.high, x.cell) for thing in things) for x in b.scene.things("Liquid")]
    return [sorted({str(x) for x in liquids}), kind_names(things), moved, parted, *["bodies"] * bool(own)]
