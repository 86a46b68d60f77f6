"""Which points make a cluster. NumPy only.

By cubes: space is cut into cubes, and each cube that holds points makes a cluster of all points within it and a margin around
it, so that neighbouring clusters share points and hold together (Mueller, Heidelberger, Teschner, Gross 2005, section 4.3).
"""

import numpy as np

from wsim.geometry.topology import order_of

LINE = 1e-6            # of the largest spread: points that spread less across it are in a line, and have no best rotation

FLAT = 0.02            # thickness of a cluster over its size below which it does not flow: strain across it is noise


def group_starts(sizes: np.ndarray) -> np.ndarray:
    """Starts of the groups, and the end, (groups + 1,)."""
    return np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)])


def cells_of_points(places: np.ndarray, spacing: float, overlap: float) -> list[np.ndarray]:
    """Points of each cube of edge `spacing` [m] with a margin of `overlap` times that, cubes in the order x, y, z; places
    (n, 3) [m]. The cubes are centred on the box about all points. One group of all where spacing is inf."""
    n = len(places)
    if not n or not np.isfinite(spacing):
        return [np.arange(n, dtype=np.int32)]
    low, high = places.min(axis=0), places.max(axis=0)
    cells = np.maximum(np.ceil((high - low) / spacing - 1e-9), 1.0).astype(np.int64)
    at = (places - 0.5 * (low + high)) / spacing + 0.5 * cells                   # in cubes
    own = np.clip(np.floor(at).astype(np.int64), 0, cells - 1)
    reach = int(np.ceil(overlap))
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    held = np.unique((own[:, 0] * cells[1] + own[:, 1]) * cells[2] + own[:, 2])
    keys, points = [], []
    for step in steps:
        cell = own + step
        inside = ((cell >= 0) & (cell < cells)).all(axis=1)
        inside &= ((at >= cell - overlap) & (at <= cell + 1 + overlap)).all(axis=1) | (step == 0).all()
        key = (cell[:, 0] * cells[1] + cell[:, 1]) * cells[2] + cell[:, 2]
        keys.append(key[inside])
        points.append(np.flatnonzero(inside))
    key, point = np.concatenate(keys), np.concatenate(points)
    there = np.isin(key, held)
    key, point = key[there], point[there]
    order = order_of(key * np.int64(n) + point)
    ends = np.flatnonzero(np.diff(key[order])) + 1
    return np.split(point[order].astype(np.int32), ends)


def spread_of_group(places: np.ndarray) -> np.ndarray:
    """Root mean square distances [m] of points, (n, 3), from their centre along the principal axes, from the least, (3,)."""
    off = places - places.mean(axis=0)
    return np.sqrt(np.maximum(np.linalg.eigvalsh(off.T @ off / max(len(places), 1)), 0.0))


def lies_in_line(places: np.ndarray) -> bool:
    """True if points are in a line, or in one place: their rotation is not determined."""
    spread = spread_of_group(places)
    return len(places) < 3 or not spread[1] > LINE * max(spread[2], 1e-300)


def kept_groups(places: np.ndarray, groups: list[np.ndarray]) -> list[np.ndarray]:
    """The groups whose rotation is determined; of the others, those points that no other group has join the group whose centre
    is nearest."""
    good = [g for g in groups if not lies_in_line(places[g])]
    if not good or len(good) == len(groups):
        return good or groups
    taken = np.zeros(len(places), bool)
    taken[np.concatenate(good)] = True
    centres = np.stack([places[g].mean(axis=0) for g in good])
    for left in np.flatnonzero(~taken):
        k = int(np.argmin(((centres - places[left])**2).sum(axis=1)))
        good[k] = np.append(good[k], np.int32(left))
    return good


def colours_of_groups(groups: list[np.ndarray], n: int) -> np.ndarray:
    """Colour of each group, (groups,), from 0: no point is in two groups of a colour. Greedy, in the order of the groups."""
    used, found = np.zeros(n, object), np.zeros(len(groups), np.int64)
    if not len(groups) or np.bincount(np.concatenate(groups), minlength=n).max(initial=0) <= 1:
        return found
    for k, group in enumerate(groups):
        taken = int(np.bitwise_or.reduce(used[group]))
        colour = (~taken & (taken + 1)).bit_length() - 1
        found[k] = colour
        used[group] |= 1 << colour
    return found
