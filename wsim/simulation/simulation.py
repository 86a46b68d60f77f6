"""Runs a scene, frame by frame. A frame is a transaction: it is committed whole or repeated.

All substeps of a frame are captured as a graph and replayed; where all launch the same, they are a loop in it
(`wsim.model.launches.SubstepLoop`). After each frame one small status word is read; where it says that a buffer overflowed, a
residual was missed or a position is no number, the frame's snapshot is restored, the buffer grown or the variant switched, and
the frame repeated: by a new graph if the old one knows what has changed (`wsim.simulation.measure.captures`). Nothing is
dropped in silence.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np
import warp as wp

from wsim.model import kernel_cache
from wsim.model.compiler.core_team import count_cores
from wsim.model.kernel_cache import GATE
from wsim.scene import Problem, Scene, SceneError
from wsim.scene.bodies import scene_of_run
from wsim.scene.check.counts import checked_count
from wsim.scene.check.scene import check_scene
from wsim.simulation import duration, interrupt, retry
from wsim.simulation import plan as plans
from wsim.simulation.measure import indicators as measure
from wsim.simulation.measure.captures import FrameGraphs, capture_forms, capture_frame
from wsim.simulation.measure.exceeded import ExceededNote, note_exceeded_limits
from wsim.simulation.measure.host import HostTimes
from wsim.simulation.measure.log_messages import LogMessages
from wsim.simulation.measure.readings import Readings
from wsim.simulation.predicted.measured import follow_start

PRECISIONS = {"float32": wp.float32, "float64": wp.float64}
MUCH = 1e8             # bytes of particles, from which they are compared with the memory that is free
REPEATS = 8            # a frame that is not done after so many repeats is an error, not a loop


class Simulation(Readings):
    """A scene on a device, as in `Simulation(scene, device="cpu").run(10)`.

    scene      a `Scene`, the path of a USD file, or a `Usd.Stage`
    device     "cpu", "cuda:0", ...; None takes the GPU if there is one, but the CPU for up to 48 rigid bodies alone
    precision  "float32" or "float64" (the measuring instrument)
    worlds     so many independent copies of the scene in one set of arrays
    gradients  kernels are compiled with their adjoints, for a `wsim.gradient.recording.Recording`
    fps        frames a second of wall clock, which the setting is to hold: `wsim.simulation.predicted.rate`
    Raises SceneError with every problem of the scene.
    """

    def __init__(self, scene: "Scene | str | PathLike", *, device=None, precision: str = "float32", worlds: int = 1,
                 gradients: bool = False, fps: float | None = None):
        began = time.perf_counter()
        if precision not in PRECISIONS:
            raise SceneError(Problem("precision", f"found {precision!r}; allowed are {', '.join(PRECISIONS)}"))
        if fps is not None and not 0.0 < fps < float("inf"):
            raise SceneError(Problem("fps", f"found {fps}; allowed is a finite number of frames a second above 0"))
        count_cores()                          # raises before anything is written, as WSIM_CPU_THREADS may be wrong
        if not isinstance(scene, Scene):
            from wsim.usd import load
            scene = load(scene)
        self.given, self.precision, self.worlds = scene, precision, checked_count("worlds", worlds, 1)
        self.gradients, self.fps, self.device = gradients, fps, plans.choose_device(device, scene, self.worlds, gradients)
        self._require_free_memory(scene)
        problems = check_scene(scene)
        if any(p.fatal for p in problems):
            raise SceneError([p for p in problems if p.fatal])
        self.warnings, self.overlaps = [str(p) for p in (*scene.notes, *problems)], any(p.overlap for p in problems)
        self.seconds: dict[str, float] = {}
        self.graphs = FrameGraphs()
        self.watchers: list[Callable] = []     # called with (simulation) after every frame, see `record`
        if worlds > 1:
            from wsim.simulation.measure.memory import require_memory
            require_memory(scene, worlds, lambda: Simulation(scene, device=self.device, precision=precision))
        self._build()
        self.seconds["build"] = time.perf_counter() - began
        self.watchers.append(LogMessages(self).log_frame)

    def _require_free_memory(self, scene: Scene) -> None:
        """Raises SceneError where particles of a scene would not fit on the device: before they are looked at, and with those
        that come later."""
        if (need := sum(body.run_bytes() for body in scene.bodies()) * self.worlds) > MUCH:
            from wsim.simulation.measure.memory import require_free_memory
            require_free_memory(scene, need * (1.0 + (self.precision == "float64")), self.device)

    def _build(self) -> None:
        self.frame = 0
        self.graphs.forget("the simulation was reset")
        self.pulled = self.settled = None      # made by `reactions` (pulled) and `follow_start` (settled)
        self.sensors: Any = None               # made by `joints`, `links` and `imu`
        self.host = HostTimes()                # where its time goes
        self.measured: Any = None              # made by `follow_start` in the first frame; False: never, nor `settled`
        self.balance: measure.IntegratorBalance | None = None
        self.scene = replace(self.given, colliders=[replace(c) for c in self.given.colliders])      # live motions change copies
        if self.precision == "float32":
            self.scene = self.scene.single()
        self.scene = scene_of_run(self.scene)
        self._require_free_memory(self.scene)
        self.forms = {"free": 0, "met": 0, "repeated": 0}        # frames without contacts, with them, tried without first
        self.notes: dict[tuple, ExceededNote] = {}  # frames that were beyond a bound, see `wsim.simulation.measure.exceeded`
        self.repeats: list[str] = []           # why frames were repeated, where that asks nothing of anybody
        self.lost: dict[int, int] = {}         # worlds that were taken out, each with the frame in which it broke
        self.origin: Any = None                # one world where it begins, made where a world begins again
        self.changes: list[tuple] = []         # live parameters that were set, for another plan of the same scene
        self.headroom: Any = None  # `wsim.simulation.live_stability.LiveStability`, once explicit steps are asked for it
        try:
            with GATE.alone():
                self.plan = plans.build_plan(self.scene, device=self.device, real=PRECISIONS[self.precision],
                                             worlds=self.worlds, gradients=self.gradients, fps=self.fps)
        except RuntimeError as error:
            raise retry.failure_in_words(error, self.device) from None
        self.model, self.state, start = self.plan.model, self.plan.state, self.plan.ports.start_warnings
        self.warnings += [w for w in (*map(str, start), *duration.warn_steps(self.plan, self.fps)) if w not in self.warnings]
        self.milliseconds: list[float] = []
        retry.settle_built_simulation(self)

    @property
    def time(self) -> float:
        """Time [s] since the scene's start."""
        return self.frame / self.scene.fps

    def __repr__(self) -> str:
        return f"<Simulation at frame {self.frame} on {self.device}, {self.precision}, of {self.scene!r}>"

    def step(self) -> None:
        """Steps one frame. Raises SceneError when it cannot be finished. Threads may step simulations of their own."""
        with GATE.shared():
            self._step()
        self.host.call("first frames, measured", follow_start, self)
        self.host.count_host_frame(self.frame)

    def _step(self) -> None:
        began = time.perf_counter()
        self.load()
        interrupt.raise_if_interrupted()
        if self.plan.clock.starting:
            self.balance = measure.begin_integrator_balance(self)
        retry.enter_frame(self)
        for _ in range(REPEATS):
            try:
                retry.prepare_frame_tables(self)
                self._replay()
            except RuntimeError as error:
                raise retry.failure_in_words(error, self.device) from None
            self.plan.status.wait()
            if not self.host.call("status", retry.prepare_frame_retry, self):
                break
            self.state.restore_snapshot()
        else:
            raise SceneError(Problem("frame", f"frame {self.frame + 1} was repeated {REPEATS} times and still does not "
                                     "hold; give it more substeps"))
        self.plan.clock.starting = False
        self.forms["free" if self.plan.clock.free else "met"] += 1
        self.frame += 1
        self.host.call("status", note_exceeded_limits, self)
        if not self.milliseconds and self.device.is_cuda and self.graphs.wanted and self.plan.fits:
            try:
                capture_forms(self)
            except RuntimeError as error:
                raise retry.failure_in_words(error, self.device) from None
        self.milliseconds.append(1e3 * (time.perf_counter() - began))
        self.seconds.setdefault("first_frame", time.perf_counter() - began)
        if self.balance:
            self.host.call("energy, looked at", self.balance.look, self)
        for watch in list(self.watchers):
            watch(self)

    def frames(self, n: int | None = None) -> Iterator[int]:
        """Steps n frames (None: the scene's), and yields the number of each after it: 1, 2, 3 ..."""
        return map(self._step_and_number, range(self.scene.frames if n is None else checked_count("frames", n)))

    def _step_and_number(self, _) -> int:
        self.step()
        return self.frame

    def record(self, path, **more):
        """Writes this frame, and every frame from here on, into a USD file over the scene, until the block of a `with` ends, or
        it is closed: a `wsim.simulation.record.Record`, which says what `more` there is (stress, reactions, flatten)."""
        from wsim.simulation import record
        return record.Record(self, path, **more)

    def run(self, frames: int | None = None, each: Callable | None = None) -> None:
        """Runs so many frames (None: the scene's); `each(simulation)` is called after every one."""
        for _ in self.frames(frames):
            if each:
                each(self)

    def load(self) -> None:
        """Compiles the plan's kernels, once."""
        if "compile" in self.seconds:
            return
        began = time.perf_counter()
        with GATE.alone(), kernel_cache.without_header():
            self.model.load()
        self.seconds["compile"] = time.perf_counter() - began

    def _replay(self) -> None:
        if not self.plan.starts and (self.graph or self.graphs.wanted and self.plan.fits):
            wp.capture_launch(self.graph or capture_frame(self))
        elif "met again" in self.graphs and not self.plan.clock.starting:
            wp.capture_launch(self.graphs["met again"])
        else:
            self.plan.frame()

    @property
    def graph(self) -> wp.Graph | None:
        """Graph of frames of the present form; None: none was captured."""
        return self.graphs.get(self.plan.clock.free)

    def prepare(self) -> None:
        """Compiles, captures every form of a frame, and makes lists of near surfaces longer, so that no frame to come captures
        and few are repeated: for live use, when motions were set once."""
        from wsim.simulation import live
        with GATE.alone():
            live.prepare_live_use(self)

    def reset(self, world: int | None = None) -> None:
        """Sets the simulation back to the scene's initial state, with the scene's own parameters; or one world alone, while its
        live values stay and what varies in time goes on. Raises SceneError for a world that there is not."""
        if world is None:
            return self._build()
        if world not in range(self.worlds):
            raise SceneError(Problem("world", f"there is no world {world}; allowed are 0 to {self.worlds - 1}"))
        from wsim.simulation.measure.checks.lost import begin_again
        begin_again(self, {world})

    # reading and setting

    def positions(self, path: str | None = None, world: int = 0, device: bool = False):
        """World positions [m] of points of a body, of rods or of followers, float64, (n, 3), in the author's order.
        device=True, of bodies alone: (array of all points on the device in solver order, relative to the body's origin,
        index table); no copy is made and nothing is waited for."""
        from wsim.simulation import record
        return record.positions_of_path(self, path, world, device)

    def velocities(self, path: str | None = None, world: int = 0, device: bool = False):
        """Velocities [m/s] of points, (n, 3), as `positions`; masses in this order: `model.body(path).point_masses` [kg]."""
        from wsim.simulation import record
        return record.velocities_of_path(self, path, world, device)

    def poses(self, path: str | None = None, world: int = 0) -> dict[str, np.ndarray]:
        """Local-to-world transforms (4, 4) [m] of rigid bodies and colliders now, by path (None: of all)."""
        from wsim.simulation import record
        return record.poses_of_path(self, path, world)

    def samples(self, world: int = 0) -> list:
        """Samples for a result besides points, now (`wsim.scene.samples`): particles of liquids, smoke, poses of bodies ..."""
        return [sample for method in self.plan.methods for sample in method.samples(world)]

    def set(self, path: str, name: str, value, world: "int | Sequence[int] | None" = None) -> None:
        """Sets a value in SI units, from the next frame on, as in `sim.set("/", "wind", (6, 0, 0))`: of the object at a path
        ("/": the scene), in one world, in all (None), or a list of worlds with a value each. Numbers and vectors may be Curves.

        "/"           gravity, wind, air_drag
        cloth         stretch, weft, shear, bend, damping, strain_limit (if finite), poisson (of the model "membrane"), density
        springs       stiffness, mass, lengths [m], actuation of muscles (a Curve, or its values)
        soft body     young, poisson, density; damping, pressure, yield_strain (where not 0 at the start)
        each of them  positions, velocities (world, author's order), rest_shape [m], static_friction, dynamic_friction
        rigid body    velocity, spin, force, torque, drag, spin_drag, mass, inertia; friction, restitution of its colliders
        joint         stiffness, damping, target, speed of its drives; control of an actuator
        collider      motion (rigid), static_friction, dynamic_friction, thickness, restitution (where not 0 at the start)
        pin, load     motion of a pin; force or traction of a load: (3,), or as actuation
        fluid         lift, weight, vorticity, smoke_decay, cooling, viscosity, side_velocities, acceleration
        source        smoke, temperature, expansion, strength, place
        MPM           young, poisson, density, viscosity, bulk, exponent, friction_angle, cohesion, compression_limit,
                      tension_limit, hardening

        `wsim.scene.values.table` has units and bounds. Raises SceneError, and changes nothing, where nothing takes it."""
        from wsim.simulation import live
        with GATE.alone():
            live.set_value(self, path, name, value, world)

    def fields(self, path: str | None = None) -> dict[str, np.ndarray]:
        """Fields of an object for an exact restart, by name, in the author's order; mid-edge nodes come behind points."""
        path = self.model.body(None).path if path is None else path
        found = {name: array.numpy()[rows] for name, array, rows in self.state.of(path)}
        if not found:
            raise SceneError(Problem(path, f"has no fields; there are {self.state.paths()}"))
        return found

    def restart(self, frame: int, fields: dict[str, dict[str, np.ndarray]], alike: bool = True) -> None:
        """Goes on after `frame` frames with the fields that an earlier run left, by path and name: bit for bit where every
        body has all of them and no others, else as at a start, without history, with a warning. alike: that run stepped as
        this one does. Raises SceneError for fields of another shape."""
        from wsim.simulation import record
        record.restart_from_fields(self, frame, fields, alike)

    # measuring: more in `Readings`

    def report(self, profile: bool = True) -> dict:
        """Report of what ran and how well: device, precision, frames, times, errors, stages, what was skipped, warnings."""
        return measure.make_run_report(self, profile)
