"""Derivatives by s at 0, of values at steps that halve, extrapolated to none (Richardson 1911; the tableau and its error
estimate as Ridders 1982, Adv. Eng. Software 4:75): from both sides, or from one where the other is not allowed.

    both    D_k0 = (f(h_k) - f(-h_k)) / (2 h_k)       D_kj = D_k,j-1 + (D_k,j-1 - D_k-1,j-1) / (4^j - 1), of order 2 (j + 1)
    one     D_k0 = (f(h_k) - f(0)) / h_k              the same with 2^j - 1, of order j + 1

with h_k = h / 2^k, and h negative of the lower side. The entry is taken whose neighbours of lower order, and of larger steps,
agree best; how far they are apart, over the size, is the error: an estimate, and no bound.
"""

import numpy as np


def richardson_offsets(sizes: int, side: int) -> np.ndarray:
    """Multiples of h at which values are wanted, twice as many as sizes. side: 0: both, 1: only above, -1: only below."""
    if side:
        return side * np.append(0.5 ** np.arange(2 * sizes - 1), 0.0)
    return np.array([s * 0.5**k for k in range(sizes) for s in (1.0, -1.0)])


def richardson_order(sizes: int, side: int) -> int:
    """Up to which the differences go."""
    return 2 * sizes - 1 if side else 2 * sizes


def richardson_derivative(values: np.ndarray, h: float, side: int) -> tuple[np.ndarray, float]:
    """Derivative, and its relative error in the 2-norm, from values (2 sizes, ...) at h times `richardson_offsets`."""
    if side:
        steps = h * richardson_offsets(len(values) // 2, side)[:-1]
        return richardson_extrapolation([(v - values[-1]) / s for v, s in zip(values[:-1], steps, strict=True)], 2.0)
    return richardson_extrapolation([(values[2 * k] - values[2 * k + 1]) / (2.0 * h * 0.5**k) for k in range(len(values) // 2)],
                                    4.0)


def richardson_extrapolation(first: list, ratio: float) -> tuple[np.ndarray, float]:
    """Extrapolated value from D_k0, whose errors fall by the ratio, its square, ... from step to step."""
    table: list[np.ndarray] = []
    best, least = first[0], np.inf
    for k, d in enumerate(first):
        before, table = table, [d]
        for j in range(1, k + 1):
            table.append(table[j - 1] + (table[j - 1] - before[j - 1]) / (ratio**j - 1.0))
            error = max(float(np.linalg.norm(table[j] - other)) for other in (table[j - 1], before[j - 1]))
            if error < least:
                best, least = table[j], error
    size = float(np.linalg.norm(best))
    return best, least / size if size else float(least > 0.0)
