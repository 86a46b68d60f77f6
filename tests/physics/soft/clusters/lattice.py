"""Points of cubes for tests of clusters, and what bodies of points have."""

import numpy as np


def cube_points(n: int, spacing: float) -> np.ndarray:
    """n x n x n points, `spacing` [m] apart, about the origin."""
    a = (np.arange(n) - 0.5 * (n - 1)) * spacing
    return np.stack(np.meshgrid(a, a, a, indexing="ij"), axis=-1).reshape(-1, 3)


def angular_momentum(x: np.ndarray, v: np.ndarray, m: np.ndarray) -> np.ndarray:
    """About the centre [kg m^2/s]."""
    X, V = (m @ x) / m.sum(), (m @ v) / m.sum()
    return (m[:, None] * np.cross(x - X, v - V)).sum(axis=0)


def best_rotation(rest: np.ndarray, x: np.ndarray) -> np.ndarray:
    """R with the least sum of |x - R r|^2, by the singular value decomposition (Kabsch 1976)."""
    U, _, W = np.linalg.svd((x - x.mean(axis=0)).T @ (rest - rest.mean(axis=0)))
    return U @ np.diag([1.0, 1.0, np.linalg.det(U @ W)]) @ W
