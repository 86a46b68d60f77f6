"""What can be wrong with a live value that varies in time: the rows of `wsim.scene.values.table` that may. NumPy only."""

from collections.abc import Callable, Iterator
from math import isfinite
from typing import Any

import numpy as np

from wsim.scene import Deformable, Problem, Scene, Varying
from wsim.scene.check.objects import thing_error
from wsim.scene.methods import feels_air, object_at_path
from wsim.scene.nodal.masses import single_density
from wsim.scene.values import table
from wsim.scene.values.value import ValueRow, value_holder


def zero_value_reason(holder, name: str) -> str:
    """Reason why a value does nothing that is 0 at the start, or that the material lacks, in words; "" where it does."""
    if not hasattr(holder, name):
        return f"{type(holder).__name__} has none"
    return "" if getattr(holder, name) else "it is 0 at the start, so that nothing of it runs"


# what a value needs at the start of a scene to do anything: why it does nothing, in words, "" where it does
NEEDS: dict[str, Callable[[Any, str, Scene], str]] = {
    "air": lambda thing, name, scene: "" if feels_air(scene) or any(
        r.drag or r.skin_drag for r in scene.things("Rods")) else
    f"no cloth has drag or lift (wsim:drag, wsim:normalDrag, wsim:lift), and no rods have drag, so that {name} does nothing",
    "collider": lambda thing, name, scene: "" if scene.colliders else "there is no collider, so that friction does nothing",
    "throws": lambda thing, name, scene: "" if any(c.restitution for c in scene.colliders) else
    "no collider throws back at the start",
    "apart": lambda thing, name, scene: "points are shared" if scene.ties else "",
    "mass": lambda thing, name, scene: "" if single_density(thing) is not None and not scene.ties else
    "the masses do not follow it: they are authored, or materials differ, or points are shared",
    "start": lambda thing, name, scene: zero_value_reason(value_holder(thing, name), name),
    "finite": lambda thing, name, scene: "" if isfinite(getattr(value_holder(thing, name), name)) else
    "it is infinite at the start, so that nothing of it runs",
    "alone": lambda thing, name, scene: "it has more than one material" if len(getattr(thing, "materials", ())) > 1 else "",
    "membrane": lambda thing, name, scene: "" if thing.model == "membrane" else "the model 'springs' has none",
    "shear": lambda thing, name, scene: "" if thing.model == "membrane" or (
        thing.material.shear > 0.0 and (thing.counts > 3).any()) else
    "the model 'springs' has shear in quads alone, and where it is not 0 at the start",
    "driven": lambda thing, name, scene: "" if thing.enabled and thing.driven() else
    "the joint has no drive, or is not enabled, so that nothing goes there",
    "actuated": lambda thing, name, scene: "" if any(j.path == thing.joint and j.enabled for j in scene.things("Joint")) else
    "its joint is not enabled, so that it does nothing",
    "bend": lambda thing, name, scene: "" if thing.material.bend else "it is 0 at the start, so that nothing bends against it",
}


def has_painted_stiffness(thing, name: str) -> bool:
    """True if the faces of an object have their own values of a stiffness, so that the material's does not count."""
    painted = {"bend": "bends", "stretch": "stretches", "shear": "stretches", "weft": "stretches"}.get(name)
    return painted is not None and getattr(thing, painted, None) is not None


def idle_value_reason(row: ValueRow, thing, scene: Scene) -> str:
    """Reason why a value of an object does nothing while the scene runs, in words; "" where it does."""
    return next((reason for need in row.needs if (reason := NEEDS[need](thing, row.name, scene))), "")


def fixed_value_reason(path: str, name: str, scene: Scene) -> str:
    """Reason why a value cannot vary while the scene runs, in words; "" where it can."""
    thing = object_at_path(scene, path)
    if thing is None:
        return "nothing of that path is simulated"
    owner = type(thing).__name__
    row = table.values_of_class(owner).get(name)
    if row is None or not row.varies:
        return f"it is fixed while a scene runs (what may vary there: {', '.join(table.varying_value_names(owner)) or 'none'})"
    if has_painted_stiffness(thing, name):
        return "its faces have values of their own"
    return idle_value_reason(row, thing, scene)


def check_varying_value(thing: Varying, scene: Scene) -> Iterator[Problem]:
    """Problems of a value that varies in time."""
    if reason := fixed_value_reason(thing.path, thing.name, scene):
        yield thing_error(thing.path, f"{thing.name} varies in time, and {reason}", "a value that is live", "author one value")
        return
    values, owner = np.asarray(thing.curve.values), object_at_path(scene, thing.path)
    row = table.values_of_class(type(owner).__name__)[thing.name]
    shape = (3,) if row.form == "vector" else ()
    if hasattr(owner, "driven") and len(owner.driven()) > 1:               # a joint: a number for each of its drives
        shape = (len(owner.driven()),)
    if thing.name == "stiffness" and isinstance(owner, Deformable):
        shape = values.shape[1:] if values.shape[1:] in ((1,), (len(owner.held_points()[0]),)) else shape
    if values.shape[1:] != shape or values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        yield thing_error(thing.path, f"{thing.name} has keys of shape {values.shape[1:]}"
                           + ("" if values.dtype.kind in "fiu" and np.isfinite(values).all() else " that are not all finite"),
                           f"finite numbers of shape {shape}", "author its samples again")
    elif not np.isfinite(thing.curve.times).all():
        yield thing_error(thing.path, f"{thing.name} has times that are not finite", "finite ones", "author its samples again")
    elif len(bad := values[~row.range.holds(values)]):
        yield thing_error(thing.path, row.range.wrong(thing.name, bad[0]), "that range at every key",
                           "author that sample again")
    elif not thing.curve.plain and len(bad := (read := values_at_frames(thing, scene))[~row.range.holds(read)]):
        yield thing_error(thing.path,
                           f"{row.range.wrong(thing.name, bad[0])}; a curve of kind {thing.curve.kind} leaves that range "
                           "between its keys or outside of them", "that range at every frame",
                           "take kind monotone, which stays between its keys, or hold it outside of them")


def values_at_frames(thing: Varying, scene: Scene) -> np.ndarray:
    """Values that the frames of a scene have, those at their middles."""
    return thing.curve.sampled((np.arange(max(scene.frames, 1)) + 0.5) / scene.fps)


def unfittable_parameter(scene: Scene, what: str, path: str) -> list[Problem]:
    """Reason why a parameter of a fit, of one object or of all (""), cannot be one number."""
    names = table.PARTS.get(what, (what,))
    return [Problem(v.path, f"{v.name} varies in time, and a fit finds one value; author one value, or leave {what} out")
            for v in scene.varying if v.name in names and path in ("", v.path)]
