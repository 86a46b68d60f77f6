"""Consistent winding of a triangle mesh: neighbours pass their shared edge in opposite directions. NumPy only."""

import numpy as np

from wsim.geometry.memo import keep_latest_results
from wsim.geometry.topology import labels_of_islands, weld_points

NEAR = 1e-6             # of the extent: corners nearer than this are one


@keep_latest_results
def wound_alike(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Triangles (t, 3) of points (n, 3) [m] with consistent winding: in each connected piece the minority is flipped.

    Neighbours share an edge that no third triangle has; coincident corners count as one, as in files that list the corners of
    each face separately. A piece that has only one side, like a Moebius strip, stays as it is.
    """
    triangles = np.asarray(triangles).reshape(-1, 3)
    count = len(triangles)
    first, second, against = _neighbour_triangles(np.asarray(points, np.float64), triangles)
    if not against.any():
        return triangles
    # Each triangle twice, as it is and flipped: an orientable piece gives two components, one for each winding.
    pairs = [np.stack([first + count * side, second + count * np.where(against, 1 - side, side)], 1) for side in (0, 1)]
    label = labels_of_islands(2 * count, np.concatenate(pairs))
    plain, over = label[:count].astype(np.int64), label[count:].astype(np.int64)
    piece, turned = np.minimum(plain, over), plain > over
    balance = np.bincount(piece, np.where(turned, 1.0, -1.0))
    turned = np.where(balance[piece] > 0.0, ~turned, turned) & (plain != over)
    found = triangles.copy()
    found[turned] = found[turned, ::-1]
    return found


def _neighbour_triangles(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of triangles that share an edge, (m,) and (m,), and whether they pass it in the same direction (m,)."""
    corner = weld_points(points, NEAR * float(np.ptp(points, axis=0).max(initial=0.0)))[triangles].astype(np.int64)
    flat = (corner == np.roll(corner, -1, axis=1)).any(axis=1)
    start, end = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    owner = np.repeat(np.arange(len(triangles)), 3)
    kept = ~np.repeat(flat, 3)
    start, end, owner = start[kept], end[kept], owner[kept]
    key = np.minimum(start, end) * len(points) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    ranked, place = np.unique(key[order], return_index=True)
    lone = place[np.diff(np.append(place, len(order))) == 2]
    a, b = order[lone], order[lone + 1]
    return owner[a], owner[b], (start < end)[a] == (start < end)[b]
