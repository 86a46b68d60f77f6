"""What tests/show/test_picture.py shares with other tests: ball."""

import numpy as np

from wsim.geometry import primitives
from wsim.show.shading import MeshLook, smoothing_groups

SIDES = 64


def ball(radius: float = 1.0) -> tuple[np.ndarray, MeshLook]:
    points, triangles = primitives.sphere_outline(radius, SIDES)
    return points, MeshLook(triangles, normal_of=smoothing_groups(points, triangles))
