"""What can be fitted with a value for each element: rows of `wsim.scene.values.table`, how a simulation takes the values, and
its gradient with respect to them.

    young[], poisson[]            of each tet of a soft body
    stiffness[]                   of each spring of a net
    bend[]                        of each hinge of a cloth; two of a triangle that differ are coupled by the root of both
    stretch[], shear[], weft[]    of each triangle of a membrane; of the model "springs" stretch[] of each edge, shear[] of each
                                  diagonal. A weft of 0 follows stretch; one that is not stays while stretch[] changes
    velocities[]                  of each point of any body at the start, in the world
    rest_shape[]                  of each point of a cloth or soft body, in the world, about its mean; in steps of 1 cm
    lengths[]                     of each spring of a net
    actuation[]                   of each key and group of the muscles of a net
    force[], traction[]           of each key of a load, in units of its size (or 10)
    /pin:motion[]                 shift of a pin or a collider in each frame after the first, on top of its own motion

/World/Bar:young[] is that of one body. In the brackets stands what is believed of neighbours (`wsim.fitting.fields.prior`):
young[smooth], young[tv], young[free], or with what they usually differ by: young[tv=0.5]. Values are in the author's order;
hinges in that of `wsim.geometry.topology.hinges_of_triangles`.
"""

import re
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from wsim.fitting.fields.prior import NeighbourBelief, elements_sharing_points, tets_sharing_faces
from wsim.fitting.least_squares.bounds import LARGE, FittingMap
from wsim.gradient.gradient import Gradient
from wsim.model.model import edge_lengths
from wsim.physics.cloth.constraints import AT_REST, of_body
from wsim.physics.cloth.rest_shape import current_rest_shape, object_with_rest
from wsim.scene import Collider, Deformable, Load, Motion, Pin, Problem, Scene, SceneError
from wsim.scene.values import table
from wsim.scene.values.per_tet import material_per_tet
from wsim.simulation.simulation import Simulation

WHOLE = ("velocities", "rest_shape", "actuation", "force", "traction")         # of more than one column
BELIEFS = ("smooth", "tv", "free")


@dataclass(frozen=True)
class FieldKind:
    """A name of the table of values, with all that have it. near: what neighbours differ by, in units of theta."""

    name: str
    owners: tuple[str, ...]
    noun: str
    unit: str
    map: FittingMap
    near: float = 0.3



def field_kinds() -> list[FieldKind]:
    """Rows of the table of values of each element, by name."""
    found: dict[str, FieldKind] = {}
    for row in table.VALUES:
        if row.each:
            owners = (*(found[row.name].owners if row.name in found else ()), row.owner)
            found[row.name] = FieldKind(row.name, owners, row.each.noun, row.unit, FittingMap.of(row.each.map), row.each.near)
    return list(found.values())


_NAME = re.compile(r"(?:(?P<path>.*):)?(?P<what>\w+)\[(?P<belief>\w*)(?:=(?P<near>[^\]]*))?\]")


def things_with_fields(scene: Scene) -> list[Deformable | Pin | Collider | Load]:
    """All that may have fields."""
    return [*scene.bodies(), *scene.pins, *scene.colliders, *scene.loads]


@dataclass(frozen=True)
class ParameterField:
    """One field to be fitted. belief, near: as asked."""

    name: str                    # without what stands in the brackets
    kind: FieldKind
    path: str
    belief: str = "smooth"
    near: float = 0.3

    @property
    def map(self) -> FittingMap:
        return self.kind.map

    def belongs_to_scene(self, scene: Scene) -> bool:
        return any(b.path == self.path for b in things_with_fields(scene))

    def thing_of_scene(self, scene: Scene):
        return next(b for b in things_with_fields(scene) if b.path == self.path)

    # values

    def values(self, sim: Simulation, last: int) -> np.ndarray:
        """Values of the scene, (n, c); last: frame of the last observation."""
        thing, what = self.thing_of_scene(sim.given), self.kind.name
        if what == "motion":
            return np.zeros((last, 3))
        if what == "velocities":
            return sim.velocities(self.path)
        if what in AT_REST:
            body = sim.model.body(self.path)
            return current_rest_shape(body) if what == "rest_shape" else edge_lengths(body)[:, None]
        if what == "actuation":
            return thing.actuation.values
        if isinstance(thing, Load):
            return thing.curve.values
        if thing.is_solid:
            which = np.zeros(len(thing.tets), np.int64) if thing.which is None else thing.which
            return np.array([getattr(m, what) for m in thing.materials], np.float64)[which][:, None]
        ids, stiffness = self.rows(sim)
        return np.broadcast_to(stiffness, len(ids)).astype(np.float64)[:, None]

    def rows(self, sim: Simulation) -> tuple[np.ndarray, np.ndarray]:
        """Places of the points of each spring, edge or hinge, and their stiffness."""
        found = [r for r in of_body(sim.model, sim.model.body(self.path)) if self.kind.name in r.stiffness]
        if len(found) != 1 or not np.all(found[0].stiffness[self.kind.name] > 0.0):
            raise SceneError(Problem(self.path, f"has no {self.kind.noun} with a {self.kind.name} of their own > 0; give it "
                                     "one, or leave it out"))
        return found[0].ids, found[0].stiffness[self.kind.name]

    def belief_at(self, sim: Simulation, theta: np.ndarray) -> NeighbourBelief:
        """Prior of theta (n, c), before anything was seen."""
        return NeighbourBelief(self.pairs(sim, len(theta)), self.belief, self.near, theta.copy())

    def pairs(self, sim: Simulation, count: int) -> np.ndarray:
        """Neighbours, (k, 2)."""
        if self.kind.name in ("motion", "actuation", "force", "traction"):
            return np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
        body = sim.model.body(self.path)
        if self.kind.name == "lengths":
            return elements_sharing_points(body.edges, sim.model.points)
        if self.kind.name in ("velocities", "rest_shape"):
            author = np.zeros(sim.model.points, np.int64)
            author[body.index] = np.arange(len(body.index))
            return author[body.edges]
        if body.source.is_solid:
            return tets_sharing_faces(cast(Any, body.source).tets)
        return elements_sharing_points(self.rows(sim)[0], sim.model.points)

    # a simulation

    def give(self, sim: Simulation, values: np.ndarray) -> None:
        """Sets them; velocities where it stands."""
        if self.kind.name == "motion":
            sim.set(self.path, "motion", self.moved(sim.given, values))
        else:
            sim.set(self.path, self.kind.name, values if self.kind.name in WHOLE else values[:, 0])
        sim.changes.clear()

    def moved(self, scene: Scene, shift: np.ndarray) -> Motion:
        """A motion with a shift [m] in each frame after the first."""
        times = np.arange(len(shift) + 1) / scene.fps
        values = np.stack([self.thing_of_scene(scene).motion.at(t) for t in times])
        values[1:, :3, 3] += shift
        return Motion(times, values)

    def slope(self, sim: Simulation, gradient: Gradient, shape: tuple) -> np.ndarray:
        """Derivative by the values, (n, c)."""
        found = np.zeros(shape)
        if isinstance(self.thing_of_scene(sim.given), Load):
            return gradient.load(self.path).reshape(shape)
        if self.kind.name in (*WHOLE, "lengths"):
            return getattr(gradient, self.kind.name)(self.path).reshape(shape)
        if self.kind.name == "motion" and isinstance(self.thing_of_scene(sim.given), Collider):
            by = gradient.motion(self.path)[1:, 0]
            found[:len(by)] = by
            return found
        if self.kind.name == "motion":
            by = gradient.targets(self.path).sum(axis=2)              # (frames, moments, 3)
            clock = sim.plan.clock
            at = (np.arange(by.shape[0])[:, None] + clock.moments(not np.isfinite(self.thing_of_scene(sim.given).stiffness))
                  / clock.dt)
            before = np.minimum(at.astype(int), by.shape[0] - 1)
            each = np.zeros((by.shape[0] + 1, 3))
            np.add.at(each, before, by * (before + 1 - at)[..., None])
            np.add.at(each, before + 1, by * (at - before)[..., None])
            found[:by.shape[0]] = each[1:]
            return found
        elements = np.asarray(gradient.material(self.kind.name, self.path, elements=True))
        if self.thing_of_scene(sim.given).is_solid:
            body = sim.model.body(self.path)
            order = np.concatenate([p.rows for t in gradient.parameters.tables for p in getattr(t, "parts", ())
                                    if p.body is body])
            found[order, 0] = elements
        else:
            found[:, 0] = elements
        return found

    # a scene

    def written(self, scene: Scene, values: np.ndarray) -> Scene:
        """The scene with these values; the given one stays as it is. A stretch or bend of each edge or hinge, for which a
        scene has no place, is left as their middle."""
        thing = self.thing_of_scene(scene)
        if isinstance(thing, (Pin, Collider)):
            new: Any = replace(thing, motion=self.moved(scene, values))
        elif isinstance(thing, Load):
            new = replace(thing, curve=thing.curve.replaced(values))
        elif self.kind.name in AT_REST:
            new = object_with_rest(thing, self.kind.name, values)
        elif self.kind.name == "velocities":
            new = replace(thing, velocities=values @ thing.motion.at(0.0)[:3, :3])
        elif thing.is_solid:
            new = material_per_tet(thing, self.kind.name, values[:, 0])
        elif self.kind.name == "actuation":
            new = replace(thing, actuation=thing.actuation.replaced(values))
        elif thing.is_net:
            new = replace(thing)
            new.stiffness = values[:, 0].copy()                        # stays in float64
        else:
            new = replace(thing, material=replace(thing.material, **{self.kind.name: float(np.median(values))}))
        return scene.exchanged(thing, new)


# from names

def is_field(name: str) -> bool:
    return "[" in name


def fields_of_names(names: list[str], scenes: list[Scene]) -> list[ParameterField]:
    """The fields of these names. Raises SceneError with everything that is wrong."""
    problems: list[Problem] = []
    found = []
    for name in names:
        try:
            found.append(_field_of_name(name, scenes))
        except SceneError as error:
            problems += error.problems
    twice = {f.name for f in found if sum((f.path, f.kind) == (g.path, g.kind) for g in found) > 1}
    problems += [Problem(name, "is named twice; name it once") for name in sorted(twice)]
    if problems:
        raise SceneError(problems)
    return found


def _field_of_name(name: str, scenes: list[Scene]) -> ParameterField:
    match = _NAME.fullmatch(name)
    kind = next((k for k in field_kinds() if match and k.name == match["what"]), None)
    if not match or not kind:
        every = [f"{k.name}[]" for k in field_kinds()]
        raise SceneError(Problem(name, f"is no field; allowed are {', '.join(every)}, of one body as /World/Body:{every[0]}"))
    belief, near = match["belief"] or "smooth", match["near"]
    try:
        size = kind.near if near is None else float(near)
    except ValueError:
        size = 0.0
    if belief not in BELIEFS or not (np.isfinite(size) and size > 0.0):
        raise SceneError(Problem(name, f"found [{belief}{'' if near is None else f'={near}'}]; allowed are "
                                 f"{', '.join(BELIEFS)}, of the first two with a number > 0 that neighbours differ by, as "
                                 "tv=0.5"))
    have = list(dict.fromkeys(b.path for s in scenes for b in things_with_fields(s) if type(b).__name__ in kind.owners
                              and (kind.name != "actuation" or getattr(b, "actuation", None) is not None)
                              and (not isinstance(b, Load) or b.name == kind.name)))
    path = match["path"] or (have[0] if len(have) == 1 else "")
    if path not in have:
        what = "name one of them" if len(have) > 1 and not path else f"nothing there has {kind.name}[]"
        raise SceneError(Problem(path or name, f"{what}; those that have it: {', '.join(have) or 'none'}"))
    for b in (b for s in scenes for b in s.bodies() if b.path == path and kind.name in ("velocities", "rest_shape")):
        if b.weld:
            raise SceneError(Problem(path, f"points that are welded move as one: {kind.name}[] of each are not to be had"))
        if kind.name == "rest_shape" and b.skins:
            raise SceneError(Problem(path, "its skins are bound to its rest shape; fit that without them"))
    if any(b.path == path and b.model == "membrane" for s in scenes for b in s.bodies()):
        kind = replace(kind, noun="triangles" if kind.name in ("stretch", "shear", "weft") else kind.noun)
    if sizes := [float(np.abs(load.curve.values).max()) for s in scenes for load in s.loads if load.path == path]:
        kind = replace(kind, map=FittingMap("plain", high=max(sizes) or LARGE))
    return ParameterField(f"{match['path']}:{kind.name}[]" if match["path"] else f"{kind.name}[]", kind, path, belief, size)
