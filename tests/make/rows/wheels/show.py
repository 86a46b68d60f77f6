"""Wheels as triangles: a square that turns."""

import numpy as np


def triangles(prim) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) in the prim's frame and triangles (t, 3)."""
    return np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]), np.array([(0, 1, 2), (0, 2, 3)])
