"""Stiffnesses of the elements of a cloth whose faces differ (`Cloth.stretches`, `Cloth.bends`). NumPy only.

A triangle has the stretch of its face; shear and weft keep their ratio to it. A hinge and a spring have the mean of the faces
at them, to equal parts. Where no face differs each has the one value of the material, and the arrays have one entry.
"""

import numpy as np

from wsim.model.model import Body
from wsim.scene import Cloth


def of_triangles(body: Body, cloth: Cloth, good: np.ndarray) -> dict[str, np.ndarray]:
    """stretch, shear, weft [N/m] and poisson of the triangles that are good, each (m,) or (1,)."""
    k = {name: np.array([getattr(cloth.material, name)]) for name in ("stretch", "shear", "weft", "poisson")}
    if cloth.stretches is None:
        return k
    times = cloth.stretches[body.polygon[good]].astype(np.float64) / cloth.material.stretch
    return {name: value if name == "poisson" else value * times for name, value in k.items()}


def of_hinges(cloth: Cloth, faces: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """bend [N m] of hinges between two faces each, (m,) or (1,)."""
    if cloth.bends is None:
        return np.array([cloth.material.bend])
    left, right = (cloth.bends[each].astype(np.float64) for each in faces)
    return 0.5 * (left + right)


def of_springs(body: Body, cloth: Cloth, name: str, triangles: np.ndarray, owner: np.ndarray, count: int) -> np.ndarray:
    """stretch or shear [N/m] of springs, (count,) or (1,); triangles (a, 3) that they stand for, the spring of each (a,)."""
    value = getattr(cloth.material, name)
    if cloth.stretches is None:
        return np.array([value])
    row = {tuple(t): k for k, t in enumerate(np.sort(body.triangles, axis=1).tolist())}
    face = body.polygon[[row[tuple(t)] for t in np.sort(triangles, axis=1).tolist()]]
    total = np.bincount(owner, cloth.stretches[face].astype(np.float64), count)
    return value / cloth.material.stretch * total / np.maximum(np.bincount(owner, minlength=count), 1)


def polygons(body: Body, hinges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The polygons on both sides of each hinge, (m,) each."""
    t = np.sort(body.triangles, axis=1).astype(np.int64)
    n = body.last + 1
    key = (t[:, 0] * n + t[:, 1]) * n + t[:, 2]
    order = np.argsort(key)

    def polygon(corners):
        s = np.sort(corners, axis=1).astype(np.int64)
        return body.polygon[order[np.searchsorted(key[order], (s[:, 0] * n + s[:, 1]) * n + s[:, 2])]]

    return polygon(hinges[:, [0, 1, 2]]), polygon(hinges[:, [0, 1, 3]])
