"""Gap of two convex shapes in float64, found another way than by the engine: from all faces of the hull of differences of
corners (SciPy's Qhull), or, where a shape is round, by a search over directions that closes in on the best."""

import numpy as np
import pytest

from tests.physics.rigid.pairs import matrix

SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


def corners(kind, size):
    """Vertices of the core and the radius all around it."""
    if kind == "box":
        return SIGNS * size, 0.0
    if kind == "sphere":
        return np.zeros((1, 3)), float(np.atleast_1d(size)[0])
    if kind == "capsule":
        return np.array([[0, 0, -size[1]], [0, 0, size[1]]], float), size[0]
    return np.asarray(size, float), 0.0


def placed(points, pose):
    return points @ matrix(pose[3:]).T + pose[:3]


def to_triangles(X):
    """Least distance from 0 to triangles (n, 3, 3)."""
    a, b, c = X[:, 0], X[:, 1], X[:, 2]
    n = np.cross(b - a, c - a)
    areas = np.stack([(n * np.cross(b, c)).sum(1), (n * np.cross(c, a)).sum(1), (n * np.cross(a, b)).sum(1)])
    inside = (areas > 0).all(0)
    best = np.abs((n * a).sum(1) / np.linalg.norm(n, axis=1))[inside].min(initial=np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        e = q - p
        t = np.clip(-(p * e).sum(1) / (e * e).sum(1), 0, 1)
        best = min(best, np.linalg.norm(p + t[:, None] * e, axis=1).min())
    return best


def polyhedra(a, pose_a, b, pose_b):
    """Gap of shapes (kind, size) with corners; of the cores, less the radii."""
    A, ra = corners(*a[:2])
    B, rb = corners(*b[:2])
    D = (placed(A, pose_a)[:, None] - placed(B, pose_b)[None]).reshape(-1, 3)
    hull = pytest.importorskip("scipy.spatial").ConvexHull(D)
    offset = hull.equations[:, 3].max()
    return (offset if offset <= 0 else to_triangles(D[hull.simplices])) - ra - rb


def extent(kind, size, d):
    """Support h(d) of a shape, d (n, 3) unit."""
    if kind in ("cylinder", "cone"):
        R, H = size[:2]
        rim = R * np.hypot(d[:, 0], d[:, 1])
        return rim + H * np.abs(d[:, 2]) if kind == "cylinder" else np.maximum(H * d[:, 2], rim - H * d[:, 2])
    points, r = corners(kind, size)
    return (d @ points.T).max(1) + r


def round_shapes(a, pose_a, b, pose_b, samples=4000, rounds=40):
    """Gap = max over n of min n.b - max n.a, by samples that close in on the eight best of all directions."""
    Ra, Rb, p = matrix(pose_a[3:]), matrix(pose_b[3:]), pose_b[:3] - pose_a[:3]

    def apart(n):
        return n @ p - extent(*a[:2], n @ Ra) - extent(*b[:2], -n @ Rb)
    rng = np.random.default_rng(1)
    n = rng.normal(size=(samples, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    best = n[np.argsort(apart(n))[-8:]]
    width = 0.2
    for _ in range(rounds):
        m = best[:, None] + width * rng.normal(size=(8, 60, 3))
        m = np.concatenate([best[:, None], m / np.linalg.norm(m, axis=2, keepdims=True)], 1)
        score = apart(m.reshape(-1, 3)).reshape(8, -1)
        best = m[np.arange(8), score.argmax(1)]
        width *= 0.6
    return apart(best).max()
