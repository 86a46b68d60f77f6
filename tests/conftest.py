"""What several test files share: a small cloth as arrays, and a scene that holds one."""

import numpy as np
import pytest

from wsim.scene import Scene


def grid(side: int = 4, size: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """side x side points on a square of `size` [m] in the x-z plane, with counts and indices of its quads."""
    s = np.linspace(0.0, size, side, dtype=np.float32)
    points = np.stack([np.repeat(s, side), np.zeros(side * side, np.float32), np.tile(s, side)], axis=1)
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).reshape(-1)
    indices = np.stack([corner, corner + 1, corner + side + 1, corner + side], axis=1).reshape(-1)
    return points, np.full(len(corner), 4, np.int32), indices.astype(np.int32)


@pytest.fixture
def scene() -> Scene:
    """A cloth of 4 x 4 points, 1 m wide, pinned at two corners."""
    scene = Scene(frames=2, substeps=2, iterations=2)
    cloth = scene.cloth("/cloth", *grid())
    scene.pin("/pin", cloth, points=[0, 3])
    return scene
