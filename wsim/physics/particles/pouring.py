"""Where and when material comes that a shape pours: all of it known before the first frame. NumPy only.

The velocity u points along the shape's own axes and turns with it. Columns of edge d along u go through the shape.
A particle enters a column where that enters the shape, and goes with u and the shape. They enter one after the other, columns
in a fixed order that mixes them, each a little to the side of the one before:

    t_k = start + (k + 1/2) m / rate,  k = 0, 1, 2 ...,  m the mass of a particle

so that the mass that has come at t is rate (t - start) to half a particle, whatever steps are taken. A column carries at most a
particle each d: the greatest rate is m |u| columns / d, which is what comes where no rate is given.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, floor, inf
from typing import Any

import numpy as np

from wsim.geometry.triangulate import triangulate_polygons
from wsim.physics.contact.collider.point_cloud import PointCloud
from wsim.scene import Surface
from wsim.scene.solids import shape_row

WITHIN = 0.96            # of a column's width, over which particles that may overlap are spread
EVENLY = np.array([0.7548776662466927, 0.5698402909980532])
MOST_PLACES = 3e7        # of the lattice about a shape: some 2 GB while it is looked at
SPARSE, TRIES = 0.5, 8   # see `_scatter_apart`
LOOKS = 4                # times a frame at which a motion is evaluated; it is linear between


@dataclass(frozen=True)
class Pour:
    """When and how much a shape pours, as in `Pour(start=0.5, end=2.0, rate=3.0)`: of `scene.particles` and `scene.mpm`, which
    give the shape, the velocity and the material. Equation: the head of this file.

    start   [s] from the scene's start; what would come before the first frame that is simulated does not come
    end     [s], after the start; inf: without end
    rate    mass a time [kg/s], above 0 and at most what the cross-section carries at the velocity; None: that much
    """

    start: float = 0.0
    end: float = inf
    rate: float | None = None

    def later(self, delay: float) -> "Pour":
        """The same, `delay` [s] later."""
        return replace(self, start=self.start + delay, end=self.end + delay)


def velocity_axes(velocity: np.ndarray) -> np.ndarray:
    """Axes as columns, the third along a velocity (3, 3)."""
    u = velocity / np.linalg.norm(velocity)
    a = np.eye(3)[int(np.argmin(np.abs(u)))]
    a = a - (a @ u) * u
    a = a / np.linalg.norm(a)
    return np.stack([a, np.cross(u, a), u], axis=1)


@dataclass
class PouredPoints:
    """x [m] world (n, 3), v [m/s] (n, 3), volume [m^3] of each one's part of a column (n,), t [s] (n,) ascending: when each
    comes."""

    x: np.ndarray
    v: np.ndarray
    volume: np.ndarray
    t: np.ndarray


class PouringShape:
    """The columns of a thing that pours: it has a shape, a motion, a velocity [m/s] and a `Pour`.

    edge     d, of a column [m]          mass     of a particle [kg]
    within   part of a column's width over which particles are spread
    """

    def __init__(self, thing: Any, edge: float, mass: float, within: float = WITHIN):
        self.thing, self.pour, self.edge, self.mass, self.within = thing, thing.pour, edge, mass, within
        self.start = max(self.pour.start, 0.0)
        self.velocity = np.asarray(thing.velocity, np.float64)

    @cached_property
    def places(self) -> np.ndarray:
        """Where columns enter the shape, own frame (n, 3) [m]; none: the shape holds no particle."""
        R = velocity_axes(self.velocity)
        begin, end = self._lattice_bounds(R)
        index = np.stack(np.meshgrid(*(np.arange(a, b) for a, b in zip(begin, end, strict=True)), indexing="ij"), -1)
        inside = self._inside(index.reshape(-1, 3), R, begin, end).reshape(index.shape[:3])
        first = inside.copy()
        first[:, :, 1:] &= ~inside[:, :, :-1]
        found = (index[first] + 0.5) * self.edge @ R.T
        return found[np.random.default_rng(0).permutation(len(found))]

    def _lattice_bounds(self, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        low, high = own_bounds(self.thing.shape, R)
        return np.floor(low / self.edge).astype(int) - 2, np.ceil(high / self.edge).astype(int) + 2

    @property
    def lattice_size(self) -> float:
        """Places of the lattice about the shape, which `places` looks at."""
        begin, end = self._lattice_bounds(velocity_axes(self.velocity))
        return float(np.prod((end - begin).astype(np.float64)))

    def _inside(self, index: np.ndarray, R: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        shape, q = self.thing.shape, (index + 0.5) * self.edge @ R.T
        if isinstance(shape, PointCloud):
            near = np.zeros(len(q), bool)
            for center, radius in zip(shape.start, shape.radius_of, strict=True):
                near |= np.sum((q - center) ** 2, axis=1) < radius**2
            return near
        if not isinstance(shape, Surface):
            return shape_row(shape).distance(shape, q) < 0.0
        from wsim.geometry.tetra.inside import AxisRays
        triangles = triangulate_polygons(shape.points, shape.counts, shape.indices)[0]
        return AxisRays(shape.points.astype(np.float64) @ R / self.edge - 0.5, triangles, begin, end - 1).inside(index)

    @property
    def greatest_rate(self) -> float:
        """Mass that columns carry [kg/s]."""
        return float(len(self.places) * self.mass * np.linalg.norm(self.velocity) / self.edge)

    @property
    def interval(self) -> float:
        """Time [s] from one particle to the next."""
        rate = self.pour.rate
        return self.mass / (self.greatest_rate if rate is None else rate)

    def count_until(self, time: float) -> int:
        """Particles that have come before a time [s]."""
        length = min(self.pour.end, time) - self.start
        return max(0, floor(length / self.interval + 0.5)) if length < inf else 0

    def _scatter(self, k: np.ndarray, within: float | None = None) -> np.ndarray:
        """Ways across the columns (n, 3) [m], own frame, up to half a column: else grains of a column would fall on each other
        and run in rows. Points of the plane that fill it evenly: multiples of powers of the plastic number (Roberts 2018)."""
        across, within = velocity_axes(self.velocity)[:, :2], self.within if within is None else within
        return within * self.edge * (np.modf(0.5 + np.outer(k, EVENLY))[0] - 0.5) @ across.T

    def _scatter_apart(self, count: int) -> np.ndarray:
        """Ways across the columns (count, 3) [m], own frame, of particles that may not overlap: each goes as far to the side as
        others do that may, of TRIES places to the first where it touches none before it, else to the one farthest off them.
        Above SPARSE of the greatest rate there is no room for that: all keep to the lattice."""
        k, apart = np.arange(count), self.edge * (1.0 - self.within)               # apart: diameter
        way = self.interval * float(np.linalg.norm(self.velocity))                 # from one to the next
        if way * len(self.places) * SPARSE < self.edge:
            return self._scatter(k)
        wide = self._scatter(np.arange(count * TRIES), WITHIN).reshape(count, TRIES, 3)
        places, near = self.places[k % len(self.places)], ceil(apart / way)
        u, found = self.velocity / np.linalg.norm(self.velocity), np.zeros((count, 3))
        for j in range(count):
            before = found[max(j - near, 0):j] + u * (way * np.arange(min(near, j), 0, -1))[:, None]
            gaps = np.linalg.norm(before[None] - (places[j] + wide[j])[:, None], axis=2).min(axis=1, initial=np.inf)
            free = gaps > apart
            found[j] = places[j] + wide[j, int(np.argmax(free)) if free.any() else int(np.argmax(gaps))]
        return found - places

    def pour_points(self, first: int, last: int, fps: float) -> PouredPoints:
        """Particles first to last - 1 of all that come."""
        k, thing = np.arange(first, last), self.thing
        t = self.start + (k + 0.5) * self.interval
        scatter = self._scatter(k) if self.within == WITHIN else self._scatter_apart(last)[first:]
        q = self.places[k % len(self.places)] + scatter
        look = t * fps * LOOKS
        at, part = np.floor(look).astype(np.int64), (look - np.floor(look))[:, None]
        times, which = np.unique(at, return_inverse=True)
        M = np.array([[thing.motion.at(n / (fps * LOOKS)) for n in (m, m + 1)] for m in times.tolist()]).reshape(-1, 2, 4, 4)
        M = M[which.reshape(-1)]
        x0, x1 = (np.einsum("nij,nj->ni", M[:, n, :3, :3], q) + M[:, n, :3, 3] for n in (0, 1))
        u0, u1 = (M[:, n, :3, :3] @ self.velocity for n in (0, 1))
        v = (1.0 - part) * u0 + part * u1 + (x1 - x0) * (fps * LOOKS)
        return PouredPoints((1.0 - part) * x0 + part * x1, v, np.full(len(k), self.edge**3), t)


def own_bounds(shape, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Low and high corner of a box about a shape in its own frame, along the columns of R [m]."""
    if isinstance(shape, Surface):
        points = shape.points.astype(np.float64) @ R
        return points.min(axis=0), points.max(axis=0)
    reach = shape.bounding_radius if isinstance(shape, PointCloud) else float(shape_row(shape).ball(shape))
    return np.full(3, -reach), np.full(3, reach)
