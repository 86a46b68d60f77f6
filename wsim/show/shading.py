"""How a triangle mesh is drawn: its colours, and which corners share a normal. NumPy only.

Corners at one place share a normal where the triangles between them meet at less than the crease angle: the sum of the
triangles' normals weighed by area. So a cloth is smooth, a box has edges, a cylinder has both.
"""

from dataclasses import dataclass, field
from math import cos, radians

import numpy as np

from wsim.geometry import topology

CREASE = radians(40.0)

# Linear RGB. Cloth and soft bodies are warm and saturated, what they fall on is light grey: the eye goes to what moves.
PALETTE = {"cloth": [(0.62, 0.075, 0.045), (0.80, 0.30, 0.025), (0.50, 0.04, 0.16), (0.70, 0.45, 0.06),
                     (0.36, 0.06, 0.32)],
           "soft": [(0.84, 0.36, 0.03), (0.66, 0.06, 0.12), (0.78, 0.16, 0.03), (0.56, 0.30, 0.04), (0.48, 0.05, 0.26)],
           "springs": [(0.50, 0.09, 0.04), (0.60, 0.25, 0.03)],
           "collider": [(0.56, 0.57, 0.59), (0.47, 0.49, 0.53), (0.62, 0.60, 0.56)],
           "particles": [(0.05, 0.20, 0.44), (0.62, 0.42, 0.20), (0.10, 0.36, 0.22), (0.56, 0.30, 0.04)],
           "plain": [(0.20, 0.30, 0.42), (0.30, 0.38, 0.33), (0.36, 0.30, 0.40)]}


def palette_colour(kind: str, number: int) -> tuple[float, float, float]:
    """Linear colour of the number-th prim of a kind: a key of PALETTE."""
    colors = PALETTE[kind]
    return colors[number % len(colors)]


@dataclass
class MeshLook:
    """One mesh as a picture needs it: what does not change when it moves."""

    triangles: np.ndarray                                     # (t, 3) int32
    colors: np.ndarray = field(default_factory=lambda: np.array([palette_colour("cloth", 0)]))  # linear, (k, 3)
    color_of: np.ndarray = None     # type: ignore[assignment]  # colour of each corner, (t, 3); None: all the first
    normal_of: np.ndarray = None    # type: ignore[assignment]  # normal of each corner, (t, 3); None: that of its point
    path: str = ""

    def __post_init__(self):
        self.triangles = np.asarray(self.triangles, np.int32).reshape(-1, 3)
        self.colors = np.asarray(self.colors, np.float32).reshape(-1, 3)
        if self.color_of is None:
            self.color_of = np.zeros_like(self.triangles)
        if self.normal_of is None:
            self.normal_of = self.triangles

    def normals(self, points: np.ndarray) -> np.ndarray:
        """Unit normals (k, 3) that normal_of points at, for points (n, 3)."""
        faces = np.repeat(topology.area_normals(points, self.triangles), 3, axis=0)
        group = self.normal_of.ravel()
        total = np.stack([np.bincount(group, faces[:, k], int(group.max(initial=-1)) + 1) for k in range(3)], axis=1)
        length = np.linalg.norm(total, axis=1, keepdims=True)
        return np.divide(total, length, out=np.tile([0.0, 0.0, 1.0], (len(total), 1)), where=length > 0)


def smoothing_groups(points: np.ndarray, triangles: np.ndarray, crease: float = CREASE) -> np.ndarray:
    """Group of each corner, (t, 3) int32: corners of a group share a normal. Points at equal places count as one.

    crease: largest angle [rad] between neighbouring triangles that are shaded as one surface; pi: everything is smooth.
    """
    places = topology.distinct_rows(np.asarray(points, np.float64))[1][triangles]         # (t, 3)
    if crease >= np.pi:
        return places.astype(np.int32)
    normal = topology.area_normals(points, triangles)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    start, end = places, np.roll(places, -1, axis=1)                                       # side k: corners k, k + 1
    key = (np.minimum(start, end) * (int(places.max(initial=0)) + 1) + np.maximum(start, end)).ravel()
    order = topology.order_of(key)
    same = key[order[1:]] == key[order[:-1]]
    a, b = order[:-1][same], order[1:][same]                                               # sides that meet
    fold = (normal[a // 3] * normal[b // 3]).sum(axis=1)
    turned = start.ravel()[a] == start.ravel()[b]                 # windings disagree: the normals would cancel
    near = (fold > cos(crease)) & ~turned
    a, b = a[near], b[near]
    following = np.arange(triangles.size).reshape(-1, 3)[:, [1, 2, 0]].ravel()
    links = np.concatenate([np.stack([a, following[b]], 1), np.stack([following[a], b], 1)])
    return topology.labels_of_islands(triangles.size, links).reshape(-1, 3)
