"""From gradients of what kernels of material points read to those of what a scene says, in float64."""

from dataclasses import replace
from typing import Any

import numpy as np

from wsim.scene.values.coverage import gradient_refusal

STEP = 1e-3            # of a number of a material, in differences of closed forms: their error is its fourth power


def number_slopes(material: Any, name: str) -> np.ndarray:
    """Derivatives of the numbers of a law (`numbers()` of its material) with respect to a value: differences of fourth order of
    a closed form, off by 1e-12 of its size."""
    value = getattr(material, name)
    h = STEP * (abs(value) or 1.0)
    if name == "poisson":
        h = STEP * min(0.5 - value, 1.0 + value)

    def at(times: float) -> np.ndarray:
        return np.array(replace(material, **{name: value + times * h}).numbers(), np.float64)
    return (8.0 * (at(1.0) - at(-1.0)) - (at(2.0) - at(-2.0))) / (12.0 * h)


class MaterialPointGradient:
    """Derivatives of a loss by what bodies of material points begin with and are made of."""

    def __init__(self, recorded: Any, states: Any):
        self.recorded, self.method, part = recorded, recorded.method, recorded.method.part
        adjoint = recorded.adjoint
        self.numbers, self.mass, self.g = (a.numpy()[:part.count] for a in (adjoint.numbers, adjoint.mass, adjoint.g))
        every = np.asarray(states[part.every.ptr], np.float64).reshape(len(part.names), part.capacity, 3)
        self.o, self.v = (every[part.names.index(name)] for name in "ov")

    def value(self, path: str, name: str, world: int = 0) -> Any:
        """Gradient with respect to a value of a body. Raises SceneError where its material has none."""
        rows = self.recorded.rows(path, world)
        if name == "positions":
            return self.o[rows] / self.method.cell
        if name == "velocities":
            return self.v[rows]
        k = self.method.things.index(next(thing for thing in self.method.things if thing.path == path))
        if self.method.things[k].further:
            raise gradient_refusal("mixed", path, name=name)
        material = self.method.material_now(k, world)
        if not hasattr(material, name):
            raise gradient_refusal("law", path, name=name, law=material.law)
        found = float(number_slopes(material, name) @ self.numbers[rows].sum(axis=0)) if name != "density" else 0.0
        if name == "density":
            found = float(self.mass[rows] @ self.method.volume[self.method.thing_of == k])
        return found

    def gravity(self, world: int) -> np.ndarray:
        """Gradient with respect to gravity [s^2/m], (3,)."""
        rows = [self.recorded.rows(thing.path, world) for thing in self.method.things]
        return self.g[np.concatenate(rows)].sum(axis=0)
