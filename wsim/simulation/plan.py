"""The ordered list of stages that a scene needs, and why each other method is left out.

`build_plan` imports the methods that the scene wants, lets each make its tables, and runs a frame:

    frame    every stage of rate "frame" in phase pose, then `substeps` times
             methods that subdivide a substep, with all their phases;
             pose, predict, collide; `iterations` times solve; finish;      at last the stages "frame" of deform
"""

from dataclasses import dataclass, field, replace

from wsim.kernels.math.real import ADJOINT
from wsim.model import kernel_cache
from wsim.model import model as models
from wsim.model.launches import PEELED, SubstepLoop, loop_of
from wsim.model.model import Model
from wsim.model.stage import FREE, MET, PHASES, Clock, Method, Methods, Ports, Stage
from wsim.model.state import SimulationState
from wsim.model.status import FrameStatus
from wsim.physics.cloth.constraints import LOOKS, fill_constraints
from wsim.scene import Scene
from wsim.scene.check import counts
from wsim.scene.methods import METHODS, describe_scene_contents, each_method_object, has_sheets, has_tets, loads_on_deformables
from wsim.simulation import cost
from wsim.simulation.choice import SchemeChoice, choose_scheme
from wsim.simulation.methods import (
    Build,
    allocate_points,
    connect_methods,
    left_out,
    make_methods,
    module_name,
    reason_for_method,
    set_initial_positions,
)
from wsim.simulation.predicted.sag import set_rigid_substeps

LAUNCH = 5.5e3           # [B] of a launch of the table in a graph of a CPU: crossed cloths, 84 of them in a substep
OWN_STEPS = {"fluid", "liquid", "mpm"}          # methods that choose their steps in a frame, whatever the substeps
SMALL = 1 << 28          # bytes of a graph, for which there is room


@dataclass
class SimulationPlan:
    """Stages in order; `methods` own them; `skipped` says what is not there and why."""

    model: Model
    state: SimulationState
    clock: Clock
    methods: Methods
    status: FrameStatus
    choice: SchemeChoice
    skipped: list[dict] = field(default_factory=list)
    seconds: float = 0.0                     # that a frame is expected to take, see `wsim.simulation.cost`
    followed: dict = field(default_factory=dict)       # what varies in time, as set last, by path and name
    loop: SubstepLoop | None = None          # of substeps that launch the same

    @property
    def starts(self) -> bool:
        """True if the frame to come differs from those after it: it is not worth a graph of its own."""
        clock, half = self.clock, self.state.has_point_field("b")
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
        from wsim.simulation.measure.memory import free_bytes
        return self.recorded() <= 0.5 * free_bytes(self.model.device)

    def stages(self, phase: str, rate: str, form: str = "") -> list[Stage]:
        """Stages of methods that step with the others. form: of frames; "": of the present one."""
        form = form or self.clock.form
        return [s for m in self.methods if m.subdivide == 1 or rate == "frame"
                for s in m.stages if s.phase == phase and s.rate == rate and s.frames in ("", form)]

    @property
    def parted(self) -> bool:
        """True if frames without contacts leave their stages out."""
        return any(s.frames == FREE for m in self.methods for s in m.stages)

    def run_subdivided_methods(self) -> None:
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
        self.state.take_snapshot()
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
        self.run_subdivided_methods()
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
        from wsim.simulation.measure.columns import text_columns
        from wsim.simulation.measure.memory import bytes_held_by
        from wsim.simulation.report import contactless_launches_text, kept_distance_lines
        c, m = self.clock, self.model
        rows = self.table()
        bodies = f"{m.points} points in {len(m.bodies)} {'body' if len(m.bodies) == 1 else 'bodies'}"
        bodies = bodies if m.points else describe_scene_contents(m.scene).split(";")[0]
        solver = (f", solver {self.choice.solver}, integrator {self.integrator}{' while its residual is met' * c.watched}: "
                  f"{self.choice.why}") * bool(m.points)
        lines = [f"{bodies}, {m.worlds} world{'s' * (m.worlds > 1)}, "
                 f"{m.real.__name__} on {m.device}",
                 "" if {row.name for row, _ in each_method_object(m.scene) if not row.posed} <= OWN_STEPS and not m.points else
                 f"{c.steps} substeps of {c.dt / c.steps * 1e3:.4g} ms{' in two stages' * (c.integrator.solves > 1)}, "
                 f"{c.iterations} iteration{'s' * (c.iterations > 1)}{solver}"]
        lines[1] = lines[1] or f"frames of {c.dt * 1e3:.4g} ms, in which methods choose steps of their own"
        cells = [(r["phase"], r["name"], r["rate"], str(r["launches"]), f"{r['bytes'] / 1e6:.2f}", f"  {r['what']}")
                 for r in rows]
        lines += text_columns([("phase", "stage", "rate", "launches", "MB", "  on"), *cells], "<<<>><", (9, 16, 10, 9, 9, 0),
                              gap="")
        a_substep = [r for r in rows if r["rate"] != "frame"]
        lines.append(f"a substep: {sum(r['launches'] for r in a_substep)} launches, "
                     f"{sum(r['bytes'] for r in a_substep) / 1e6:.2f} MB moved; state {self.state.bytes / 1e6:.2f} MB, all "
                     f"arrays {bytes_held_by(self) / 1e6:.2f} MB")
        if self.parted:
            lines.append(contactless_launches_text(self.table(FREE)))
        lines += kept_distance_lines([k for method in self.methods for k in method.kept_distances()])
        if m.fuser:
            lines.append(m.fuser.why)
        if self.hard:
            lines.append(f"tethers and strain limits are {LOOKS}")
        return "\n".join(lines + [f"left out: {s['stage']}: {s['why']}" for s in self.skipped])


def build_plan(scene: Scene, *, device, real, worlds: int = 1, gradients: bool = False,
               fps: float | None = None) -> SimulationPlan:
    """Model, state and stages of a checked scene, its substeps as `set_rigid_substeps` has them. fps: of wall clock, that it is
    to hold."""
    model = models.build_model(scene, worlds, device, real)
    pushed = bool(scene.things("MaterialPoints") and scene.bodies())
    model.gradients, model.by_point = gradients, gradients or pushed or bool(loads_on_deformables(scene))
    b = _model_with_choice(model, fps)
    b.reasons = {row.name: reason_for_method(row, b) for row in METHODS}
    model.module = module_name(b) + ADJOINT * gradients
    _choose_fusion(b)
    allocate_points(b)
    make_methods(b)
    connect_methods(b)
    b.status.allocate()
    set_initial_positions(b)
    return _assemble_plan(b)


def _choose_fusion(b: Build) -> None:
    """Lets explicit steps launch all that acts in a substep at once, where that pays."""
    model, scene = b.model, b.scene
    acts = model.fuses or model.device.is_cuda or b.within or has_tets(scene)     # else a march of a CPU takes whole frames
    if b.choice.solver == "explicit" and model.fuses is not False and acts:
        from wsim.physics.motion.fused.kernel_fusion import Fuser, fusing_pays, why_not_fused
        model.fuser = None if why_not_fused(model,
                                            b.reasons) or model.fuses is None and not fusing_pays(model) else Fuser(model)


def _assemble_plan(b: Build) -> SimulationPlan:
    model = b.model
    plan = SimulationPlan(model, b.state, b.clock, b.methods, b.status, b.choice, left_out(b),
                          cost.seconds_of_counts(model, cost.count_frame_of_choice(model, b.choice)))
    if model.fuser:
        model.fuser.prepare(plan)
    plan.loop = loop_of(plan)
    return plan


def choice_of_scene(scene: Scene, *, device, real) -> SchemeChoice:
    """The choice that a simulation of a checked scene makes. Raises SceneError as it does."""
    return _model_with_choice(models.build_model(replace(scene), 1, device, real)).choice


def _model_with_choice(model: Model, fps: float | None = None) -> Build:
    """Constraints of every body, and the solver, integrator and steps that they are given: worlds take those of one alone,
    whose bits they then have, but where all are to hold a rate of frames."""
    scene, one, need = model.scene, model, set_rigid_substeps(model.scene)
    fill_constraints(model)
    if fps is None:
        if model.worlds > 1:
            one = models.build_model(scene, 1, model.device, model.real)
            fill_constraints(one, model)
        choice = choose_scheme(one)
    else:
        from wsim.simulation.predicted.rate import choose_for_rate
        choice = choose_for_rate(model, fps)
    if scene.solver == "explicit" and choice.substeps > scene.substeps and has_sheets(scene):
        from wsim.physics.motion.fused.mass_scaling import add_sliver_mass
        if said := add_sliver_mass(model):
            if one is not model:
                add_sliver_mass(one)
            choice = choose_scheme(one)
            choice = replace(choice, why="; ".join([choice.why, *map(str, said)]))
    if choice.slowed:
        from wsim.physics.motion.fused.mass_scaling import add_sliver_mass
        for each in {id(m): m for m in (model, one)}.values():
            add_sliver_mass(each)
    choice = replace(choice, need=need, why="; ".join(filter(None, (choice.why, need.told(scene, choice.substeps)))))
    counts.refuse_large_count("substeps a frame, for steps that are short enough," if choice.steps > scene.substeps
                              else "substeps",
                              choice.steps, "take softer materials, larger masses or elements, or another solver")
    clock = Clock(1.0 / scene.fps, choice.substeps, choice.iterations, choice.integrator)
    return Build(model, choice, SimulationState(), FrameStatus(model.device), clock)


FEW = 48          # rigid bodies of all worlds. Contacts are solved one after the other, where they share a body: on an H200 30
                  # dominoes take 5.3 ms a frame and an arch of 18 blocks 5.3, on a core beside it 2.9 and 1.6; 55 in a pyramid
                  # take as long on both


def choose_device(name, scene, worlds: int, gradients: bool):
    """The device of a name; None: the CPU for FEW rigid bodies alone, else the GPU if there is one. Raises SceneError for a
    name that no device has."""
    device = kernel_cache.warp_device(name)
    few = 0 < len(scene.things("Body")) * worlds <= FEW and not gradients
    if name is None and device.is_cuda and few and not scene.bodies() and all(row.name == "rigid"
                                                                              for row, _ in each_method_object(scene)):
        device = kernel_cache.warp_device("cpu")
    return device
