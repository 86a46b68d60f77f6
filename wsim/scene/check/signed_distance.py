"""Signed distance of points to solid colliders where a scene starts, negative inside [m]. NumPy only, for checks; what a step
uses is kernels/contact/collider/shape.py and kernels/contact/mesh.py.

Convex shapes: exact inside, a bound from below outside. Closed meshes: a point is inside where a ray along each of the three
axes says so (sum of signed crossings above it, the winding number of a closed surface), and further from its crossings than
`near`; then its distance to the triangles (Ericson 2005, 5.1.5). Other points of a mesh get inf.
"""

from math import inf

import numpy as np

from wsim.geometry import topology
from wsim.geometry.triangulate import triangulate_polygons
from wsim.geometry.winding import wound_alike
from wsim.scene import Collider, Surface
from wsim.scene.solids import shape_row

SOME = 64              # of the points inside of a mesh have their distance taken: those furthest from their crossings
ASIDE = 1e-7 * np.array([0.61, 0.37, 0.83])         # of the extent: rays pass beside edges and points of triangles
CELLS = 256            # of the grid in which crossings are sought, along each of two axes, at most


def collider_signed_distance(collider: Collider, points: np.ndarray, near: float) -> np.ndarray:
    """Signed distance of points (n, 3) [m, world] to a collider at the start, (n,). near [m]: a mesh leaves out what is no
    deeper."""
    M = collider.motion.at(0.0)
    q, shape = (points - M[:3, 3]) @ M[:3, :3], collider.shape
    if isinstance(shape, Surface):
        return _mesh_signed_distance(shape, q, near)
    return shape_row(shape).distance(shape, q)


def _mesh_signed_distance(shape: Surface, q: np.ndarray, near: float) -> np.ndarray:
    points = (shape.points if shape.poses is None else shape.poses.at(0.0)).astype(np.float64)
    triangles = wound_alike(points, triangulate_polygons(shape.points, shape.counts, shape.indices, True)[0])
    found = np.full(len(q), inf)
    if not is_closed_mesh(points, triangles):
        return found
    within = np.flatnonzero((q > points.min(axis=0)).all(axis=1) & (q < points.max(axis=0)).all(axis=1))
    depth, aside = np.full(len(within), inf), ASIDE * np.ptp(points, axis=0).max(initial=0.0)
    for axis in range(3):
        if len(within):
            winding, away = _ray_crossings(points[triangles], q[within] + aside, axis)
            depth = np.where(winding != 0, np.minimum(depth, away), 0.0)
    inside = depth > near
    found[within[inside]] = -depth[inside]                           # no less deep than they are
    for k in within[inside][np.argsort(-depth[inside])[:SOME]]:
        found[k] = -distance_to_triangles(q[k], points[triangles])
    return found


def is_closed_mesh(points: np.ndarray, triangles: np.ndarray) -> bool:
    """True if every edge is passed as often in one direction as in the other; points nearer than 1e-6 of the extent are one."""
    corner = topology.weld_points(points, 1e-6 * float(np.ptp(points, axis=0).max(initial=0.0)))[triangles].astype(np.int64)
    start, end = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    start, end = start[start != end], end[start != end]
    _, edge = np.unique(np.minimum(start, end) * len(points) + np.maximum(start, end), return_inverse=True)
    return len(start) > 0 and not np.bincount(edge.reshape(-1), np.where(start < end, 1.0, -1.0)).any()


def _ray_crossings(X: np.ndarray, q: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """(sum of signed crossings above, distance to the nearest crossing above or below [m]) of lines along an axis through q,
    with triangles X (t, 3, 3)."""
    from wsim.geometry.tetra.lattice import cells_of_integer_boxes
    u, v = (axis + 1) % 3, (axis + 2) % 3
    low, high = X[:, :, [u, v]].min(axis=(0, 1)), X[:, :, [u, v]].max(axis=(0, 1))
    cells = int(np.clip(np.sqrt(len(X)), 1, CELLS))
    scale = cells / np.maximum(high - low, 1e-300)

    def ray_grid_cell(p: np.ndarray) -> np.ndarray:
        return np.clip(((p - low) * scale).astype(np.int64), 0, cells - 1)
    mine = ray_grid_cell(q[:, [u, v]])
    mine = mine[:, 0] * cells + mine[:, 1]
    order = np.argsort(mine, kind="stable")
    starts = np.searchsorted(mine[order], np.arange(cells * cells + 1))
    winding, away = np.zeros(len(q)), np.full(len(q), inf)
    for owner, place in cells_of_integer_boxes(ray_grid_cell(X[:, :, [u, v]].min(axis=1)),
                                               ray_grid_cell(X[:, :, [u, v]].max(axis=1))):
        one = place[:, 0] * cells + place[:, 1]
        count = starts[one + 1] - starts[one]
        face = np.repeat(owner, count)
        which = order[np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(starts[one], count)]
        a, b, c = (X[face, k] - q[which] for k in range(3))
        A, B, C = (x[:, u] * y[:, v] - x[:, v] * y[:, u] for x, y in ((b, c), (c, a), (a, b)))
        hit = ((A > 0) & (B > 0) & (C > 0)) | ((A < 0) & (B < 0) & (C < 0))
        which, sign = which[hit], np.sign(A[hit])
        height = (A * a[:, axis] + B * b[:, axis] + C * c[:, axis])[hit] / (A + B + C)[hit]
        np.add.at(winding, which, np.where(height > 0.0, sign, 0.0))
        np.minimum.at(away, which, np.abs(height))
    return winding, away


def distance_to_triangles(q: np.ndarray, X: np.ndarray) -> float:
    """The least distance of a point (3,) to triangles (t, 3, 3)."""
    n = np.cross(X[:, 1] - X[:, 0], X[:, 2] - X[:, 0])
    square = (n * n).sum(axis=1)
    over, least = square > 0.0, inf
    for k in range(3):
        a, e = X[:, k], X[:, (k + 1) % 3] - X[:, k]
        t = np.clip(((q - a) * e).sum(axis=1) / np.maximum((e * e).sum(axis=1), 1e-300), 0.0, 1.0)
        least = min(least, float(np.linalg.norm(q - a - t[:, None] * e, axis=1).min()))
        over &= (np.cross(e, q - a) * n).sum(axis=1) >= 0.0
    if over.any():
        least = min(least, float((np.abs(((q - X[:, 0]) * n).sum(axis=1))[over] / np.sqrt(square[over])).min()))
    return least
