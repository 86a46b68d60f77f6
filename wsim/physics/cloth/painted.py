"""Stretch of the elements of a cloth whose faces differ (`Cloth.stretches`). NumPy only; imported where some do.

A triangle has the stretch of its face; shear and weft keep their ratio to it. A spring has the mean of the triangles that it
stands for, to equal parts, as factors of what the material has.
"""

import numpy as np

from wsim.geometry import topology
from wsim.model.model import PointBody
from wsim.scene import Cloth


def stretch_factors(cloth: Cloth, faces: np.ndarray) -> np.ndarray:
    """Stretch of faces over that of the material, (m,)."""
    assert cloth.stretches is not None
    return cloth.stretches[faces].astype(np.float64) / cloth.material.stretch


def of_triangles(body: PointBody, cloth: Cloth, good: np.ndarray, k: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """stretch, shear, weft [N/m] (m,) of the triangles that are good, and poisson; k: those of the material, each (1,)."""
    times = stretch_factors(cloth, body.polygon[good])
    return {name: value if name == "poisson" else value * times for name, value in k.items()}


def of_springs(body: PointBody, cloth: Cloth, triangles: np.ndarray, owner: np.ndarray, count: int) -> np.ndarray:
    """Factors of the stiffness of springs, (count,); triangles (a, 3) that they stand for, the spring of each (a,)."""
    face = body.polygon[topology.rows_of_triangles(body.triangles, triangles)]
    return np.bincount(owner, stretch_factors(cloth, face), count) / np.maximum(np.bincount(owner, minlength=count), 1)
