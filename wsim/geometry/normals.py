"""Normals that follow a deforming mesh the way its author shaded it. NumPy only.

A normal of a polygon is half the sum of cross products of its fan (its area vector, Newell); a smooth normal is the
normalised sum of the area vectors of the polygons around. Which corners were smooth together is read off the authored
normals: corners at one place (seam duplicates included) that carry the same normal form one group and stay smooth; the
others stay creased.
"""

import numpy as np

SAME = 1e-3       # normals closer than this (chord of the unit sphere) were meant to be one


class AuthoredNormals:
    """Recomputes the normals of one mesh.

    points    rest points, (n, 3)              counts, indices   polygons, as in UsdGeom.Mesh
    values    authored normals, (slots, 3)     interpolation     "vertex", "varying", "faceVarying" or "uniform"
    Raises ValueError saying what does not match: the interpolation, or the number of normals.
    """

    def __init__(self, points, counts, indices, values, interpolation: str):
        points, values = np.asarray(points), np.asarray(values, np.float64)
        counts, indices = np.asarray(counts), np.asarray(indices)
        corners, faces = len(indices), np.repeat(np.arange(len(counts)), counts)
        slots = {"vertex": (len(points), indices), "varying": (len(points), indices),
                 "faceVarying": (corners, np.arange(corners)), "uniform": (len(counts), faces)}
        if interpolation not in slots:
            raise ValueError(f"has {interpolation!r} normals, which cannot follow; vertex, faceVarying or uniform do")
        expected, slot = slots[interpolation]
        if len(values) != expected:
            raise ValueError(f"has {len(values)} normals where {interpolation!r} needs {expected}")
        self.fan, self.face = polygon_fans(counts, indices)
        self.triangular, self.count = bool(np.all(counts == 3)), len(counts)
        self.corner_face = faces
        self.last = _unit_or_previous(values, np.zeros_like(values))
        if interpolation == "uniform":
            groups = faces
        else:
            place = np.unique(points, axis=0, return_inverse=True)[1].reshape(-1)
            groups = smooth_groups(place[indices], self.last[slot])
        self.corner_group = groups
        self.slot_group = np.full(len(values), -1)
        self.slot_group[slot] = groups
        self.sign = 1.0
        if np.sum(self._follow_points(points) * self.last) < 0.0:  # a left-handed mesh, or one shaded inside out
            self.sign = -1.0

    def at(self, points: np.ndarray) -> np.ndarray:
        """Unit normals (slots, 3), float32, of deformed points (n, 3). Where all area is gone the last normal stays."""
        self.last = self._follow_points(points)
        return self.last.astype(np.float32)

    def _follow_points(self, points: np.ndarray) -> np.ndarray:
        p = np.asarray(points, np.float64)
        a = p[self.fan[:, 0]]
        area = 0.5 * np.cross(p[self.fan[:, 1]] - a, p[self.fan[:, 2]] - a)
        if not self.triangular:
            area = _sum_by_group(self.face, area, self.count)
        total = _sum_by_group(self.corner_group, area[self.corner_face], int(self.corner_group.max(initial=-1)) + 1)
        used = self.slot_group >= 0
        value = np.zeros_like(self.last)
        value[used] = self.sign * total[self.slot_group[used]]
        return _unit_or_previous(value, self.last)


def polygon_fans(counts: np.ndarray, indices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (t, 3) fanned from each polygon's first corner, and the polygon of each (t,).

    Area vectors add up right for concave polygons too; polygons with fewer than three corners have none.
    """
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)
    each = np.maximum(np.asarray(counts) - 2, 0)
    face = np.repeat(np.arange(len(counts)), each)
    step = np.arange(len(face)) - np.repeat(np.cumsum(each) - each, each)
    first = starts[face] if len(face) else np.zeros(0, np.int64)
    return np.stack([indices[first], indices[first + step + 1], indices[first + step + 2]], axis=1), face


def smooth_groups(place: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Group of each corner (c,), numbered from 0: corners at one place (c,) whose normals (c, 3) are the same."""
    group = np.full(len(place), -1)
    todo = np.arange(len(place))
    while len(todo):                              # one pass for each crease that meets at a place
        places, first = np.unique(place[todo], return_index=True)
        leader = todo[first[np.searchsorted(places, place[todo])]]
        near = (np.sum((normal[todo] - normal[leader]) ** 2, axis=1) < SAME**2) | (leader == todo)
        group[todo[near]] = leader[near]
        todo = todo[~near]
    return np.unique(group, return_inverse=True)[1].reshape(-1)


def _sum_by_group(group: np.ndarray, vectors: np.ndarray, count: int) -> np.ndarray:
    return np.stack([np.bincount(group, vectors[:, k], count) for k in range(3)], axis=1)


def _unit_or_previous(vectors: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where((length > 0.0) & np.isfinite(length), vectors / length, otherwise)
