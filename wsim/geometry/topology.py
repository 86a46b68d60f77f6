"""Meshes as index arrays: edges, hinges, welded particles, islands, distances along edges. NumPy only.

Distances along edges are shortest paths by buckets of nearly equal distance (Meyer and Sanders 2003, delta stepping),
exact for the edge graph; islands join roots to smaller roots and shorten the paths (Shiloach and Vishkin 1982).
Everything runs over whole arrays.

    points     positions [m], (n, 3)         triangles   corners, counter-clockwise seen from outside, (t, 3) int32
    counts     corners of each polygon       indices     point of each corner
"""

from functools import reduce

import numpy as np

from wsim.geometry.memo import keep_latest_results
from wsim.geometry.triangulate import doubled_area_normal

CELLS = 2.0**53        # tolerances from the origin that a weld can count: beyond, neighbours in float64 are further apart


def order_of(keys: np.ndarray) -> np.ndarray:
    """Stable ascending order of keys >= 0, (m,). Sorts (key, position) packed in 64 bits where they fit: NumPy sorts
    plain integers several times faster than it argsorts."""
    bits = max(len(keys) - 1, 0).bit_length()
    if len(keys) and int(keys.max()) >> (63 - bits):
        return np.argsort(keys, kind="stable")
    packed = (keys.astype(np.int64) << bits) | np.arange(len(keys))
    packed.sort()
    return packed & ((1 << bits) - 1)


def first_face_corners(counts: np.ndarray, indices: np.ndarray) -> np.ndarray:
    """The first three corners of each polygon, (faces, 3)."""
    return indices[(np.cumsum(counts) - counts)[:, None] + np.arange(3)]


def smallest_point_of_row(ids: np.ndarray) -> np.ndarray:
    """Smallest point of each row of ids (m, k), (m,). (By columns: NumPy takes several times longer by rows.)"""
    return reduce(np.minimum, ids.T)


def incident_rows(ids: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows of ids (m, k) that name each of n points: those of point p are items[starts[p]:starts[p + 1]], ascending."""
    ids = np.asarray(ids)
    starts = np.zeros(n + 1, np.int64)
    np.cumsum(np.bincount(ids.ravel(), minlength=n), out=starts[1:])
    return starts, (order_of(ids.ravel()) // max(ids.shape[1], 1)).astype(np.int32)


def incident_positions(starts: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions in a list of `incident_rows` that belong to the given points, and the number of the point of each."""
    counts = starts[points + 1] - starts[points]
    which = np.repeat(np.arange(len(points)), counts)
    return np.arange(len(which)) + (starts[points] - np.cumsum(counts) + counts)[which], which


@keep_latest_results
def weld_points(points: np.ndarray, tolerance: float) -> np.ndarray:
    """Particle of each point, (n,) int32, numbered by first appearance. Points nearer than tolerance [m] are one
    particle, and so are chains of such points. Tolerance 0 welds nothing, not even equal points.

    Cells of four tolerances a side; a point enters every cell that a cube of side tolerance about it touches, so two
    near points share one. Raises ValueError when tolerance is negative, not finite, so large that cells
    overflow, or so small that float64 does not resolve it where the points are.
    """
    points = np.asarray(points, np.float64).reshape(-1, 3)
    n = len(points)
    if not 0 <= tolerance < np.inf:
        raise ValueError(f"weld tolerance is {tolerance}; it must be finite and >= 0 [m]")
    if tolerance == 0 or n == 0:
        return np.arange(n, dtype=np.int32)
    places, place = np.unique(points, axis=0, return_inverse=True) if n < 2048 else distinct_rows(points)
    reach = float(np.abs(points).max())
    if not reach < CELLS * tolerance:                        # also: not finite
        raise ValueError(f"weld tolerance {tolerance:g} m is too small for points {reach:g} m away, which floating point "
                         "cannot tell apart so finely; raise it, or move the points to the origin")
    corners = [np.floor((places + s * tolerance) / (4 * tolerance)).astype(np.int64) for s in (-0.5, 0.5)]
    keys, owners = [], []
    for corner in range(8):
        high = np.array([corner & 1, corner >> 1 & 1, corner >> 2], bool)
        fresh = ((corners[0] != corners[1]) | ~high).all(axis=1)        # cells not entered already
        keys.append(_hash_of_cells(np.where(high, corners[1], corners[0])[fresh]))
        owners.append(np.flatnonzero(fresh))
    key, owner = np.concatenate(keys), np.concatenate(owners)
    order = np.argsort(key, kind="stable")
    key, owner = key[order], owner[order]
    pairs, found, lag, tested = np.arange(len(key)), [np.zeros((0, 2), np.int64)], 1, 0
    while len(pairs):
        pairs = pairs[pairs + lag < len(key)]
        pairs = pairs[key[pairs + lag] == key[pairs]]
        a, b = owner[pairs], owner[pairs + lag]
        found.append(np.stack([a, b], 1)[((places[a] - places[b]) ** 2).sum(1) <= tolerance * tolerance])
        lag, tested = lag + 1, tested + len(pairs)
        if tested > 1e6 + 64 * n:
            raise ValueError(f"weld tolerance {tolerance:g} m holds too many of the {n} points: it must be well under "
                             "the distance of neighbouring points; lower it")
    return _number_by_appearance(labels_of_islands(len(places), np.concatenate(found))[place])


def _hash_of_cells(cells: np.ndarray) -> np.ndarray:
    """One 64-bit key for each row of integers, (m, 3); different rows may share a key."""
    x, y, z = (cells[:, k].view(np.uint64) for k in range(3))
    key = x * np.uint64(0x9E3779B97F4A7C15) + y * np.uint64(0xC2B2AE3D27D4EB4F) + z * np.uint64(0x165667B19E3779F9)
    return key ^ (key >> np.uint64(32))


def distinct_rows(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct rows of points, (p, 3), and the row of each point, (n,)."""
    order = np.lexsort(points.T)
    new = np.ones(len(points), bool)
    new[1:] = (points[order][1:] != points[order][:-1]).any(axis=1)
    place = np.empty(len(points), np.int64)
    place[order] = np.cumsum(new) - 1
    return points[order][new], place


def _number_by_appearance(labels: np.ndarray) -> np.ndarray:
    """Labels renamed 0, 1, 2, ... by first appearance, (n,) int32."""
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int32)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse]


def half_edges(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Start, end and opposite point of the three sides of each triangle, (3 t,), and a key of the undirected edge."""
    triangles = np.asarray(triangles, np.int64).reshape(-1, 3)
    start, end, opposite = (triangles[:, np.roll([0, 1, 2], -k)].ravel() for k in range(3))
    return start, end, opposite, np.minimum(start, end) * (int(triangles.max(initial=0)) + 1) + np.maximum(start, end)


def _count_distinct_keys(keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct keys, ascending, and how often each occurs. (NumPy's own unique hashes, which is slower here.)"""
    return _counted_sorted(np.sort(keys))


def _counted_sorted(keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As `_count_distinct_keys`, of keys in ascending order."""
    starts = np.flatnonzero(np.r_[np.ones(min(len(keys), 1), bool), keys[1:] != keys[:-1]])
    return keys[starts], np.diff(np.r_[starts, len(keys)])


def count_directed_keys(keys: np.ndarray, forward: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distinct keys, ascending; how often each occurs, and how often forward, (m,) each. (One sort, no search: at
    random numbering a search in millions of keys takes far longer.)"""
    marked = np.sort(keys * 2 + forward)
    sides, uses = _counted_sorted(marked >> 1)
    return sides, uses, np.add.reduceat(marked & 1, np.cumsum(uses) - uses) if len(uses) else uses


def edges_of_triangles(triangles: np.ndarray) -> np.ndarray:
    """Edges, each once, (m, 2) int32, lower point first, ascending."""
    key, _ = _count_distinct_keys(half_edges(triangles)[3])
    n = int(np.max(triangles, initial=0)) + 1
    return np.stack([key // n, key % n], axis=1).astype(np.int32)


def hinges_of_triangles(triangles: np.ndarray) -> np.ndarray:
    """Rows (i, j, left, right), (k, 4) int32: edge i-j between triangles with corners (i, j, left) and (j, i, right).

    Where the windings disagree the right triangle is (i, j, right). An edge of more than two triangles gives a hinge
    for each two that follow each other; two triangles with the same points give none.
    """
    start, end, opposite, key = half_edges(triangles)
    order = order_of(key)
    same = key[order[1:]] == key[order[:-1]]
    a, b = order[:-1][same], order[1:][same]
    found = np.stack([start[a], end[a], opposite[a], opposite[b]], axis=1).astype(np.int32)
    return found[found[:, 2] != found[:, 3]]


@keep_latest_results
def labels_of_islands(n: int, edges: np.ndarray) -> np.ndarray:
    """Label of each of n points, (n,) int32: equal if edges (m, 2) join them; numbered by first appearance."""
    label = np.arange(n)
    a, b = np.asarray(edges, np.int64).reshape(-1, 2).T
    while len(a):
        a, b = label[a], label[b]
        apart = a != b
        a, b = a[apart], b[apart]
        np.minimum.at(label, np.maximum(a, b), np.minimum(a, b))
        while (label[label] != label).any():
            label = label[label]
    return (np.cumsum(label == np.arange(n)) - 1)[label].astype(np.int32)      # a root is its island's first point


def geodesic_distance(points: np.ndarray, edges: np.ndarray, sources: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance [m] of each point along edges to the nearest source, (n,) float64, and that source, (n,) int32.
    Points that no source reaches: inf and -1."""
    points, edges = np.asarray(points, np.float64).reshape(-1, 3), np.asarray(edges, np.int64).reshape(-1, 2)
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    starts, items = incident_rows(edges, len(points))
    neighbour = edges[items].sum(axis=1) - np.repeat(np.arange(len(points)), np.diff(starts))
    reach = length[items]
    distance, source = np.full(len(points), np.inf), np.full(len(points), -1, np.int32)
    active = np.unique(np.asarray(sources, np.int64))
    distance[active], source[active] = 0.0, active
    width = length.mean() if len(length) else 0.0
    while len(active):
        near = distance[active] <= distance[active].min() + width
        now, later = active[near], active[~near]
        slot, which = incident_positions(starts, now)
        to, trial, origin = neighbour[slot], distance[now][which] + reach[slot], source[now][which]
        better = trial < distance[to]
        to, trial, origin = to[better], trial[better], origin[better]
        np.minimum.at(distance, to, trial)
        won = trial == distance[to]
        source[to[won]] = origin[won]
        active = np.unique(np.concatenate([later, to[won]]))
    return distance, source


# Surfaces

def area_normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Normal of each triangle times its area [m^2], (t, 3) float64."""
    return 0.5 * doubled_area_normal(np.asarray(points, np.float64), triangles)[0]


def triangle_areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Area of each triangle [m^2], (t,) float64."""
    return np.linalg.norm(area_normals(points, triangles), axis=1)


def vertex_normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit normal of each point, (n, 3) float64: its triangles weighed by area. Zero where there is none."""
    normal, corner = np.repeat(area_normals(points, triangles), 3, axis=0), np.asarray(triangles).ravel()
    total = np.stack([np.bincount(corner, normal[:, k], len(points)) for k in range(3)], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, length, out=np.zeros(total.shape), where=length > 0)


def rows_of_triangles(triangles: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Row in `triangles` (t, 3) of each triangle of `corners` (m, 3), whose corners may stand in another order, (m,)."""
    n = int(triangles.max(initial=0)) + 1

    def sorted_corner_key(rows: np.ndarray) -> np.ndarray:
        s = np.sort(rows, axis=1).astype(np.int64)
        return (s[:, 0] * n + s[:, 1]) * n + s[:, 2]
    keys = sorted_corner_key(triangles)
    order = np.argsort(keys)
    return order[np.searchsorted(keys[order], sorted_corner_key(corners))]


def triangles_beside_hinges(triangles: np.ndarray, hinges: np.ndarray) -> np.ndarray:
    """Rows in `triangles` of the two triangles of each hinge (m, 4), (2, m)."""
    return np.stack([rows_of_triangles(triangles, hinges[:, [0, 1, k]]) for k in (2, 3)])
