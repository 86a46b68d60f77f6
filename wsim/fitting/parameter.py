"""What can be fitted: a table of parameters, the map of each to a line without ends, and how a scene takes a value.

    stretch               one value for every body that has it
    /World/Cloth:stretch  of that body alone
    stretch_warp, stretch_weft    apart; stretch keeps their ratio
    gravity               three parameters: gravity_x, gravity_y, gravity_z; each may be named alone; so with wind, and with
                          force and traction of loads that stay
    mass                  of a net, whose points keep their proportions

The maps: `wsim.fitting.least_squares.bounds`. A step of the fit, its priors and its error bars live in the mapped space
(theta), the results in both.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np

from wsim.fitting.least_squares.bounds import LARGE, LOG, PLAIN, WIDE, Map
from wsim.scene import Cloth, Collider, Load, Problem, Scene, SceneError, Soft, Springs
from wsim.scene.check.varying import painted, unfit
from wsim.scene.curve import Curve
from wsim.scene.masses import density_of

AXES, VECTORS = ("x", "y", "z"), ("gravity", "wind", "force", "traction")


@dataclass(frozen=True)
class Fittable:
    """A parameter of a kind of body, of colliders, or of the scene."""

    name: str
    owner: type
    unit: str
    map: Map = LOG
    within: str = ""             # attribute of the body that has it; "": the body itself


TABLE = (
    Fittable("stretch", Cloth, "N/m", within="material"), Fittable("stretch_warp", Cloth, "N/m", within="material"),
    Fittable("stretch_weft", Cloth, "N/m", within="material"), Fittable("shear", Cloth, "N/m", within="material"),
    Fittable("bend", Cloth, "N m", within="material"), Fittable("damping", Cloth, "s", within="material"),
    Fittable("density", Cloth, "kg/m^3", within="material"), Fittable("strain_limit", Cloth, "1", within="material"),
    Fittable("poisson", Cloth, "1", WIDE, "material"),
    Fittable("stiffness", Springs, "N/m"), Fittable("damping", Springs, "s"), Fittable("mass", Springs, "kg"),
    Fittable("force", Load, "N", PLAIN), Fittable("traction", Load, "Pa", PLAIN),
    Fittable("young", Soft, "Pa", within="material"), Fittable("poisson", Soft, "1", Map("bounded", 0.0, 0.5), "material"),
    Fittable("density", Soft, "kg/m^3", within="material"), Fittable("damping", Soft, "s", within="material"),
    Fittable("pressure", Soft, "Pa", Map("plain", high=1e3)),
    Fittable("static_friction", Cloth, "1", within="material"), Fittable("static_friction", Soft, "1", within="material"),
    Fittable("dynamic_friction", Cloth, "1", within="material"), Fittable("dynamic_friction", Soft, "1", within="material"),
    Fittable("static_friction", Collider, "1"), Fittable("dynamic_friction", Collider, "1"),
    Fittable("restitution", Collider, "1", Map("bounded", 0.0, 1.0)),
    Fittable("gravity", Scene, "m/s^2", PLAIN), Fittable("wind", Scene, "m/s", PLAIN), Fittable("air_drag", Scene, "1/s"),
)
STRETCHES = {"stretch": ("warp", "weft"), "stretch_warp": ("warp",), "stretch_weft": ("weft",)}
NAMES = tuple(dict.fromkeys(row.name for row in TABLE))
FROZEN = ("thickness", "yield_strain", "drag", "lift", "weld",
          "masses", "lengths", "rest_points", "air_density")        # of a scene, and fixed while it runs


def things(scene: Scene) -> list[Cloth | Springs | Soft | Collider | Load]:
    """All that may have parameters."""
    return [*scene.bodies(), *scene.colliders, *scene.loads]


@dataclass(frozen=True)
class Parameter:
    """One number to be fitted."""

    name: str                    # as asked
    what: str                    # name in TABLE
    path: str                    # of the one body; "": of all that have it
    unit: str
    map: Map
    axis: int | None = None      # of a vector

    def rows(self, scene: Scene) -> list[tuple[Fittable, object]]:
        """What has it in a scene, each with its row of the table."""
        found: list[tuple[Fittable, object]] = []
        for row in (r for r in TABLE if r.name == self.what):
            if row.owner is Scene:
                found.append((row, scene))
            else:
                found += [(row, b) for b in things(scene) if _has(row, b) and self.path in ("", b.path)]
        return found

    def value(self, scene: Scene) -> float | None:
        """Its present value, of several bodies the mean; None where nothing has it."""
        found = [_get(row, thing, self.axis) for row, thing in self.rows(scene)]
        if not found:
            return None
        return float(np.exp(np.mean(np.log(found))) if self.map.kind == "log" and min(found) > 0.0 else np.mean(found))

    def written(self, scene: Scene, value: float) -> Scene:
        """The scene with that value; the given one stays as it is."""
        for row, thing in self.rows(scene):
            if row.owner is Scene:
                changed: dict = {self.what: value if self.axis is None else _with(getattr(scene, self.what), self.axis, value)}
            else:
                new = _put(row, thing, value, self.axis)
                changed = {group: [new if b is thing else b for b in getattr(scene, group)]
                           for group in ("cloths", "springs", "softs", "colliders", "loads")}
            scene = replace(scene, **changed)
        return scene

    def live(self, scene: Scene) -> list[tuple[str, str, object]]:
        """(path, name, value) of `Simulation.set` that give a running copy what this scene has."""
        found: list[tuple[str, str, object]] = []
        for row, thing in self.rows(scene):
            if row.owner is Scene:
                found.append(("/", self.what, getattr(scene, self.what)))
            elif isinstance(thing, Cloth) and self.what in STRETCHES:
                names = ("stretch", "weft") if thing.model == "membrane" else ("stretch",)
                found += [(thing.path, name, getattr(thing.material, name)) for name in names]
            elif isinstance(thing, Springs) and self.what == "stiffness":
                found.append((thing.path, self.what, np.asarray(thing.stiffness, np.float64)))
            elif isinstance(thing, Load):
                found.append((thing.path, self.what, thing.curve.values[0]))
            else:
                found.append((thing.path, self.what, _get(row, thing, None)))            # type: ignore[attr-defined]
        return found


def _with(vector, axis: int, value: float) -> tuple[float, ...]:
    return tuple(value if k == axis else float(v) for k, v in enumerate(vector))


def _has(row: Fittable, thing) -> bool:
    """Poisson's ratio is of membranes, and a strain limit is where it is finite from the start."""
    if type(thing) is not row.owner:
        return False
    if isinstance(thing, Load):
        return thing.name == row.name
    if isinstance(thing, Cloth) and painted(thing, row.name.partition("_")[0]):
        return False                                     # a map of faces, not one number
    return not isinstance(thing, Cloth) or {"poisson": thing.model == "membrane",
                                            "strain_limit": isfinite(thing.material.strain_limit)}.get(row.name, True)


def _get(row: Fittable, thing, axis: int | None) -> float:
    if row.name in STRETCHES:
        return thing.material.weft or thing.material.stretch if row.name == "stretch_weft" else thing.material.stretch
    if isinstance(thing, Load):
        return float(thing.curve.values[0, axis or 0])
    if row.name == "mass":
        return float(np.broadcast_to(thing.masses, len(thing.points)).astype(np.float64).sum())
    value = getattr(getattr(thing, row.within) if row.within else thing, row.name)
    return float(value[axis]) if axis is not None else float(np.mean(np.asarray(value, np.float64)))


def _put(row: Fittable, thing, value: float, axis: int | None = None):
    """A copy of a body or load with that value; different stiffness of springs, and masses of points, keep their proportions.
    """
    if isinstance(thing, Load):
        return replace(thing, curve=Curve(thing.curve.times, np.array([_with(thing.curve.values[0], axis or 0, value)])))
    if row.name in STRETCHES:
        m = thing.material
        new = {"stretch": {"stretch": value, "weft": m.weft * (value / m.stretch)}, "stretch_weft": {"weft": value},
               "stretch_warp": {"stretch": value, "weft": m.weft or m.stretch}}[row.name]
        return replace(thing, material=replace(m, **new))
    if row.within:
        return replace(thing, **{row.within: replace(getattr(thing, row.within), **{row.name: value})})
    if not isinstance(thing, Springs):
        return replace(thing, **{row.name: value})
    copy = replace(thing, damping=value) if row.name == "damping" else replace(thing)
    now, masses = np.asarray(thing.stiffness, np.float64), np.asarray(thing.masses, np.float64)      # stay in float64
    copy.stiffness = now * (value / now.mean()) if row.name == "stiffness" else now
    copy.masses = masses * (value / _get(row, thing, None)) if row.name == "mass" else masses
    return copy


# from names

def parameters(asked: str | Iterable[str], scenes: list[Scene], start: dict[str, float] | None = None
               ) -> tuple[list[Parameter], list[Scene]]:
    """The parameters of these names, and the scenes with the values of `start`, by name.

    Raises SceneError with every name that is unknown, frozen, named twice, or has no start to begin from.
    """
    names = [n.strip() for n in (asked.split(",") if isinstance(asked, str) else asked) if n.strip()]
    problems: list[Problem] = []
    if not names:
        problems.append(Problem("parameters", f"none is named; allowed are {', '.join(NAMES)}"))
    found = [p for name in names for p in _named(name, scenes, problems.append)]
    given = dict(start or {})
    for p in found:
        if p.name in given:
            value = given.pop(p.name)
            try:
                p.map.forward(value)
                scenes = [p.written(scene, value) for scene in scenes]
            except ValueError as error:
                problems.append(Problem(p.name, f"start is {value:g}; {str(error) or 'it must be finite'}"))
    problems += [Problem(name, f"has a start value and is not fitted; fitted are {', '.join(p.name for p in found)}")
                 for name in given]
    found = [_ranged(p, scenes) for p in found]
    problems += [q for p in found for q in _wrong(p, scenes)]
    problems += _twice(found, scenes)
    if problems:
        raise SceneError(dict.fromkeys(problems))
    return found, scenes


def _named(name: str, scenes: list[Scene], fail: Callable[[Problem], None]) -> list[Parameter]:
    path, _, what = name.rpartition(":")
    axes: list[int | None] = [None]
    stem, _, axis = what.rpartition("_")
    if stem in VECTORS and axis in AXES:
        what, axes = stem, [AXES.index(axis)]
    elif what in VECTORS:
        axes = [0, 1, 2]
    if what not in NAMES:
        text = "is fixed while a scene runs and cannot be fitted" if what in FROZEN else "is no parameter"
        fail(Problem(name, f"{text}; allowed are {', '.join(NAMES)}, of one body as /World/Body:{NAMES[0]}"))
        return []
    row = next(r for r in TABLE if r.name == what)
    if path and row.owner is Scene:
        fail(Problem(name, f"{what} is the whole scene's; write {what}"))
        return []
    own = f"{path}:" if path else ""
    made = [Parameter(f"{own}{what}_{AXES[k]}" if k is not None else name, what, path, row.unit, row.map, k) for k in axes]
    maps = [r.map for p in made for scene in scenes for r, _ in p.rows(scene)]
    if not maps:
        have = [b.path for s in scenes for b in things(s) for r in TABLE if r.name == what and _has(r, b)]
        kinds = ", ".join(sorted({r.owner.__name__.lower() for r in TABLE if r.name == what}))
        more = {"poisson": "; of a cloth it acts in the model 'membrane'",
                "strain_limit": "; a cloth has one where it is finite from the start"}.get(what, "")
        fail(Problem(path or name, f"nothing here has {what}: it belongs to {kinds}{more}; those that have it: "
                     f"{', '.join(dict.fromkeys(have)) or 'none'}"))
        return []
    return [replace(p, map=min(maps, key=lambda m: m.low)) for p in made]


def _ranged(p: Parameter, scenes: list[Scene]) -> Parameter:
    """Poisson's ratio from (-1, 0.5) where it does not start above 0; of loads a unit of theta is their size."""
    if p.what in ("force", "traction"):
        size = max(float(np.abs(load.curve.values).max()) for s in scenes for _, load in p.rows(s))      # type: ignore
        return replace(p, map=Map("plain", high=size or LARGE))
    if p.what == "poisson" and any((p.value(s) or 0.0) <= 0.0 for s in scenes if p.rows(s)):
        return replace(p, map=WIDE)
    return p


def _wrong(p: Parameter, scenes: list[Scene]) -> list[Problem]:
    """Why it cannot be fitted where a scene has it."""
    problems = []
    for scene in scenes:
        problems += unfit(scene, p.what, p.path)
        if p.what == "wind" and not any(c.drag or c.lift for c in scene.cloths):
            problems.append(Problem("wind", "no cloth has drag or lift, so that wind does nothing; author one, or leave wind "
                                    "out"))
        for row, thing in p.rows(scene):
            path, value = getattr(thing, "path", "/"), _get(row, thing, p.axis)
            nothing = (p.map.kind == "log" and value <= 0.0) or (p.what in ("pressure", "restitution") and value == 0.0)
            if not isfinite(value) or nothing:
                problems.append(Problem(path, f"{p.what} is {value:g} at the start, so that nothing of it runs; give a start "
                                        f"value other than 0 ({p.name})"))
            elif p.what in ("stretch_warp", "stretch_weft") and thing.model != "membrane":     # type: ignore[attr-defined]
                problems.append(Problem(path, f"{p.what} is of membranes, and its model is 'springs'; fit stretch, or take the "
                                        "model 'membrane'"))
            elif p.what == "density" and density_of(thing) is None:
                problems.append(Problem(path, "density changes nothing: masses are authored, or materials differ; remove the "
                                        "masses, or leave density out"))
            elif p.what in ("density", "mass") and scene.ties:
                problems.append(Problem(path, f"{p.what} is fixed where bodies share points (ties); leave it out"))
            elif isinstance(thing, Load) and thing.curve.moves:
                problems.append(Problem(path, f"its {p.what} has {len(thing.curve.times)} keys, and {p.name} is one number; "
                                        f"fit {p.what}[], which has a value for each, or give it one value"))
            elif isinstance(thing, Soft) and row.within and thing.others:
                problems.append(Problem(path, f"has {len(thing.materials)} materials, and {p.what} is fitted as one value; "
                                        "give it one material, or leave it out"))
    return problems


def _twice(found: list[Parameter], scenes: list[Scene]) -> list[Problem]:
    seen: dict[tuple, str] = {}
    problems = []
    for p in found:
        for key in {(k, getattr(thing, "path", "/"), part, p.axis) for k, s in enumerate(scenes) for _, thing in p.rows(s)
                    for part in STRETCHES.get(p.what, (p.what,))}:
            if key in seen:
                problems.append(Problem(key[1], f"{p.what} is named twice, by {seen[key]} and {p.name}; name it once"))
            seen[key] = p.name
    return problems
