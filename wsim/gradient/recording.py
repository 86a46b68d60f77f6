"""A run that can be differentiated: frames forward, and the adjoint of all that they did backward.

Frames are recorded once (`wsim.model.tape`) and replayed as graphs, forward and backward. What the backward pass reads of a
frame is either kept for all frames, or for a segment at a time (some substeps, or frames): then each segment leaves the arrays
with which it began, and runs once more before it is differentiated (checkpoints; Griewank, Walther 2000, Algorithm 799).
"""

from dataclasses import dataclass
from math import ceil

import warp as wp

from wsim.gradient.amplification import GradientGrowth
from wsim.gradient.apart import DifferenceToSimulation
from wsim.gradient.checkpoints import CheckpointCosts, bytes_of_launches, in_words, measure_recording_cost
from wsim.gradient.gradient import FetchedArrays, Gradient
from wsim.gradient.loss import LossCotangents
from wsim.gradient.tables import GradientTables
from wsim.gradient.trajectory import RecordedFrames
from wsim.model import kernel_cache
from wsim.model.arena import ArraySlots
from wsim.model.kernel_cache import GATE
from wsim.model.tape import RecordedArray, Tape
from wsim.scene import Problem, SceneError
from wsim.simulation.measure.diagnose import judge_recorded_run
from wsim.simulation.measure.exceeded import EXPLICIT
from wsim.simulation.simulation import Simulation

LEFT = 1e-6            # [m/s] that impulses of bodies may leave, from which a warning is due
POOR = 1e-4            # residual of an implicit solve from which a warning is due


@dataclass
class RecordedStretch:
    """A part of a frame, recorded, and graphs of both directions."""

    tape: Tape
    forward: wp.Graph | None = None
    backward: wp.Graph | None = None


class Recording(RecordedFrames):
    """Frames of a simulation from where it stands, forward by `run`, backward by `backward`, as in
    `Recording(simulation, 2).run()`. Live parameters may change between runs, but not the number of substeps or the start.

    keep   "all": memory for every frame; "checkpoints": for a segment, which runs twice; "auto": by bytes
    Raises SceneError where the simulation has no gradients, or a method of the scene has none.
    """

    @GATE.alone()
    def __init__(self, sim: Simulation, frames: int, keep: str = "auto"):
        if not sim.model.gradients:
            raise SceneError(Problem("gradients", "found False; a recording needs Simulation(scene, gradients=True)"))
        if frames < 1:
            raise SceneError(Problem("frames", f"found {frames}; allowed is 1 or more"))
        if keep not in ("auto", "all", "checkpoints"):
            raise SceneError(Problem("keep", f"found {keep!r}; allowed are auto, all, checkpoints"))
        if sim.scene.varying:
            from wsim.simulation import varying
            varying.refuse_varying_values(sim)
        sim.load()
        self.sim, self.frames, self.plan, self.state = sim, frames, sim.plan, sim.state
        self.start, self.begins, self.jumps = sim.frame, self.plan.clock.starting, self.plan.starts
        self.roots: list[RecordedArray] = []
        self.slots, self.parameters = ArraySlots(sim.device, sim.model.real), GradientTables(self.plan)
        self.moved, self.bodies = self.state.parts.get("points"), self.plan.ports.recorded_bodies
        self.fluids, self.grains = self.plan.ports.recorded_fluids, self.plan.ports.recorded_points
        self.every = self.moved.every if self.moved else wp.zeros(0, dtype=sim.model.real, device=sim.device)
        self.initial = wp.clone(self.every)
        self.marks = [(array, wp.clone(array)) for array, _ in (self.moved.saved.values() if self.moved else ())]
        self.flowed = [(array, wp.clone(array)) for part in self.state.parts.values() if part is not self.moved
                       for array, _ in part.copies()]
        self.stretches: dict[tuple, RecordedStretch] = {}
        self.cost: CheckpointCosts | None = None
        with in_words(self.known, str(sim.device)):
            self.choose(keep)
            self.prepare()
            self.allot()
        self.recorded, self.growth = self.shape, GradientGrowth(frames, sim.device, sim.model.real)
        self.apart: DifferenceToSimulation | None = None  # difference from a simulation, after the first run
        self.residuals: dict[str, float] = {}         # of implicit solves, after `backward`
        self.rewind()

    # what is recorded and kept

    def choose(self, keep: str) -> None:
        """Measures a frame, and chooses how many are kept at a time."""
        S, F = self.plan.clock.substeps, self.frames
        self.cost, scalars = measure_recording_cost(self)
        if self.bodies and self.bodies.whole:
            if keep == "checkpoints":
                raise SceneError(Problem("keep", f"found {keep!r}; allowed with joints or contacts of bodies are auto, all"))
            keep = "all"
        length = self.cost.choose(keep)
        self.checkpoints = length > 0
        self.group, self.cuts = max(length // S, 1) if length else F, [0, S]
        if 0 < length < S:
            length += -length % self.plan.clock.integrator.solves        # a step is not cut
            self.cuts = [*range(0, S, length), S]
        count = length if len(self.cuts) > 2 else S * min(F, self.group + self.jumps)
        share = 1.0 + self.cost.over / (count * self.cost.each)
        self.slots.reserve(tuple(ceil(n * count * share) for n in scalars))

    def prepare(self) -> None:
        """Records every stretch once; allocates what checkpoints need."""
        self.rewind()
        for frame in range(min(self.frames, self.group + self.jumps)):
            self.pose(frame)
            for part in range(len(self.cuts) - 1):
                if len(self.cuts) > 2:
                    self.slots.rewind()
                self.stretches[self._stretch_key(frame, part)] = RecordedStretch(self.record(*self.cuts[part:part + 2]))
            self.plan.clock.starting = False
        found = {id(r) for stretch in self.stretches.values() for r, _ in stretch.tape.entries}
        self.carried = [r for r in self.roots if id(r) in found]
        count = ceil(self.frames / self.group) * (len(self.cuts) - 1) if self.checkpoints else 0
        self.saved = [[wp.empty_like(r.base) for r in self.carried] for _ in range(count)]

    @property
    def shape(self) -> tuple:
        """Part of a simulation that may not change after it was recorded."""
        clock, stride = self.plan.clock, self.plan.ports.target_stride
        return (clock.substeps, clock.integrator.name, stride() if stride else 0,
                *(array.ptr for array in self.parameters.targets()))

    def _stretch_key(self, frame: int, part: int) -> tuple:
        return frame % self.group, part, self.jumps and frame == 0

    def record(self, first: int, last: int) -> Tape:
        """Runs substeps first .. last once, recording."""
        model = self.sim.model
        tape = model.tape = Tape(self.slots, self.roots, model.plain, model.vjp)
        try:
            tape.begin()
            for table in self.plan.solids:               # run once more, it begins as it did
                table.forget()
            self.plan.stretch(first, last)
            tape.finish()
        except ValueError as error:
            raise SceneError(Problem("gradients", f"{error}; leave out what needs it, or choose another solver")) from None
        finally:
            model.tape = None
        return tape

    def rewind(self) -> None:
        """The state that the recording began with."""
        for array, initial in ((self.every, self.initial), *self.marks, *self.flowed):
            wp.copy(array, initial)
        self.plan.clock.starting = self.begins

    def pose(self, frame: int) -> None:
        """Poses of pins and colliders in a frame."""
        self.plan.before_frame((self.start + frame) / self.sim.scene.fps)

    def known(self) -> tuple[CheckpointCosts, int, int] | None:
        """The cost, bytes that are needed and those that were got, where the first are known."""
        cost = self.cost
        return None if cost is None else (cost, cost.bytes(cost.best) if self.checkpoints else cost.full, self.slots.bytes)

    @property
    def bytes(self) -> int:
        """Memory of versions, their gradients and checkpoints, and of what the host keeps: on a CPU also recorded launches."""
        launches = sum(bytes_of_launches(stretch.tape, self.sim.device) for stretch in self.stretches.values())
        return self.slots.bytes + sum(a.capacity for arrays in self.saved for a in arrays) + int(launches)

    # forward

    @GATE.shared()
    def run(self) -> None:
        """All frames from the beginning. Raises SceneError when a position is no number, or frames are not those recorded."""
        self.rewind()
        self.pose(0)
        if self.sim.plan is not self.plan or self.shape != self.recorded:
            raise SceneError(Problem("recording", "the simulation now has other substeps or another integrator, or pins that "
                                     "move where they stood still; make another Recording"))
        self.plan.status.begin()
        for array in self.misses():
            array.zero_()
        self.keep(0)
        for frame in range(self.frames):
            self.pose(frame)
            for part in range(len(self.cuts) - 1):
                if self.checkpoints and (frame % self.group == 0):
                    for array, root in zip(self.saved[self._segment_number(frame, part)], self.carried, strict=True):
                        wp.copy(array, root.base)
                self.forward(frame, part)
            self.keep(frame + 1)
        self.sim.frame, self.plan.clock.starting, self.ran = self.start + self.frames, False, True
        judge_recorded_run(self, f"an edge is more than twice its rest length: {EXPLICIT}")
        if self.apart is None and self.plan.ports.solve_adjoint:
            self.apart = DifferenceToSimulation(self)

    def misses(self) -> list[wp.array]:
        """Residuals that the worst forward and the worst adjoint solve of implicit steps have left."""
        return [adjoint.missed, adjoint.left] if (adjoint := self.plan.ports.solve_adjoint) else []

    def warn(self, text: str) -> None:
        """Adds a warning to the simulation's, once."""
        if text not in self.sim.warnings:
            self.sim.warnings.append(text)

    def _segment_number(self, frame: int, part: int) -> int:
        return frame // self.group * (len(self.cuts) - 1) + part

    def forward(self, frame: int, part: int) -> None:
        """Runs a part of a frame again."""
        stretch = self.stretches[self._stretch_key(frame, part)]
        if stretch.tape.eager:
            return stretch.tape.forward()
        if stretch.forward is None:
            stretch.forward = self._capture_stretch_graph(stretch.tape.forward)
        wp.capture_launch(stretch.forward)

    def _capture_stretch_graph(self, launch) -> wp.Graph:
        with kernel_cache.capture_graph(self.sim.device) as capture:
            launch()
        return capture.graph

    # backward

    @GATE.shared()
    def backward(self, positions: dict | None = None, velocities: dict | None = None, reactions: dict | None = None,
                 poses: dict | None = None, twists: dict | None = None, fluids: dict | None = None) -> Gradient:
        """Gradient of a loss whose derivatives by positions [1/m] and velocities [s/m] after some frames are given:
        {frame: (n, 3) in the author's order, or {path: (n, 3)}, or {(path, world): (n, 3)}, or an array of the device over all
        points in the solver's order, which must be finite}; so by reactions of pins [1/N], by path; so of rigid bodies by
        `poses`, (4, 4), and `twists`, (2, 3), see `Recording.poses`; so of smoke by `fluids`, {frame: {path: {"smoke",
        "temperature", "velocity"}}}, see `Recording.fluid`. Raises SceneError for frames and shapes that are none.
        """
        if not self.ran:
            self.run()
        seeds = LossCotangents(self, positions, velocities, reactions, poses, twists, fluids)
        for root in self.roots:
            root.carried.zero_()
        self.parameters.zero()
        for array in (*self.misses()[1:], self.growth.sums):
            array.zero_()
        targets, motions = [], []
        for frame in reversed(range(self.frames)):
            seeds.add(frame + 1)
            self.note(frame, False)
            if self.checkpoints and (frame + 1 == self.frames or (frame + 1) % self.group == 0) and len(self.cuts) == 2:
                self.again(frame)
            self.pose(frame)
            for part in reversed(range(len(self.cuts) - 1)):
                if len(self.cuts) > 2:
                    self._restore_checkpoint(frame, part)
                    self.forward(frame, part)
                self._reverse_part(frame, part)
            targets.append(self.parameters.take_targets(frame == 0))
            motions.append(self.parameters.take_motions())
            seeds.take()
            self.note(frame, True)
        seeds.add(0)
        self.look(seeds)
        states = FetchedArrays({r.base.ptr: wp.clone(r.carried) for r in self.roots})
        if self.apart and self.parameters.contact and not seeds.pulls:
            self.apart.tell_gradient(self, seeds, states)
        return Gradient(self.parameters, states, targets[::-1], motions[::-1], seeds)

    def look(self, seeds: LossCotangents) -> None:
        """Writes what implicit solves have left into `residuals`: gradients are as right as those are small."""
        self.residuals = dict(zip(("forward", "adjoint"), [float(a.numpy()[0]) for a in self.misses()], strict=False))
        if seeds.fluids:
            self.residuals["pressure adjoint"] = seeds.fluids.worst
        for name, value in self.residuals.items():
            if not value < POOR:
                self.warn(f"/: gradients: the worst {name} solve has left {value:.1e} of its right side; they are no better "
                          "than that. Take smaller substeps")
        if self.bodies and self.bodies.left > LEFT:
            self.warn(f"/: gradients: contacts and joints of bodies were solved to {self.bodies.left:.1e} m/s; they are no "
                      "better than that. Take smaller substeps, more iterations, a smaller contact_tolerance in float64")
        if said := self.growth.check(self.start, self.sim.scene.fps, self.sim.precision):
            self.warn(said)

    def note(self, frame: int, after: bool) -> None:
        """The norm of the gradient by the positions at the end of a frame, or (after its adjoint) at its begin."""
        if self.moved:
            root = next(r for r in self.roots if r.base.ptr == self.state.x.ptr)
            self.growth.note(root.carried, frame, after)

    def again(self, last: int) -> None:
        """The segment that ends with frame `last`, from its checkpoint."""
        first = last // self.group * self.group
        self._restore_checkpoint(first, 0)
        for frame in range(first, last + 1):
            self.pose(frame)
            self.forward(frame, 0)

    def _restore_checkpoint(self, frame: int, part: int) -> None:
        for array, root in zip(self.saved[self._segment_number(frame, part)], self.carried, strict=True):
            wp.copy(root.base, array)

    def _reverse_part(self, frame: int, part: int) -> None:
        stretch = self.stretches[self._stretch_key(frame, part)]
        if stretch.tape.eager:
            return stretch.tape.backward()
        if stretch.backward is None:
            stretch.backward = self._capture_stretch_graph(stretch.tape.backward)
        wp.capture_launch(stretch.backward)
