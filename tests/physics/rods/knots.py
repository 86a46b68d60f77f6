"""Topology of curves, independent of the engine: linking numbers by Gauss's integral, and a knot's determinant.

    Lk = 1 / (4 pi) sum over pairs of segments of the signed solid angle that they span (Klenin, Langowski 2000, eq. 13-16)
    determinant = |Alexander polynomial at -1|: 1 of what is no knot, 3 of a trefoil (overhand knot), 5 of a figure eight
"""

import numpy as np


def linking(a: np.ndarray, b: np.ndarray) -> float:
    """Linking number of two closed polygons (n, 3), (m, 3): a whole number, but for rounding."""
    p, q = np.asarray(a, np.float64)[:, None], np.asarray(b, np.float64)[None]
    p2, q2 = np.roll(p, -1, axis=0), np.roll(q, -1, axis=1)
    r13, r14, r23, r24 = q - p, q2 - p, q - p2, q2 - p2
    def unit(n):
        size = np.linalg.norm(n, axis=-1, keepdims=True)
        return n / np.where(size > 0.0, size, 1.0)
    n = [unit(np.cross(u, v)) for u, v in ((r13, r14), (r14, r24), (r24, r23), (r23, r13))]
    angle = sum(np.arcsin(np.clip(np.sum(n[k] * n[(k + 1) % 4], -1), -1.0, 1.0)) for k in range(4))
    sign = np.sign(np.sum(np.cross(q2 - q, p2 - p) * r13, -1))
    return float(np.sum(angle * sign) / (4.0 * np.pi))


def closed(x: np.ndarray, far: np.ndarray) -> np.ndarray:
    """An open curve with points far away that close it."""
    return np.concatenate([np.asarray(x, np.float64), far])


def crossings(p: np.ndarray) -> list[tuple[float, float]]:
    """Places (over, under) along a closed polygon where it crosses itself, seen along z."""
    q, n, found = np.roll(p, -1, axis=0), len(p), []
    for i in range(n):
        j = np.arange(i + 2, n if i else n - 1)
        d, e, r = q[i] - p[i], q[j] - p[j], p[j] - p[i]
        area = d[0] * e[:, 1] - d[1] * e[:, 0]
        along = np.abs(area) <= 1e-12 * np.linalg.norm(d) * np.linalg.norm(e, axis=1)      # of one line: they have no crossing
        area = np.where(along, 1e-300, area)
        s, u = (r[:, 0] * e[:, 1] - r[:, 1] * e[:, 0]) / area, (r[:, 0] * d[1] - r[:, 1] * d[0]) / area
        for k in np.flatnonzero((s >= 0.0) & (s < 1.0) & (u >= 0.0) & (u < 1.0) & ~along):
            above = p[i, 2] + s[k] * d[2] > p[j[k], 2] + u[k] * e[k, 2]
            pair = i + s[k], j[k] + u[k]
            found.append(pair if above else pair[::-1])
    return found


def determinant(x: np.ndarray, seed: int = 0) -> int:
    """Determinant of the knot in an open curve (n, 3) whose ends lie outside of it: closed far away, seen from a direction of
    that seed."""
    x = np.asarray(x, np.float64) - np.mean(x, axis=0)
    out = 20.0 * np.abs(x).max()
    ends = [out * v / np.linalg.norm(v) for v in (x[-1], x[0])]
    turn = np.linalg.qr(np.eye(3) + 0.3 * np.random.default_rng(seed).normal(size=(3, 3)))[0]
    found = crossings(closed(x, np.array([ends[0], (0.0, out, 0.0), ends[1]])) @ turn)
    if len(found) < 3:
        return 1
    under, m = np.sort([u for _, u in found]), len(found)
    A = np.zeros((m, m))
    for k, (over, below) in enumerate(found):
        i = int(np.searchsorted(under, below))
        A[k, int(np.searchsorted(under, over)) % m] += 2.0
        A[k, i] -= 1.0
        A[k, (i + 1) % m] -= 1.0
    return round(abs(np.linalg.det(A[1:, 1:])))
