"""What tests/show/test_smoke.py shares with other tests: N, cloud, plate."""

import numpy as np

from wsim.geometry import primitives
from wsim.show.shading import MeshLook
from wsim.show.smoke.read import SmokeDensity, SmokeVolume

N = 16


def cloud(values: np.ndarray, low=(-1.0, -1.0, -1.0), edge: float = 2.0,
          depth: float = 1.0) -> tuple[SmokeVolume, SmokeDensity]:
    """Smoke in a cube of that edge [m], of optical depth `depth` across where it is 1."""
    M = np.eye(4)
    M[:3, :3] *= edge / len(values)
    M[:3, 3] = np.array(low) + 0.5 * edge / len(values)
    box = np.array(low) + edge * np.array(list(np.ndindex(2, 2, 2)))
    made = SmokeVolume("/smoke", np.full(3, 0.8), lambda t: None, lambda t: box, [0.0])
    made.__dict__["extinction"] = depth / edge
    return made, SmokeDensity(values.astype(np.float32), M)


def plate(z: float, half: float = 4.0, color=(0.0, 0.0, 0.0)) -> tuple[np.ndarray, MeshLook]:
    points, triangles = primitives.plate_outline(half, half)
    return points + [0.0, 0.0, z], MeshLook(triangles, np.array([color]))
