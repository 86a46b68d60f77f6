"""Live parameters: values that a simulation takes from the next frame on, judged before anything is changed.

What a scene would refuse is refused here by the bounds of the table of values (`wsim.scene.values.table`), before any method is
asked; arrays have one value for all or one for each element; numbers must fit the precision. A refusal leaves state, tables and
the list of changes as they were. Nothing is compiled or captured anew by motions and stiffnesses that go to and fro.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from wsim.model.midnodes import places_with_midnodes, with_midnode_values
from wsim.model.model import PointBody, edge_lengths
from wsim.model.stage import ByWorld
from wsim.scene import Motion, Problem, SceneError
from wsim.scene.check import objects
from wsim.scene.methods import object_at_path, objects_with_values
from wsim.scene.nodal.separate import separate_coincident_ends
from wsim.scene.values import table
from wsim.scene.values.value import ValueRow
from wsim.simulation import retry, varying
from wsim.simulation.measure.captures import capture_forms

if TYPE_CHECKING:
    from wsim.simulation.simulation import Simulation


def prepare_live_use(sim: Simulation) -> None:
    """Compiles kernels, makes lists longer and captures all graphs: see `Simulation.prepare`."""
    sim.load()
    for method in sim.plan.methods if not sim.graphs.log else ():
        method.lengthen_lists()
    retry.prepare_frame_tables(sim)
    capture_forms(sim)


def set_value(sim: Simulation, path: str, name: str, value, world) -> None:
    """See `Simulation.set`."""
    if isinstance(world, (list, tuple, range)):
        _set_each(sim, path, name, value, list(world))
        return
    if world is not None and (isinstance(world, bool) or world not in range(sim.worlds)):
        raise SceneError(Problem(path, f"{name}: there is nothing in world {world} of {sim.worlds}; allowed are 0 to "
                                 f"{sim.worlds - 1}, or None for all"))
    thing = object_at_path(sim.scene, path)
    if name in ("positions", "velocities"):
        place_body(sim, path, name, _float64_copy(path, name, value), world)
        return
    row = table.find_value_row(type(thing).__name__, name)
    if row is None or not row.live:
        raise _unknown_live_value_error(sim, thing, path, name, world)
    if varying.is_value_curve(value) and row.form in varying.FORMS:
        varying.give_value_curve(sim, path, name, value, world)
        return
    value = _checked_live_value(sim, row, thing, path, value, world)
    undo = _undo_of_live_value(sim)
    if not any([m.set_value(path, name, value, world) for m in sim.plan.methods]):
        raise _unknown_live_value_error(sim, thing, path, name, world)
    _apply_consequences(sim, name, undo, thing, path, value, world)
    sim.changes = [c for c in sim.changes if c[:2] != (path, name) or world not in (None, c[3])] + [(path, name, value, world)]


def _set_each(sim: Simulation, path: str, name: str, given, worlds: list[int]) -> None:
    """A value in each of several worlds. Of all worlds, numbers and vectors are uploaded once; others one after another."""
    thing = object_at_path(sim.scene, path)
    row = table.find_value_row(type(thing).__name__, name)
    if len(given) != len(worlds):
        raise SceneError(Problem(path, f"{name} has {len(given)} values for {len(worlds)} worlds; give one for each"))
    single = worlds != list(range(sim.worlds)) or any(map(varying.is_value_curve, given))
    if single or row is None or not row.live or row.form not in ("number", "vector"):
        for value, world in zip(given, worlds, strict=True):
            set_value(sim, path, name, value, world)
        return
    values = [_checked_live_value(sim, row, thing, path, value, world) for value, world in zip(given, worlds, strict=True)]
    if any(np.ndim(value) != (row.form == "vector") for value in values):         # a number for each element
        for value, world in zip(values, worlds, strict=True):
            set_value(sim, path, name, value, world)
        return
    undo, together, hit = _undo_of_live_value(sim), ByWorld(np.array(values, np.float64)), False
    for m in sim.plan.methods:
        if m.by_world:
            hit = m.set_value(path, name, together, None) or hit
        else:
            hit = any([m.set_value(path, name, value, world) for value, world in zip(values, worlds, strict=True)]) or hit
    if not hit:
        raise _unknown_live_value_error(sim, thing, path, name, None)
    _apply_consequences(sim, name, undo)
    sim.changes = [c for c in sim.changes if c[:2] != (path, name)] + [(path, name, v, k) for k, v in enumerate(values)]


def _apply_consequences(sim: Simulation, name: str, undo: Callable[[], None], *what) -> None:
    """Consequences of a value that was set; undone where it takes too many steps. what: thing, path, value, world, where all
    have one."""
    if any(m.remade for m in sim.plan.methods):
        sim.graphs.forget(f"{name} was set, which takes another kernel")
        sim.seconds.pop("compile", None)
        for m in sim.plan.methods:
            m.remade = False
    try:
        retry.keep_stable(sim, name, *what)
    except SceneError:
        undo()
        raise


def _unknown_live_value_error(sim: Simulation, thing, path: str, name: str, world: int | None) -> SceneError:
    """What there is, by the table of values; of what no method takes, why."""
    if thing is None:
        there = ", ".join(["/", *(t.path for t in objects_with_values(sim.scene))])
        return SceneError(Problem(path, f"is no object of this scene; there are {there}"))
    where = "" if world is None else f" in world {world} of {sim.worlds}"
    owner = type(thing).__name__
    row, why = table.find_value_row(owner, name), ""
    if row is not None and row.live:
        from wsim.scene.check.varying import idle_value_reason
        why = f": {idle_value_reason(row, thing, sim.scene) or 'nothing that runs here has it'}"
    elif others := [r.owner.lower() for r in table.VALUES if r.live and r.name == name]:
        why = f", which is of {', '.join(others)}"
    names = ", ".join(n for n in table.live_value_names(owner) if n != name or not why) or "none"
    return SceneError(Problem(path, f"has no live parameter {name!r}{where}{why}; there are {names}"))


def _float64_copy(path: str, name: str, value) -> np.ndarray:
    """A copy, float64."""
    try:
        return np.array(value, np.float64)
    except (TypeError, ValueError):
        raise SceneError(Problem(path, f"{name} is {value!r:.60}; allowed are numbers")) from None


def _undo_of_live_value(sim: Simulation) -> Callable[[], None]:
    """Puts what explicit steps depend on back to where it is now, to the bit: bodies, constraints, materials of tets."""
    points, send = sim.plan.ports.points, sim.plan.ports.upload_constraints
    if send is None:
        return lambda: None
    rows = [r for r in sim.plan.ports.constraint_rows if not r.hard]
    kept = [(thing, {name: getattr(thing, name) for name in names}) for owners, names in (
        (sim.model.bodies, ("masses", "rest", "source")), (rows, ("stiffness", "tau", "rest", "shape", "coupling")))
        for thing in owners]
    parts = [(p, dict(p.values)) for solid in sim.plan.solids for p in solid.parts if hasattr(p, "values")]
    densities = dict(points.densities)

    def restore_live_value() -> None:
        for thing, values in kept:
            for name, value in values.items():
                setattr(thing, name, value)
        for part, values in parts:
            part.values = values
        points.densities.clear()
        points.densities.update(densities)
        points.send(sim.model.bodies)
        for solid in sim.plan.solids:
            for body in sim.model.bodies:
                solid.set_value(body.path, "rest_shape", None, body.world)
            if hasattr(solid, "send"):
                solid.send()
        send()
    return restore_live_value


# values

def _checked_live_value(sim: Simulation, row: ValueRow, thing, path: str, value, world: int | None):
    """A value as methods take it: a float, an array or a Motion of its own. Raises SceneError for what cannot be."""
    name = row.name
    if row.form == "motion":
        return _rigid_motion_of_value(path, value)
    if row.form == "curve":
        return value
    values = _require_representable(sim, path, name, _float64_copy(path, name, value))
    if row.form == "array":
        return values
    if row.form == "vector":
        if values.shape != (3,) or not np.isfinite(values).all():
            raise SceneError(Problem(path, f"{name} is {value}; allowed are three finite numbers"))
        if not np.asarray(row.range.holds(values)).all():
            raise SceneError(Problem(path, row.range.wrong(name, float(values.min()))))
        return values
    if row.form == "factor":
        keys = thing.taken(name).shape
        if values.shape not in ((), keys) or not np.isfinite(values).all():
            raise SceneError(Problem(path, f"{name} is {value!r:.60}; allowed is one finite number, or {keys[0]}, one a key"))
        return values
    good = np.asarray(row.range.holds(values))
    if not good.all():
        more = " (inf takes the constraints away: that needs another Simulation)" if row.range.endless else ""
        raise SceneError(Problem(path, row.range.wrong(name, values[~good].flat[0]) + more))
    counts = _numbers_of_elements(sim, row, thing, path, world)
    if values.size == 1 and values.ndim < 2:
        return float(values.reshape(()))
    if values.shape not in [(n,) for n in counts]:
        allowed = " or ".join(["one number", *(f"{n} of them, one for each element" for n in sorted(counts))])
        raise SceneError(Problem(path, f"{name} has shape {values.shape}; allowed is {allowed}"))
    return values


def _require_representable(sim: Simulation, path: str, name: str, values: np.ndarray) -> np.ndarray:
    """Refuses numbers that are finite, and not in the precision of the simulation."""
    most = float(np.finfo(sim.model.dtype).max)
    large = np.isfinite(values) & (np.abs(values) > most)
    if large.any():
        raise SceneError(Problem(path, f"{name} holds {values[large].flat[0]:g}; allowed is up to {most:.3g}, the most that "
                                 f"{sim.precision} holds"))
    return values


def _numbers_of_elements(sim: Simulation, row: ValueRow, thing, path: str, world: int | None) -> set[int]:
    """Numbers of elements that may have a value each: of all of a body's constraints of that name, or its tets."""
    if getattr(thing, "is_solid", False):
        return {len(thing.tets)} if row.tets else set()
    if hasattr(thing, "driven"):
        return {len(thing.driven())}
    sizes = {len(r.ids) for r in sim.plan.ports.constraint_rows
             if r.body is not None and r.body.path == path and world in (None, r.body.world) and row.name in r.stiffness}
    return sizes if len(sizes) == 1 else set()


def _rigid_motion_of_value(path: str, value) -> Motion:
    """A rigid one."""
    if not isinstance(value, Motion):
        matrix = _float64_copy(path, "motion", value)
        if matrix.shape != (4, 4):
            raise SceneError(Problem(path, f"motion has shape {matrix.shape}; allowed are a Motion, or a matrix (4, 4)"))
        value = Motion.still(matrix)
    if not np.isfinite(value.times).all():
        raise SceneError(Problem(path, "the times of its motion are not finite; give finite ones [s]"))
    problems = list(objects.check_rigid_motion(path, value, "take scale and mirror out of it"))
    if problems:
        raise SceneError(problems)
    return value


# the state

def place_body(sim: Simulation, path: str | None, name: str, values: np.ndarray, world: int | None) -> None:
    """Positions or velocities of a body, (n, 3), in world space and the author's order, in one world or in all."""
    bodies = [b for b in sim.model.bodies if path in (None, b.path) and world in (None, b.world)]
    if len({b.path for b in bodies}) != 1:
        have = ", ".join(dict.fromkeys(b.path for b in sim.model.bodies))
        raise SceneError(Problem(str(path), f"has no {name}; bodies are {have}"))
    for body in bodies:
        if values.shape != (len(body.index), 3) or not np.isfinite(values).all():
            raise SceneError(Problem(body.path, f"{name} must be finite with shape ({len(body.index)}, 3); found "
                                     f"{values.shape if np.isfinite(values).all() else 'NaN or infinity'}"))
        _require_representable(sim, body.path, name, values)
    for body in bodies:
        _put_body_values(sim, body, name, values)
    sim.plan.clock.starting, sim.measured, sim.settled = True, False, None
    sim.graphs.forget(f"{name} were set")


def _put_body_values(sim: Simulation, body: PointBody, name: str, values: np.ndarray) -> None:
    array = sim.state.x if name == "positions" else sim.state.v
    now = array.numpy()
    exact, index = (with_midnode_values(values - body.origin if name == "positions" else values, body.ends),
                    places_with_midnodes(body))
    if name == "positions":
        own = np.concatenate([body.own, body.middles]) - body.first
        solver = np.empty((body.count, 3))
        solver[own] = exact
        exact = separate_coincident_ends(solver, body.edges - body.first, edge_lengths(body))[own]
    now[index] = exact
    array.assign(now)
    if name == "positions":
        rest = sim.state.e.numpy()
        rest[index] = exact - now[index]
        sim.state.e.assign(rest)
