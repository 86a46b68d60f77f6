"""What can be fitted: a table of parameters, the map of each to a line without ends, and how a scene takes a value.

    stretch               one value for every body that has it
    /World/Cloth:stretch  of that body alone
    stretch_warp, stretch_weft    apart; stretch keeps their ratio
    gravity               three parameters: gravity_x, gravity_y, gravity_z; each may be named alone; so with wind

Maps: moduli, densities, times and strain limits, which are positive, by their logarithm; Poisson's ratio by a bounded map, from
0 of soft bodies, from -1 of membranes; the rest as it is.
A step of the fit, its priors and its error bars live in the mapped space (theta), the results in both.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np

from wsim.check_varying import unfit
from wsim.masses import density_of
from wsim.scene import Cloth, Collider, Problem, Scene, SceneError, Soft, Springs

AXES = ("x", "y", "z")
LARGE = 10.0           # [m/s^2, m/s, Pa] one unit of theta of a parameter that may have either sign


@dataclass(frozen=True)
class Map:
    """theta of a value, the value of theta, and d value / d theta."""

    kind: str                    # "log", "plain" or "bounded"
    low: float = 0.0             # of "bounded"
    high: float = 1.0            # of "bounded"; of "plain" the value of theta = 1

    def forward(self, value):
        """Of a number or an array. Raises ValueError, with what is allowed, outside the range."""
        if self.kind == "plain":
            return value / self.high
        if self.kind == "log":
            if not np.all(value > 0.0):
                raise ValueError("allowed is a number > 0")
            return np.log(value)
        if not np.all((self.low < value) & (value < self.high)):
            raise ValueError(f"allowed is between {self.low:g} and {self.high:g}")
        return np.log((value - self.low) / (self.high - value))

    def inverse(self, theta):
        if self.kind == "plain":
            return theta * self.high
        theta = np.clip(theta, -300.0, 300.0)
        return np.exp(theta) if self.kind == "log" else self.low + (self.high - self.low) / (1.0 + np.exp(-theta))

    def slope(self, theta):
        if self.kind == "plain":
            return np.full_like(theta, self.high) if isinstance(theta, np.ndarray) else self.high
        if self.kind == "log":
            return self.inverse(theta)
        value = self.inverse(theta)
        return (value - self.low) * (self.high - value) / (self.high - self.low)


LOG, PLAIN = Map("log"), Map("plain", high=LARGE)
WIDE = Map("bounded", -1.0, 0.5)


@dataclass(frozen=True)
class Row:
    """A parameter of a kind of body, of colliders, or of the scene."""

    name: str
    owner: type
    unit: str
    map: Map = LOG
    within: str = ""             # attribute of the body that has it; "": the body itself


TABLE = (
    Row("stretch", Cloth, "N/m", within="material"), Row("stretch_warp", Cloth, "N/m", within="material"),
    Row("stretch_weft", Cloth, "N/m", within="material"), Row("shear", Cloth, "N/m", within="material"),
    Row("bend", Cloth, "N m", within="material"), Row("damping", Cloth, "s", within="material"),
    Row("density", Cloth, "kg/m^3", within="material"), Row("strain_limit", Cloth, "1", within="material"),
    Row("poisson", Cloth, "1", WIDE, "material"),
    Row("stiffness", Springs, "N/m"), Row("damping", Springs, "s"),
    Row("young", Soft, "Pa", within="material"), Row("poisson", Soft, "1", Map("bounded", 0.0, 0.5), "material"),
    Row("density", Soft, "kg/m^3", within="material"), Row("damping", Soft, "s", within="material"),
    Row("pressure", Soft, "Pa", Map("plain", high=1e3)),
    Row("static_friction", Cloth, "1", within="material"), Row("static_friction", Soft, "1", within="material"),
    Row("dynamic_friction", Cloth, "1", within="material"), Row("dynamic_friction", Soft, "1", within="material"),
    Row("static_friction", Collider, "1"), Row("dynamic_friction", Collider, "1"),
    Row("restitution", Collider, "1", Map("bounded", 0.0, 1.0)),
    Row("gravity", Scene, "m/s^2", PLAIN), Row("wind", Scene, "m/s", PLAIN), Row("air_drag", Scene, "1/s"),
)
STRETCHES = {"stretch": ("warp", "weft"), "stretch_warp": ("warp",), "stretch_weft": ("weft",)}
NAMES = tuple(dict.fromkeys(row.name for row in TABLE))
FROZEN = ("thickness", "yield_strain", "drag", "lift", "weld",
          "masses", "mass", "lengths", "rest_points", "air_density")        # of a scene, and fixed while it runs


def things(scene: Scene) -> list[Cloth | Springs | Soft | Collider]:
    """All that may have parameters."""
    return [*scene.bodies(), *scene.colliders]


@dataclass(frozen=True)
class Parameter:
    """One number to be fitted."""

    name: str                    # as asked
    what: str                    # name in TABLE
    path: str                    # of the one body; "": of all that have it
    unit: str
    map: Map
    axis: int | None = None      # of a vector

    def rows(self, scene: Scene) -> list[tuple[Row, object]]:
        """What has it in a scene, each with its row of the table."""
        found: list[tuple[Row, object]] = []
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
                new = _put(row, thing, value)
                changed = {group: [new if b is thing else b for b in getattr(scene, group)]
                           for group in ("cloths", "springs", "softs", "colliders")}
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
            else:
                found.append((thing.path, self.what, _get(row, thing, None)))            # type: ignore[attr-defined]
        return found


def _with(vector, axis: int, value: float) -> tuple[float, ...]:
    return tuple(value if k == axis else float(v) for k, v in enumerate(vector))


def _has(row: Row, thing) -> bool:
    """Poisson's ratio is of membranes, and a strain limit is where it is finite from the start."""
    if type(thing) is not row.owner:
        return False
    return not isinstance(thing, Cloth) or {"poisson": thing.model == "membrane",
                                            "strain_limit": isfinite(thing.material.strain_limit)}.get(row.name, True)


def _get(row: Row, thing, axis: int | None) -> float:
    if row.name in STRETCHES:
        return thing.material.weft or thing.material.stretch if row.name == "stretch_weft" else thing.material.stretch
    value = getattr(getattr(thing, row.within) if row.within else thing, row.name)
    return float(value[axis]) if axis is not None else float(np.mean(np.asarray(value, np.float64)))


def _put(row: Row, thing, value: float):
    """A copy of a body with that value; springs of different stiffness keep their proportions."""
    if row.name in STRETCHES:
        m = thing.material
        new = {"stretch": {"stretch": value, "weft": m.weft * (value / m.stretch)}, "stretch_weft": {"weft": value},
               "stretch_warp": {"stretch": value, "weft": m.weft or m.stretch}}[row.name]
        return replace(thing, material=replace(m, **new))
    if row.within:
        return replace(thing, **{row.within: replace(getattr(thing, row.within), **{row.name: value})})
    copy = replace(thing) if row.name == "stiffness" else replace(thing, **{row.name: value})
    if isinstance(thing, Springs):
        now = np.asarray(thing.stiffness, np.float64)         # stays in float64 from here on
        copy.stiffness = now * (value / now.mean()) if row.name == "stiffness" else now
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
    if stem in ("gravity", "wind") and axis in AXES:
        what, axes = stem, [AXES.index(axis)]
    elif what in ("gravity", "wind"):
        axes = [0, 1, 2]
    if what not in NAMES:
        text = "is fixed while a scene runs and cannot be fitted" if what in FROZEN else "is no parameter"
        fail(Problem(name, f"{text}; allowed are {', '.join(NAMES)}, of one body as /World/Body:{NAMES[0]}"))
        return []
    row = next(r for r in TABLE if r.name == what)
    if path and row.owner is Scene:
        fail(Problem(name, f"{what} is the whole scene's; write {what}"))
        return []
    made = [Parameter(f"{what}_{AXES[k]}" if k is not None else name, what, path, row.unit, row.map, k) for k in axes]
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
    """Poisson's ratio from (-1, 0.5) where it does not start above 0."""
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
            elif p.what == "density" and scene.ties:
                problems.append(Problem(path, "density is fixed where bodies share points (ties); leave it out"))
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
