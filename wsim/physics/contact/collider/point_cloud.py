"""Balls about many points, which may move: a shape of sources of smoke and liquid (USD: Points with widths).

Inside is the union of the balls. The distance to it is phi(q) = min_k |q - c_k| - r_k: exact outside, a bound from below within
where balls overlap. On the device a cloud is a mesh with a face of three equal corners for each ball, so that Warp's tree of
faces finds the nearest ones; behind the centres come points (r_k, 0, 0), which no face has
(kernels/contact/collider/nearest.py).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from wsim.scene import Problem
from wsim.scene.bodies import ArrayDataclass
from wsim.scene.check.objects import check_point_array, thing_error
from wsim.scene.curve import Curve
from wsim.scene.values.arrays import real_array


@dataclass(eq=False)
class PointCloud(ArrayDataclass):
    """Balls about points, a shape of sources, as in `scene.smoke_source("/sparks", scene.smoke("/air", (0, 0, 0), (1, 2, 1),
    cell=0.1), PointCloud([(0.3, 0.5, 0.5), (0.7, 0.5, 0.5)], radii=0.1), smoke=5.0)`.

    points    centres, (n, 3) [m], own frame
    radii     of each ball, (n,), or one for all [m]
    poses     of points that move, a Curve of centres (keys, n, 3) [m]; None: they stay
    """

    points: np.ndarray
    radii: np.ndarray | float
    poses: Curve | None = None

    def __post_init__(self):
        self.points, self.radii = real_array(self.points, -1, 3), real_array(self.radii, -1)

    @property
    def radius_of(self) -> np.ndarray:
        """Radius of each ball [m], (n,) float64."""
        return np.broadcast_to(np.asarray(self.radii, np.float64), (len(self.points),))

    @property
    def start(self) -> np.ndarray:
        """Centres where the scene starts, (n, 3) float64 [m], own frame."""
        return np.asarray(self.points if self.poses is None else self.poses.at(0.0), np.float64)

    @property
    def bounding_radius(self) -> float:
        """Radius about the own origin that holds all balls at all keys [m]."""
        centers = self.points[None] if self.poses is None else self.poses.values
        away = np.linalg.norm(np.asarray(centers, np.float64), axis=2)
        return float((away + self.radius_of).max(initial=0.0))

    @property
    def faces(self) -> np.ndarray:
        """Corners of the mesh of the device, (3 n,)."""
        return np.repeat(np.arange(len(self.points), dtype=np.int32), 3)


def device_points(shape: Any, points: np.ndarray) -> np.ndarray:
    """Points of the mesh that the device has of a surface or a cloud whose own points are these, float32."""
    if isinstance(shape, PointCloud):
        own = np.zeros((len(points), 3))
        own[:, 0] = shape.radius_of
        points = np.concatenate([points, own])
    return np.asarray(points, np.float32)


def fill_lattice(cloud: PointCloud, M: np.ndarray, first: np.ndarray, edge: np.ndarray, low: np.ndarray, high: np.ndarray,
                 margin: float) -> np.ndarray:
    """True at places first + edge * k, low <= k < high, nearer to the cloud at the start than margin [m], (places,) bool;
    M (4, 4): its frame to the world, rigid."""
    inside = np.zeros(np.asarray(high) - low, bool)
    for center, radius in zip(cloud.start @ M[:3, :3].T + M[:3, 3], cloud.radius_of + margin, strict=True):
        a = np.maximum(np.ceil((center - radius - first) / edge), low).astype(int)
        b = np.minimum(np.floor((center + radius - first) / edge) + 1, high).astype(int)
        if radius <= 0.0 or (a >= b).any():
            continue
        x, y, z = (first[k] + edge[k] * np.arange(a[k], b[k]) - center[k] for k in range(3))
        part = inside[tuple(slice(s - o, e - o) for s, e, o in zip(a, b, low, strict=True))]
        part |= x[:, None, None] ** 2 + y[:, None] ** 2 + z**2 < radius**2
    return inside.reshape(-1)


def cloud_problems(cloud: PointCloud, path: str) -> Iterator[Problem]:
    """What is wrong with the numbers of a cloud."""
    n = len(cloud.points)
    if n == 0:
        yield thing_error(path, "it has no points", "one or more", "author points")
    if not np.isfinite(cloud.points).all():
        bad = int(np.argmax(~np.isfinite(cloud.points).all(axis=1)))
        yield thing_error(path, f"point {bad} is {cloud.points[bad].tolist()}", "finite numbers", "author its points again")
    yield from check_point_array(path, "radii", np.asarray(cloud.radii), (1, n), 0.0, True)
    if cloud.poses is not None and np.shape(cloud.poses.values)[1:] != (n, 3):
        yield thing_error(path, f"its animated points have shape {np.shape(cloud.poses.values)}", f"(keys, {n}, 3)",
                           "animate the points without changing their number")
    elif cloud.poses is not None and not np.isfinite(cloud.poses.values).all():
        yield thing_error(path, "its animated points hold NaN or infinity", "finite numbers", "author its points again")
