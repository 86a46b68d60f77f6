"""What a recording begins with and reads, by name: values that can be read, written and differentiated by.

    /World/Cloth:positions, :velocities      (n, 3) [m], [m/s] where the recording begins, in world space, author's order
    /World/Cloth:rest_shape                  (n, 3) [m] where points are at rest; of a net :lengths, (edges,) [m]
    /World/Cloth:stretch, :density, ...      () one value of a live parameter, or (elements,) one for each element
    /World/Net:actuation                     factors of a net's muscles, (keys, groups) of its curve
    /World/Pin:targets                       where a pin puts its points [m]: (frames, moments of a frame, n, 3), see
                                             `wsim.model.stage.Clock.moments`, or (n, 3) if it is still
    /World/Load:force, :traction             of a load [N], [Pa]: (3,), or (keys, 3) of its curve
    gravity, wind                            (3,) [m/s^2], [m/s] of the whole scene
    air_drag                                 () [1/s]
    friction, restitution, colliders' shifts: `wsim.gradient.inputs.contact`

Elements are springs and tets in the author's order, hinges in the solver's. With several worlds a value may have one axis more,
the worlds, in front; without it all worlds share the value. Points that are one particle (a weld, a tie) have one place: that
of the last of them.
"""

from typing import Any

import numpy as np

from wsim.gradient.inputs.base import PART, Input, Start
from wsim.gradient.inputs.contact import contact_input
from wsim.gradient.inputs.controls import Actuation, Loaded, Targets
from wsim.gradient.inputs.rest import Rest
from wsim.scene import Problem, SceneError, Springs
from wsim.scene.masses import density_of
from wsim.simulation.retry import STIFFENS

SCENE = {"gravity": (3,), "wind": (3,), "air_drag": ()}


class Whole(Input):
    """gravity, wind or air_drag, of the whole scene."""

    def read(self, world: int = 0) -> np.ndarray:
        p = self.recording.parameters
        if self.what == "wind" and not p.air:
            raise SceneError(Problem(self.name, "no cloth has drag or lift, so that wind does nothing; leave it out"))
        points = p.plan.find("points")
        array = points.gravity() if self.what == "gravity" else (p.air.wind if self.what == "wind" else p.points.decay).numpy()
        rows = array.astype(np.float64)[self.model.rows("/", world)]
        if (rows != rows[0]).any():
            raise SceneError(Problem(self.name, "is not the same for all bodies, and has no one value"))
        return rows[0]

    def gradient(self, gradient, world: int, shape: tuple[int, ...]) -> np.ndarray:
        return np.asarray(getattr(gradient, self.what)(world))

    def scale(self) -> float:
        return PART * max(1.0, float(np.abs(self.read()).max()))


class Density(Input):
    """Density of a body whose masses follow it."""

    def read(self, world: int = 0) -> np.ndarray:
        body = self.model.body(self.path, world)
        density = self.sim.plan.find("densities").get(body.number) or density_of(body.source)
        if density is None:
            raise SceneError(Problem(self.name, "its masses follow no single density"))
        return np.array(density)

    def gradient(self, gradient, world: int, shape: tuple[int, ...]) -> np.ndarray:
        return np.array(gradient.density(self.path, world))


class Mass(Input):
    """Mass of a net."""

    def read(self, world: int = 0) -> np.ndarray:
        body = self.model.body(self.path, world)
        if not isinstance(body.source, Springs):
            raise SceneError(Problem(self.name, "is a cloth or soft body; take its density"))
        return np.array(body.masses.sum())

    def gradient(self, gradient, world: int, shape: tuple[int, ...]) -> np.ndarray:
        return np.array(gradient.mass(self.path, world))


class MaterialInput(Input):
    """A live parameter of a material, one for the body or one for each element."""

    def constraints(self, body) -> list:
        p = self.recording.parameters
        return [r for r in (*p.springs, *(r for source in (*p.flat, *p.batches) for r in source.rows)) if r.body is body]

    def values(self, body) -> list[np.ndarray]:
        """By the tables that have it, one for each element."""
        rows = self.constraints(body)
        found = [np.broadcast_to(r.stiffness[self.what], len(r.ids)) for r in rows if self.what in r.stiffness]
        if self.what == "damping":
            found += [np.full(len(r.ids), r.tau) for r in rows if r.tau > 0.0]
        for table in self.recording.parameters.tables:
            found += [np.array([v]) for b, v in zip(getattr(table, "bodies", ()), getattr(table, "values", ()), strict=True)
                      if b is body and self.what == "pressure"]
            if self.what == "yield_strain" and table.plastic:
                found += [np.unique(y[np.isfinite(y)]) for p, y in zip(table.parts, table.plastic.limits, strict=True)
                          if p.body is body]
        return found + [part.values[self.what] for part in self.tets(body)]

    def tets(self, body) -> list:
        return [part for table in self.recording.parameters.tables for part in table.parts
                if part.body is body and self.what in part.values]

    def read(self, world: int = 0) -> np.ndarray:
        """One value where all elements have the same, else that of each element."""
        body = self.model.body(self.path, world)
        found = self.values(body)
        if not found:
            names = ", ".join(["positions", "velocities", "rest_shape", *self.names(body)])
            raise SceneError(Problem(self.path, f"has no {self.what!r} to be differentiated by; there are {names}"))
        every = self.sorted(np.concatenate(found).astype(np.float64), body)
        return np.array(every[0]) if (every == every[0]).all() else every

    def sorted(self, values: np.ndarray, body) -> np.ndarray:
        """Of tets, which stand by their materials: in the author's order."""
        parts = self.tets(body)
        if parts:
            values[np.concatenate([part.rows for part in parts])] = values.copy()
        return values

    def names(self, body) -> list[str]:
        """What of a body can be written."""
        tables, rows = self.recording.parameters.tables, self.constraints(body)
        tets = [part for table in tables for part in table.parts if part.body is body]
        damped = any(r.tau > 0.0 for r in rows) or any(part.values["damping"].any() for part in tets)
        pressed = any(b is body for table in tables for b in getattr(table, "bodies", ()))
        flows = any(p.body is body for table in tables if table.plastic for p in table.parts)
        return sorted({name for d in (*(r.stiffness for r in rows), *(part.values for part in tets)) for name in d}
                      - {"damping"} | set(["damping"] * damped + ["pressure"] * pressed + ["yield_strain"] * flows)
                      | set(["density"] * (density_of(body.source) is not None))
                      | set(["mass"] * isinstance(body.source, Springs)))

    def shapes(self) -> list[tuple[int, ...]]:
        body = self.model.body(self.path)
        count = sum(len(each) for each in self.values(body))
        single = count == 1 or self.what == "yield_strain" or (self.what == "damping" and not self.tets(body))
        return [()] if single else [(), (count,)]

    def gradient(self, gradient, world: int, shape: tuple[int, ...]) -> np.ndarray:
        found = np.asarray(gradient.material(self.what, self.path, world, elements=bool(shape)))
        return self.sorted(found, self.model.body(self.path, world)) if shape else found

    def scale(self) -> float:
        """Of Poisson's ratio a part of what is left to its ends."""
        value = self.read()
        if self.what == "poisson":
            return PART * float(np.minimum(0.5 - value, 1.0 + value).min())
        return PART * float(np.abs(value).min())

    def bounds(self) -> tuple[float, float]:
        return {"poisson": (-1.0, 0.5), "pressure": (-np.inf, np.inf)}.get(self.what, (0.0, np.inf))


def inputs(recording, names) -> dict[str, Input]:
    """By name. Raises SceneError with every name that is none, or nothing can be differentiated by."""
    found: dict[str, Input] = {}
    problems: list[Problem] = []
    for name in names:
        try:
            found[name] = _input(recording, name)
            found[name].read()
        except SceneError as error:
            problems += error.problems
        if list(names).count(name) > 1:
            problems.append(Problem(name, "is named twice; name it once"))
    if problems or not found:
        raise SceneError(list(dict.fromkeys(problems)) or Problem("inputs", "none is named"))
    return found


def _input(recording, name: str) -> Input:
    path, _, what = name.rpartition(":")
    paths = [b.path for b in recording.sim.scene.bodies()]
    if path in ("", "/"):
        if what not in SCENE:
            raise SceneError(Problem(name, f"is no value of the whole scene; there are {', '.join(SCENE)}, and of a body such "
                                     f"as {paths[0]}:positions"))
        return Whole(recording, name)
    if what == "targets" and path in [p.path for p in recording.sim.scene.pins]:
        return Targets(recording, name)
    if (load := next((each for each in recording.sim.scene.loads if each.path == path), None)) and what == load.name:
        return Loaded(recording, name)
    if path in (others := [c.path for c in recording.sim.scene.colliders]) or what.endswith("_friction"):
        return contact_input(recording, name)
    if path not in paths:
        pins = [f"{p.path}:targets" for p in recording.sim.scene.pins]
        loads = [f"{load.path}:{load.name}" for load in recording.sim.scene.loads]
        raise SceneError(Problem(name, f"there is no body {path}; there are {', '.join(paths + pins + loads + others)}"))
    kinds: dict[str, Any] = {"positions": Start, "velocities": Start, "density": Density, "mass": Mass, "actuation": Actuation,
                             "rest_shape": Rest, "lengths": Rest}
    return kinds.get(what, MaterialInput)(recording, name)


def stable(recording, names) -> None:
    """Raises SceneError where the values that were written want shorter explicit steps than were recorded."""
    least, found = recording.plan.find("least"), recording.plan.clock.substeps
    if least and any(name.rpartition(":")[2] in STIFFENS for name in names) and (wanted := least()) > found:
        raise SceneError(Problem("substeps", f"found {found}; these values want {wanted}. Give the scene more substeps before "
                                 "it is recorded, or keep stiffness and damping below"))
