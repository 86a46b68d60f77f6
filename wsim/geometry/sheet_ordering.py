"""Orders and colours of flat regular sheets, which a GPU reads in the longest runs; anything else goes by
`wsim.geometry.ordering` and `wsim.geometry.color`. NumPy only.

A flat sheet is ordered in rows. Springs that join points the same distance apart in memory then make two colours by
themselves, balanced, and in each the threads of a warp touch points that follow each other:

    i and i + s, s the same for all:  colour = (i // s) mod 2,  since i + s is in the next block of s

H200, one sweep over the 4M springs of a 1M-point grid with `kernels/math/block.py`: so 72 us, rows with first-fit colours 87
us, Hilbert's curve with first-fit colours 145 us. With plain reads and the colours of rows: rows 88 us, Hilbert's curve 123 us,
random numbers 406 us.
"""

import numpy as np

from wsim.geometry import color as colors
from wsim.geometry.ordering import locality_order
from wsim.geometry.topology import order_of

FLAT = 1e-3            # a sheet thinner than this part of its size is flat
STEPS = 8              # distances in memory that may have colours of their own
COMMON = 0.01          # part of all constraints that such a distance must have


def order_of_points(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Order of points in memory, order[place] = point, (n,): rows of a flat sheet, else levels of the mesh. Points of no edge
    come last, and do not change the order of the others.

    points [m], (n, 3); edges (m, 2).
    """
    points, joined = np.asarray(points, np.float64), np.unique(edges)
    if 0 < len(joined) < len(points):
        order = order_of_points(points[joined], np.searchsorted(joined, edges))
        return np.concatenate([joined[order], np.setdiff1d(np.arange(len(points)), joined)])
    if len(edges) == 0 or len(points) < 4:
        return locality_order(points, edges)
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    normal = axes[:, 0]
    size = np.ptp(points, axis=0).max()
    if not size > 0.0 or np.ptp(points @ normal) > FLAT * size:
        return locality_order(points, edges)
    return _order_in_rows(points, edges, normal, size)


def _order_in_rows(points: np.ndarray, edges: np.ndarray, normal: np.ndarray, size: float) -> np.ndarray:
    """Rows along the direction of the shortest edges, as wide as edges reach across them."""
    some = edges[::max(1, len(edges) // 100_000)]
    vectors = points[some[:, 1]] - points[some[:, 0]]
    lengths = np.linalg.norm(vectors, axis=1)
    real = np.flatnonzero(lengths > 1e-9 * size)
    if len(real) == 0:
        return locality_order(points, edges)
    shortest = real[np.argmin(np.round(lengths[real] / size, 9))]
    along = vectors[shortest] / lengths[shortest]
    along = along * np.sign(along[np.argmax(np.abs(along))])
    across = np.cross(normal, along)
    reach = np.abs(vectors @ across)
    width = np.median(reach[reach > 1e-6 * size]) if (reach > 1e-6 * size).any() else size
    v = points @ across
    row = np.round((v - v.min()) / width).astype(np.int64)
    u = points @ along
    order = np.argsort(u)
    return order[order_of(row[order])]


def lowest_point_of_constraint(ids: np.ndarray) -> np.ndarray:
    """The smallest point of each constraint, (m,)."""
    low = ids[:, 0]
    for k in range(1, ids.shape[1]):
        low = np.minimum(low, ids[:, k])
    return low


def color_sheet(ids: np.ndarray, n: int) -> np.ndarray:
    """Colour of each constraint, (m,): no point occurs twice in a colour. ids (m, k), points 0 .. n - 1."""
    if ids.shape[1] == 2 and len(ids):
        found = _colours_by_stride(ids, n)
        if found is not None:
            return found
    return colors.color_constraints(ids, n)


def _colours_by_stride(ids: np.ndarray, n: int) -> np.ndarray | None:
    """Colours by distance in memory, or None where too few distances are shared by many springs."""
    low = lowest_point_of_constraint(ids).astype(np.int64)
    step = np.abs(ids[:, 1].astype(np.int64) - ids[:, 0])
    count = np.bincount(step)
    common = np.flatnonzero(count > COMMON * len(ids))
    pair = np.sort(low * np.int64(n) + step)
    twice = bool((pair[1:] == pair[:-1]).any())                       # two springs between the same points
    if twice or len(common) > STEPS or count[common].sum() < 0.95 * len(ids) or step.min() == 0:
        return None
    common = common[np.argsort(-count[common], kind="stable")]
    rank = np.full(len(count), -1)
    rank[common] = np.arange(len(common))
    kind = rank[step]
    found = 2 * kind + (low // step) % 2
    rare = np.flatnonzero(kind < 0)
    if len(rare):
        found[rare] = 2 * len(common) + color_sheet(ids[rare], n)
    number = np.cumsum(np.bincount(found) > 0) - 1                    # without the colours that nothing has
    return number[found].astype(np.int32)

