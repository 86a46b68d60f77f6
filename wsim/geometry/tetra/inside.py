"""Inside or outside of a surface that need not be quite closed, at places of an integer lattice. NumPy only.

The generalised winding number (Jacobson, Kavan, Sorkine-Hornung 2013) is the mean, over all directions, of the
signed crossings of a ray with the surface. Here: the mean over the six directions of the axes. It is exact for closed
surfaces; a hole spoils it only where three of six rays leave through holes. Where neighbouring triangles are wound
differently signs mean nothing: then a ray with an odd number of crossings counts as one from inside.

A line through lattice places meets a triangle if it does so after moving by (e, e^2), e -> 0 (simulation of simplicity,
Edelsbrunner and Muecke 1990): of the triangles at an edge or point that it hits just one is met.
"""

import numpy as np

from wsim.geometry.tetra.lattice import cells_of_integer_boxes
from wsim.geometry.topology import hinges_of_triangles


def triangles_wound_alike(triangles: np.ndarray) -> bool:
    """True if all neighbouring triangles are wound alike."""
    start = triangles.ravel().astype(np.int64)
    key = np.sort(start * (int(start.max(initial=0)) + 1) + np.roll(triangles, -1, axis=1).ravel())
    return not (key[1:] == key[:-1]).any() or not len(hinges_of_triangles(triangles))


class AxisRays:
    """Crossings of all axis-parallel lines through the places low to high with a surface."""

    def __init__(self, points: np.ndarray, triangles: np.ndarray, low, high):
        """points (n, 3) in steps of the lattice; triangles (t, 3); places low to high (three integers each, both counted)."""
        self.low, self.high = np.asarray(low, np.int64), np.asarray(high, np.int64)
        self.signed = triangles_wound_alike(triangles)
        depth = points[triangles].reshape(-1, 3)
        self.near = np.minimum(depth.min(axis=0), self.low) - 1.0
        self.reach = 2.0 * (np.maximum(depth.max(axis=0), self.high) - self.near + 1.0)
        self.lines = [self._crossings_of_lines(points, triangles, axis) for axis in range(3)]

    def _column(self, place: np.ndarray, axis: int) -> np.ndarray:
        u, v = (axis + 1) % 3, (axis + 2) % 3
        return (place[:, u] - self.low[u]) * (self.high[v] - self.low[v] + 1) + place[:, v] - self.low[v]

    def _crossings_of_lines(self, points: np.ndarray, triangles: np.ndarray,
                            axis: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Crossings of the lines along an axis, ascending: key (column + depth in 0 .. 1/2), running sum of signs with a
        leading 0, and where each column begins."""
        uv = [(axis + 1) % 3, (axis + 2) % 3]
        flat = points[:, uv][triangles]                                                        # (t, 3, 2)
        a, b, c = flat[:, 0], flat[:, 1], flat[:, 2]
        low = np.maximum(np.ceil(np.minimum(np.minimum(a, b), c)), self.low[uv]).astype(np.int64)
        high = np.minimum(np.floor(np.maximum(np.maximum(a, b), c)), self.high[uv]).astype(np.int64)
        keys, signs = [np.zeros(0)], [np.zeros(0, np.int64)]
        width = int(self.high[uv[1]] - self.low[uv[1]] + 1)
        for owner, cell in cells_of_integer_boxes(low, high):
            hit, sign, depth = _lines_meeting_triangles(points, triangles[owner], cell.astype(np.float64), axis)
            column = ((cell - self.low[uv]) @ (width, 1))[hit]
            keys.append(column + (depth - self.near[axis]) / self.reach[axis])
            signs.append(sign)
        key, sign = np.concatenate(keys), np.concatenate(signs)
        order = np.argsort(key, kind="stable")
        columns = np.arange(width * int(self.high[uv[0]] - self.low[uv[0]] + 1) + 1)
        return key[order], np.r_[0, np.cumsum(sign[order])], np.searchsorted(key[order], columns)

    def winding(self, places: np.ndarray) -> np.ndarray:
        """Estimate of the winding number, or of the part of rays that cross an odd number of times, (m,), at integer places
        (m, 3): about 1 inside, 0 outside (-1 inside of a surface that is wound inward)."""
        total = np.zeros(len(places))
        for axis, (key, run, starts) in enumerate(self.lines):
            column = self._column(places, axis)
            at = np.searchsorted(key, column + (places[:, axis] - self.near[axis]) / self.reach[axis])
            begin, end = starts[column], starts[column + 1]
            if self.signed:
                total += (run[end] - run[at]) - (run[at] - run[begin])         # outward faces count 1 above, -1 below
            else:
                total += (end - at) % 2 + (at - begin) % 2
        return total / 6.0

    def inside(self, places: np.ndarray) -> np.ndarray:
        """(m,) bool: more than half a turn, whichever way the surface is wound."""
        return np.abs(self.winding(places)) > 0.5


def _lines_meeting_triangles(points: np.ndarray, corners: np.ndarray, place: np.ndarray, axis: int):
    """Which lines along the axis through places (k, 2) meet their triangles (corners (k, 3)); of those the sign of the
    normal along the axis and the depth of the crossing."""
    u, v = points[:, (axis + 1) % 3], points[:, (axis + 2) % 3]
    area, side = [], []
    for k in range(3):
        i, j = corners[:, (k + 1) % 3], corners[:, (k + 2) % 3]
        flip = np.where(i < j, 1.0, -1.0)                      # both triangles of an edge get the same rounding
        i, j = np.minimum(i, j), np.maximum(i, j)
        du, dv = u[j] - u[i], v[j] - v[i]
        twice = du * (place[:, 1] - v[i]) - dv * (place[:, 0] - u[i])
        tie = np.where(dv != 0, -np.sign(dv), np.sign(du))
        area.append(flip * twice)
        side.append(flip * np.where(twice != 0, np.sign(twice), tie))
    hit = (side[0] == side[1]) & (side[1] == side[2]) & (side[0] != 0)
    weights = np.stack(area)[:, hit]
    total = weights.sum(axis=0)
    third = np.full(1, 1.0 / 3.0)
    weights = np.divide(weights, total, out=np.broadcast_to(third, weights.shape).copy(), where=total != 0)
    depth = (weights * points[:, axis][corners[hit]].T).sum(axis=0)
    return hit, side[0][hit].astype(np.int64), depth
