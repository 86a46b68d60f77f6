"""Fluids on the device: the parts "grid" (rows are cells), "grid x", "grid y" and "grid z" (rows are faces), of the fluids of
every world one behind the other, and the steps of a frame (`wsim.physics.fluid.grid.domain`)."""

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.fluid.grid import grid_structs
from wsim.model.stage import Clock, Method, Remedy, Stage
from wsim.model.state import StateField, StatePart
from wsim.model.status import FrameStatus
from wsim.model.structs import fill_struct
from wsim.physics.contact.collider.shells import body_shells, obstacle_sheets
from wsim.physics.contact.collider.table import kind_names
from wsim.physics.fluid import memory, volumes
from wsim.physics.fluid.grid.direct import MOST
from wsim.physics.fluid.grid.domain import LIVE, FluidDomain
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.multigrid import AXES
from wsim.physics.fluid.grid.threads import Threads
from wsim.physics.fluid.measure import fields_at_centers, fluid_measures
from wsim.physics.fluid.objects import Fluid, Source, meets_bodies
from wsim.physics.fluid.start import cut_step_warnings
from wsim.scene import Problem, SceneError
from wsim.scene.samples import Sample
from wsim.scene.values.coverage import gradient_refusal

if TYPE_CHECKING:
    from wsim.simulation.methods import Build

NAMES = ("u", "v", "w")
SCALARS = {"smoke": StateField("smoke", "1", True, "of the air in a cell", "scalar"),
           "heat": StateField("temperature", "K", True, "above the air around", "scalar")}
WORDS = {"solves": 2, "missed": 1, "steps": 2}
SOURCE = ("smoke", "temperature", "expansion", "velocity", "strength", "place")


def build(b: "Build") -> Method:
    return Fluids(b)


def carried_scalars(fluid: Fluid, sources: list[Source]) -> tuple[str, ...]:
    """Scalars that there is ever something of."""
    smoke = fluid.smoke is not None or any(s.smoke != 0.0 for s in sources)
    heat = fluid.temperature is not None or any(s.temperature != 0.0 for s in sources)
    return (*["smoke"] * smoke, *["heat"] * heat)


def near_sources(fluid: Fluid, scene) -> list[Source]:
    return [s for s in scene.things("Source") if s.fluid in ("", fluid.path)]


class Fluids(Method):
    """`domains`: one for each fluid of each world."""
    measures_worlds = True

    def __init__(self, b: "Build"):
        super().__init__("fluid")
        self.model, self.scene, self.status, self.state = b.model, b.scene, b.status, b.state
        self.base, self.more = b.clock.substeps, 1
        self.pairs = [(fluid, world) for world in range(b.model.worlds) for fluid in b.scene.things("Fluid")]
        memory.refuse_large_fluids([fluid for fluid, _ in self.pairs], b)
        self.layouts = [Layout.of(fluid) for fluid, _ in self.pairs]
        self.threads = Threads(b.model)
        self.wind = np.tile(np.asarray(b.scene.wind, np.float64), (b.model.worlds, 1))
        self.gravity = np.tile(np.asarray(b.scene.gravity, np.float64), (b.model.worlds, 1))
        self.numbers: list[dict[str, Any]] = [{name: float(getattr(fluid, name)) for name in LIVE} for fluid, _ in self.pairs]
        self.changed: list[list[dict]] = []
        self.carried = [carried_scalars(fluid, near_sources(fluid, b.scene)) for fluid, _ in self.pairs]
        self.rows: dict[tuple[int, str], slice] = {}
        self.parts = self._parts(b)
        for name, count in WORDS.items():
            b.status.reserve(f"fluid: {name}", count * len(self.pairs))
        if any(fluid.margin > 0.0 for fluid, _ in self.pairs):
            b.status.reserve("fluid: reach", 6 * len(self.pairs))
        self.windows: dict[int, Any] = {}
        self.rigid = None if b.model.gradients else b.ports.bodies
        self.domains = [self._make_domain(k) for k in range(len(self.pairs))]
        self.settled, self.recorded, self.offers.fluids = False, None, self
        if b.model.gradients:
            for fluid in b.scene.things("Fluid"):
                for name in ("layers", "margin", "conserve"):
                    if getattr(fluid, name):
                        raise gradient_refusal(name, fluid.path, name=name)
                if meets_bodies(fluid) and obstacle_sheets(b.model):
                    raise gradient_refusal("walls", fluid.path, name=obstacle_sheets(b.model)[0].path)
            from wsim.physics.fluid.recorded import RecordedFluids
            self.offers.recorded_fluids = self.recorded = RecordedFluids(self)
        phase = "pose" if any(d.floating for d in self.domains) else "predict"     # before that of the bodies
        cells = sum(layout.cells for layout in self.layouts)
        how = sorted({"direct" if d.pressure.direct else "by multigrid" for d in self.domains})
        held = ' and '.join(SCALARS[name].name for name in self.carried[0])
        where = f", {held} where there is some" if self.domains[0].tiles else ""
        from wsim.physics.fluid.window import state_windows
        part = state_windows([*self.windows.values()]) if self.windows else ""
        self.stages.append(Stage("fluids", phase, self.advance, sum(d.launches for d in self.domains),
                                 sum(p.bytes for p in self.parts.values()), "frame",
                                 f"{cells} cells{part}, {', '.join(sorted({f.advection for f, _ in self.pairs}))}, pressure "
                                 f"{' and '.join(how)}{where}"))

    # what there is

    def _parts(self, b) -> dict[str, StatePart]:
        """Part by name, with the rows of each fluid."""
        fields: dict[str, tuple[StateField, ...]] = {}
        counts: dict[str, int] = {}
        rows: dict[str, dict] = {}
        used = [name for name in SCALARS if any(name in names for names in self.carried)]
        for k, (pair, layout) in enumerate(zip(self.pairs, self.layouts, strict=True)):
            size = {f"grid {AXES[a]}": int(np.prod(layout.faces(a))) for a in range(layout.dim)}
            for a in range(layout.dim):
                fields[f"grid {AXES[a]}"] = (StateField(NAMES[a], "m/s", True, f"velocity across faces of axis {a}", "scalar"),)
            if self.carried[k]:
                fields["grid"], size["grid"] = tuple(SCALARS[name] for name in used), layout.cells
            for of, n in size.items():
                first = counts.get(of, 0)
                self.rows[k, of] = slice(first, first + n)
                rows.setdefault(of, {})[pair[0].path, pair[1]] = np.arange(first, first + n)
                counts[of] = first + n
        found = {n: StatePart.allocate(n, fields[n], counts[n], b.model.real, b.model.device) for n in sorted(fields)}
        for name, part in found.items():
            part.rows = rows[name]
            b.state.add(part)
        return found

    def field(self, k: int, name: str) -> wp.array:
        """Array of a component ("u", "v", "w") or scalar ("smoke", "heat") of fluid k."""
        part, name = (f"grid {AXES[NAMES.index(name)]}", name) if name in NAMES else ("grid", SCALARS[name].name)
        return self.parts[part].arrays[name][self.rows[k, part]]

    def _make_domain(self, k: int) -> FluidDomain:
        (fluid, world), layout = self.pairs[k], self.layouts[k]
        u = fill_struct(grid_structs(self.model.real).Faces, **{AXES[a]: self.field(k, NAMES[a]) for a in range(layout.dim)})
        scalars = {name: self.field(k, name) for name in self.carried[k]}
        sources = near_sources(fluid, self.scene)
        self.changed.append([{} for _ in sources])
        self._set_start_fields(k, u, scalars)
        if fluid.margin > 0.0:
            from wsim.physics.fluid.window import FluidWindow
            self.windows[k] = FluidWindow(self, k, sources)
            return self.windows[k].domain
        bodies = body_shells(self.scene) if self.rigid and meets_bodies(fluid) else []
        cloth = obstacle_sheets(self.model, world) if meets_bodies(fluid) else []
        domain = FluidDomain(self.threads, fluid, world, [*self.scene.colliders, *bodies, *cloth], sources, u, scalars)
        if domain.obstacles:
            domain.obstacles.shapes.state = self.state
        if bodies:
            domain.float(self.rigid)
        return domain

    def air(self, k: int) -> np.ndarray:
        """Velocity of the air around fluid k where its sides let it in, along the grid's axes [m/s]."""
        (fluid, world), layout = self.pairs[k], self.layouts[k]
        let_in = any(fluid.sides[2 * a + side] in ("open", "wind") for a in layout.axes for side in (0, 1))
        return self.wind[world][list(layout.axes)] * let_in

    def _set_start_fields(self, k: int, u: Any, scalars: dict[str, wp.array]) -> None:
        fluid, layout, dtype, air = self.pairs[k][0], self.layouts[k], self.model.dtype, self.air(k)
        for a, axis in enumerate(layout.axes):
            centers = (np.full(layout.n, air[a]) if fluid.velocity is None
                       else np.asarray(fluid.velocity, np.float64).reshape(*fluid.shape, 3)[..., axis])
            getattr(u, AXES[a]).assign(layout.faced(centers, a).ravel().astype(dtype))
        for name, given in (("smoke", fluid.smoke), ("heat", fluid.temperature)):
            if given is not None:
                scalars[name].assign(np.asarray(given, np.float64).ravel().astype(dtype))

    # frames

    def before_frame(self, time: float, clock: Clock) -> None:
        for k, window in self.windows.items():
            if window.follow(time, clock.dt):
                self.domains[k], self.moved = window.domain, True
                if self.settled:
                    self._settle(k)
        if not self.settled:
            for k in range(len(self.domains)):
                self._settle(k)
            self.settled = True
        each = [group for domain in self.domains for group in (domain.obstacles, domain.sources) if group]
        for group in each:
            group.pose(time, clock.dt)
        self.evaluates["poses"] = list(dict.fromkeys(path for group in each for path in group.shapes.moved))

    def _settle(self, k: int) -> None:
        domain = self.domains[k]
        for name, count in WORDS.items():
            domain.words[name] = self.status.word(f"fluid: {name}")[count * k:count * (k + 1)]
        domain.blow(self.wind[domain.world], self.gravity[domain.world], self.numbers[k])
        domain.settle()
        if domain.sources:
            domain.sources.upload(self.changed[k])

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        return [Remedy("grow", str) for window in self.windows.values() if window.lacks()]

    def advance(self, clock: Clock) -> None:
        self.more = more = max(1, clock.substeps // self.base)   # of a frame that is repeated with smaller steps
        for k, domain in enumerate(self.domains):
            steps = domain.fluid.steps
            least, most = more * max(1, steps), more * (steps or domain.fluid.most_steps)
            if self.recorded and self.model.tape:
                self.recorded.frame(k, clock, least, most)
            else:
                self.windows.get(k, domain).frame(clock.dt, least, most)

    def frame_warnings(self, status: FrameStatus) -> list[tuple[tuple, float, str]]:
        missed = status.said("fluid: missed")
        found = cut_step_warnings([(d.fluid, d.world) for d in self.domains], status.said("fluid: steps"), self.more)
        return found + [(("fluid", domain.fluid.path, domain.world), float(n),
                 f"{domain.fluid.path}: {{worst}} solves of a frame missed the tolerance of the pressure; give a larger one, "
                 "or float64") for domain, n in zip(self.domains, missed, strict=True) if n]

    def arrays(self, k: int) -> dict[str, np.ndarray]:
        """u, v, w on faces along the grid's axes and smoke, heat of fluid k now, float64, in the shapes of its layout."""
        layout = self.layouts[k]
        shapes = {NAMES[a]: layout.faces(a) for a in range(layout.dim)} | {name: layout.n for name in self.carried[k]}
        return {name: self.field(k, name).numpy().astype(np.float64).reshape(shape) for name, shape in shapes.items()}

    def samples(self, world: int = 0) -> list[Sample]:
        found: list[Sample] = []
        for k, (fluid, of) in enumerate(self.pairs):
            if of == world:
                found += volumes.volume_samples(fluid, fields_at_centers(fluid, self.layouts[k], self.arrays(k)))
        return found

    def indicators(self, x, v, world: int | None = None) -> dict[str, float]:
        """Indicators of a world (None: the first): kinetic energy [J], smoke [m^3], greatest speed [m/s], divergence [1/s]; of
        the last frame: most iterations of one solve of the pressure, steps."""
        found: dict[str, float] = {}
        for k, domain in enumerate(self.domains):
            if domain.world == (world or 0):
                obstacles = domain.obstacles if self.settled else None
                arrays = self.windows[k].arrays() if k in self.windows else self.arrays(k)
                own = {"fluid_iterations": float(self.status.said("fluid: solves")[2 * k + 1]),
                       "fluid_steps": float(self.status.said("fluid: steps")[2 * k])}
                for name, value in (fluid_measures(domain.fluid, domain.layout, arrays, obstacles) | own).items():
                    both = sum if name in ("fluid_energy", "fluid_smoke") else max
                    found[name] = both([found.get(name, 0.0), value])
        return found

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        rows = slice(None) if world is None else world
        if path == "/" and name in ("wind", "gravity"):
            getattr(self, name)[rows] = value
        hit = [k for k, (fluid, of) in enumerate(self.pairs) if world in (None, of)]
        mine = False
        for k, domain in ((k, self.domains[k]) for k in hit):
            own = path == domain.fluid.path and name in (*LIVE, *self.shapes(domain.fluid))
            if path == "/" and name in ("wind", "gravity") or own:
                shapes = self.shapes(domain.fluid).get(name, (np.shape(value),))
                if np.shape(value) not in shapes or not np.isfinite(value).all():
                    raise SceneError(Problem(path, f"{name} has shape {np.shape(value)}; allowed are finite numbers "
                                             f"{' or '.join(map(str, shapes))}"))
                if path != "/":
                    self.numbers[k][name] = float(value) if name in LIVE else np.array(value, np.float64)
                domain.blow(self.wind[domain.world], self.gravity[domain.world], self.numbers[k])
                mine = True
            mine |= self._source(domain, k, path, name, value)
        return mine

    @staticmethod
    def shapes(fluid: Fluid) -> dict[str, tuple[tuple[int, ...], ...]]:
        """Shapes of arrays that are set while it runs."""
        moved = {} if fluid.acceleration is None else {"acceleration": ((3,), (*fluid.shape, 3))}
        return {"side_velocities": ((6, 3),), **moved}

    def _source(self, domain: FluidDomain, k: int, path: str, name: str, value) -> bool:
        """Whether a value of a source of fluid k was set."""
        if domain.sources is None or name not in SOURCE:
            return False
        hit = [new for s, new in zip(domain.sources.sources, self.changed[k], strict=True) if s.path == path]
        for new in hit:
            new[name] = value
        domain.sources.upload(self.changed[k])
        return bool(hit)

    def source_value(self, path: str, name: str, world: int = 0) -> np.ndarray:
        """A value of a source as it is now, float64."""
        for domain, changed in zip(self.domains, self.changed, strict=True):
            for source, new in zip(domain.sources.sources if domain.sources and domain.world == world else (), changed,
                                   strict=False):
                if source.path == path:
                    given = source.strength.values if name == "strength" else getattr(source, name)
                    return np.array(np.broadcast_to(new.get(name, given), np.shape(given)), np.float64)
        return np.zeros(())


def signature(b) -> list:
    """Part of the fluids that decides their kernels."""
    fluids: list[Any] = [(len(f.axes), f.advection, f.scalar_advection, f.pressure, sum(f.shape) <= MOST, f.slip, f.layers,
                          f.margin > 0.0, f.conserve, f.viscosity > 0.0, f.vorticity > 0.0, f.acceleration is not None,
                          carried_scalars(f, near_sources(f, b.scene)), [s.expansion != 0.0 for s in near_sources(f, b.scene)],
                          [s.velocity is not None for s in near_sources(f, b.scene)], kind_names(near_sources(f, b.scene)))
                         for f in b.scene.things("Fluid")]
    moved = any(c.motion.moves for c in b.scene.colliders)
    some = any(meets_bodies(f) for f in b.scene.things("Fluid"))
    bodies, cloth = body_shells(b.scene) if some and not b.model.gradients else [], obstacle_sheets(b.model) if some else []
    return [sorted(set(map(str, fluids))), kind_names([*b.scene.colliders, *bodies, *cloth]), moved, *["bodies"] * bool(bodies)]
