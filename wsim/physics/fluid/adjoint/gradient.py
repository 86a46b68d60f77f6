"""From gradients of what the kernels of fluids read to those of what a scene says, in float64."""

from typing import Any

import numpy as np

from wsim.kernels.fluid.adjoint import covering as kernels
from wsim.physics.contact.collider.table import is_deforming_collider
from wsim.physics.fluid.adjoint.launches import AIR, ROWS
from wsim.physics.fluid.grid.domain import LIVE
from wsim.physics.fluid.measure import NAMES
from wsim.scene.values.coverage import gradient_refusal

FIELDS = {"smoke": "smoke", "temperature": "heat"}
SOURCE = {"smoke": kernels.SMOKE, "temperature": kernels.HEAT, "expansion": kernels.EXPANSION}


class FluidGradient:
    """Derivatives of a loss by what fluids and their sources begin with and are made of."""

    def __init__(self, losses: Any, states: Any, start: int):
        self.recorded, self.states, self.start = losses.recorded, states, start
        self.method = self.recorded.method
        self.numbers = [a.launches.numbers.numpy() for a in self.recorded.adjoints]
        self.frames = [[tuple(array.numpy() for array in own) for own in frame] for frame in losses.frames[::-1]]

    def value(self, path: str, name: str, world: int = 0) -> Any:
        """Gradient with respect to a value of a fluid, a source or an obstacle. Raises SceneError where there is none, or
        nothing of it runs."""
        if name == "surface":
            return self.surface(path, world)
        self.recorded.runs(path, name)
        if any(fluid.path == path for fluid, _ in self.method.pairs):
            return self.fluid(self.recorded.row(path, world), name)
        return self.source(path, name, world)

    # fluids

    def fluid(self, k: int, name: str) -> Any:
        if name in LIVE:
            return float(self.numbers[k][LIVE[name]])
        if name == "side_velocities":
            return self.walls(k)
        fluid, layout, arrays = self.method.pairs[k][0], self.method.layouts[k], self.recorded.arrays(k)
        if name == "acceleration":
            return self.field(k)
        if name == "velocity":
            found = np.zeros((*fluid.shape, 3))
            for a, axis in enumerate(layout.axes):
                by = self.states[arrays[NAMES[a]].ptr].reshape(layout.faces(a))
                found[..., axis] = layout.transpose_faced(by, a).reshape(fluid.shape)
            return found
        return np.asarray(self.states[arrays[FIELDS[name]].ptr]).reshape(fluid.shape)

    def field(self, k: int) -> np.ndarray:
        """Gradient with respect to the acceleration: of each cell, or of the one of all."""
        fluid, layout, found = self.method.pairs[k][0], self.method.layouts[k], np.zeros((*self.method.pairs[k][0].shape, 3))
        rows = self.recorded.adjoints[k].forces.field.numpy().astype(np.float64)
        found[..., layout.axes] = rows[:, :layout.dim].reshape(*fluid.shape, layout.dim)
        one = np.ndim(self.method.numbers[k].get("acceleration", fluid.acceleration)) == 1
        return found.sum(axis=(0, 1, 2)) if one else found

    def air(self, k: int) -> np.ndarray:
        """Gradient with respect to the rows of `StaggeredGrid.air`, along the world's axes, (7, 3)."""
        rows, found = self.numbers[k][AIR:].reshape(ROWS, 3), np.zeros((ROWS, 3))
        for a, axis in enumerate(self.method.layouts[k].axes):
            found[:, axis] = rows[:, a]
        return found

    def walls(self, k: int) -> np.ndarray:
        """Gradient with respect to the velocities of closed sides, (6, 3)."""
        fluid, air, found = self.method.pairs[k][0], self.air(k), np.zeros((6, 3))
        for a, axis in enumerate(self.method.layouts[k].axes):
            for side in (0, 1):
                if fluid.sides[2 * axis + side] == "closed":
                    found[2 * axis + side] = air[1 + 2 * a + side]
        return found

    def wind(self, world: int) -> np.ndarray:
        """Gradient with respect to the wind that comes in, (3,) [s/m]; the air that was there at the start stays as it is."""
        found = np.zeros(3)
        for k, (fluid, of) in enumerate(self.method.pairs):
            if of == world:
                air = self.air(k)
                found += air[0] + sum(air[1 + 2 * a + side] for a, axis in enumerate(self.method.layouts[k].axes)
                                      for side in (0, 1) if fluid.sides[2 * axis + side] == "wind")
        return found

    def gravity(self, world: int) -> np.ndarray:
        """Gradient with respect to gravity [s^2/m], (3,)."""
        found = np.zeros(3)
        for k, (_, of) in enumerate(self.method.pairs):
            if of == world:
                for a, axis in enumerate(self.method.layouts[k].axes):
                    found[axis] += self.numbers[k][a]
        return found

    # what moves

    def surface(self, path: str, world: int = 0) -> np.ndarray:
        """Gradient with respect to what may be added to the velocity [s/m] and the angular velocity [s/rad] of an obstacle's
        surface in each frame, (frames, 2, 3), where it is as it is: of all fluids of a world. Raises SceneError for others."""
        found = np.zeros((len(self.frames), 2, 3))
        for k, domain in enumerate(self.method.domains):
            things = domain.obstacles.shapes.things if domain.obstacles and domain.obstacles.moving else []
            for j, thing in enumerate(things if domain.world == world else ()):
                if thing.path == path:
                    if is_deforming_collider(thing):
                        raise gradient_refusal("forming", path)
                    found += np.stack([frame[k][-1][j][:6].reshape(2, 3) for frame in self.frames])
        if not any(thing.path == path for d in self.method.domains if d.obstacles and d.obstacles.moving
                   for thing in d.obstacles.shapes.things):
            raise gradient_refusal("surface", path)
        return found

    # sources

    def source(self, path: str, name: str, world: int) -> Any:
        """Gradient of a source, of all fluids of a world that it reaches."""
        found, dt = 0.0, 1.0 / self.method.scene.fps
        for k, domain in enumerate(self.method.domains):
            for j, source in enumerate(domain.sources.sources if domain.sources and domain.world == world else ()):
                if source.path == path:
                    rows = np.stack([frame[k][0][j] for frame in self.frames])
                    times = (self.start + np.arange(len(rows))) * dt
                    found = found + self.one(source, name, rows, times, dt, self.method.layouts[k].axes)
        return found

    def one(self, source: Any, name: str, rows: np.ndarray, times: np.ndarray, dt: float, axes: tuple[int, ...]) -> Any:
        """rows: what the numbers of a source got in each frame, which began at `times`."""
        if name == "strength":
            first, last = (source.strength.weights(t) for t in (times, times + dt))
            return first.T @ rows[:, kernels.FIRST] + last.T @ rows[:, kernels.LAST]
        total = rows.sum(axis=0)
        if name == "place":
            return total[kernels.PLACE:]
        if name == "velocity":
            found = np.zeros(3)
            found[list(axes)] = total[kernels.VELOCITY:kernels.VELOCITY + len(axes)]
            return found
        return float(total[SOURCE[name]])
