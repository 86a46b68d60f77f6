"""What is wrong with a polygon mesh, and what a simulation can live with. NumPy only."""

import numpy as np

from wsim.geometry import topology
from wsim.geometry.memo import keep_latest_results
from wsim.geometry.triangulate import index_fault, triangulate_polygons
from wsim.scene import Problem


@keep_latest_results
def check_polygon_mesh(path: str, points: np.ndarray, counts: np.ndarray, indices: np.ndarray,
                       parts: bool = True) -> list[Problem]:
    """Problems of a mesh, by its prim path: fatal where no triangle could be trusted, else warnings. parts: points at one place
    move apart, as those of a cloth do."""
    points = np.asarray(points).reshape(-1, 3)
    counts, indices = np.asarray(counts, np.int64).ravel(), np.asarray(indices, np.int64).ravel()
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    problems = []
    if len(bad):
        problems.append(Problem(path, f"{_count_and_first(bad, 'point')} not finite; give each three finite coordinates"))
    wrong = index_fault(len(points), counts, indices)
    if wrong:
        problems.append(Problem(path, wrong))
    if problems:
        return problems
    triangles, polygon = triangulate_polygons(points, counts, indices)
    if len(triangles) == 0:
        return [Problem(path, f"none of its {len(counts)} faces has an area; a surface needs at least one triangle")]
    return [Problem(path, text, fatal=False) for text in _mesh_flaws(points, counts, triangles, polygon, parts)]


def _mesh_flaws(points: np.ndarray, counts: np.ndarray, triangles: np.ndarray, polygon: np.ndarray, parts: bool) -> list[str]:
    """What a simulation can live with, but its author should know."""
    texts = []
    lost = np.flatnonzero(np.bincount(polygon, minlength=len(counts)) == 0)
    if len(lost):
        texts.append(f"{_count_and_first(lost, 'face')} without area; left out (remove such faces, or move their corners "
                     f"apart)")
    start, end, _, key = topology.half_edges(triangles)
    n = int(triangles.max()) + 1
    sides, uses, forward = topology.count_directed_keys(key, start < end)
    many = sides[uses > 2]
    if len(many):
        texts.append(f"{len(many)} edges belong to more than two triangles (first: points {many[0] // n} and "
                     f"{many[0] % n}); bending joins such triangles two by two (split the mesh there for other folds)")
    turned = sides[(uses == 2) & (forward != 1)]
    if len(turned):
        texts.append(f"the windings of neighbouring faces disagree at {len(turned)} edges (first: points "
                     f"{turned[0] // n} and {turned[0] % n}); normals and wind are wrong there (turn one of the faces)")
    alone = np.flatnonzero(np.bincount(triangles.ravel(), minlength=len(points)) == 0)
    if len(alone):
        texts.append(f"{_count_and_first(alone, 'point')} in no face; they stay where they are, or where a hard pin has them "
                     "(remove them from the mesh)")
    place = topology.distinct_rows(points)[1]
    first = np.full(len(points), -1)
    first[place[::-1]] = np.arange(len(points))[::-1]
    twins = np.flatnonzero(first[place] != np.arange(len(points)))
    if parts and len(twins):
        texts.append(f"{_count_and_first(twins, 'point')} where another one is (that one: {first[place[twins[0]]]}): seams "
                     "come apart there, unless welded (set weld to a distance under the shortest edge)")
    return texts


def _count_and_first(which: np.ndarray, noun: str) -> str:
    """Says how many and which is the first."""
    return f"1 {noun} (number {which[0]}) is" if len(which) == 1 else f"{len(which)} {noun}s (first: {which[0]}) are"
