"""The ordered list of stages that a scene needs, and why each other method is left out.

`build` imports the methods that the scene wants, lets each make its tables, and runs a frame:

    frame    every stage of rate "frame" in phase pose, then `substeps` times
             methods that subdivide a substep, with all their phases;
             pose, predict, collide; `iterations` times solve; finish;      at last the stages "frame" of deform
"""

from dataclasses import dataclass, field, replace

from wsim.kernels.math.real import ADJOINT
from wsim.model import model as models
from wsim.model.launches import PEELED, Loop, loop_of
from wsim.model.model import Model
from wsim.model.stage import FREE, MET, PHASES, Clock, Method, Methods, Ports, Stage
from wsim.model.state import State
from wsim.model.status import Status
from wsim.physics.cloth.constraints import LOOKS, constrain
from wsim.scene import Scene
from wsim.scene.check import counts
from wsim.scene.methods import METHODS, loads_of_bodies
from wsim.simulation import cost
from wsim.simulation.choice import Choice, choose
from wsim.simulation.methods import (
    Build,
    allocate_points,
    connect_methods,
    left_out,
    make_methods,
    module_name,
    needed,
    place_points,
)
from wsim.simulation.predicted.sag import settle

LAUNCH = 5.5e3           # [B] of a launch of the table in a graph of a CPU: crossed cloths, 84 of them in a substep
SMALL = 1 << 28          # bytes of a graph, for which there is room


@dataclass
class Plan:
    """Stages in order; `methods` own them; `skipped` says what is not there and why."""

    model: Model
    state: State
    clock: Clock
    methods: Methods
    status: Status
    choice: Choice
    skipped: list[dict] = field(default_factory=list)
    seconds: float = 0.0                     # that a frame is expected to take, see `wsim.simulation.cost`
    followed: dict = field(default_factory=dict)       # what varies in time, as set last, by path and name
    loop: Loop | None = None                 # of substeps that launch the same

    @property
    def starts(self) -> bool:
        """True if the frame to come differs from those after it: it is not worth a graph of its own."""
        clock, half = self.clock, self.state.has("b")
        return clock.starting and (clock.integrator.memory > 0.0 or half) or clock.after_free and half and not clock.free

    def recorded(self) -> float:
        """Bytes that a graph of a frame among contacts takes on a CPU, which keeps the arguments of every launch."""
        rows = self.table()
        often, once = (sum(r["launches"] for r in rows if (r["rate"] == "frame") == frame) for frame in (False, True))
        return 0.0 if self.model.device.is_cuda else LAUNCH * (once + often * (PEELED if self.loop else self.clock.substeps))

    @property
    def fits(self) -> bool:
        """False where there is no room for it: frames are launched one by one."""
        if self.recorded() < SMALL:
            return True
        from wsim.simulation.measure.memory import free
        return self.recorded() <= 0.5 * free(self.model.device)

    def stages(self, phase: str, rate: str, form: str = "") -> list[Stage]:
        """Stages of methods that step with the others. form: of frames; "": of the present one."""
        form = form or self.clock.form
        return [s for m in self.methods if m.subdivide == 1 or rate == "frame"
                for s in m.stages if s.phase == phase and s.rate == rate and s.frames in ("", form)]

    @property
    def parted(self) -> bool:
        """True if frames without contacts leave their stages out."""
        return any(s.frames == FREE for m in self.methods for s in m.stages)

    def subdivided(self) -> None:
        """Methods that take several steps in a substep: all of them, before the others predict; what these exchange with others
        they do at the ends of substeps."""
        for method in self.methods:
            for self.clock.j in range(method.subdivide if method.subdivide > 1 else 0):
                for phase in PHASES:
                    for stage in method.stages:
                        if stage.phase == phase and stage.rate == "substep":
                            stage.launch(self.clock)

    @property
    def ports(self) -> Ports:
        """Ports of the methods."""
        return self.methods.ports

    def method(self, name: str) -> Method | None:
        """The method of a row of the table, for those who have the row or look inside."""
        return next((m for m in self.methods if m.name == name), None)

    @property
    def hard(self) -> bool:
        """True if tethers or strain limits hold something."""
        return any(batch.hard for batch in self.ports.xpbd_batches)

    @property
    def solids(self) -> list:
        """Tables of tets (`wsim.physics.soft.fem`), of whichever method has them."""
        return self.ports.tet_tables

    def before_frame(self, time: float) -> None:
        for method in self.methods:
            method.before_frame(time, self.clock)

    def frame(self) -> None:
        """Launches one frame: all that a graph holds."""
        self.status.begin()
        self.state.snapshot()
        self.stretch(0, self.clock.substeps)
        self.status.end()

    def stretch(self, first: int, last: int) -> None:
        """Substeps first .. last of a frame, with what stands before the first of a frame and behind its last."""
        clock = self.clock
        for phase in PHASES[:-1] if first == 0 else ():
            for stage in self.stages(phase, "frame"):
                stage.launch(clock)
        (self.loop or self.model).repeat(self.substep, first, last)
        if last == clock.substeps:
            for stage in self.stages("deform", "frame"):
                stage.launch(clock)

    def substep(self, k: int | None = None) -> None:
        """Launches substep k, or the present one."""
        clock = self.clock
        clock.k = clock.k if k is None else k
        self.subdivided()
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

    def table(self, form: str = MET) -> list[dict]:
        """Stages in the order of a substep: name, phase, rate, what, launches and bytes a substep. form: of frames."""
        rows = []
        for phase in PHASES:
            for rate in ("frame", "iteration", "substep"):
                for s in self.stages(phase, rate, form):
                    times = self.clock.iterations if rate == "iteration" else 1
                    rows.append({"name": s.name, "phase": phase, "rate": rate, "what": s.what,
                                 "launches": s.launches * times, "bytes": int(s.bytes) * times})
            rows += [{"name": s.name, "phase": phase, "rate": f"1/{m.subdivide}", "what": s.what,
                      "launches": s.launches * m.subdivide, "bytes": int(s.bytes) * m.subdivide}
                     for m in self.methods if m.subdivide > 1 for s in m.stages if s.phase == phase and s.rate == "substep"]
        return rows

    @property
    def integrator(self) -> str:
        """Name of the integrator now: one that needs its residual may have given way."""
        return self.clock.integrator.name

    def describe(self) -> str:
        """The plan in words: what `wsim plan` prints."""
        from wsim.simulation.measure.columns import columns
        from wsim.simulation.measure.memory import held
        from wsim.simulation.report import kept, parted
        c, m = self.clock, self.model
        rows = self.table()
        bodies = f"{len(m.bodies)} {'body' if len(m.bodies) == 1 else 'bodies'}"
        lines = [f"{m.points} points in {bodies}, {m.worlds} world{'s' * (m.worlds > 1)}, "
                 f"{m.real.__name__} on {m.device}",
                 f"{c.steps} substeps of {c.dt / c.steps * 1e3:.4g} ms{' in two stages' * (c.integrator.solves > 1)}, "
                 f"{c.iterations} iteration{'s' * (c.iterations > 1)}, solver "
                 f"{self.choice.solver}, integrator {self.integrator}{' while its residual is met' * c.watched}: "
                 f"{self.choice.why}"]
        cells = [(r["phase"], r["name"], r["rate"], str(r["launches"]), f"{r['bytes'] / 1e6:.2f}", f"  {r['what']}")
                 for r in rows]
        lines += columns([("phase", "stage", "rate", "launches", "MB", "  on"), *cells], "<<<>><", (9, 16, 10, 9, 9, 0), gap="")
        a_substep = [r for r in rows if r["rate"] != "frame"]
        lines.append(f"a substep: {sum(r['launches'] for r in a_substep)} launches, "
                     f"{sum(r['bytes'] for r in a_substep) / 1e6:.2f} MB moved; state {self.state.bytes / 1e6:.2f} MB, all "
                     f"arrays {held(self) / 1e6:.2f} MB")
        if self.parted:
            lines.append(parted(self.table(FREE)))
        lines += kept([k for method in self.methods for k in method.kept()])
        if m.fuser:
            lines.append(m.fuser.why)
        if self.hard:
            lines.append(f"tethers and strain limits are {LOOKS}")
        return "\n".join(lines + [f"left out: {s['stage']}: {s['why']}" for s in self.skipped])


def build(scene: Scene, *, device, real, worlds: int = 1, gradients: bool = False, fps: float | None = None) -> Plan:
    """Model, state and stages of a checked scene, its substeps as `settle` has them. fps: of wall clock, that it is to hold."""
    model = models.build(scene, worlds, device, real)
    model.gradients, model.by_point = gradients, gradients or bool(loads_of_bodies(scene))
    b = _chosen(model, fps)
    b.reasons = {row.name: needed(row, b) for row in METHODS}
    model.module = module_name(b) + ADJOINT * gradients
    _choose_fusion(b)
    allocate_points(b)
    make_methods(b)
    connect_methods(b)
    b.status.allocate()
    place_points(b)
    return _assemble_plan(b)


def _choose_fusion(b: Build) -> None:
    """Lets explicit steps launch all that acts in a substep at once, where that pays."""
    model, scene = b.model, b.scene
    acts = model.fuses or model.device.is_cuda or b.within or scene.softs          # else a march of a CPU takes whole frames
    if b.choice.solver == "explicit" and model.fuses is not False and acts:
        from wsim.physics.fused.fuser import Fuser, apart, pays
        model.fuser = None if apart(model, b.reasons) or model.fuses is None and not pays(model) else Fuser(model)


def _assemble_plan(b: Build) -> Plan:
    model = b.model
    plan = Plan(model, b.state, b.clock, b.methods, b.status, b.choice, left_out(b),
                cost.seconds(model, cost.frame(model, b.choice)))
    if model.fuser:
        model.fuser.prepare(plan)
    plan.loop = loop_of(plan)
    return plan


def choice(scene: Scene, *, device, real) -> Choice:
    """The choice that a simulation of a checked scene makes. Raises SceneError as it does."""
    return _chosen(models.build(replace(scene), 1, device, real)).choice


def _chosen(model: Model, fps: float | None = None) -> Build:
    """Constraints of every body, and the solver, integrator and steps that they are given: worlds take those of one alone,
    whose bits they then have, but where all are to hold a rate of frames."""
    scene, one, need = model.scene, model, settle(model.scene)
    constrain(model)
    if fps is None:
        if model.worlds > 1:
            one = models.build(scene, 1, model.device, model.real)
            constrain(one, model)
        choice = choose(one)
    else:
        from wsim.simulation.predicted.rate import hold
        choice = hold(model, fps)
    if scene.solver == "explicit" and choice.substeps > scene.substeps and scene.cloths:
        from wsim.physics.fused.stiff_few import slow
        if said := slow(model):
            if one is not model:
                slow(one)
            choice = choose(one)
            choice = replace(choice, why="; ".join([choice.why, *map(str, said)]))
    if choice.slowed:
        from wsim.physics.fused.stiff_few import slow
        for each in {id(m): m for m in (model, one)}.values():
            slow(each)
    choice = replace(choice, need=need, why="; ".join(filter(None, (choice.why, need.told(scene, choice.substeps)))))
    counts.refuse("substeps a frame, for steps that are short enough," if choice.steps > scene.substeps else "substeps",
                  choice.steps, "take softer materials, larger masses or elements, or another solver")
    clock = Clock(1.0 / scene.fps, choice.substeps, choice.iterations, choice.integrator)
    return Build(model, choice, State(), Status(model.device), clock)
