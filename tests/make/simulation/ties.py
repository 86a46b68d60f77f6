"""What tests/simulation/test_ties.py shares with other tests: laid."""

import numpy as np

from tests.make.physics.soft.soft_bar import bar
from wsim import Fabric, Scene


def laid(overhang: int = 2, **more) -> tuple[Scene, np.ndarray, np.ndarray]:
    """A bar with a cloth on its upper side that hangs over one edge, and the points of both that are one."""
    scene = bar(**more)
    soft = scene.softs[0]
    x, z = np.linspace(-0.3, 0.3, 7), -0.1 + 0.1 * np.arange(3 + overhang)
    points = np.array([[i, 0.1, k] for i in x for k in z])
    corner = np.array([i * len(z) + k for i in range(6) for k in range(len(z) - 1)])
    faces = corner[:, None] + [0, 1, len(z) + 1, len(z)]
    cloth = scene.cloth("/blanket", points, np.full(len(faces), 4), faces.ravel(), material=Fabric(stretch=200.0, bend=1e-4))
    away = np.linalg.norm(points[:, None] - soft.points[None], axis=2)
    mine = np.flatnonzero(away.min(axis=1) < 1e-5)
    scene.tie("/tie", cloth, mine, soft, away.argmin(axis=1)[mine])
    return scene, mine, scene.ties[0].others
