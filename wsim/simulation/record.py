"""Recording of a simulation that is stepped from Python: each frame is a sample of a result layer over its scene.

    with simulation.record("out.usdc"):
        for frame in simulation.frames(24):
            ...

`wsim run` writes its frames by the same functions. What is read of points, here and by `Simulation`. How a simulation goes on
from a recording.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wsim.model.midnodes import restart_rows_of_body
from wsim.scene import Problem, SceneError
from wsim.scene.bodies import bodies_sampled_by_point
from wsim.scene.check.counts import checked_count
from wsim.scene.methods import all_scene_pins
from wsim.scene.samples import PointSample

if TYPE_CHECKING:
    from wsim.simulation.simulation import Simulation
    from wsim.usd.result.recorder import Recorder


def settings_of_run(sim: "Simulation", samples: int = 1) -> dict:
    """Settings by which a run is stepped now: what its result says, and what one that goes on from it is held against.
    samples: of the steps that make a frame."""
    return {"device": "cuda" if sim.device.is_cuda else "cpu", "precision": sim.precision, "solver": sim.plan.choice.solver,
            "integrator": sim.plan.integrator, "substeps": sim.plan.clock.steps * samples,
            "iterations": sim.plan.clock.iterations}


def points_of_path(sim: "Simulation", path: str | None, world: int, device: bool = False) -> PointSample | None:
    """Points by that path, None: the only ones, that are no body's, such as rods'; None: a body's are meant. device: they are
    asked for there, where bodies' are alone. Raises SceneError that lists the paths there are."""
    bodies = [b.path for b in sim.model.bodies if b.world == world]
    if path in bodies or (path is None and len(bodies) == 1):
        return None
    rest = [] if device else [s for s in sim.samples(min(max(world, 0), sim.worlds - 1)) if isinstance(s, PointSample)]
    found = [s for s in rest if path in (None, s.path)] if 0 <= world < sim.worlds else []
    if len(found) != 1 or (path is None and bodies):
        there = sorted({b.path for b in sim.model.bodies} | {s.path for s in rest})
        count = len(found) + len(bodies) * (path is None)
        raise SceneError(Problem(path or "path", f"world {world} has {count} prims with points{' on the device' * device} of "
                                 f"that path; there are {there} in worlds 0 to {sim.worlds - 1}; rigid bodies have "
                                 "poses(PATH), smoke and liquids fields(PATH)"))
    return found[0]


def positions_of_path(sim: "Simulation", path: str | None, world: int, device: bool):
    """World positions [m] of points by path, as `Simulation.positions` has them."""
    found = points_of_path(sim, path, world, device)
    if found is not None:
        return found.positions
    body = sim.model.body(path, world)
    if device:
        return sim.state.x, body.index
    x = sim.state.x.numpy().astype(np.float64) + sim.state.e.numpy()
    return x[_present_places(sim, body)] + body.origin


def _present_places(sim: "Simulation", body) -> np.ndarray:
    """Places in the state's arrays of a body's points, without particles that have not come or are gone."""
    arrivals = sim.plan.ports.arrivals
    return body.index[arrivals.which_are_there(body.path, body.world)] if arrivals and body.source.is_particles else body.index


def velocities_of_path(sim: "Simulation", path: str | None, world: int, device: bool):
    """Velocities [m/s] of points by path, as `Simulation.velocities` has them."""
    found = points_of_path(sim, path, world, device)
    if found is not None:
        return found.velocities
    body = sim.model.body(path, world)
    return (sim.state.v, body.index) if device else sim.state.v.numpy().astype(np.float64)[_present_places(sim, body)]


def poses_of_path(sim: "Simulation", path: str | None, world: int) -> dict[str, np.ndarray]:
    """Local-to-world transforms (4, 4) [m] by path, as `Simulation.poses` has them."""
    found = {c.path: c.motion.at(sim.time) for c in sim.scene.colliders if path in (None, c.path)}
    if (rigid := sim.plan.ports.bodies) is not None:
        found |= {body.path: M for (body, of), M in zip(rigid.bodies, rigid.poses(), strict=True)
                  if of == world and path in (None, body.path)}
    if path is not None and path not in found or not 0 <= world < sim.worlds:
        there = sorted({c.path for c in sim.scene.colliders} | {b.path for b in sim.scene.things("Body")})
        raise SceneError(Problem(path or "world", f"world {world} has no rigid body and no collider of that path; there are "
                                 f"{there} in worlds 0 to {sim.worlds - 1}"))
    return found


def append_sample(recorder: "Recorder", sim: "Simulation", code: float, stress: bool = False, reactions: bool = False,
                  others: Sequence = ()) -> None:
    """Writes the present state of every body, collider and method at a time code.

    stress       with von Mises stress and strain of soft bodies        reactions    with the reaction forces of pins
    others       further samples, see `wsim.scene.samples`
    """
    scene, paths = recorder.scene, [body.path for body in bodies_sampled_by_point(recorder.scene)]
    primvars = {s.path: sim.stress(s.path).at_points() for s in scene.bodies() if s.is_solid and stress}
    forces = {p.path: sim.reactions(p.path) for p in all_scene_pins(scene) if reactions}
    recorder.notes += [note for path in forces if not recorder.stage.GetPrimAtPath(path)
                       for note in [_unwritten_reaction_note(path)] if note not in recorder.notes]
    recorder.append(code, {p: sim.positions(p) for p in paths}, {p: sim.velocities(p) for p in paths},
                    _poses_given_by_run(recorder, sim), primvars, forces, [*sim.samples(), *others])


def _unwritten_reaction_note(pin: str) -> Problem:
    return Problem(pin, "its reaction forces are not written: a painted pin has no prim to take them; hold its points by a "
                   "PhysicsAttachment, or ask Simulation.reactions for them", fatal=False)


def _poses_given_by_run(recorder: "Recorder", sim: "Simulation") -> dict:
    """Of colliders that may move otherwise than their source says: they were given a motion here or in an earlier run. All
    are not asked: that takes 0.1 to 0.4 ms each, which the simulation does not need on the host."""
    given = {path for path, over in recorder.colliders.items() if over.op is not None}
    given |= {path for path, name, *_ in sim.changes if name == "motion"}
    return {c.path: c.motion.at(sim.time) for c in sim.scene.colliders if c.path in given}


def restart_from_fields(sim: "Simulation", frame: int, fields: dict[str, dict[str, np.ndarray]], alike: bool) -> None:
    """Goes on from what a recording has left; see `Simulation.restart`."""
    frame = checked_count("frame", frame)
    sim.plan.methods.prepare_restart(fields)
    misses = _fields_that_miss(sim, fields)
    for path in sim.state.paths():
        values = fields.get(path, {})
        for name, array, rows in sim.state.of(path):
            if name in values:
                now = array.numpy()
                now[rows] = values[name] if len(values[name]) == len(rows) else restart_rows_of_body(sim.model.body(path),
                                                                                                     values[name])
                array.assign(now)
    exact = alike and not misses
    if alike and fields and misses:
        path, why = next(iter(misses.items()))
        sim.warnings.append(f"warning: {path}: {why}: the run goes on from frame {frame} without history, to the order of "
                            "accuracy, not bit for bit")
    sim.frame, sim.plan.clock.starting, sim.measured, sim.settled = frame, not exact, False, None
    for method in sim.plan.methods if exact else ():
        method.resume_run((frame - 1) / sim.scene.fps)


def _fields_that_miss(sim: "Simulation", fields: dict[str, dict[str, np.ndarray]]) -> dict[str, str]:
    """What of the fields of an earlier run is not as this one has it, by path, in words. Raises SceneError for rows and shapes
    that no body of this run takes."""
    found, bodies = {}, [body.path for body in sim.model.bodies]
    for path in sim.state.paths():
        values, own = fields.get(path, {}), {name: (array, rows) for name, array, rows in sim.state.of(path)}
        for name, (array, rows) in own.items():
            shape = (len(rows), *array.numpy().shape[1:])
            given = np.shape(values.get(name, np.zeros(shape)))
            if given[1:] != shape[1:] or (given != shape and path not in bodies) or not given:
                raise SceneError(Problem(path, f"its restart field {name} has shape {given}; allowed is {shape}; restart with "
                                         "the scene that the result was made from"))
            if given != shape:
                found[path] = f"its restart field {name} has {given[0]} rows, and {len(rows)} are needed"
        for said, names in (("lack", own.keys() - values.keys()), ("hold more than this run has:", values.keys() - own.keys())):
            if names:
                found[path] = f"its restart fields {said} {', '.join(sorted(names))}"
    return found


class Record:
    """A result layer that grows by every frame that its simulation steps; a context manager, or closed by `close`.

    path         the result: .usdc, .usda or .usd, over the scene's file
    stress       with von Mises stress and strain of soft bodies        reactions    with the reaction forces of pins
    more         what `wsim.Recorder` takes: flatten, velocities, normals

    `result` is the finished file. After an exception the frames so far stay in NAME.partial.usdc.
    Raises SceneError for a simulation of several worlds, and as `wsim.Recorder` does.
    """

    def __init__(self, sim: "Simulation", path, *, stress: bool = False, reactions: bool = False, **more):
        from wsim.usd.result.recorder import Recorder
        if sim.worlds > 1:
            raise SceneError(Problem(str(path), f"a result holds one world, and the simulation has {sim.worlds}; record one of "
                                     "worlds=1"))
        self.sim, self.stress, self.reactions = sim, stress, reactions
        self.result: str | None = None
        self.recorder = Recorder(sim.given, path, restart_fields=lambda: {p: sim.fields(p) for p in sim.state.paths()},
                                 settings=lambda: settings_of_run(sim), **more)
        try:
            self._write(sim)
        except BaseException:
            self.recorder.close(interrupted=True)
            raise
        sim.watchers.append(self._write)

    def _write(self, sim: "Simulation") -> None:
        append_sample(self.recorder, sim, self.recorder.time_code(sim.frame), self.stress, self.reactions)

    @property
    def notes(self) -> list[Problem]:
        """Warnings of the file that grows."""
        return self.recorder.notes

    def close(self, interrupted: bool = False) -> str | None:
        """Ends the file and gives it its name, which is returned. Later frames are not written."""
        if self._write in self.sim.watchers:
            self.sim.watchers.remove(self._write)
        self.result = self.recorder.close(interrupted=interrupted)
        return self.result

    def __enter__(self) -> "Record":
        return self

    def __exit__(self, kind, error, trace) -> None:
        self.close(interrupted=kind is not None)
