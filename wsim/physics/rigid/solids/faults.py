"""What can be wrong with a concave mesh that rigid bodies meet: one warning each. NumPy only."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from wsim.geometry.memo import keep_latest_results
from wsim.geometry.triangulate import triangulate_polygons
from wsim.geometry.winding import wound_alike
from wsim.physics.rigid.mass import shape_volume
from wsim.physics.rigid.solids import CONVEX, MESHES, collider_parts, hull_fill_ratio
from wsim.physics.rigid.solids.decomposition import INSTALL, coacd_is_installed
from wsim.scene import Collider, Problem
from wsim.scene.check.objects import object_warning

FACES = 50_000             # of a mesh that moves: a search of 100 links of so many takes a CPU longer than a frame lasts
SAMPLES = 200              # faces asked for a crossing, times all faces: 0.1 s for 10 000
OUTWARD = 1e-4             # of the size: where a face is asked
CROSSED = 0.02             # part of them from which a mesh crosses itself: rounding and slivers make fewer


def check_concave_mesh(c: Collider, of_body: bool) -> Iterator[Problem]:
    """Warnings of a mesh whose `approximation` asks for its triangles or for parts."""
    shape: Any = c.shape
    fill = hull_fill_ratio(shape)
    if fill >= 1.0 - CONVEX:
        return
    if c.approximation == "convexDecomposition":
        if len(collider_parts([c])) > 1:
            return
        instead = "its convex hull" if of_body and fill == 0.0 else "its triangles"
        if not coacd_is_installed():
            yield object_warning(c.path, f"asks for a convexDecomposition, and coacd is not installed: it is met as {instead}",
                                 "coacd >= 1.0.7", f"{INSTALL}, or author physics:approximation = none")
            return
        yield object_warning(c.path, f"asks for a convexDecomposition, and coacd makes no parts of it: it is met as {instead}",
                             "a closed mesh with hollows", "close it, or author physics:approximation = none")
    if not of_body:
        return
    if fill == 0.0:
        flat = shape_volume(shape).volume == 0.0 and _is_closed(shape)
        what = "encloses no volume" if flat else "is an open mesh"
        yield object_warning(c.path, f"{what}, and of a body that moves it meets others as its convex hull", "a closed mesh",
                             "close it, give it a thickness, or put several convex colliders in its place")
        return
    faces = int(np.maximum(shape.counts - 2, 0).sum())
    if faces > FACES:
        yield object_warning(c.path, f"is a concave mesh of {faces} triangles that moves, and contacts with it are slow",
                             f"up to {FACES}", "thin it out, or author physics:approximation = convexDecomposition")
        return
    inside = faces_inside_mesh(shape.points, shape.counts, shape.indices)
    if inside > CROSSED:
        yield object_warning(c.path, f"crosses itself: {100.0 * inside:.0f} % of its surface lie within it; bodies catch there",
                             "a surface without crossings", "unite its pieces, or author physics:approximation = "
                             "convexDecomposition")


def _is_closed(shape: Any) -> bool:
    from wsim.scene.check.signed_distance import is_closed_mesh
    points = np.asarray(shape.points, np.float64)
    return is_closed_mesh(points, wound_alike(points, triangulate_polygons(points, shape.counts, shape.indices, True)[0]))


@partial(keep_latest_results, most=MESHES)
def faces_inside_mesh(points: np.ndarray, counts: np.ndarray, indices: np.ndarray) -> float:
    """Part of the surface of a closed mesh that lies within it, by the winding number of places just outside of faces: 0 there,
    else another piece holds them (Jacobson, Kavan, Sorkine-Hornung 2013, equation 5)."""
    points = np.asarray(points, np.float64)
    triangles = wound_alike(points, triangulate_polygons(points, counts, indices, True)[0])
    X = points[triangles]
    n = np.cross(X[:, 1] - X[:, 0], X[:, 2] - X[:, 0])
    sign = np.sign(np.einsum("ij,ij->", X[:, 0] - points.mean(axis=0), n))
    area = np.linalg.norm(n, axis=1)
    rank = (np.arange(SAMPLES) + 0.5) / SAMPLES * area.sum()
    some = np.minimum(np.searchsorted(np.cumsum(area), rank), len(X) - 1)
    lift = OUTWARD * np.linalg.norm(np.ptp(points, axis=0)) * sign / np.maximum(area[some], 1e-300)
    asked = X[some].mean(axis=1) + lift[:, None] * n[some]
    return float(np.mean([abs(_winding_number(X, q)) > 0.5 for q in asked]))


def _winding_number(X: np.ndarray, q: np.ndarray) -> float:
    """Of triangles X (m, 3, 3) about q, by solid angles (Van Oosterom, Strackee 1983)."""
    a, b, c = np.moveaxis(X - q, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    det = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = [np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (b, c), (c, a))]
    return float(np.arctan2(det, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb).sum() / (2.0 * np.pi))
