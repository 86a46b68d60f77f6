"""How deep boxes lie in each other, by the separating axes of their pairs. NumPy only, float64, whatever engine moved them."""

import numpy as np


def matrices(q: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) of quaternions (x, y, z, w)."""
    x, y, z, w = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    return np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
                     2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                     2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=1).reshape(-1, 3, 3)


def near(x: np.ndarray, reach: float) -> np.ndarray:
    """Pairs (m, 2) of points closer than `reach`, by cells of that width."""
    order = np.argsort(x[:, 0], kind="stable")
    last = np.searchsorted(x[order, 0], x[order, 0] + reach)
    pairs = [np.stack([np.full(b - a, a), np.arange(a, b)], 1) for a, b in zip(range(1, len(x) + 1), last, strict=True)]
    i, j = (order[k] for k in np.concatenate([p - (1, 0) for p in pairs]).T)
    close = ((x[i] - x[j])**2).sum(1) < reach * reach
    return np.stack([i[close], j[close]], 1)


def overlaps(x: np.ndarray, q: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Depth [m] of every pair of boxes that overlap, and of every box that reaches below z = 0: the least over all axes."""
    if not np.isfinite(x).all():
        return np.array([np.inf])
    R = matrices(q)
    low = x[:, 2] - (np.abs(R[:, 2]) * half).sum(1)
    pairs = near(x, 2.0 * float(np.linalg.norm(half, axis=1).max()))
    if len(pairs) == 0:
        return -low[low < 0.0]
    a, b = pairs.T
    d = x[b] - x[a]
    A, B = R[a].transpose(0, 2, 1), R[b].transpose(0, 2, 1)                 # rows are axes
    edges = np.cross(A[:, :, None], B[:, None]).reshape(len(a), 9, 3)
    size = np.linalg.norm(edges, axis=2, keepdims=True)
    edges = np.where(size > 1e-6, edges / np.maximum(size, 1e-300), A[:, :1])        # parallel: an axis that is there already
    axes = np.concatenate([A, B, edges], axis=1)

    def extent(rows, h):
        return (np.abs(np.einsum("pij,pkj->pik", axes, rows)) * h[:, None]).sum(2)
    depth = (extent(A, half[a]) + extent(B, half[b]) - np.abs(np.einsum("pij,pj->pi", axes, d))).min(1)
    return np.concatenate([depth[depth > 0.0], -low[low < 0.0]])
