"""Places of a lattice within shapes, where particles of liquids and material points start. NumPy only."""

from collections.abc import Callable

import numpy as np

from wsim.geometry.triangulate import triangulate_polygons
from wsim.scene import Surface


def index_block(begin, end, stride: int = 1) -> np.ndarray:
    """Whole numbers from begin up to end, three a row (n, 3), the last of each row fastest."""
    return np.stack(np.meshgrid(*(np.arange(a, b, stride) for a, b in zip(begin, end, strict=True)), indexing="ij"),
                    -1).reshape(-1, 3)


def indices_inside_mesh(shape: Surface, M: np.ndarray, begin: np.ndarray, end: np.ndarray,
                        on_lattice: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """True for the rows of `index_block(begin, end)` that lie inside a closed mesh, (n,) bool.

    M (4, 4) takes its points to the world [m]; on_lattice takes places there to indices.
    """
    from wsim.geometry.tetra.inside import AxisRays
    triangles = triangulate_polygons(shape.points, shape.counts, shape.indices)[0]
    points = on_lattice(shape.points.astype(np.float64) @ M[:3, :3].T + M[:3, 3])
    return AxisRays(points, triangles, begin, np.asarray(end) - 1).inside(index_block(begin, end))
