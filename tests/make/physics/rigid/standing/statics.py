"""What tests/physics/rigid/standing/test_statics.py shares with other tests: frame, stone."""

import numpy as np

from wsim.scene import Surface
from wsim.scene.curve import Motion


def frame(R, at) -> Motion:
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = R, at
    return Motion.still(M)


def stone(thickness: float, angle: float, deep: float = 0.5) -> Surface:
    """A voussoir of a ring of mean radius 1, from -angle / 2 to angle / 2 about the y axis of its frame, whose origin is the
    middle of the stone; a convex mesh."""
    rho, a = np.array([1.0 - 0.5 * thickness, 1.0 + 0.5 * thickness]), 0.5 * angle
    points = np.array([(r * np.sin(s * a), r * np.cos(a) - 1.0, 0.5 * z * deep) for z in (-1, 1) for r in rho for s in (-1, 1)])
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return Surface(points, np.full(6, 4), np.ravel(faces))
