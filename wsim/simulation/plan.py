"""The ordered list of stages that a scene needs, and why each other method is left out.

`build` imports the methods that the scene wants, lets each make its tables, and runs a frame:

    frame    every stage of rate "frame" in phase pose, then `substeps` times
             pose, predict, collide; `iterations` times solve; finish;      at last the stages "frame" of deform
"""

import hashlib
import json
from dataclasses import dataclass, field
from math import inf

import numpy as np
import warp as wp

from wsim.kernels.math.real import ADJOINT, types
from wsim.model import model as models
from wsim.model.model import Model, edge_lengths, hard_places
from wsim.model.separate import apart
from wsim.model.stage import EACH, PHASES, Clock, Method, Stage
from wsim.model.state import ANCHOR, CARRY, HALF, HISTORY, POINTS, STAGED, State
from wsim.physics.cloth.constraints import HARD, LOOKS, Rows, rows_of
from wsim.scene import Cloth, Problem, Scene, SceneError
from wsim.scene.check import counts
from wsim.simulation import cost
from wsim.simulation.choice import Choice, choose
from wsim.simulation.reasons import WITHOUT, why


@dataclass
class Plan:
    """Stages in order; `methods` own them; `skipped` says what is not there and why."""

    model: Model
    state: State
    clock: Clock
    methods: list[Method]
    status: wp.array
    choice: Choice
    skipped: list[dict] = field(default_factory=list)
    words: np.ndarray = field(init=False)
    seconds: float = 0.0                     # that a frame is expected to take, see `wsim.simulation.cost`
    followed: dict = field(default_factory=dict)       # what varies in time, as set last, by path and name
    host: wp.array | None = None             # pinned memory that a frame on a GPU copies its status to

    def __post_init__(self):
        if self.model.device.is_cuda:
            self.host = wp.zeros(len(self.status), dtype=int, device="cpu", pinned=True)
        self.words = (self.status if self.host is None else self.host).numpy()         # the same memory, not a copy

    def said(self) -> np.ndarray:
        """The status of the frame launched last, after waiting for it."""
        if self.host is not None:
            wp.synchronize_stream(self.model.device.stream)
        return self.words

    @property
    def starts(self) -> bool:
        """Whether the frame to come differs from those after it: it is not worth a graph of its own."""
        return self.clock.starting and (self.clock.multistep or self.state.has("b"))

    def stages(self, phase: str, rate: str) -> list[Stage]:
        return [s for m in self.methods for s in m.stages if s.phase == phase and s.rate == rate]

    def method(self, name: str) -> Method | None:
        return next((m for m in self.methods if m.name == name), None)

    @property
    def hard(self) -> bool:
        """Whether tethers or strain limits hold something."""
        return any(batch.kind in HARD for batch in getattr(self.method("xpbd"), "batches", []))

    @property
    def solids(self) -> list:
        """Tables of tets (`wsim.physics.soft.fem`), of whichever method has them."""
        return [table for m in self.methods for table in getattr(m, "solids", [])]

    def before_frame(self, time: float) -> None:
        for method in self.methods:
            method.before_frame(time, self.clock)

    def frame(self) -> None:
        """Launches one frame: all that a graph holds."""
        self.status.zero_()
        self.state.snapshot()
        self.stretch(0, self.clock.substeps)
        if self.host is not None:
            wp.copy(self.host, self.status)

    def stretch(self, first: int, last: int) -> None:
        """Substeps first .. last of a frame, with what stands before the first of a frame and behind its last."""
        clock = self.clock
        for phase in PHASES[:-1] if first == 0 else ():
            for stage in self.stages(phase, "frame"):
                stage.launch(clock)
        for k in range(first, last):
            clock.k = k
            self.substep()
        if last == clock.substeps:
            for stage in self.stages("deform", "frame"):
                stage.launch(clock)

    def substep(self) -> None:
        clock = self.clock
        for phase in ("pose", "predict", "collide"):
            for stage in self.stages(phase, "substep"):
                stage.launch(clock)
        for i in range(clock.iterations):
            clock.i = i
            for stage in self.stages("solve", "iteration"):
                stage.launch(clock)
        for phase in ("solve", "finish", "deform"):
            for stage in self.stages(phase, "substep"):
                stage.launch(clock)

    def table(self) -> list[dict]:
        """Stages in the order of a substep: name, phase, rate, what, launches and bytes a substep."""
        rows = []
        for phase in PHASES:
            for rate in ("frame", "iteration", "substep"):
                for s in self.stages(phase, rate):
                    times = self.clock.iterations if rate == "iteration" else 1
                    rows.append({"name": s.name, "phase": phase, "rate": rate, "what": s.what,
                                 "launches": s.launches * times, "bytes": int(s.bytes) * times})
        return rows

    @property
    def integrator(self) -> str:
        """Name of the integrator now: one that needs its residual may have given way."""
        named = self.choice.integrator
        given_way = (named.name == "bdf2" or named.beyond or named.solves > 1) and not self.clock.watched
        return "backward_euler" if given_way else named.name

    def describe(self) -> str:
        """The plan in words: what `wsim plan` prints."""
        from wsim.simulation.report import kept
        c, m = self.clock, self.model
        rows = self.table()
        bodies = f"{len(m.bodies)} {'bodies' if len(m.bodies) > 1 else 'body'}"
        lines = [f"{m.points} points in {bodies}, {m.worlds} world{'s' * (m.worlds > 1)}, "
                 f"{m.real.__name__} on {m.device}",
                 f"{c.steps} substeps of {c.dt / c.steps * 1e3:.4g} ms{' in two stages' * c.staged}, "
                 f"{c.iterations} iteration{'s' * (c.iterations > 1)}, solver "
                 f"{self.choice.solver}, integrator {self.integrator}{' while its residual is met' * c.watched}: "
                 f"{self.choice.why}",
                 f"{'phase':<9}{'stage':<14}{'rate':<10}{'launches':>9}{'MB':>9}  on"]
        lines += [f"{r['phase']:<9}{r['name']:<14}{r['rate']:<10}{r['launches']:>9}{r['bytes'] / 1e6:>9.2f}  {r['what']}"
                  for r in rows]
        a_substep = [r for r in rows if r["rate"] != "frame"]
        lines.append(f"a substep: {sum(r['launches'] for r in a_substep)} launches, "
                     f"{sum(r['bytes'] for r in a_substep) / 1e6:.2f} MB moved; state {self.state.bytes / 1e6:.2f} MB")
        lines += kept([k for method in self.methods for k in getattr(method, "kept", list)()])
        if self.hard:
            lines.append(f"tethers and strain limits are {LOOKS}")
        return "\n".join(lines + [f"left out: {s['stage']}: {s['why']}" for s in self.skipped])


def _fields(scene: Scene, choice: Choice, reasons: dict[str, str]):
    """State of the points that this scene needs."""
    multistep, explicit = choice.integrator.name == "bdf2", choice.integrator.explicit
    steps = explicit and _among_others(scene, reasons)
    return (POINTS + (ANCHOR if multistep or scene.colliders or steps else ()) + (HISTORY if multistep else ())
            + (STAGED if choice.integrator.solves > 1 else ()) + (CARRY if explicit else ())
            + (HALF if steps and len(choice.integrator.steps) > 1 else ()))


def _among_others(scene: Scene, reasons: dict[str, str]) -> bool:
    """Whether wind, contacts, soft pins or hard constraints act within a substep."""
    return any(reasons[name] for name in ("aero", "xpbd", "contact")) or any(np.isfinite(p.stiffness) for p in scene.pins)


def _module(scene: Scene, real, reasons: dict[str, str], choice: Choice) -> str:
    """Name of the Warp module of this set of kernels: scenes that need the same kernels share it."""
    kinds = [sorted(name for name, reason in reasons.items() if reason), real.__name__, choice.solver,
             choice.integrator.name, choice.iterations > 1,
             sorted({type(c.shape).__name__ for c in scene.colliders}), bool(scene.springs),
             sorted({(c.model, c.material.damping > 0, c.material.bend > 0, np.isfinite(c.material.strain_limit),
                      c.tethers) for c in scene.cloths}),
             sorted({(s.damping > 0, len(s.stiffness) > 1) for s in scene.springs}),
             sorted({(m.model, m.damping > 0, m.yield_strain < inf, s.pressure != 0.0, s.quadratic)
                     for s in scene.softs for m in s.materials}),
             sorted({bool(np.isfinite(p.stiffness)) for p in scene.pins}),
             *("bounce" for c in scene.colliders[:1] if any(k.restitution > 0.0 for k in scene.colliders)),
             *("muscles" for s in scene.springs[:1] if any(n.actuation for n in scene.springs)),
             *("loads" for _ in scene.loads[:1])]
    return "wsim_" + hashlib.sha256(json.dumps(kinds, default=str).encode()).hexdigest()[:12]


def build(scene: Scene, *, device, real, worlds: int = 1, gradients: bool = False) -> Plan:
    """Model, state and stages of a checked scene."""
    model = models.build(scene, worlds, device, real)
    model.gradients, model.by_point = gradients, gradients or bool(scene.loads)
    pinned = hard_places(model)
    rows = {b.path: rows_of(b, pinned) for b in model.bodies if b.world == 0}
    choice = choose(model, rows)
    if scene.contact_width > 0.0 and scene.colliders and choice.solver == "implicit":
        raise SceneError(Problem("/", f"contact_width is {scene.contact_width:g} m, and Newton's method has hard contacts; set "
                                 "it to 0, or wsim:solver = explicit or xpbd"))
    counts.refuse("substeps a frame, for steps that are short enough," if choice.steps > scene.substeps else "substeps",
                  choice.steps, "take softer materials, larger masses or elements, or another solver")
    reasons = why(scene, choice, rows)
    model.module = _module(scene, real, reasons, choice) + ADJOINT * gradients
    state = State.allocate(_fields(scene, choice, reasons), model.points, types(real).vec3, device)
    clock = Clock(1.0 / scene.fps, choice.substeps, choice.iterations, choice.integrator.name == "bdf2",
                  choice.integrator.beyond, choice.integrator.solves > 1)
    status = wp.zeros(EACH + 2 * len(model.bodies), dtype=int, device=device)
    plan = Plan(model, state, clock, [], status, choice, seconds=cost.seconds(model, cost.frame(model, rows, choice)))
    plan.skipped = [{"stage": name, "why": text} for name, text in WITHOUT.items()
                    if not reasons.get(name) and not (name == "history" and clock.multistep)
                    and not (name == "gradients" and gradients)]
    _add(plan, scene, reasons, rows)
    state.elements = {name: kept for table in plan.solids for name, kept in table.kept.items()}
    _start(model, state)
    return plan


def _add(plan: Plan, scene: Scene, reasons: dict[str, str], rows: dict[str, list[Rows]]) -> None:
    """Imports what is wanted and appends its stages; contacts come last."""
    from wsim.physics.motion.points import Pins, Points
    model, state, status = plan.model, plan.state, plan.status
    struck = None
    if reasons["contact"] and plan.clock.multistep:
        struck = wp.zeros(model.points, dtype=model.real, device=model.device)
    points = Points(model, state, status, struck, plan.choice.integrator)
    plan.methods.append(points)
    pins = Pins(model, state, points, plan.choice.integrator.explicit) if reasons["pins"] else None
    if pins:
        plan.methods.append(pins)
    if reasons["explicit"]:
        from wsim.physics.motion.explicit import Explicit
        hard = pins if pins and pins.groups["hard"] else None
        explicit = Explicit(model, state, points, _kept(rows, soft=True), plan.clock, _among_others(scene, reasons), hard)
        plan.methods.append(explicit)
    if reasons["aero"]:
        from wsim.physics.cloth.air import Aero
        plan.methods.append(Aero(model, state, points))
    if reasons["implicit"]:
        from wsim.physics.solver.newton import Implicit
        plan.methods.append(Implicit(model, state, points, status, plan.clock, _kept(rows, soft=True)))
    if reasons["xpbd"]:
        from wsim.physics.solver.xpbd import Xpbd
        plan.methods.append(Xpbd(model, state, points, status, plan.clock,
                                 rows if plan.choice.solver == "xpbd" else _kept(rows, soft=False)))
    if reasons["contact"]:
        from wsim.physics.contact import Contact
        contact = Contact(model, state, points, status, struck, plan.clock)
        plan.methods.append(contact)
        if contact.bounce and reasons["explicit"]:
            contact.bounce.join(explicit)
    watch = None if reasons["explicit"] or model.gradients else _watch(plan)
    if reasons["muscles"]:
        from wsim.physics.cloth.muscles import Muscles
        muscles = Muscles(model, plan.clock)
        plan.methods.append(muscles)
        muscles.drive(plan.method(plan.choice.solver), watch)
    if reasons["loads"]:
        from wsim.physics.motion.loads import Loads
        plan.methods.append(Loads(model, plan.clock, points, plan.method("explicit")))
    if implicit := plan.method("implicit"):
        implicit.join(plan.method("contact"), pins, plan.method("xpbd"))                # type: ignore[attr-defined]
    plan.skipped += [{"stage": "membrane", "why": "no cloth has triangle strain"}] * (
        not any(isinstance(b.source, Cloth) and b.source.model == "membrane" for b in model.bodies))


def _watch(plan: Plan):
    """What looks at the edges of an implicit run, where there are any."""
    from wsim.physics.motion.overstretch import Watch
    watch = Watch(plan.model, plan.state, plan.status)
    plan.methods += [watch] * bool(watch.stages)
    return watch


def _kept(rows: dict[str, list[Rows]], soft: bool) -> dict[str, list[Rows]]:
    """The rows that have a stiffness, or those that have none: XPBD holds the hard ones whatever solves for the forces."""
    return {path: [r for r in found if (r.kind not in HARD) == soft] for path, found in rows.items()}


def _start(model: Model, state: State) -> None:
    """Initial positions with their rounding remainder, and velocities."""
    dtype = model.dtype
    places = np.concatenate([apart(b.places, b.edges - b.first, edge_lengths(b)) for b in model.bodies])
    x = places.astype(dtype)
    state.x.assign(x)
    state.e.assign((places - x).astype(dtype))
    state.v.assign(model.stack("velocities").astype(dtype))
