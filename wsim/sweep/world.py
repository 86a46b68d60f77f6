"""One world of a simulation at the end of its run: errors, warnings, a digest of its state, and its result layer.

    max_strain, rms_strain             of edges of cloths and springs
    kinetic_energy, gravity_energy     [J]
    state                              digest of positions, their rounding remainders and velocities: two runs that agree in it
                                       ended alike to the bit

Each is of the world's own arrays, so that it does not depend on how many others there are. Methods of other things add theirs
(`wsim.model.stage.Method.measures_worlds`). Of scenes whose worlds share no arrays, errors are `Simulation.indicators`.
"""

import os
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wsim.scene.methods import has_other_objects
from wsim.simulation.measure.indicators import edge_strain
from wsim.sweep.share import reason_runs_go_apart
from wsim.usd.result.as_json import as_json
from wsim.usd.result.provenance import content_digest

if TYPE_CHECKING:
    from wsim.simulation.simulation import Simulation
    from wsim.sweep.job import Job

OF_WORLD = re.compile(r" \(world (\d+)\)")
SAID = "wsim:sweep"          # custom data of a result: run and draw


@dataclass
class FinishedWorld:
    """State of one world."""

    error: dict[str, float]
    warnings: list[str]
    state: str


def worlds_of(sim: "Simulation") -> list[FinishedWorld]:
    """Every world now."""
    if sim.worlds == 1 and reason_runs_go_apart(sim.scene):
        return [FinishedWorld(sim.indicators(), list(sim.warnings), _digest_of_fields(sim, 0))]
    if has_other_objects(sim.scene) or not sim.model.bodies:
        points = _points_of_worlds(sim) if sim.model.bodies else [FinishedWorld({}, [], "")] * sim.worlds
        return [FinishedWorld(found.error | _errors_of_methods(sim, world), _warnings_of_world(sim, world),
                              _digest_of_fields(sim, world)) for world, found in enumerate(points)]
    return _points_of_worlds(sim)


def _digest_of_fields(sim: "Simulation", world: int) -> str:
    """Of all that outlives a frame in a world, but what stands for none in particular, and what checks keep."""
    found = []
    for path in sorted(sim.state.paths()):
        fields = {name: array.numpy()[rows] for name, array, rows in sim.state.of(path, world, own=True)
                  if not name.startswith("balance_")}
        found.append((path, sorted(fields.items())))
    return content_digest(found)


def _errors_of_methods(sim: "Simulation", world: int) -> dict[str, float]:
    """Errors that methods measure of one world."""
    none = np.zeros((0, 3))
    found: dict[str, float] = {}
    for method in sim.plan.methods:
        if method.measures_worlds:
            found |= method.indicators(none, none, world)  # type: ignore[call-arg]
    return found


def _points_of_worlds(sim: "Simulation") -> list[FinishedWorld]:
    """Worlds of bodies of points."""
    s, model, points = sim.state, sim.model, sim.plan.ports.points
    x, e, v = (a.numpy() for a in (s.x, s.e, s.v))
    free, gravity = points.constants.w.numpy() > 0.0, points.gravity().astype(np.float64)
    masses = model.stack("masses")
    masses[model.gone] = 0.0
    each, found = len(model.bodies) // sim.worlds, []
    for world in range(sim.worlds):
        bodies = model.bodies[world * each:(world + 1) * each]
        place = slice(bodies[0].first, bodies[-1].last)
        error = _errors_of_world(bodies, place, x, e, v, masses * free)
        error["gravity_energy"] = float(-sum(np.sum(
            masses[b.first:b.last, None] * (x[b.first:b.last].astype(np.float64) + e[b.first:b.last] + b.origin)
            * gravity[b.first:b.last]) for b in bodies))
        found.append(FinishedWorld(error, _warnings_of_world(sim, world), content_digest([x[place], e[place], v[place]])))
    return found


def _errors_of_world(bodies, place: slice, x, e, v, masses) -> dict[str, float]:
    own = x[place].astype(np.float64) + e[place]
    whole = np.zeros((place.stop, 3))
    whole[place] = own
    strains = [edge_strain(b, whole) for b in bodies if len(b.edges)]
    out: dict[str, float] = {}
    if strains:
        strain = np.concatenate(strains)
        out["max_strain"] = float(np.abs(strain).max(initial=0.0))
        out["rms_strain"] = float(np.sqrt(np.mean(strain**2))) if len(strain) else 0.0
    out["kinetic_energy"] = float(0.5 * np.sum(masses[place] * np.sum(v[place].astype(np.float64)**2, axis=1)))
    return out


def _warnings_of_world(sim: "Simulation", world: int) -> list[str]:
    """Warnings of a world: those of all, and its own, without its number."""
    found = []
    for text in sim.warnings:
        named = OF_WORLD.search(text)
        if named is None or int(named[1]) == world:
            found.append(OF_WORLD.sub("", text))
    return found


class ResultLayers:
    """Result layers of the worlds of a simulation, as the job keeps them."""

    def __init__(self, job: "Job", members: list):
        """members: (number, draw, case) of each world."""
        self.keep, self.members = job.settings.keep, members
        self.recorders: list = []
        self.sim: Simulation | None = None
        if self.keep == "none":
            return
        from wsim.usd.result.recorder import Recorder
        folder = os.path.join(job.folder, "results")
        os.makedirs(folder, exist_ok=True)
        for number, _, case in members:
            self.recorders.append(Recorder(case.scene, os.path.join(folder, f"{number:06d}.usdc")))

    def look(self, sim: "Simulation") -> None:
        """The state of a frame, which is written where it is kept."""
        self.sim = sim
        if self.recorders and (self.keep == "all" or sim.frame == sim.scene.frames):
            self._append_frame(sim)

    def _append_frame(self, sim: "Simulation") -> None:
        if len(self.recorders) == 1:
            from wsim.simulation.record import append_sample
            append_sample(self.recorders[0], sim, self.recorders[0].time_code(sim.frame))
            return
        s = sim.state
        x, v = s.x.numpy().astype(np.float64) + s.e.numpy(), s.v.numpy().astype(np.float64)
        each = len(sim.model.bodies) // sim.worlds
        for world, recorder in enumerate(self.recorders):
            bodies = sim.model.bodies[world * each:(world + 1) * each]
            recorder.append(recorder.time_code(sim.frame), {b.path: x[b.index] + b.origin for b in bodies},
                            {b.path: v[b.index] for b in bodies}, None, {}, {}, sim.samples(world))

    def close(self, found: list[FinishedWorld]) -> list[str]:
        """Ends the files; their names within the folder of the sweep, "" where none is kept."""
        names = []
        for (number, draw, _), recorder, world in zip(self.members, self.recorders, found, strict=bool(self.recorders)):
            layer = recorder.file.layer
            layer.customLayerData = {**layer.customLayerData, SAID: as_json({"run": number, **draw, **world.error})}
            recorder.close()
            names.append(os.path.join("results", os.path.basename(recorder.path)))
        return names or [""] * len(self.members)

    def drop(self) -> None:
        """Removes what was written of runs that do not end here."""
        for recorder in self.recorders:
            recorder.close(interrupted=True)
            if recorder.kept and os.path.exists(recorder.kept):
                os.remove(recorder.kept)
        self.recorders = []
