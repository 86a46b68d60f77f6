"""Orders of points in which neighbours in space are neighbours in memory. NumPy only.

    hilbert   along Hilbert's curve (Skilling 2004): for any points; neighbours mostly lie in one block of memory
    rows      row by row of cells: for particles, whose cells are searched in rows (kernels/position_based/neighbours.py)
    levels    along a mesh: the lowest end first, then the neighbours of each level, placed by the mean place of those
              that they hang on (breadth first as Cuthill and McKee 1969; means as Sugiyama et al. 1981). A grid comes
              out in rows, whatever its numbers were and however it is bent, so that a colour can be read in long runs

Distinct 32-byte sectors that 32 threads touch in a colour of springs (both ends, three floats a point), and the sum of
both ends taken alone, which the time follows; 90,000 points, colours of `color`:

                                     random     Hilbert    levels     rows
    grid springs (8 at a point)      61, 61     34, 54     26, 32     25, 31 (best possible)
    edges of a triangulated grid     61, 61     34, 55     26, 34
    edges of a Delaunay mesh         63, 63     39, 58     49, 58

H200, 1M points, one sweep over 4M grid springs [us]: random 348, Hilbert 157, levels 85, rows 78 at best; over the 3M
edges of a Delaunay mesh: random 305, Hilbert 180, levels 206. So a regular mesh goes by levels, others along the curve.
"""

import numpy as np

from wsim.geometry.topology import incident_positions, incident_rows, labels_of_islands, order_of

REGULAR = 0.6        # share of the points with one number of edges: 0.3 in a Delaunay mesh, 1 less the border in a grid


def locality_order(points: np.ndarray, edges: np.ndarray | None = None) -> np.ndarray:
    """Order of points, (n,) int32: point order[i] comes at place i. By levels of the mesh if edges (m, 2) are given and
    meet in equal numbers at most points, else along Hilbert's curve. Points [m], (n, 3), finite; they may coincide."""
    points = np.asarray(points, np.float64).reshape(-1, 3)
    if edges is None or len(edges) == 0 or len(points) < 3:
        return hilbert_order(points)
    edges = np.asarray(edges, np.int64).reshape(-1, 2)
    meeting = np.bincount(edges.ravel(), minlength=len(points))
    regular = np.bincount(meeting).max() >= REGULAR * len(points)
    return level_order(points, edges) if regular else hilbert_order(points)


def row_order(points: np.ndarray, edge: float) -> np.ndarray:
    """Order of points (n,) int32 by cells of an edge [m]: along x first, then y, then z; as given within a cell.

    Points (n, 3) [m]. A million grains that fall together on an H200, 8 x 2: 15.1 ms a frame, along Hilbert's curve 16.7. What
    is kept by numbers is read and written in runs."""
    cells = np.floor(np.asarray(points, np.float64) / edge)
    return np.lexsort(cells.T).astype(np.int32)


def level_order(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Order of points (n,) int32 by levels from the low end of the longest side of their box, all islands at once."""
    n = len(points)
    along = points[:, int(np.argmax(np.ptp(points, axis=0)))]
    label = labels_of_islands(n, edges)
    low = np.full(int(label.max()) + 1, np.inf)
    np.minimum.at(low, label, along)
    some = edges[::max(1, len(edges) // 100_000)]
    width = 0.5 * np.linalg.norm(points[some[:, 0]] - points[some[:, 1]], axis=1).mean()
    end = np.flatnonzero(along <= low[label] + width)
    return _breadth_first_order(n, edges, _order_along_front(end, edges, n)).astype(np.int32)


def _breadth_first_order(n: int, edges: np.ndarray, front: np.ndarray) -> np.ndarray:
    """The points that edges join to a front, level after level, in the order of the mean place of their neighbours."""
    starts, items = incident_rows(edges, n)
    neighbour = edges[items].sum(axis=1) - np.repeat(np.arange(n), np.diff(starts))
    seen, order = np.zeros(n, bool), []
    while len(front):
        seen[front] = True
        order.append(front)
        slot, place = incident_positions(starts, front)
        to = neighbour[slot]
        place, to = place[~seen[to]], to[~seen[to]]
        by_point = np.argsort(to, kind="stable")
        place, to = place[by_point], to[by_point]
        first = np.flatnonzero(np.r_[np.ones(min(len(to), 1), bool), to[1:] != to[:-1]])
        mean = np.add.reduceat(place, first) / np.diff(np.r_[first, len(to)]) if len(to) else place
        front = to[first[np.argsort(mean, kind="stable")]]
    return np.concatenate(order)


def _order_along_front(front: np.ndarray, edges: np.ndarray, n: int) -> np.ndarray:
    """A front in the order of its own edges: from one end to the other, piece after piece."""
    number = np.full(n, -1)
    number[front] = np.arange(len(front))
    inner = number[edges]
    inner = inner[(inner >= 0).all(axis=1)]
    piece = labels_of_islands(len(front), inner)
    start = np.unique(piece, return_index=True)[1]
    for _ in range(2):                                      # what is reached last is an end of its piece
        order = _breadth_first_order(len(front), inner, start)
        start[piece[order]] = order
    order = _breadth_first_order(len(front), inner, start[np.argsort(start)])
    return front[order[np.argsort(piece[order], kind="stable")]]


def colours_by_level(ids: np.ndarray, n: int) -> np.ndarray:
    """Colours (m,) for constraints of two points, (m, 2), if the points are numbered by levels: threads that follow
    each other then read points that follow each other. They may clash here and there, and are of no use without levels.

    Inside a level by odd and even points (0, 1); between levels two for the first, two for the second ... that the
    lower point sends on, by odd and even levels. A level ends with the last neighbour of the one before.
    """
    low, high = np.minimum(ids[:, 0], ids[:, 1]).astype(np.int64), np.maximum(ids[:, 0], ids[:, 1]).astype(np.int64)
    reach, ends = np.zeros(n, np.int64), [0]
    np.maximum.at(reach, low, high)
    reach = np.maximum.accumulate(reach)
    while ends[-1] < n:
        ends.append(max(int(reach[max(ends[-1] - 1, 0)]), ends[-1]) + 1)
    level = np.repeat(np.arange(len(ends) - 1), np.diff(np.minimum(ends, n)))
    inside = level[low] == level[high]
    order = order_of(low * n + high)
    before = np.cumsum(~inside[order]) - ~inside[order]
    first = np.r_[np.ones(min(len(low), 1), bool), np.diff(low[order]) > 0]
    which = np.empty_like(low)
    which[order] = before - np.maximum.accumulate(np.where(first, before, 0))
    return np.where(inside, low & 1, 2 + 2 * which + (level[low] & 1))


def hilbert_order(points: np.ndarray, bits: int = 21) -> np.ndarray:
    """Order of points (n,) int32 along Hilbert's curve through cells of 2^-bits of the largest extent. Directions
    without extent take no part."""
    if len(points) == 0:
        return np.zeros(0, np.int32)
    low, extent = points.min(axis=0), np.ptp(points, axis=0)
    size = extent.max()
    if not size > 0:
        return np.arange(len(points), dtype=np.int32)
    axes = np.flatnonzero(extent > 1e-3 * size)
    cells = np.minimum((points - low)[:, axes] * (2.0**bits / size), 2**bits - 1).astype(np.int64)
    return order_of(_hilbert_index([np.ascontiguousarray(cells[:, k]) for k in range(len(axes))], bits)).astype(np.int32)


def _hilbert_index(X: list[np.ndarray], bits: int) -> np.ndarray:
    """Place along Hilbert's curve of cells given by one integer array for each of 1 to 3 axes."""
    for b in range(bits - 1, 0, -1):
        below = (1 << b) - 1
        for x in X:
            upper = (x >> b & 1).astype(bool)
            swap = np.where(upper, 0, (X[0] ^ x) & below)
            X[0] ^= np.where(upper, below, swap)
            x ^= swap
    for k in range(1, len(X)):
        X[k] ^= X[k - 1]
    turned = np.zeros_like(X[0])
    for b in range(bits - 1, 0, -1):
        turned ^= np.where(X[-1] >> b & 1, (1 << b) - 1, 0)
    key = np.zeros_like(X[0])
    for b in range(bits - 1, -1, -1):
        for x in X:
            key = key << 1 | (x ^ turned) >> b & 1
    return key
