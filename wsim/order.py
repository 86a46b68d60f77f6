"""Orders and colours that a GPU reads in long runs. NumPy; one sequential kernel on the CPU for large irregular sets.

On an H200 a sweep over the 4M springs of a 1M-point grid takes 73 us when both the points stand in rows and the colours are
those of rows, 87 us in rows with other colours, 121 us along Hilbert's curve, 406 us at random: neighbours in a warp
should touch neighbours in memory. So a flat sheet is ordered in rows, anything else along Hilbert's curve; and springs that
join points the same distance apart in memory make two colours by themselves:

    i and i + s, s the same for all:  colour = (i // s) mod 2,  since i + s is in the next block of s
"""

import numpy as np

from wsim import color as colors
from wsim.topology import order_of

FLAT = 1e-3            # a sheet thinner than this part of its size is flat
MANY = 200_000         # constraints from which the sequential kernel beats NumPy, its compile time (0.5 s) included
STEPS = 8              # distances in memory that may have colours of their own
COMMON = 0.01          # part of all constraints that such a distance must have


def order_of_points(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Place of each point in memory, order[place] = point, (n,): rows of a flat sheet, else Hilbert's curve.

    points [m], (n, 3); edges (m, 2).
    """
    points = np.asarray(points, np.float64)
    if len(edges) == 0 or len(points) < 4:
        return colors.locality(points)
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    normal = axes[:, 0]
    size = np.ptp(points, axis=0).max()
    if not size > 0.0 or np.ptp(points @ normal) > FLAT * size:
        return colors.locality(points)
    return _rows(points, edges, normal, size)


def _rows(points: np.ndarray, edges: np.ndarray, normal: np.ndarray, size: float) -> np.ndarray:
    """Rows along the direction of the shortest edges, as wide as edges reach across them."""
    some = edges[::max(1, len(edges) // 100_000)]
    vectors = points[some[:, 1]] - points[some[:, 0]]
    lengths = np.linalg.norm(vectors, axis=1)
    real = np.flatnonzero(lengths > 1e-9 * size)
    if len(real) == 0:
        return colors.locality(points)
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


def lowest(ids: np.ndarray) -> np.ndarray:
    """The smallest point of each constraint, (m,)."""
    low = ids[:, 0]
    for k in range(1, ids.shape[1]):
        low = np.minimum(low, ids[:, k])
    return low


def color(ids: np.ndarray, n: int) -> np.ndarray:
    """Colour of each constraint, (m,): no point occurs twice in a colour. ids (m, k), points 0 .. n - 1."""
    if ids.shape[1] == 2 and len(ids):
        found = _steps(ids, n)
        if found is not None:
            return found
    return _first_fit(ids, n) if len(ids) >= MANY else colors.color(ids, n)


def _steps(ids: np.ndarray, n: int) -> np.ndarray | None:
    """Colours by distance in memory, or None where too few distances are shared by many springs."""
    low = lowest(ids).astype(np.int64)
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
        found[rare] = 2 * len(common) + color(ids[rare], n)
    number = np.cumsum(np.bincount(found) > 0) - 1                    # without the colours that nothing has
    return number[found].astype(np.int32)


def _first_fit(ids: np.ndarray, n: int) -> np.ndarray:
    """Greedy in the order of memory, by one thread; what needs more than 64 colours is left to NumPy."""
    import warp as wp

    from wsim.kernels.greedy import first_fit
    k, m = ids.shape[1], len(ids)
    order = order_of(lowest(ids).astype(np.int64)).astype(np.int32)
    with wp.ScopedDevice("cpu"):
        out = wp.full(m, -1, dtype=int)
        wp.launch(first_fit(k), 1, [wp.array(np.ascontiguousarray(ids, np.int32), dtype=wp.types.vector(k, int)),
                                    wp.array(order, dtype=int), wp.zeros(n, dtype=wp.uint64)], [out])
        found = out.numpy()
    left = np.flatnonzero(found < 0)
    if len(left):
        found[left] = 64 + colors.color(ids[left], n)
    return found
