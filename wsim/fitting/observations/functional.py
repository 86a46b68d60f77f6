"""Weighted sums of positions as observations: means, centroids, heights, markers inside triangles or tets.

    y_j = sum over entries i of j of  part_i . x(point_i)        part_i of each axis, x in the world [m]

    Functional(path, frames, values, rows, points, parts)                       any of them: values (k, m) [m]
    Functional.mean("/World/Bar", [10, 20], [[0, 0.41, 0], [0, 0.38, 0]], points)
    Functional.markers("/World/Cloth", [10], places, corners, parts)            each at parts of its corners' places

A value that is NaN was not seen: a mean of which only the height is known has NaN in x and z.
"""

from dataclasses import dataclass

import numpy as np


@dataclass
class Functional:
    """values (k, m) [m] of m weighted sums of a body's positions at k frames. Entry i adds parts[i] . x(points[i]) to sum
    rows[i]."""

    unit = "m"
    path: str
    frames: np.ndarray
    values: np.ndarray
    rows: np.ndarray                         # of 0 to m - 1, (q,)
    points: np.ndarray                       # in the author's order, (q,)
    parts: np.ndarray                        # of each axis, (q, 3)
    weights: np.ndarray | None = None        # of each sum, (m,) or (k, m): part of 1 / sigma^2; 0: not counted
    sigma: float | None = None               # standard deviation of a value [m]; None: estimated
    source: str = "observations"             # file, for messages

    def __post_init__(self):
        self.frames = np.atleast_1d(np.asarray(self.frames, np.int64))
        self.values = np.atleast_2d(np.asarray(self.values, np.float64))
        self.rows, self.points = (np.asarray(a, np.int64).ravel() for a in (self.rows, self.points))
        self.parts = np.asarray(self.parts, np.float64)
        self.weights = None if self.weights is None else np.asarray(self.weights, np.float64)

    @staticmethod
    def mean(path: str, frames, positions, points, shares=None, **more) -> "Functional":
        """Functional of the mean place (k, 3) [m] of some points (q,), by their shares (q,) (None: alike), whose sum is not
        0."""
        points = np.asarray(points, np.int64)
        each = np.ones(len(points)) if shares is None else np.asarray(shares, np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            parts = each / each.sum()
        return Functional.markers(path, frames, positions, points[None], parts[None], **more)

    @staticmethod
    def markers(path: str, frames, positions, corners, parts, **more) -> "Functional":
        """Functional of places (k, m, 3) [m], marker j at the parts (m, c) of its corners (m, c): of a triangle 3, of a tet
        4."""
        corners, parts = np.asarray(corners, np.int64), np.asarray(parts, np.float64)
        m, c = corners.shape
        rows = (3 * np.arange(m)[:, None, None] + np.arange(3)).repeat(c, axis=1)                # (m, c, 3)
        each = parts[:, :, None, None] * np.eye(3)                                               # (m, c, 3, 3)
        return Functional(path, frames, np.reshape(positions, (-1, 3 * m)), rows, corners[:, :, None].repeat(3, axis=2),
                          each.reshape(-1, 3), **more)

    def prepare(self, model) -> None:
        """Nothing to look up."""

    def residuals(self, k: int, x: np.ndarray) -> np.ndarray:
        """sqrt(weight) times what each of x (worlds, points, 3) [m] misses at frame number k, (worlds, seen) [m]."""
        (good, root), m = self.counted(k), self.values.shape[1]
        found = np.stack([np.bincount(self.rows, (self.parts * each[self.points]).sum(axis=1), m) for each in x])
        return (found[:, good] - self.values[k, good]) * root

    def back(self, k: int, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        """Derivative of r . residuals by x (points, 3), of one world: W^T r."""
        good, root = self.counted(k)
        by, found = np.zeros(self.values.shape[1]), np.zeros(x.shape)
        by[good] = r * root
        np.add.at(found, self.points, self.parts * by[self.rows][:, None])
        return found

    def counted(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Sums that count, and the roots of their weights."""
        weight = np.ones(self.values.shape[1]) if self.weights is None else (
            self.weights[k] if self.weights.ndim == 2 else self.weights)
        good = np.isfinite(self.values[k]) & (weight > 0.0)
        return good, np.sqrt(weight[good])

    def wrong(self, count: int) -> list[str]:
        """All that is wrong with it, of a body of so many points."""
        (k, m), texts = self.values.shape, []
        if len(self.frames) != k or len(np.unique(self.frames)) != k:
            texts.append(f"has {k} rows of values for the frames {self.frames.tolist()}; give each frame once, with a row")
        if len(self.rows) != len(self.points) or self.parts.shape != (len(self.rows), 3):
            texts.append(f"has {len(self.rows)} rows, {len(self.points)} points and parts of shape {self.parts.shape}; allowed "
                         "are as many of each, parts (q, 3)")
        elif not np.isfinite(self.parts).all():
            texts.append("has parts that are not finite; a mean needs weights whose sum is not 0")
        else:
            for name, of, end in (("rows", self.rows, m), ("points", self.points, count)):
                if len(of) and (of.min() < 0 or of.max() >= end):
                    texts.append(f"{name} name {of.min()} to {of.max()}; allowed is 0 to {end - 1}")
            if empty := sorted(set(range(m)) - set(self.rows.tolist())):
                texts.append(f"sum {empty[0]} has no points; give each some")
        if not np.isfinite(self.values).any():
            texts.append("none of its values was seen: every one is NaN or infinite")
        if self.weights is not None and (self.weights.shape not in ((m,), (k, m)) or not np.isfinite(self.weights).all()
                                         or not (self.weights >= 0.0).all()):
            texts.append(f"weights have shape {self.weights.shape}; allowed are finite ones >= 0 of shape {(m,)} or {(k, m)}")
        return texts
