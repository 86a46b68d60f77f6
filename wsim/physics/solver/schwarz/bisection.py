"""Recursive coordinate bisection: points in 2^depth parts of equal size, each cut across its longest side (Berger, Bokhari
1987). Neighbouring parts in the order of the result have a common part one cut before."""

import numpy as np


def bisect_coordinates(points: np.ndarray, depth: int) -> np.ndarray:
    """Part of each point, (n,), in 0 .. 2^depth - 1; points (n, 3). Sizes of parts differ by one at most.

    Equal coordinates are cut by the order of the points, so that points in one place are no trouble.
    """
    n = len(points)
    part, every = np.zeros(n, np.int64), np.arange(n)
    for level in range(depth):
        low, high = np.full((1 << level, 3), np.inf), np.full((1 << level, 3), -np.inf)
        np.minimum.at(low, part, points)
        np.maximum.at(high, part, points)
        axis = np.where(np.isfinite(high), high - low, 0.0).argmax(axis=1)
        order = np.lexsort((every, points[every, axis[part]], part))
        first = np.searchsorted(part[order], np.arange((1 << level) + 1))
        rank = np.empty(n, np.int64)
        rank[order] = every - first[part[order]]
        size = np.diff(first)[part]
        fewer = -(-(1 << (depth - level)) // 2)
        part = 2 * part + (rank >= -(-size * fewer // (1 << (depth - level))))
    return part
