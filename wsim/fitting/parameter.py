"""What can be fitted as one number: the rows of the table of values (`wsim.scene.values.table`) with a map to a line without
ends, and how a scene takes a value.

    stretch               one value for every body that has it
    /World/Cloth:stretch  of that body alone
    stretch_warp, stretch_weft    apart; stretch keeps their ratio
    gravity               three parameters: gravity_x, gravity_y, gravity_z; each may be named alone; so with wind, and with
                          force and traction of loads that stay
    mass                  of a net, whose points keep their proportions

The maps: `wsim.fitting.least_squares.bounds`. Steps, priors and error bars live in the mapped space (theta), results in both.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

import numpy as np

from wsim.fitting import shared as sharing
from wsim.fitting.least_squares.bounds import LARGE, WIDE, FittingMap
from wsim.scene import Load, Problem, Scene, SceneError
from wsim.scene.check.varying import NEEDS, has_painted_stiffness, unfittable_parameter
from wsim.scene.methods import each_method_object, separated_words
from wsim.scene.nodal.masses import single_density
from wsim.scene.values import table
from wsim.scene.values.value import ValueRow, value_holder

AXES = ("x", "y", "z")


def fit_rows() -> list[ValueRow]:
    """Values that are fitted as one number, with the parts of stretch behind it."""
    found = [row for row in table.VALUES if row.fit]
    return [each for row in found for each in ([replace(row, name=name) for name in table.PARTS]
                                               if (row.owner, row.name) == ("Cloth", "stretch") else [row])]


def parameter_names() -> list[str]:
    return list(dict.fromkeys(row.name for row in fit_rows()))


def fit_things(scene: Scene) -> list:
    return [*scene.bodies(), *scene.colliders, *scene.loads, *(thing for _, thing in each_method_object(scene))]


@dataclass(frozen=True)
class Parameter:
    """One number to be fitted."""

    name: str                    # as asked
    what: str                    # name of `rows`
    path: str                    # of the one body; "": of all that have it
    unit: str
    map: FittingMap
    axis: int | None = None      # of a vector
    only: int | None = None      # number of the one experiment that has it; None: all share it

    def among(self, scenes: list) -> list:
        """Scenes of the experiments that have it."""
        return scenes if self.only is None else [scenes[self.only]]

    def in_all(self, scenes: list[Scene], value: float) -> list[Scene]:
        """The scenes with that value, where they have it."""
        return [self.written(s, value) if self.only in (None, k) else s for k, s in enumerate(scenes)]

    def rows(self, scene: Scene) -> list[tuple[ValueRow, Any]]:
        """Objects of a scene that have the parameter, each with its row of the table."""
        found: list[tuple[ValueRow, Any]] = []
        for row in (r for r in fit_rows() if r.name == self.what):
            if row.owner == "Scene":
                found.append((row, scene))
            else:
                found += [(row, b) for b in fit_things(scene) if _has_value(row, b, scene) and self.path in ("", b.path)]
        return found

    def value(self, scene: Scene) -> float | None:
        """Present value of the parameter, of several bodies the mean; None where nothing has it."""
        found = [_value_of(row, thing, self.axis) for row, thing in self.rows(scene)]
        if not found:
            return None
        return float(np.exp(np.mean(np.log(found))) if self.map.kind == "log" and min(found) > 0.0 else np.mean(found))

    def written(self, scene: Scene, value: float) -> Scene:
        """The scene with that value; the given one stays as it is."""
        for row, thing in self.rows(scene):
            if row.owner != "Scene":
                scene = scene.exchanged(thing, thing_with_parameter(row, thing, value, self.axis))
            else:
                new = value if self.axis is None else _put_in(getattr(scene, self.what), self.axis, value)
                scene = replace(scene, **{self.what: new})                                   # type: ignore[arg-type]
        return scene

    def live(self, scene: Scene) -> list[tuple[str, str, object]]:
        """(path, name, value) of `Simulation.set` that give a running copy what this scene has."""
        found: list[tuple[str, str, object]] = []
        for row, thing in self.rows(scene):
            if row.owner == "Scene":
                found.append(("/", self.what, getattr(scene, self.what)))
            elif getattr(thing, "is_sheet", False) and self.what in table.PARTS:
                names = ("stretch", "weft") if thing.model == "membrane" else ("stretch",)
                found += [(thing.path, name, getattr(thing.material, name)) for name in names]
            elif getattr(thing, "is_net", False) and self.what == "stiffness":
                found.append((thing.path, self.what, np.asarray(thing.stiffness, np.float64)))
            elif isinstance(thing, Load):
                found.append((thing.path, self.what, thing.curve.values[0]))
            elif row.form == "factor":
                found.append((thing.path, self.what, thing.taken(self.what)))
            elif row.form == "vector":
                found.append((thing.path, self.what, getattr(thing, self.what)))
            else:
                found.append((thing.path, self.what, _value_of(row, thing, None)))
        return found


def _put_in(vector, axis: int, value: float) -> tuple[float, ...]:
    return tuple(value if k == axis else float(v) for k, v in enumerate(vector))


def _has_value(row: ValueRow, thing, scene: Scene) -> bool:
    """Poisson's ratio is of membranes, and a strain limit is where it is finite from the start."""
    if type(thing).__name__ != row.owner or (isinstance(thing, Load) and thing.name != row.name):
        return False
    none = row.gradient == "grains" and (thing.further or not hasattr(thing.material, row.name))      # of its law
    if none or has_painted_stiffness(thing, row.name.partition("_")[0]):         # a map of faces, not one number
        return False
    if hasattr(thing, "taken") and thing.taken(row.name) is None and row.name != "mass":     # no drive, or no collider
        return False
    return not any(NEEDS[need](thing, row.name, scene) for need in ("membrane", "finite") if need in row.needs)


def _value_of(row: ValueRow, thing, axis: int | None) -> float:
    if row.owner == "Cloth" and row.name in table.PARTS:
        return thing.material.weft or thing.material.stretch if row.name == "stretch_weft" else thing.material.stretch
    if isinstance(thing, Load):
        return float(thing.curve.values[0, axis or 0])
    if getattr(thing, "is_net", False) and row.name == "mass":
        return float(np.broadcast_to(thing.masses, len(thing.points)).astype(np.float64).sum())
    if row.owner == "Body" and row.name == "mass":
        from wsim.physics.rigid.mass import body_inertia
        return body_inertia(thing).mass
    value = thing.taken(row.name) if hasattr(thing, "taken") else getattr(value_holder(thing, row.name), row.name)
    return float(value[axis]) if axis is not None else float(np.mean(np.asarray(value, np.float64)))


def thing_with_parameter(row: ValueRow, thing, value: float, axis: int | None = None):
    """A copy of a body or load with that value; different stiffness of springs, and masses of points, keep their proportions.
    """
    if isinstance(thing, Load):
        return replace(thing, curve=thing.curve.replaced(np.array([_put_in(thing.curve.values[0], axis or 0, value)])))
    if row.owner == "Cloth" and row.name in table.PARTS:
        m = thing.material
        new = {"stretch": {"stretch": value, "weft": m.weft * (value / m.stretch)}, "stretch_weft": {"weft": value},
               "stretch_warp": {"stretch": value, "weft": m.weft or m.stretch}}[row.name]
        return replace(thing, material=replace(m, **new))
    if hasattr(thing, "given"):
        return thing.given(row.name, value if axis is None else np.array(_put_in(thing.taken(row.name), axis, value)))
    if value_holder(thing, row.name) is not thing:
        return replace(thing, material=replace(thing.material, **{row.name: value}))
    if not getattr(thing, "is_net", False):
        return replace(thing, **{row.name: value if axis is None else np.array(_put_in(getattr(thing, row.name), axis, value))})
    own: Any = {} if row.name in ("stiffness", "mass") else {row.name: value}
    copy = replace(thing, **own)
    now, masses = np.asarray(thing.stiffness, np.float64), np.asarray(thing.masses, np.float64)      # stay in float64
    copy.stiffness = now * (value / now.mean()) if row.name == "stiffness" else now
    copy.masses = masses * (value / _value_of(row, thing, None)) if row.name == "mass" else masses
    return copy


# from names

def parameters_of_names(asked: str | Iterable[str], scenes: list[Scene], start: dict[str, float] | None = None,
                        shared: str | Iterable[str] | None = None) -> tuple[list[Parameter], list[Scene]]:
    """The parameters of these names, and the scenes with the values of `start`, by name. shared: see `wsim.fitting.shared`.

    Raises SceneError with every name that is unknown, frozen, named twice, or has no start to begin from.
    """
    wanted = [n.strip() for n in (asked.split(",") if isinstance(asked, str) else asked) if n.strip()]
    problems: list[Problem] = []
    if not wanted:
        problems.append(Problem("parameters", f"none is named; allowed are {', '.join(parameter_names())}"))
    found = [p for name in wanted for p in _parameters_of_name(name, scenes, problems.append)]
    found, used = sharing.split_by_experiment(found, scenes, shared, problems.append), set()
    for p in found:
        if begun := sharing.value_given_by_name(p, start or {}):
            used.add(begun[0])
            try:
                p.map.forward(begun[1])
                scenes = p.in_all(scenes, begun[1])
            except ValueError as error:
                problems.append(Problem(p.name, f"start is {begun[1]:g}; {str(error) or 'it must be finite'}"))
    problems += [Problem(name, f"has a start value and is not fitted; fitted are {', '.join(p.name for p in found)}")
                 for name in start or {} if name not in used]
    found = [_with_range_of_scenes(p, p.among(scenes)) for p in found]
    problems += [q for p in found for q in _problems_of_parameter(p, p.among(scenes))]
    problems += _problems_of_repetition(found, scenes)
    if problems:
        raise SceneError(dict.fromkeys(problems))
    return found, scenes


def _parameters_of_name(name: str, scenes: list[Scene], fail: Callable[[Problem], None]) -> list[Parameter]:
    path, _, what = name.rpartition(":")
    axes: list[int | None] = [None]
    vectors = [row.name for row in fit_rows() if row.form not in ("number", "factor")]
    stem, _, axis = what.rpartition("_")
    if stem in vectors and axis in AXES:
        what, axes = stem, [AXES.index(axis)]
    elif what in vectors:
        axes = [0, 1, 2]
    mine = [r for r in fit_rows() if r.name == what]
    if not mine:
        fail(Problem(name, f"{_reason_not_fitted(what, scenes)}; allowed are {', '.join(parameter_names())}, of one body as "
                           f"/World/Body:{parameter_names()[0]}"))
        return []
    row = mine[0]
    if path and row.owner == "Scene":
        fail(Problem(name, f"{what} is the whole scene's; write {what}"))
        return []
    own = f"{path}:" if path else ""
    made = [Parameter(f"{own}{what}_{AXES[k]}" if k is not None else name, what, path, row.unit, _map(row), k) for k in axes]
    maps = [_map(r) for p in made for scene in scenes for r, _ in p.rows(scene)]
    if not maps:
        have = [b.path for s in scenes for b in fit_things(s) for r in mine if _has_value(r, b, s)]
        kinds = ", ".join(sorted({separated_words(r.owner) for r in mine}))
        more = "".join({"membrane": "; of a cloth it acts in the model 'membrane'",
                        "finite": "; a cloth has one where it is finite from the start"}.get(need, "") for need in row.needs)
        named = ", ".join(dict.fromkeys(have)) or "none"
        fail(Problem(path or name, f"nothing here has {what}: it belongs to {kinds}{more}; those that have it: {named}"))
        return []
    return [replace(p, map=min(maps, key=lambda m: m.low)) for p in made]


def _map(row: ValueRow) -> FittingMap:
    assert row.fit
    return FittingMap.of(row.fit)


def _reason_not_fitted(what: str, scenes: list[Scene]) -> str:
    """Why a name is no parameter."""
    known = [row for row in table.VALUES if row.name == what]
    here = {type(thing).__name__ for scene in scenes for thing in fit_things(scene)}
    if not known:
        return "is no parameter"
    if not any(row.live for row in known if row.owner in here or not here & {r.owner for r in known}):
        return "is fixed while a scene runs and cannot be fitted"
    return f"is fitted with a value for each element ({what}[])" if any(row.each for row in known) else \
        "is live, and no fit finds it"


def _with_range_of_scenes(p: Parameter, scenes: list[Scene]) -> Parameter:
    """Poisson's ratio from (-1, 0.5) where it does not start above 0; of loads a unit of theta is their size."""
    if loads := [thing for s in scenes for _, thing in p.rows(s) if isinstance(thing, Load)]:
        return replace(p, map=FittingMap("plain", high=max(float(np.abs(load.curve.values).max()) for load in loads) or LARGE))
    if p.what == "poisson" and any((p.value(s) or 0.0) <= 0.0 for s in scenes if p.rows(s)):
        return replace(p, map=WIDE)
    return p


def _problems_of_parameter(p: Parameter, scenes: list[Scene]) -> list[Problem]:
    """Why it cannot be fitted where a scene has it."""
    problems = []
    for scene in scenes:
        problems += unfittable_parameter(scene, p.what, p.path)
        for row, thing in p.rows(scene):
            path, value = getattr(thing, "path", "/"), _value_of(row, thing, p.axis)
            nothing = (p.map.kind == "log" and value <= 0.0) or (bool({"start", "throws"} & set(row.needs)) and value == 0.0)
            if "air" in row.needs and (reason := NEEDS["air"](thing, p.what, scene)):
                problems.append(Problem(p.what, f"{reason}; author one, or leave {p.what} out"))
            elif not isfinite(value) or nothing:
                problems.append(Problem(path, f"{p.what} is {value:g} at the start, so that nothing of it runs; give a start "
                                        f"value other than 0 ({p.name})"))
            elif p.what in ("stretch_warp", "stretch_weft") and thing.model != "membrane":
                problems.append(Problem(path, f"{p.what} is of membranes, and its model is 'springs'; fit stretch, or take the "
                                        "model 'membrane'"))
            elif "mass" in row.needs and single_density(thing) is None:
                problems.append(Problem(path, "density changes nothing: masses are authored, or materials differ; remove the "
                                        "masses, or leave density out"))
            elif {"mass", "apart"} & set(row.needs) and scene.ties:
                problems.append(Problem(path, f"{p.what} is fixed where bodies share points (ties); leave it out"))
            elif isinstance(thing, Load) and thing.curve.moves:
                problems.append(Problem(path, f"its {p.what} has {len(thing.curve.times)} keys, and {p.name} is one number; "
                                        f"fit {p.what}[], which has a value for each, or give it one value"))
            elif "alone" in row.needs and NEEDS["alone"](thing, p.what, scene):
                problems.append(Problem(path, f"has {len(thing.materials)} materials, and {p.what} is fitted as one value; "
                                        "give it one material, or leave it out"))
    return problems


def _problems_of_repetition(found: list[Parameter], scenes: list[Scene]) -> list[Problem]:
    seen: dict[tuple, str] = {}
    problems = []
    for p in found:
        for key in {(k, getattr(thing, "path", "/"), part, p.axis) for k, s in enumerate(scenes) if p.only in (None, k)
                    for _, thing in p.rows(s) for part in table.PARTS.get(p.what, (p.what,))}:
            if key in seen:
                problems.append(Problem(key[1], f"{p.what} is named twice, by {seen[key]} and {p.name}; name it once"))
            seen[key] = p.name
    return problems
