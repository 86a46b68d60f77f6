"""One run of a scene with one setting: where its points are at sampled frames, and what a frame takes.

    size       largest extent of a body at the start [m], at least 1 mm: errors are over it
    distance   RMS over the points of |x - y|, at every sampled frame, (samples,) [m]
    ms         of a warm frame, the median: on a CPU its seconds in all threads of this process, so that others on the machine
               do not count; on a GPU wall clock
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter, process_time

import numpy as np

from wsim.bench.setting import Setting
from wsim.scene import Scene
from wsim.simulation.choice import SchemeChoice
from wsim.simulation.simulation import Simulation

SAMPLES = 12           # frames whose positions are kept
WARM, LASTING = 3, 0.1 # frames that are timed at least, and [s] that they last together; frames may go on for it
MOST = 64              # to so many
LONGEST = 256          # substeps of one graph in a reference; more are taken as shorter frames


@dataclass(frozen=True)
class SampledFrames:
    """The settings that all runs of a bench share: device, frames, and which of them are sampled."""

    device: str | None
    frames: int

    @property
    def sampled(self) -> list[int]:
        count = min(self.frames, SAMPLES)
        return [round((k + 1) * self.frames / count) for k in range(count)]


@dataclass
class Trajectory:
    """Positions that one run left. places (samples, points, 3) [m] in world space, the author's order, all bodies."""

    setting: Setting                       # as it ran
    places: np.ndarray
    start: np.ndarray                      # places before the first frame, (points, 3)
    ms: float
    seconds: float                         # of the frames, compiling and capturing not counted
    notes: list[str] = field(default_factory=list)
    found: dict[str, float] = field(default_factory=dict)      # after the last frame, where measured


def largest_body_extent(scene: Scene) -> float:
    """Largest extent of a body at the start [m]; at least 1 mm."""
    extents = [np.ptp(body.motion.points(body.points), axis=0).max() for body in scene.bodies() if len(body.points)]
    return max([1e-3, *map(float, extents)])


def rms_point_distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """RMS over the points at each sampled frame [m]; shapes (samples, points, 3)."""
    return np.sqrt(np.mean(np.sum((a - b)**2, axis=-1), axis=-1))


def all_world_positions(sim: Simulation) -> np.ndarray:
    """World positions of every point [m], (points, 3)."""
    return np.concatenate([sim.positions(body.path) for body in sim.scene.bodies()])


def measure_energies(sim: Simulation) -> dict[str, float]:
    """Energies [J], strain and residual now, and the work of gravity since the start [J]."""
    model, x = sim.model, sim.state.x.numpy().astype(np.float64) + sim.state.e.numpy()
    fallen = (x - model.stack("places")) @ np.asarray(sim.scene.gravity)
    return sim.indicators() | {"gravity_work": float(model.stack("masses") @ fallen)}


def run_with_setting(scene: Scene, setting: Setting, look: SampledFrames, prepare: Callable[[Simulation], None] | None = None,
                     measured: bool = False, timed: bool = True) -> Trajectory:
    """Simulates look.frames frames; `prepare` may move the points first; `measured` gathers energies and strains too, by
    kernels that are compiled for it; `timed`: frames go on after those until their time is known well.

    Raises SceneError where the scene cannot be stepped so.
    """
    sim = Simulation(setting.applied_to_scene(scene), device=look.device, precision=setting.precision)
    if prepare:
        prepare(sim)
    choice, start, kept, spent = sim.plan.choice, all_world_positions(sim), list[np.ndarray](), list[float]()
    while sim.frame < look.frames:
        spent.append(_time_one_step(sim))
        if sim.frame in look.sampled:
            kept.append(all_world_positions(sim))
    found = measure_energies(sim) if measured else {}
    notes = _notes_on_setting_changes(sim, choice)
    wall = sim.milliseconds[2:] or sim.milliseconds[-1:]
    while timed and (len(spent) < 2 + WARM or (sum(spent[2:]) < 1e3 * LASTING and len(spent) < MOST)):
        spent.append(_time_one_step(sim))
    ms, seconds = float(np.median(spent[2:] or spent)), 1e-3 * float(np.mean(wall)) * look.frames
    ran = Setting(choice.solver, choice.integrator.name, choice.steps, choice.iterations, setting.precision)
    return Trajectory(ran, np.stack(kept), start, ms, seconds, notes, found)


def _time_one_step(sim: Simulation) -> float:
    """A frame, and its time [ms]; the first two compile, capture, and start BDF2."""
    clock = perf_counter if sim.device.is_cuda else process_time
    began = clock()
    sim.step()
    return 1e3 * (clock() - began)


def _notes_on_setting_changes(sim: Simulation, choice: SchemeChoice) -> list[str]:
    """What became on the way of a choice that was made."""
    clock, notes = sim.plan.clock, []
    if sim.plan.choice.solver != choice.solver:
        return [f"gave way to {sim.plan.choice.solver}"]
    if sim.plan.integrator != choice.integrator.name:
        notes.append("gave way to backward Euler")
    if clock.substeps != choice.substeps:
        notes.append(f"took {clock.steps} substeps where a point stopped being a number")
    return notes


def run_in_shorter_frames(scene: Scene, setting: Setting, look: SampledFrames,
                          prepare: Callable[[Simulation], None] | None = None, measured: bool = False) -> Trajectory:
    """A run as `run_with_setting` makes it, with frames cut so that no graph holds more than LONGEST substeps: for references,
    whose substeps are many. What is done once a frame, as uploading motions, is done more often then."""
    cut = -(-setting.substeps // LONGEST)
    short = replace(scene, fps=scene.fps * cut)
    shorter = replace(setting, substeps=-(-setting.substeps // cut))
    track = run_with_setting(short, shorter, _CutSampledFrames(look.device, look.frames * cut, cut), prepare, measured,
                             timed=False)
    return replace(track, setting=replace(track.setting, substeps=track.setting.substeps * cut), ms=track.ms * cut)


@dataclass(frozen=True)
class _CutSampledFrames(SampledFrames):
    """Frames cut into so many: the samples stay where they were."""

    cut: int = 1

    @property
    def sampled(self) -> list[int]:
        return [k * self.cut for k in SampledFrames(self.device, self.frames // self.cut).sampled]
