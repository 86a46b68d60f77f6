"""Live values that vary in time (`wsim.scene.Varying`), set before each frame by `Simulation.set`.

A frame has the value at its middle, so that what a value does over a frame is met to second order in the length of a frame;
targets and speeds of drives are met in each substep (`wsim.physics.rigid.joints.aims`).
What a user sets by hand from then on stays as it was set; a `Curve` that is set is followed likewise, in one world or in all.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wsim.scene import Motion, Scene, Varying
from wsim.scene.curve import Curve
from wsim.scene.methods import object_at_path
from wsim.scene.values import table

if TYPE_CHECKING:
    from wsim.simulation.simulation import Simulation


FORMS = "number", "vector", "factor"         # of values that are set frame by frame


def follow_varying_values(sim: Simulation) -> None:
    """Sets the values of the frame to come, those that differ from what was set last."""
    set_before = sim.plan.followed
    for thing in by_frames(sim):
        value, key = thing.curve.at(sim.time + 0.5 / sim.scene.fps), (thing.path, thing.name)
        if key in set_before and np.array_equal(set_before[key], value):
            continue
        _put_varying_value(sim, thing.path, thing.name, value)
        set_before[key] = value
        for change in [c for c in sim.changes if c[1] == thing.name and not is_value_curve(c[2])]:
            _put_varying_value(sim, *change)
    _follow_given_curves(sim, set_before)


def _follow_given_curves(sim: Simulation, set_before: dict) -> None:
    """Sets the values of curves that were set by hand, as `follow_varying_values` does, whatever the scene's own have put
    there."""
    put = {key for key in set_before if len(key) == 2}
    for path, name, curve, world in [c for c in sim.changes if is_value_curve(c[2]) and is_followed_by_frames(sim, *c[:2])]:
        value, key = curve.at(sim.time + 0.5 / sim.scene.fps), (path, name, world)
        if (path, name) in put or not (key in set_before and np.array_equal(set_before[key], value)):
            _put_varying_value(sim, path, name, value, world)
            set_before[key] = value
            put |= {(path, name)} if world is None else set()


def is_followed_by_frames(sim: Simulation, path: str, name: str) -> bool:
    """True for a value that `follow_varying_values` sets frame by frame; others, as actuations and loads, take a curve
    whole."""
    row = table.find_value_row(type(object_at_path(sim.scene, path)).__name__, name)
    return row is not None and row.form in FORMS


def is_value_curve(value) -> bool:
    """True for a value over time that `give_value_curve` has set."""
    return isinstance(value, Curve) and not isinstance(value, Motion)


def give_value_curve(sim: Simulation, path: str, name: str, curve: Curve, world: int | None) -> None:
    """Sets a curve from here on: the substeps that its stiffest value needs, then its value of the frame to come. Raises
    SceneError for what a value could not be, and where a recording has one value for all frames."""
    if sim.gradients:
        from wsim.scene.values import coverage
        raise coverage.gradient_refusal("varying", path, name=name, count=1)
    for value in _ends_of_curve(Varying(path, name, curve), sim.scene) if curve.moves else ():
        _put_varying_value(sim, path, name, value, world)
    _put_varying_value(sim, path, name, curve.at(sim.time + 0.5 / sim.scene.fps), world)
    sim.changes = [c for c in sim.changes if c[:2] != (path, name) or world not in (None, c[3])] + [(path, name, curve, world)]
    for key in [key for key in sim.plan.followed if key[:2] == (path, name)]:
        del sim.plan.followed[key]


def _ends_of_curve(thing: Varying, scene: Scene) -> tuple:
    """Least and greatest values of a curve, of each number of a vector."""
    read = thing.curve.values
    if not thing.curve.plain:
        from wsim.scene.check.varying import values_at_frames
        read = np.concatenate([read, values_at_frames(thing, scene)])
    return read.min(axis=0), read.max(axis=0)


def by_frames(sim: Simulation) -> list:
    """The values that a frame has one of."""
    within = sim.plan.ports.drive_targets or ()
    return [thing for thing in sim.scene.varying if (thing.path, thing.name) not in within]


def take_stiffest_substeps(sim: Simulation) -> None:
    """Takes the substeps that the stiffest of the values need, of an explicit integrator: then every frame of a run, and of one
    that goes on in its middle, has as many."""
    for thing in by_frames(sim) if sim.plan.ports.stable_substeps else ():
        least, most = _ends_of_curve(thing, sim.scene)
        _put_varying_value(sim, thing.path, thing.name, least if thing.name == "density" else most)
    follow_varying_values(sim)


def refuse_varying_values(sim: Simulation) -> None:
    """Raises SceneError where a value varies: a recording knows one value of each for all its frames."""
    for thing in sim.scene.varying:
        from wsim.scene.values import coverage
        raise coverage.gradient_refusal("varying", thing.path, name=thing.name, count=len(sim.scene.varying))


def _put_varying_value(sim: Simulation, path: str, name: str, value, world: int | None = None) -> None:
    """As `Simulation.set`, without a note for another plan, which follows by itself."""
    noted = list(sim.changes)
    sim.set(path, name, value if np.ndim(value) else float(value), world)
    sim.changes[:] = noted
