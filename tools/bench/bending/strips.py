"""Strips in the x-y plane on six kinds of mesh, clamped at x <= 0: points (n, 3), triangles (t, 3), pinned points."""

import numpy as np

LENGTH, WIDTH = 1.0, 0.25


def grid(cells: int, turned, jitter: float = 0.0, warp=None):
    """Columns x = -h, 0, .. LENGTH. turned(i, j, corners): whether the diagonal of cell i, j goes the other way."""
    h, m = LENGTH / cells, max(2, round(WIDTH * cells / LENGTH))
    x, y = np.meshgrid(h * np.arange(-1, cells + 1), WIDTH / m * np.arange(m + 1), indexing="ij")
    points = np.stack([x, y], -1).reshape(-1, 2)
    inner = (points[:, 0] > 0.5 * h) & (points[:, 0] < LENGTH - 0.5 * h) & (points[:, 1] > 1e-9) & (points[:, 1] < WIDTH - 1e-9)
    points[inner] += jitter * h * np.random.default_rng(3).uniform(-1.0, 1.0, (inner.sum(), 2))
    if warp:
        points = warp(points)
    faces, of = [], np.arange(len(points)).reshape(cells + 2, m + 1)
    for i in range(cells + 1):
        for j in range(m):
            a, b, c, d = of[i, j], of[i + 1, j], of[i + 1, j + 1], of[i, j + 1]
            faces += [[a, b, d], [b, c, d]] if turned(i, j, points[[a, b, c, d]]) else [[a, b, c], [a, c, d]]
    return points, np.array(faces)


def delaunay(i: int, j: int, p: np.ndarray) -> bool:
    """The diagonal with the smaller angles across from it."""
    def angle(k: int) -> float:
        u, v = p[(k + 1) % 4] - p[k], p[k - 1] - p[k]
        return float(np.arccos(u @ v / np.sqrt((u @ u) * (v @ v))))
    return angle(0) + angle(2) < angle(1) + angle(3)


def slanted(cells: int):
    """A square lattice at 45 degrees: points of a grid and the middles of its cells, diamonds cut along x but at the clamp."""
    points, _ = grid(cells, lambda *_: False)
    m = max(2, round(WIDTH * cells / LENGTH))
    of = np.arange(len(points)).reshape(cells + 2, m + 1)
    middle = len(points) + np.arange((cells + 1) * m).reshape(cells + 1, m)
    p = points.reshape(cells + 2, m + 1, 2)
    points = np.concatenate([points, (0.25 * (p[:-1, :-1] + p[1:, :-1] + p[1:, 1:] + p[:-1, 1:])).reshape(-1, 2)])
    faces = []
    for j in range(m):
        for i in range(cells + 1):
            a, b, c, d, o = of[i, j], of[i + 1, j], of[i + 1, j + 1], of[i, j + 1], middle[i, j]
            faces += [[a, b, o], [c, d, o]]
            faces += [[d, a, o]] if i < 2 else []
            faces += [[b, c, o]] if i in (0, cells) else [[b, middle[i + 1, j], o], [o, middle[i + 1, j], c]]
    return points, np.array(faces)


def equilateral(cells: int):
    """Rows along x that are half a cell apart in turn."""
    return grid(cells, lambda i, j, p: j % 2 == 1, warp=lambda p: p + _half(p, cells))


def _half(p: np.ndarray, cells: int) -> np.ndarray:
    h, m = LENGTH / cells, max(2, round(WIDTH * cells / LENGTH))
    odd = np.round(p[:, 1] * m / WIDTH) % 2 == 1
    inner = (p[:, 0] > 0.5 * h) & (p[:, 0] < LENGTH - 0.5 * h)
    return np.stack([np.where(odd & inner, -0.5 * h, 0.0), 0.0 * odd], axis=1)


def skewed(p: np.ndarray) -> np.ndarray:
    """Cells that grow away from the clamp and the lower edge, and lean."""
    t, s = np.maximum(p[:, 0], 0.0) / LENGTH, p[:, 1] / WIDTH
    lean = 0.4 * (p[:, 1] - 0.5 * WIDTH) * np.minimum(4.0 * t * (1.0 - t), 1.0)
    x = np.where(p[:, 0] > 0.0, LENGTH * (0.5 * t + 0.5 * t**1.5) + lean, p[:, 0])
    return np.stack([x, WIDTH * (0.6 * s + 0.4 * s * s)], axis=1)


MESHES = {
    "diagonal": lambda n: grid(n, lambda *_: False),
    "alternating": lambda n: grid(n, lambda i, j, p: (i + j) % 2 == 1),
    "slanted": slanted,
    "equilateral": equilateral,
    "irregular": lambda n: grid(n, delaunay, jitter=0.4),
    "skewed": lambda n: grid(n, lambda *_: False, warp=skewed),
}


def strip(mesh: str, cells: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    points, triangles = MESHES[mesh](cells)
    return np.column_stack([points, np.zeros(len(points))]), triangles.astype(np.int32), points[:, 0] < 1e-9
