"""The main job: a scene simulated into a result layer, frame by frame.

    preroll     frames before the first one, simulated and not written, in which cloth settles: every curve is moved
                later, so that the scene's own start stays where it was
    samples     written a frame: the scene is simulated with so many times its frame rate and as many substeps less,
                and every such short frame is written, at a fraction of a time code

An interruption or a failure keeps the frames that were written, in a file of their own beside an earlier result; Ctrl-C waits
while a frame is being written.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from shlex import quote
from time import perf_counter
from typing import TYPE_CHECKING

from wsim.scene import Collider, Pin, Problem, Scene, SceneError, Surface
from wsim.scene.check.counts import refuse_large_count
from wsim.scene.curve import Curve, Motion
from wsim.scene.methods import count_noun, has_tets
from wsim.simulation import interrupt
from wsim.simulation.duration import long_run
from wsim.simulation.interrupt import delay_interrupts
from wsim.simulation.record import append_sample, settings_of_run
from wsim.usd.result.provenance import changed_settings

if TYPE_CHECKING:
    from wsim.simulation.simulation import Simulation
    from wsim.usd.result.recorder import Recorder
    from wsim.usd.result.restart import RestartState


def subdivide_frames(scene: Scene, samples: int) -> Scene:
    """The scene with `samples` frames for each of its own, and substeps of the same length or a little shorter."""
    if samples == 1:
        return scene
    return replace(scene, fps=scene.fps * samples, frames=scene.frames * samples,
                   substeps=type(scene.substeps)(-(-scene.substeps // samples)))


def delay_scene_curves(scene: Scene, delay: float) -> Scene:
    """The scene with every curve and pour `delay` [s] later, so that simulating begins that long before its start."""
    if delay == 0.0:
        return scene
    bones = {id(b): b.later(delay) for b in scene.things("Skeleton")}
    objects = {name: [_thing_later(thing, delay, bones) for thing in found] for name, found in scene.objects.items()}
    objects |= {"Skeleton": list(bones.values())} if bones else {}
    return replace(scene, frames=scene.frames + round(delay * scene.fps), objects=objects,
                   colliders=[_collider_later(c, delay, bones) for c in scene.colliders],
                   pins=[_pin_later(p, delay, bones) for p in scene.pins],
                   loads=[replace(load, curve=_curve_later(load.curve, delay)) for load in scene.loads],
                   varying=[replace(v, curve=_curve_later(v.curve, delay)) for v in scene.varying])


def _thing_later(thing, delay: float, bones: dict):
    """An object whose curves, pour, and pins of its own, act `delay` [s] later."""
    own = ((f.name, getattr(thing, f.name)) for f in fields(thing) if f.init)
    later: dict = {name: _curve_later(value, delay) for name, value in own
                   if isinstance(value, Curve) and len(value.times) > 1}
    if getattr(thing, "pour", None) is not None:
        later["pour"] = thing.pour.later(delay)
    if getattr(thing, "pins", None):
        later["pins"] = [_pin_later(pin, delay, bones) for pin in thing.pins]
    return replace(thing, **later) if later else thing


def _motion_later(motion: Motion, delay: float) -> Motion:
    return motion.later(delay)


def _curve_later(curve: Curve, delay: float) -> Curve:
    return curve.later(delay)


def _pin_later(pin: Pin, delay: float, bones: dict) -> Pin:
    follows = pin.follows and replace(pin.follows, skin=_skin_later(pin.follows.skin, bones))
    return replace(pin, motion=_motion_later(pin.motion, delay), follows=follows)


def _skin_later(skin, bones: dict):
    return replace(skin, skeleton=bones[id(skin.skeleton)])


def _collider_later(collider: Collider, delay: float, bones: dict) -> Collider:
    shape = collider.shape
    if isinstance(shape, Surface) and shape.poses is not None:
        skinned = hasattr(shape.poses, "skeleton")
        shape = replace(shape, poses=_skin_later(shape.poses, bones) if skinned else _curve_later(shape.poses, delay))
    return replace(collider, shape=shape, motion=_motion_later(collider.motion, delay))


@dataclass
class RecordedRun:
    """A simulation and the recorder that its frames go to; `scene` is the one that is written.

    `shown` is called with (short frames done), each of `watchers` with (simulation) after every written one.
    """

    scene: Scene
    simulation: "Simulation"
    recorder: "Recorder"
    samples: int = 1
    preroll: int = 0
    first: int = 0                                # frames that an earlier run has done and written
    stress: bool = False                          # written with the points of soft bodies, see `wsim.simulation.measure.stress`
    colour: str = ""                              # displayColor by strain or stress, see `wsim.show.colour`; "": not written
    reactions: bool = False                       # of every pin, written with it, see `wsim.simulation.measure.reaction`
    shown: Callable[[int], None] = lambda done: None
    watchers: list[Callable] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=lambda: {"simulate": 0.0, "write": 0.0})
    written: int = 0                              # whole frames, counted from the scene's start
    result: str | None = None                     # the finished file; None while there is none

    @property
    def steps(self) -> int:
        """Short frames of the whole run."""
        return (self.preroll + self.scene.frames - self.first) * self.samples

    def kept(self) -> str:
        """Text about what a run that did not come to its end has left."""
        kept, output = self.recorder.kept, self.recorder.path
        text = "no frame was written" + (f"; {kept} holds those of an earlier run" if kept else "")
        if kept and self.recorder.count:
            text = f"{kept} holds the {count_noun(self.written, 'frame')} so far (go on with --restart {quote(kept)})"
        return text + (f"; {output} is as it was before" if os.path.exists(output) else "")

    def frames(self) -> None:
        """All frames. Where it does not come to the end, `recorder.kept` holds what was written before."""
        ended = False
        try:
            for done in range(self.preroll * self.samples):
                self._step(done + 1)
            if not self.first:
                self._write(0)
            for k in range(1, (self.scene.frames - self.first) * self.samples + 1):
                self._step(self.preroll * self.samples + k)
                self._write(k)
            interrupt.raise_if_interrupted()
            ended = True
        finally:
            with delay_interrupts(), self._time_phase("write"):
                self.result = self.recorder.close(interrupted=not ended)

    def measure(self, asked: bool) -> float:
        """Steps what the report measures errors by, unless it is not asked for, or Ctrl-C comes; seconds."""
        from wsim.simulation.predicted.measured import leave_out, step_report_estimates
        began = perf_counter()
        try:
            if asked:
                step_report_estimates(self.simulation)
        except KeyboardInterrupt:
            asked = False
        if not asked:
            leave_out(self.simulation)
        return perf_counter() - began

    @contextmanager
    def _time_phase(self, name: str) -> Iterator[None]:
        began = perf_counter()
        try:
            yield
        finally:
            self.seconds[name] += perf_counter() - began

    def _step(self, done: int) -> None:
        with self._time_phase("simulate"):
            self.simulation.step()
        self.shown(done)

    def _write(self, k: int) -> None:
        """The state after k short frames of this run, at its time code."""
        code = self.recorder.time_code(self.first + k / self.samples)
        with delay_interrupts(), self._time_phase("write"):
            append_sample(self.recorder, self.simulation, code, self.stress, self.reactions, self._recorded_colours())
        self.written = self.first + k // self.samples
        for watch in self.watchers:
            watch(self.simulation)

    def _recorded_colours(self) -> list:
        if not self.colour:
            return []
        from wsim.show.colour import colours_of_simulation
        return colours_of_simulation(self.simulation, self.colour)


def default_output(scene: str) -> str:
    """Path that a run without -o writes: SCENE.sim.usdc beside the scene, or here where that folder takes no file."""
    folder, name = os.path.split(os.path.abspath(scene))
    name = f"{os.path.splitext(name)[0]}.sim.usdc"
    return os.path.relpath(os.path.join(folder, name)) if os.access(folder, os.W_OK) else name


def prepare_recorded_run(scene: Scene, output: str, simulate: Callable[[Scene], "Simulation"], *, samples: int = 1,
                         preroll: int = 0,
                         flatten: bool = False, restart: str | None = None, stress: bool = False) -> RecordedRun:
    """The part of a run that comes before the first frame, so that what cannot work fails before it has cost time.

    simulate    makes the simulation of a scene (device and precision are its matter)
    restart     an earlier result of this scene to go on from; frames are still counted from the scene's start
    stress      writes von Mises stress and strain of soft bodies as primvars; a warning where there is none

    Raises SceneError, and OSError where the output cannot be written.
    """
    from wsim.usd.result.partial import partial_path
    from wsim.usd.result.recorder import Recorder, check_result
    from wsim.usd.result.restart import load_restart

    try:
        check_result(scene, output, restart)
        earlier = load_restart(restart, scene) if restart else None
        if earlier and earlier.frame >= scene.frames:
            raise SceneError(Problem(earlier.path, f"holds {earlier.frame} frames, {scene.frames} are asked for; give "
                                     "--frames a larger number: it counts from the scene's start"))
        for what, each in (("--samples times frames", samples * scene.frames), ("--preroll times samples", preroll * samples)):
            refuse_large_count(what, each, "give fewer of either")
        sim = simulate(delay_scene_curves(subdivide_frames(scene, samples), preroll / scene.fps))
        sim.warnings += long_run(sim.plan, preroll + scene.frames - (earlier.frame if earlier else 0), samples)
        if earlier:
            _resume_from_restart(sim, earlier, samples)

        def exact_restart_fields() -> dict:
            """Fields that an exact restart needs, of whole frames."""
            return {} if sim.frame % samples else {path: sim.fields(path) for path in sim.state.paths()}

        # from here on there is a file
        interrupt.set_interrupt_mode("wait", f"{partial_path(output)} holds the frames saved so far")
        recorder = Recorder(scene, output, flatten=flatten, restart_fields=exact_restart_fields, continues=earlier,
                            settings=lambda: settings_of_run(sim, samples))
        if stress and not has_tets(scene):
            recorder.notes.append(Problem("--stress", "there is no soft body whose stress could be written", fatal=False))
    except ValueError as error:                   # the recorder's word for an output that would be a mistake
        raise SceneError(Problem(output, str(error).removeprefix(f"{output}: "))) from error
    return RecordedRun(scene, sim, recorder, samples, preroll, earlier.frame if earlier else 0, stress)


def _resume_from_restart(sim: "Simulation", earlier: "RestartState", samples: int) -> None:
    """Puts the simulation where an earlier run was, bit for bit where the result holds what that takes and this run is stepped
    as that one was."""
    fields = earlier.fields
    sim.plan.methods.prepare_restart(fields)                 # substeps that checks have raised are part of what is gone on with
    if others := changed_settings(earlier.made, settings_of_run(sim, samples)):
        fields = {path: own for path, own in fields.items() if path not in earlier.positions}
        earlier.notes.append(Problem(earlier.path, f"was run otherwise ({'; '.join(others)}): the run goes on from positions "
                                     "and velocities, to the order of accuracy, not bit for bit", fatal=False))
    if not fields.keys() & earlier.positions.keys():
        for path, positions in earlier.positions.items():
            sim.set(path, "positions", positions)
            if path in earlier.velocities:
                sim.set(path, "velocities", earlier.velocities[path])
    sim.restart(earlier.frame * samples, fields, alike=not others)
    sim.warnings += [str(note) for note in earlier.notes]
