"""Polygons cut into triangles. NumPy only.

A polygon that all its corners can see from one of them (every convex one) becomes a fan from the first such corner;
any other is cut by clipping ears (Meisters 1975), best shaped first, in the plane of its Newell normal.

    points     positions [m], (n, 3)
    counts     corners of each polygon       indices     point of each corner, polygon after polygon
"""

import numpy as np

from wsim.geometry.memo import keep_latest_results

# Twice the area over the square of the longest side under which a triangle counts as having none: a height of one
# millionth of the side is all rounding in float32 (epsilon 1.2e-7), and its strain is undefined.
FLAT = 1e-6


def doubled_area_normal(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normal with twice the area as its length [m^2], (..., 3), and square of the longest side [m^2], (...)."""
    a, b, c = (points.take(triangles[..., k], axis=0) for k in range(3))
    u, v, w = b - a, c - a, c - b
    uu, vv, ww = (np.einsum("...k,...k->...", side, side) for side in (u, v, w))
    return np.cross(u, v), np.maximum(np.maximum(uu, vv), ww)


def flat_triangles(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Mask of triangles that have no area worth the name (also: a corner twice, or not finite), (t,) bool."""
    with np.errstate(invalid="ignore", over="ignore"):
        normal, longest = doubled_area_normal(np.asarray(points, np.float64), triangles)
        return ~(np.linalg.norm(normal, axis=-1) > FLAT * longest)


def _fans_from_corner(points: np.ndarray, corners: np.ndarray, first: int) -> tuple[np.ndarray, np.ndarray]:
    """Fans from corner number `first` of polygons (f, n): (f, n - 2, 3), and which are free of turned triangles."""
    ring = np.roll(corners, -first, axis=1)
    fan = np.stack([np.broadcast_to(ring[:, :1], ring[:, 2:].shape), ring[:, 1:-1], ring[:, 2:]], axis=-1)
    normal, longest = doubled_area_normal(points, fan)
    whole = normal.sum(axis=1)                              # Newell's normal: the sum over any fan
    with np.errstate(invalid="ignore", divide="ignore"):
        whole /= np.linalg.norm(whole, axis=-1, keepdims=True)
        return fan, ((normal * whole[:, None]).sum(-1) > FLAT * longest).all(axis=1)


def _clip_ears(flat: np.ndarray) -> list[tuple[int, int, int]]:
    """Ears of a counter-clockwise polygon, corners (n, 2), best shaped first. A polygon that crosses itself still ends:
    where no ear is left, the corner with the largest turn is cut."""
    left, ears = list(range(len(flat))), []
    while len(left) > 3:
        P = flat[left]
        A, B, C = np.roll(P, 1, axis=0), P, np.roll(P, -1, axis=0)
        u, v, w = B - A, C - B, A - C
        area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        longest = np.maximum(np.maximum((u * u).sum(1), (v * v).sum(1)), (w * w).sum(1))
        shape = np.divide(area, longest, out=np.zeros_like(area), where=longest > 0)
        ear = int(np.argmax(shape))
        for i in np.argsort(-shape, kind="stable"):
            if not shape[i] > FLAT:
                break
            inside = np.ones(len(P), bool)
            for corner, side in ((A[i], u[i]), (B[i], v[i]), (C[i], w[i])):
                d = P - corner
                inside &= (side[0] * d[:, 1] - side[1] * d[:, 0] >= 0) & (d != 0).any(axis=1)
            if not inside.any():
                ear = int(i)
                break
        ears.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    return [*ears, (left[0], left[1], left[2])]


def _cut_polygons(points: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (f, n - 2, 3) of polygons (f, n) with the same number of corners, and of which polygons none is flat."""
    n = corners.shape[1]
    if n == 3:
        return corners[:, None], ~flat_triangles(points, corners)
    cut, good = _fans_from_corner(points, corners, 0)
    for first in range(1, n):
        bad = np.flatnonzero(~good)
        if len(bad) == 0:
            return cut, good                                # a fan that is free of turned triangles has no flat ones
        fan, fine = _fans_from_corner(points, corners[bad], first)
        cut[bad[fine]] = fan[fine]
        good[bad[fine]] = True
    for f in np.flatnonzero(~good):
        P = points[corners[f]] - points[corners[f, 0]]
        N = np.cross(P[1:-1], P[2:]).sum(axis=0)
        if not np.linalg.norm(N) > 0:                       # no plane, no inside: any fan is as good
            continue
        across = np.cross(N, np.eye(3)[int(np.argmin(np.abs(N)))])
        plane = np.stack([across / np.linalg.norm(across), np.cross(N, across) / np.linalg.norm(np.cross(N, across))])
        cut[f] = corners[f][np.array(_clip_ears(P @ plane.T))]
    return cut, good


def triangulate_polygons(points: np.ndarray, counts: np.ndarray, indices: np.ndarray, slivers: bool = False
                         ) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (t, 3) int32 in the order and winding of the polygons, and the polygon of each, (t,) int32.

    Polygons of fewer than three corners and triangles without area (see FLAT) are left out: a polygon that does not
    occur in the second array was degenerate. slivers: triangles without area stay, which close a surface. Raises
    ValueError if an index or the number of indices is wrong.
    """
    return _triangulate_once(np.asarray(points, np.float64).reshape(-1, 3), np.asarray(counts, np.int64).ravel(),
                             np.asarray(indices, np.int64).ravel(), slivers)


@keep_latest_results
def _triangulate_once(points: np.ndarray, counts: np.ndarray, indices: np.ndarray, slivers: bool
                      ) -> tuple[np.ndarray, np.ndarray]:
    """`triangulate_polygons`, with the same mesh in the same types, so that it is cut once."""
    wrong = index_fault(len(points), counts, indices)
    if wrong:
        raise ValueError(wrong)
    starts = np.cumsum(counts) - counts
    triangles, polygons, sound = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)], [np.zeros(0, bool)]
    for n in np.unique(counts[counts >= 3]):
        faces = np.flatnonzero(counts == n)
        with np.errstate(invalid="ignore", over="ignore"):
            cut, good = _cut_polygons(points, indices[starts[faces][:, None] + np.arange(n)])
        triangles.append(cut.reshape(-1, 3))
        polygons.append(np.repeat(faces, n - 2))
        sound.append(np.repeat(good, n - 2))
    all_triangles, polygon, keep = np.concatenate(triangles), np.concatenate(polygons), np.concatenate(sound)
    doubtful = np.flatnonzero(~keep)
    keep[doubtful] = slivers or ~flat_triangles(points, all_triangles[doubtful])
    order = np.argsort(polygon, kind="stable") if len(triangles) > 2 else np.arange(len(polygon))
    order = order[keep[order]]
    return all_triangles[order].astype(np.int32), polygon[order].astype(np.int32)


def index_fault(n: int, counts: np.ndarray, indices: np.ndarray) -> str:
    """Text about what is wrong with the faces of a mesh of n points, or nothing."""
    if (counts < 0).any():
        return f"face {np.argmax(counts < 0)} has {counts.min()} corners; a face has three or more"
    if counts.sum() != len(indices):
        return (f"its faces have {counts.sum()} corners together, but there are {len(indices)} indices; "
                "give one index a corner")
    wrong = np.flatnonzero((indices < 0) | (indices >= n))
    if len(wrong):
        face = int(np.searchsorted(np.cumsum(counts), wrong[0], side="right"))
        return (f"{len(wrong)} corners name points that are not there (first: point {indices[wrong[0]]} in face "
                f"{face}); allowed is 0 to {n - 1}" if n else "its faces name points, but it has none")
    return ""
