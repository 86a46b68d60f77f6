"""Copies of one scene with different parameters, in one batched float64 simulation that can begin again.

Solver, integrator and substeps are those that the scene takes with its values at the start, for every copy and to the end of a
fit: a residual that changes its scheme with its parameters is no function. Where a stiffer copy needs shorter explicit steps,
all take them from then on.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from wsim.fitting.memory import MemoryForCopies, bytes_held_by
from wsim.fitting.parameter import Parameter
from wsim.scene import Problem, Scene, SceneError
from wsim.scene.values.table import limits_explicit_steps
from wsim.simulation import retry
from wsim.simulation.measure.reaction import reactions_in_all_worlds
from wsim.simulation.simulation import Simulation

WEIGHTS = ("mass", "inertia")           # with which momenta, which the state has, change and velocities do not


class BrokenRun(Exception):
    """A copy stopped being a number, or could not go on, in `frame`."""

    def __init__(self, frame: int, reason: str):
        super().__init__(f"frame {frame}: {reason}")
        self.frame, self.reason = frame, reason


def scene_with_named_choices(scene: Scene, device) -> Scene:
    """The scene with its solver, integrator, substeps and iterations named: what "auto" comes to at its present values."""
    return scene_as_simulated(scene, Simulation(scene, device=device, precision="float64"))


def scene_as_simulated(scene: Scene, sim: Simulation) -> Scene:
    """The scene with the choices that a simulation of it has made."""
    choice = sim.plan.choice
    if not sim.model.bodies:                             # no points, and no solver
        return replace(scene, substeps=choice.steps)
    return replace(scene, solver=choice.solver, integrator=choice.integrator.name, substeps=choice.steps,
                   iterations=choice.iterations)


def arrays_at_start(sim: Simulation) -> list[wp.array]:
    """The arrays with which a run begins."""
    return [array for array, _ in sim.state.copies()]


@dataclass
class SavedCopies:
    """The state of copies between two frames, on the host."""

    frame: int
    starting: bool
    arrays: list[np.ndarray]
    values: np.ndarray | None = None            # of the copies then, (worlds, parameters); None: those of the scene


class SceneCopies:
    """`begin` with values, go on `to` a frame, read `positions`; and again. Raises SceneError where the scene cannot run, or
    where there is no memory for so many."""

    def __init__(self, scene: Scene, parameters: list[Parameter], worlds: int, device=None):
        one = Simulation(scene, device=device, precision="float64")
        self.scene, self.parameters, self.worlds = scene_as_simulated(scene, one), parameters, worlds
        on, each = one.device, bytes_held_by(one) + sum(a.capacity for a in arrays_at_start(one))
        del one
        room = MemoryForCopies.on(on, len(parameters), worlds, each)
        room.check()
        try:
            self.sim = Simulation(self.scene, device=device, precision="float64", worlds=worlds)
        except SceneError as error:
            if "out of memory" in str(error):
                raise SceneError(room.problem()) from None
            raise
        self.warnings = list(self.sim.warnings)
        self.keep()

    def keep(self) -> None:
        """Remembers the start."""
        sim = self.sim
        clock = sim.plan.clock
        clock.touching = True                            # what one copy does must not depend on what others touch
        self.plan, self.substeps, self.steps, self.scheme = sim.plan, clock.substeps, clock.steps, clock.integrator
        self.values: np.ndarray | None = None
        self.arrays = arrays_at_start(sim)
        self.saved = [wp.clone(a) for a in self.arrays]

    def rewind(self) -> None:
        """Sets the copies back to the start; built anew where a frame has changed the scheme."""
        sim, clock = self.sim, self.sim.plan.clock
        if sim.plan is not self.plan or clock.integrator != self.scheme or sim.lost:
            sim.given = replace(sim.given, substeps=self.steps)
            sim.reset()
            self.keep()
            return
        self._weigh_as_at_first()
        for array, saved in zip(self.arrays, self.saved, strict=True):
            wp.copy(array, saved)
        if clock.substeps != self.substeps:
            clock.substeps = self.substeps
            sim.graphs.forget("substeps changed")
        clock.starting, sim.frame = True, 0
        sim.changes.clear()
        sim.milliseconds.clear()

    def _weigh_as_at_first(self) -> None:
        """Values of the scene in all copies: momenta among the arrays that were kept are those of its masses."""
        for p in self.parameters:
            for path, name, value in p.live(self.scene):
                if name in WEIGHTS:
                    for method in self.sim.plan.methods:
                        method.set_value(path, name, value, None)
        self.values = None

    def begin(self, values: np.ndarray) -> None:
        """Sets the copies back to the start, world k with the row k of values (worlds, parameters)."""
        self.rewind()
        stiff = [name for name in self.put(values) if limits_explicit_steps(name)]
        if stiff:
            retry.keep_stable(self.sim, stiff[0])
        self.substeps = self.sim.plan.clock.substeps

    def take(self, substeps: int) -> None:
        """Takes so many substeps a frame from now on, or more."""
        clock = self.sim.plan.clock
        if substeps > clock.substeps:
            clock.substeps = substeps
            self.sim.graphs.forget("substeps changed")
        self.substeps = clock.substeps

    def aside(self) -> SavedCopies:
        """The state now."""
        return SavedCopies(self.sim.frame, self.sim.plan.clock.starting, [array.numpy().copy() for array in self.arrays],
                           self.values)

    def enter(self, values: np.ndarray, state: SavedCopies | None) -> None:
        """Goes on from a state with other values; None: from the start."""
        if state is None or state.values is None:
            self._weigh_as_at_first()
        else:
            self.put(state.values)
        for k, (array, saved) in enumerate(zip(self.arrays, self.saved, strict=True)):
            if state is None:
                wp.copy(array, saved)
            else:
                array.assign(state.arrays[k])
        self.sim.frame, self.sim.plan.clock.starting = (state.frame, state.starting) if state else (0, True)
        self.put(values)
        self.sim.changes.clear()

    def put(self, values: np.ndarray) -> list[str]:
        """Values of every world (worlds, parameters) into the running copies; names of what was set."""
        sim, given = self.sim, {}
        self.values = np.array(values)
        for world, row in enumerate(values):
            scene = self.scene
            for p, value in zip(self.parameters, row, strict=True):
                scene = p.written(scene, float(value))
            given = {(path, name): value for p in self.parameters for path, name, value in p.live(scene)}
            for (path, name), value in given.items():
                if not any([m.set_value(path, name, value, world) for m in sim.plan.methods]):
                    raise SceneError(Problem(path, f"{name} is fixed while solver {sim.plan.choice.solver} runs; leave it out, "
                                             "or name another solver"))
        return [name for _, name in given]

    def to(self, frame: int) -> None:
        """Frames up to that one. Raises Broken."""
        sim = self.sim
        while sim.frame < frame:
            try:
                sim.step()
            except SceneError as error:
                raise BrokenRun(sim.frame + 1, error.problems[0].text) from None
            if sim.lost or sim.plan is not self.plan or sim.plan.clock.substeps != self.substeps:
                raise BrokenRun(sim.frame, sim.warnings[-1] if sim.warnings else "the scheme has changed")

    def look(self, seen) -> np.ndarray:
        """Quantity that an observation is about, in every copy, (worlds, n, 3): positions [m], or forces of a pin [N]."""
        if hasattr(seen, "field"):
            return self.fields(seen)
        if hasattr(seen, "local"):
            return seen.seen(self.sim.plan.ports.bodies.placed(seen.path))
        return self.positions(seen.path) if seen.unit == "m" else reactions_in_all_worlds(self.sim, seen.path)

    def fields(self, seen) -> np.ndarray:
        """Smoke or temperature of a fluid in every copy, as `seen` has it, (worlds, m)."""
        from wsim.fitting.observations.smoke import FIELDS
        method = self.sim.plan.ports.fluids
        own = [k for k, (fluid, _) in enumerate(method.pairs) if fluid.path == seen.path]
        values = np.stack([method.field(k, FIELDS[seen.field][0]).numpy().astype(np.float64) for k in own])
        return seen.seen(method.pairs[own[0]][0], values)

    def positions(self, path: str) -> np.ndarray:
        """World positions [m] of a body in every copy, (worlds, n, 3)."""
        state, bodies = self.sim.state, [b for b in self.sim.model.bodies if b.path == path]
        grains: Any = next((m for m in self.sim.plan.methods if hasattr(m, "read_particles")), None)
        if grains and path in [thing.path for thing in grains.things]:
            k = [thing.path for thing in grains.things].index(path)
            return np.stack([grains.read_particles(k, world)["x"] for world in range(self.worlds)])
        if not bodies:                                       # rods
            return np.stack([self.sim.positions(path, world) for world in range(self.worlds)])
        x = state.x.numpy().astype(np.float64) + state.e.numpy()
        return np.stack([x[b.index] + b.origin for b in bodies])
