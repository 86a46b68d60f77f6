"""Targets: what of a scene a sweep varies, and how a scene, or one world of a running simulation, takes it.

    /World/Cloth:stretch      a value of the table of values (`wsim.scene.values.table`), of one object
    stretch                   of every object that has it; gravity, wind ... of the whole scene
    gravity_y, /World/Load:force_x     one number of a vector
    /World/Pin:motion         the way of a pin or a collider, by files of curves; a file of a live value is its curve over time
    /World/Cloth:fabric       a variant set of a prim
    start                     results whose last frame is the state to start from
    file                      files of scenes, in the place of the scene
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wsim.fitting import parameter
from wsim.fitting.least_squares.bounds import LOG
from wsim.scene import Load, Pin, Problem, Scene, SceneError, Varying
from wsim.scene.check.varying import idle_value_reason
from wsim.scene.methods import object_at_path, objects_with_values
from wsim.scene.values import table
from wsim.scene.values.value import ValueRow, value_holder
from wsim.sweep.vary import curves

AXES = "xyz"
FORMS = ("number", "factor", "vector", "curve", "motion")
START, FILE = "start", "file"


@dataclass(frozen=True)
class SweepTarget:
    """kind: "value", "variant", "start" or "file". path: "" of every object; what: the value or the variant set; axis: of a
    vector."""

    name: str
    kind: str
    path: str = ""
    what: str = ""
    axis: int | None = None

    def rows(self, scene: Scene) -> list[tuple[ValueRow, Any]]:
        """Objects of a scene that have the value, each with its row; the scene itself for what is the whole scene's."""
        found = [(row, scene) for row in [table.values_of_class("Scene").get(self.what)] if row is not None
                 and self.whole(scene)]
        for thing in objects_with_values(scene):
            row = table.values_of_class(type(thing).__name__).get(self.what)
            if row is not None and self.path in ("", thing.path) and _object_has_value(row, thing):
                found.append((row, thing))
        return found

    def whole(self, scene: Scene) -> bool:
        """True if the path is that of the whole scene: none, "/", or a prim above its objects."""
        return self.path in ("", "/") or (object_at_path(scene, self.path) is None
                                          and any(t.path.startswith(f"{self.path}/") for t in objects_with_values(scene)))

    def written(self, scene: Scene, value) -> Scene:
        """The scene with that value; the given one stays as it is. Raises SceneError for what it cannot have."""
        for row, thing in self.rows(scene):
            if row.form == "motion" or curves.names_curve_file(value):
                scene = self._over_time(scene, row, thing, value)
                continue
            given = self._checked_draw(row, getattr(thing, "path", "/"), value)
            if isinstance(thing, Scene):
                own: Any = given if self.axis is None else _vector_with_component(getattr(thing, self.what), self.axis, given)
                scene = replace(scene, **{self.what: own})
                continue
            try:
                new = thing
                for axis, number in _vector_components(given, self.axis):
                    new = parameter.thing_with_parameter(row, new, number, axis)
            except (TypeError, ValueError) as error:
                raise SceneError(Problem(thing.path, f"{self.what} cannot be {value}: {error}")) from None
            scene = scene.exchanged(thing, new)
        return scene

    def bare(self, scene: Scene) -> Scene:
        """The scene without what it says of the value over time, which a draw stands for."""
        own = {(getattr(thing, "path", "/"), row.name) for row, thing in self.rows(scene)}
        left = [v for v in scene.varying if (v.path, v.name) not in own]
        return scene if len(left) == len(scene.varying) else replace(scene, varying=left)

    def _over_time(self, scene: Scene, row: ValueRow, thing, value) -> Scene:
        """The scene with the curve of a file. Raises SceneError for what takes none."""
        path = getattr(thing, "path", "/")
        if not curves.names_curve_file(value):
            raise SceneError(Problem(path, f"{self.what} is {value!r:.60}; allowed are files of curves, list(a{curves.END},"
                                     f"b{curves.END})"))
        if row.form == "motion":
            if getattr(thing, "follows", None) is not None:
                raise SceneError(Problem(path, "follows a mesh that joints move; its motion is not varied"))
            return scene.exchanged(thing, replace(thing, motion=curves.read_motion_file(value, thing.motion.at(0.0))))
        if isinstance(thing, Load) and self.axis is None:
            return scene.exchanged(thing, replace(thing, curve=curves.read_curve_file(value, row.name, True)))
        if not row.varies or self.axis is not None:
            whole = f"; vary {self.what}, of three numbers" if row.varies else ""
            raise SceneError(Problem(path, f"{self.name} takes no curve{whole}"))
        return replace(scene, varying=[*scene.varying, Varying(path, row.name, curves.read_curve_file(value, row.name,
                                                                                             row.form == "vector"))])

    def _checked_draw(self, row: ValueRow, path: str, value):
        """A number, or a vector where all of one is given."""
        vector = self.axis is None and row.form in ("vector", "curve")
        numbers: tuple
        if vector and isinstance(value, tuple) and len(value) == 3:
            numbers = value
        elif not vector and isinstance(value, float):
            numbers = (value,)
        else:
            wanted = "three numbers" if vector else "a number"
            raise SceneError(Problem(path, f"{self.name} is {value!r:.60}; allowed is {wanted}"))
        for number in numbers:
            if wrong := row.range.wrong(self.what, number, True):
                raise SceneError(Problem(path, wrong))
        return numbers if vector else numbers[0]

    def live(self, base: Scene, scene: Scene) -> list[tuple[str, str, Any]] | None:
        """(path, name, value) of `Simulation.set` that make one world of `base` as `scene` is; None where a scene must be built
        with it."""
        rows = self.rows(base)
        if curve := self._live_curves(scene, rows, base):
            return curve[0]
        if any(not row.live or (not isinstance(thing, Scene) and idle_value_reason(row, thing, base)) for row, thing in rows):
            return None
        if any(isinstance(thing, Scene) and row.needs and idle_value_reason(row, thing, base) for row, thing in rows):
            return None
        found = parameter.Parameter(self.name, self.what, "" if self.whole(base) else self.path, "", LOG, self.axis).live(scene)
        return found or None


    def _live_curves(self, scene: Scene, rows: list, base: Scene) -> list[list | None]:
        """[what `live` returns] of a value over time; [] of others."""
        if any(isinstance(thing, Load) and object_at_path(scene, thing.path).curve.moves for _, thing in rows):
            return [None]
        given = {v.path: v.curve for v in scene.varying if v.name == self.what}
        own = [(getattr(thing, "path", "/"), row, thing) for row, thing in rows]
        if any(row.form == "motion" for _, row, _ in own):
            now = {path: object_at_path(scene, path).motion for path, _, _ in own}
            same = all(np.array_equal(now[path].at(0.0), thing.motion.at(0.0)) for path, _, thing in own)
            pins = all(isinstance(thing, Pin) for _, _, thing in own)          # of colliders: worlds share them
            return [[(path, self.what, motion) for path, motion in now.items()] if pins and same else None]
        if not any(path in given for path, _, _ in own):
            return []
        return [[(path, self.what, given[path]) for path, _, _ in own]
                if not any(idle_value_reason(row, t, base) for _, row, t in own) else None]


def _object_has_value(row: ValueRow, thing) -> bool:
    """True if an object has a field for a value."""
    if isinstance(thing, Load):
        return thing.name == row.name
    if hasattr(thing, "taken"):
        return thing.taken(row.name) is not None
    return row.name == "mass" and row.owner == "Springs" or hasattr(value_holder(thing, row.name), row.name)


def _vector_with_component(vector, axis: int, value: float) -> tuple[float, ...]:
    return tuple(value if k == axis else float(v) for k, v in enumerate(vector))


def _vector_components(given, axis: int | None) -> list[tuple[int | None, float]]:
    return list(enumerate(given)) if isinstance(given, tuple) else [(axis, given)]


def resolve_sweep_target(name: str, scene: Scene, sets) -> SweepTarget:
    """Target of a name in a scene. sets(path): names of the variant sets of a prim. Raises SceneError for what is none, with
    what there is."""
    if name in (START, FILE):
        return SweepTarget(name, name)
    path, _, what = name.rpartition(":")
    axis: int | None = None
    if what[-2:-1] == "_" and what[-1] in AXES and any(r.name == what[:-2] and r.form != "number" for r in table.VALUES):
        axis, what = AXES.index(what[-1]), what[:-2]
    target = SweepTarget(name, "value", path, what, axis)
    if rows := target.rows(scene):
        wrong = next((row for row, _ in rows if row.form not in FORMS), None)
        if wrong is None and not any(row.form == "curve" and not isinstance(thing, Load) for row, thing in rows):
            return target
        raise SceneError(Problem(path or name, f"{what} is no number and no vector; a sweep takes it from files "
                                 "(file=list(...))"))
    if path and what in sets(path):
        return SweepTarget(name, "variant", path, what)
    raise _unknown_target_error(name, path, what, scene, sets)


def _unknown_target_error(name: str, path: str, what: str, scene: Scene, sets) -> SceneError:
    thing = object_at_path(scene, path) if path else scene
    if path and thing is None:
        return SceneError(Problem(path, f"nothing of that path is simulated; there are "
                                  f"{', '.join(['/', *(t.path for t in objects_with_values(scene))])}"))
    if path:
        have = [r.name for r in table.VALUES if r.owner == type(thing).__name__ and r.form in FORMS
                and (thing is scene or _object_has_value(r, thing))]
        more = f"; variant sets {', '.join(sets(path))}" if sets(path) else ""
        return SceneError(Problem(path, f"has no value {what!r}; there are {', '.join(have)}{more}"))
    have = list(dict.fromkeys(r.name for t in objects_with_values(scene) for r in table.VALUES if r.owner == type(t).__name__
                              and r.form in FORMS and _object_has_value(r, t)))
    have += [r.name for r in table.VALUES if r.owner == "Scene"]
    there = ", ".join(dict.fromkeys(have))
    return SceneError(Problem(name, f"is no value of anything here; there are {there}, of one object as "
                              f"/World/Cloth:stretch; a variant set as /World/Prim:set; {START}, {FILE}"))
