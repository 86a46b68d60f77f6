"""What can be wrong with shapes that particles fill or vanish in, and with how far apart points are. NumPy only."""

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import numpy as np

from wsim.geometry.triangulate import triangulate_polygons
from wsim.geometry.winding import wound_alike
from wsim.scene import Problem, Surface
from wsim.scene.check.objects import check_number, check_surface, thing_error
from wsim.scene.check.signed_distance import is_closed_mesh

REACH = 2**19              # cells from the middle of all bodies that the grid has room for, with up to 8 worlds


def check_volume_shape(path: str, shape: Any) -> Iterator[Problem]:
    """Problems of a shape that must have an inside: a mesh without holes, sizes above 0."""
    if isinstance(shape, Surface):
        found = check_surface(shape, path)
        yield from (problem for problem in found if problem.fatal)
        if any(problem.fatal for problem in found):
            return
        points = shape.points.astype(np.float64)
        triangles = wound_alike(points, triangulate_polygons(shape.points, shape.counts, shape.indices, True)[0])
        if not is_closed_mesh(points, triangles):
            yield thing_error(path, "its mesh is open: it has no inside", "a closed mesh, each edge with a face on both sides",
                              "close its holes, or weld points that are apart")
        return
    for f in fields(shape):
        may_vanish = f.name == "half_height"                   # a capsule without a straight part is a sphere
        values = np.atleast_1d(np.asarray(getattr(shape, f.name), object))
        for value in values if f.name != "axis" else ():
            yield from check_number(path, f.name, value, 0.0, not may_vanish, "author its size; its scale may be 0")


def check_extent(path: str, points: np.ndarray, cell: float) -> Iterator[Problem]:
    """An error of points (n, 3) [m] that are farther apart than the grid reaches."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    away = np.abs(points - middle).max(axis=1)
    if away.max() > REACH * cell:
        yield thing_error(path, f"point {int(np.argmax(away))} is {away.max():.3g} m from the middle of its points, and cells "
                          f"are {cell:g} m", f"{REACH * cell:.3g} m", "bring the points together, or give larger cells")
