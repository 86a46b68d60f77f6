"""Live parameters: values that a simulation takes from the next frame on, judged before anything is changed.

What a scene would refuse is refused here by the same bounds; arrays have one value for all or one for each element; numbers
must fit the precision. A refusal leaves state, tables and the list of changes as they were.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from wsim.model.midnodes import places, spread
from wsim.model.model import Body, edge_lengths
from wsim.model.separate import apart
from wsim.physics.cloth.constraints import HARD
from wsim.scene import Cloth, Collider, Motion, Problem, SceneError, Soft, fabric, solid
from wsim.scene.check import objects
from wsim.scene.methods import every
from wsim.simulation import retry

if TYPE_CHECKING:
    from wsim.simulation.simulation import Simulation

VECTORS = ("gravity", "wind")
ARRAYS = ("rest_shape", "lengths", "positions", "velocities", "actuation", "force", "traction")      # judged by who takes them
NAMES = ("gravity", "air_drag", "wind", "stretch", "weft", "shear", "bend", "strain_limit", "damping", "density", "mass",
         "stiffness", "young", "poisson", "pressure", "yield_strain", "actuation", "static_friction", "dynamic_friction",
         "thickness", "restitution", "motion", "rest_shape", "lengths", "positions", "velocities", "force", "traction")
POSITIVE = {"stiffness": (0.0, True, inf), "mass": (0.0, True, inf)}
BOUNDS: dict[type, dict] = {Cloth: fabric.RANGES, Soft: solid.RANGES | {"pressure": (-inf, False, inf)}}
ENDLESS = {"strain_limit", "yield_strain"}          # infinite in a scene where there is none


def set_value(sim: Simulation, path: str, name: str, value, world: int | None) -> None:
    """See `Simulation.set`."""
    if world is not None and (isinstance(world, bool) or world not in range(sim.worlds)):
        raise SceneError(Problem(path, f"{name}: there is nothing in world {world} of {sim.worlds}; allowed are 0 to "
                                 f"{sim.worlds - 1}, or None for all"))
    thing = _thing(sim, path)
    if name in ("positions", "velocities"):
        place(sim, path, name, _floats(path, name, value), world)
        return
    value = _judged(sim, thing, path, name, value, world)
    undo = _remembered(sim)
    if not any([m.set(path, name, value, world) for m in sim.plan.methods]):
        there = "" if thing is not None else f"; paths there are {', '.join(_paths(sim))}"
        where = "" if world is None else f" in world {world} of {sim.worlds}"
        raise SceneError(Problem(path, f"has no live parameter {name!r}{where}; there are {', '.join(NAMES)}{there}"))
    if any(m.remade for m in sim.plan.methods):
        sim.graph = None
        sim.seconds.pop("compile", None)
        for m in sim.plan.methods:
            m.remade = False
    try:
        retry.keep_stable(sim, name)
    except SceneError:
        undo()
        raise
    sim.changes = [c for c in sim.changes if c[:2] != (path, name) or world not in (None, c[3])] + [(path, name, value, world)]


def _things(sim: Simulation) -> list:
    scene = sim.scene
    return [*scene.bodies(), *scene.pins, *scene.colliders, *scene.loads, *(thing for _, thing in every(scene))]


def _paths(sim: Simulation) -> list[str]:
    return ["/", *(thing.path for thing in _things(sim))]


def _thing(sim: Simulation, path: str | None) -> Any:
    """The object of a path, the scene of "/"; None: there is none."""
    return sim.scene if path == "/" else next((t for t in _things(sim) if t.path == path), None)


def _floats(path: str, name: str, value) -> np.ndarray:
    """A copy, float64."""
    try:
        return np.array(value, np.float64)
    except (TypeError, ValueError):
        raise SceneError(Problem(path, f"{name} is {value!r:.60}; allowed are numbers")) from None


def _remembered(sim: Simulation) -> Callable[[], None]:
    """Puts what explicit steps depend on back to where it is now, to the bit: bodies, constraints, materials of tets."""
    points, send = sim.plan.find("points"), sim.plan.find("send")
    if send is None:
        return lambda: None
    rows = [r for r in sim.plan.methods.every("rows") if r.kind not in HARD]
    kept = [(thing, {name: getattr(thing, name) for name in names}) for things, names in (
        (sim.model.bodies, ("masses", "rest", "source")), (rows, ("stiffness", "tau", "rest", "shape")))
        for thing in things]
    parts = [(p, dict(p.values)) for table in sim.plan.solids for p in table.parts if hasattr(p, "values")]
    densities = dict(points.densities)

    def undo() -> None:
        for thing, values in kept:
            for name, value in values.items():
                setattr(thing, name, value)
        for part, values in parts:
            part.values = values
        points.densities.clear()
        points.densities.update(densities)
        points.send(sim.model.bodies)
        for table in sim.plan.solids:
            for body in sim.model.bodies:
                table.set(body.path, "rest_shape", None, body.world)
            if hasattr(table, "send"):
                table.send()
        send()
    return undo


# values

def _judged(sim: Simulation, thing, path: str, name: str, value, world: int | None):
    """A value as methods take it: a float, an array or a Motion of its own. Raises SceneError for what cannot be."""
    for row, own in every(sim.scene):
        if own is thing:
            return cast(Any, sim.plan.method(row.name)).accept(path, name, value)
    if name == "motion":
        return _motion(path, value)
    if name in ARRAYS:
        return value if name in ("actuation", "force", "traction") else _fits(sim, path, name, _floats(path, name, value))
    values = _fits(sim, path, name, _floats(path, name, value))
    if name in VECTORS:
        if values.shape != (3,) or not np.isfinite(values).all():
            raise SceneError(Problem(path, f"{name} is {value}; allowed are three finite numbers"))
        return values
    _range(thing, path, name, values)
    counts = _counts(sim, thing, path, name, world)
    if values.size == 1 and values.ndim < 2:
        return float(values.reshape(()))
    if values.shape not in [(n,) for n in counts]:
        allowed = " or ".join(["one number", *(f"{n} of them, one for each element" for n in sorted(counts))])
        raise SceneError(Problem(path, f"{name} has shape {values.shape}; allowed is {allowed}"))
    return values


def _range(thing, path: str, name: str, values: np.ndarray) -> None:
    """The bounds of a scene: of a fabric, a bulk, a net, a collider."""
    low, strict, high = BOUNDS.get(type(thing), POSITIVE).get(name, (0.0, False, inf))
    if isinstance(thing, Collider) and name == "restitution":
        good, words = (values >= 0.0) & (values <= 1.0), "a number from 0 to 1"
    else:
        good = np.isfinite(values) & ((values > low) if strict else (values >= low)) & ((values < high) | (high == inf))
        words = "a finite number" if low == -inf else f"{'>' if strict else '>='} {low:g} and < {high:g}" if high < inf else \
            f"a finite number {'>' if strict else '>='} {low:g}"
    if not good.all():
        more = " (inf takes the constraints away: that needs another Simulation)" if name in ENDLESS else ""
        raise SceneError(Problem(path, f"{name} is {values[~good].flat[0]:g}; allowed is {words}{more}"))


def _fits(sim: Simulation, path: str, name: str, values: np.ndarray) -> np.ndarray:
    """Refuses numbers that are finite, and not in the precision of the simulation."""
    most = float(np.finfo(sim.model.dtype).max)
    large = np.isfinite(values) & (np.abs(values) > most)
    if large.any():
        raise SceneError(Problem(path, f"{name} holds {values[large].flat[0]:g}; allowed is up to {most:.3g}, the most that "
                                 f"{sim.precision} holds"))
    return values


def _counts(sim: Simulation, thing, path: str, name: str, world: int | None) -> set[int]:
    """Numbers of elements that may have a value each: of all of a body's constraints of that name, or its tets."""
    if isinstance(thing, Soft):
        return {len(thing.tets)} if name in ("young", "poisson", "damping") else set()
    sizes = {len(r.ids) for r in sim.plan.methods.every("rows")
             if r.body is not None and r.body.path == path and world in (None, r.body.world) and name in r.stiffness}
    return sizes if len(sizes) == 1 else set()


def _motion(path: str, value) -> Motion:
    """A rigid one."""
    if not isinstance(value, Motion):
        matrix = _floats(path, "motion", value)
        if matrix.shape != (4, 4):
            raise SceneError(Problem(path, f"motion has shape {matrix.shape}; allowed are a Motion, or a matrix (4, 4)"))
        value = Motion.still(matrix)
    if not np.isfinite(value.times).all():
        raise SceneError(Problem(path, "the times of its motion are not finite; give finite ones [s]"))
    problems = list(objects.rigid(path, value, "take scale and mirror out of it"))
    if problems:
        raise SceneError(problems)
    return value


# the state

def place(sim: Simulation, path: str | None, name: str, values: np.ndarray, world: int | None) -> None:
    """Positions or velocities of a body, (n, 3), in world space and the author's order, in one world or in all."""
    bodies = [b for b in sim.model.bodies if path in (None, b.path) and world in (None, b.world)]
    if len({b.path for b in bodies}) != 1:
        have = ", ".join(dict.fromkeys(b.path for b in sim.model.bodies))
        raise SceneError(Problem(str(path), f"has no {name}; bodies are {have}"))
    for body in bodies:
        if values.shape != (len(body.index), 3) or not np.isfinite(values).all():
            raise SceneError(Problem(body.path, f"{name} must be finite with shape ({len(body.index)}, 3); found "
                                     f"{values.shape if np.isfinite(values).all() else 'NaN or infinity'}"))
        _fits(sim, body.path, name, values)
    for body in bodies:
        _put(sim, body, name, values)
    sim.plan.clock.starting = True
    sim.graph = None


def _put(sim: Simulation, body: Body, name: str, values: np.ndarray) -> None:
    array = sim.state.x if name == "positions" else sim.state.v
    now = array.numpy()
    exact, index = spread(values - body.origin if name == "positions" else values, body.ends), places(body)
    if name == "positions":
        own = np.concatenate([body.own, body.middles]) - body.first
        solver = np.empty((body.count, 3))
        solver[own] = exact
        exact = apart(solver, body.edges - body.first, edge_lengths(body))[own]
    now[index] = exact
    array.assign(now)
    if name == "positions":
        rest = sim.state.e.numpy()
        rest[index] = exact - now[index]
        sim.state.e.assign(rest)
