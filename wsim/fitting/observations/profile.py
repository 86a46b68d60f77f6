"""Height of what lies on a floor, along a line: the observation of an experiment without tracks, by a camera at the side.

    h_j = sum over points p of  V / (w b) N((a . x_p - s_j) / w)

    a       unit direction of the line        s_j     places along it [m]        b   breadth of the channel [m]
    w       width of the window [m]           V       volume of a point [m^3]: all have the same
    N       quadratic B-spline of width 3: windows a width apart share every point among them, so that heights times w b sum
            to the volume; once differentiable

A height is the mean over a window, weighted by N: give the heights that you saw as such means.
"""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Profile:
    """Heights (k, m) [m] of a body of points at m places along a line, at k frames, observed: as in
    `Profile("/sand", [10, 20], places, heights, width=0.02, breadth=0.1, volume=0.001)`.

    path       prim path of the body
    frames     numbers of the frames, (k,); 0 is the start
    places     along the line, from the world's origin on, (m,) [m]
    heights    (k, m) [m]; NaN: not seen
    width      of the window that a height is a mean of [m]; two cells or more, so that single points do not count
    breadth    of the channel, across the line and the height [m]
    volume     of all points together at rest [m^3]
    along      direction of the line, of any length; x if not given
    weights    of each place, (m,) or (k, m): part of 1 / sigma^2; 0: not counted
    sigma      standard deviation of a height [m]; None: estimated
    source     file, for messages
    """

    unit = "m"
    path: str
    frames: np.ndarray
    places: np.ndarray
    heights: np.ndarray
    width: float
    breadth: float
    volume: float
    along: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    weights: np.ndarray | None = None
    sigma: float | None = None
    source: str = "observations"

    def __post_init__(self):
        self.frames = np.atleast_1d(np.asarray(self.frames, np.int64))
        self.places = np.asarray(self.places, np.float64).ravel()
        self.heights = np.atleast_2d(np.asarray(self.heights, np.float64))
        self.along = np.asarray(self.along, np.float64)
        self.weights = None if self.weights is None else np.asarray(self.weights, np.float64)

    @property
    def values(self) -> np.ndarray:
        """Heights that were seen, (k, m) [m]."""
        return self.heights

    def prepare(self, model) -> None:
        """Nothing to look up."""

    def heights_of(self, x: np.ndarray) -> np.ndarray:
        """Heights (m,) [m] of points x, world (n, 3) [m]: how an observation is made of points that were seen."""
        u = self._distances(x)
        return self.volume / (len(x) * self.width * self.breadth) * _spline(u).sum(axis=0)

    def residuals(self, k: int, x: np.ndarray) -> np.ndarray:
        """sqrt(weight) times what the heights of each of x (worlds, points, 3) [m] miss at frame number k, (worlds, seen)
        [m]."""
        good, root = self.counted(k)
        return (np.stack([self.heights_of(each) for each in x])[:, good] - self.heights[k, good]) * root

    def back(self, k: int, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        """Derivative of r . residuals by x (points, 3), of one world."""
        good, root = self.counted(k)
        by = _spline_slope(self._distances(x)[:, good]) @ (r * root)
        direction = self.along / np.linalg.norm(self.along)
        return self.volume / (len(x) * self.width**2 * self.breadth) * by[:, None] * direction

    def counted(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Places that count, and the roots of their weights."""
        weight = np.ones(len(self.places)) if self.weights is None else (
            self.weights[k] if self.weights.ndim == 2 else self.weights)
        good = np.isfinite(self.heights[k]) & (weight > 0.0)
        return good, np.sqrt(weight[good])

    def wrong(self, count: int) -> list[str]:
        """All that is wrong with it."""
        k, m = len(self.frames), len(self.places)
        texts = [f"{name} is {value}; allowed is a finite number > 0 [{unit}]"
                 for name, value, unit in (("width", self.width, "m"), ("breadth", self.breadth, "m"),
                                           ("volume", self.volume, "m^3")) if not (np.isfinite(value) and value > 0.0)]
        if self.along.shape != (3,) or not np.isfinite(self.along).all() or not self.along.any():
            texts.append(f"along is {self.along.tolist()}; allowed is a direction of three finite numbers, as (1, 0, 0)")
        if self.heights.shape != (k, m) or not m or not np.isfinite(self.places).all():
            texts.append(f"has heights of shape {self.heights.shape}; allowed is {(k, m)} (frames, places), with finite places")
        elif not np.isfinite(self.heights).any():
            texts.append("none of its heights was seen: every one is NaN or infinite")
        if len(np.unique(self.frames)) != k:
            texts.append("names a frame twice; give each frame once")
        if self.weights is not None and (self.weights.shape not in ((m,), (k, m)) or not np.isfinite(self.weights).all()
                                         or not (self.weights >= 0.0).all()):
            texts.append(f"weights have shape {self.weights.shape}; allowed are finite ones >= 0 of shape {(m,)} or {(k, m)}")
        return texts

    def _distances(self, x: np.ndarray) -> np.ndarray:
        """Way along the line from each place to each point, in widths, (points, places)."""
        along = np.asarray(x, np.float64) @ (self.along / np.linalg.norm(self.along))
        return (along[:, None] - self.places) / self.width


def _spline(u: np.ndarray) -> np.ndarray:
    """Quadratic B-spline; its integral is 1."""
    a = np.abs(u)
    return np.where(a < 0.5, 0.75 - a * a, 0.5 * np.maximum(1.5 - a, 0.0)**2)


def _spline_slope(u: np.ndarray) -> np.ndarray:
    a = np.abs(u)
    return -np.sign(u) * np.where(a < 0.5, 2.0 * a, np.maximum(1.5 - a, 0.0))
