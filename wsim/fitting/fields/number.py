"""Numbers among fields: a parameter (`wsim.fitting.parameter`) as a field of one value, and both from their names.

Live values of a body are linear in the parameter (a stretch with its weft, springs in proportion), so that one difference of
them is their derivative; the chain rule does the rest.
"""

import numpy as np

from wsim.fitting import parameter
from wsim.fitting.fields.field import FieldKind, ParameterField, fields_of_names, is_field
from wsim.fitting.fields.prior import NeighbourBelief
from wsim.fitting.least_squares.bounds import FittingMap
from wsim.fitting.parameter import Parameter
from wsim.gradient.gradient import Gradient
from wsim.scene import Problem, Scene, SceneError
from wsim.scene.values.table import PARTS
from wsim.simulation.simulation import Simulation

LOADS = ("force", "traction")             # whose gradients have a row for each key


class NumberField:
    """A parameter with one value (1, 1), in the form of a `ParameterField`."""

    belief, near = "free", 1.0

    def __init__(self, parameter: Parameter):
        self.parameter, self.name, self.path = parameter, parameter.name, parameter.path
        self.kind = FieldKind(parameter.what, (), "number", parameter.unit, parameter.map)
        self.now = np.nan

    @property
    def map(self) -> FittingMap:
        return self.kind.map

    def belongs_to_scene(self, scene: Scene) -> bool:
        return bool(self.parameter.rows(scene))

    def values(self, sim: Simulation, last: int) -> np.ndarray:
        return np.array([[self.parameter.value(sim.given)]])

    def belief_at(self, sim: Simulation, theta: np.ndarray) -> NeighbourBelief:
        return NeighbourBelief(np.zeros((0, 2), np.int64), "free", self.near, theta.copy())

    def live(self, scene: Scene, value: float) -> list[tuple[str, str, object]]:
        return self.parameter.live(self.parameter.written(scene, value))

    def slope(self, sim: Simulation, gradient: Gradient, shape: tuple) -> np.ndarray:
        """Derivative by the value, (1, 1)."""
        step, total = -0.5 * self.now or 1.0, 0.0
        ends = (self.live(sim.given, self.now + s) for s in (0.0, step))
        for (path, name, before), (_, _, after) in zip(*ends, strict=True):
            by = (np.asarray(after, np.float64) - np.asarray(before, np.float64)) / step
            if by.any():
                total += float((by * self.derivative(gradient, path, name, by.ndim > 0)).sum())
        return np.array([[total]])

    def derivative(self, gradient: Gradient, path: str, name: str, each: bool):
        found = gradient.value(path, name, elements=each)
        return found[0] if name in LOADS else found

    def written(self, scene: Scene, values: np.ndarray) -> Scene:
        return self.parameter.written(scene, float(values[0, 0]))


def set_fields_and_numbers(sim: Simulation, given: list[tuple[ParameterField | NumberField, np.ndarray]]) -> None:
    """Values of fields and numbers; several numbers may be parts of one value (of a vector, of warp and weft)."""
    scene, numbers = sim.given, []
    for thing, values in given:
        if isinstance(thing, NumberField):
            thing.now = float(values[0, 0])
            scene = thing.written(scene, values)
            numbers.append(thing)
        else:
            thing.give(sim, values)
    for path, name, value in {(p, n): (p, n, v) for number in numbers for p, n, v in number.parameter.live(scene)}.values():
        sim.set(path, name, value)
    sim.changes.clear()


def numbers_and_fields(names: list[str], scenes: list[Scene],
                       start: dict) -> tuple[list[ParameterField | NumberField], list[Scene]]:
    """Numbers, then fields, of these names, and the scenes with the start values of the numbers. Raises SceneError with
    everything that is wrong."""
    plain = [n for n in names if not is_field(n)]
    problems: list[Problem] = []
    found: list[ParameterField | NumberField] = []
    try:
        if plain:
            given = {p: v for p, v in start.items() if not is_field(p) and np.ndim(v) == 0}
            numbers, scenes = parameter.parameters_of_names(plain, scenes, given)
            found += [NumberField(p) for p in numbers]
    except SceneError as error:
        problems += error.problems
    try:
        found += fields_of_names([n for n in names if is_field(n)], scenes)
    except SceneError as error:
        problems += error.problems
    problems += [Problem(n.name, f"and {f.name} are of one body ({f.path}); name one of them") for n in found for f in found
                 if isinstance(n, NumberField) and isinstance(f, ParameterField) and _number_is_of_field(n, f, scenes)]
    if problems:
        raise SceneError(problems)
    return found, scenes


def _number_is_of_field(n: NumberField, f: ParameterField, scenes: list[Scene]) -> bool:
    """Whether both say what one body has."""
    return f.kind.name in PARTS.get(n.kind.name, (n.kind.name,)) and any(
        getattr(thing, "path", "/") == f.path for s in scenes for _, thing in n.parameter.rows(s))
