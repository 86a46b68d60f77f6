"""What is believed of a field before anything was seen: neighbours are alike.

    smooth    sum over neighbours of |a_i - a_j|^2 / 2 s^2                            (Tikhonov, Arsenin 1977)
    tv        sum over neighbours of (sqrt(|a_i - a_j|^2 + e^2) - e) / s              (Rudin, Osher, Fatemi 1992), e = EDGE s
    pull      sum over elements of |a|^2 / 2 wide^2

a = t - mean, in the mapped space, (n, c): springs of several kinds keep their proportions. s is what a difference of neighbours
usually is: 0.3 of a modulus is 30 %. A jump of D costs D^2 / 2 s^2 where it should be smooth and D / s in total variation,
which lets it stay sharp.
"""

from dataclasses import dataclass, field

import numpy as np

WIDE = 3.0             # units of theta: what is not seen stays within a factor e^3 or so of its start
EDGE = 0.1             # of s: differences below count as smooth


@dataclass
class NeighbourBelief:
    """The prior of one field. kind: "smooth", "tv" or "free"."""

    pairs: np.ndarray                         # neighbours, (k, 2)
    kind: str = "smooth"
    s: float = 0.3
    mean: np.ndarray = field(default_factory=lambda: np.zeros(0))       # (n, c)
    wide: float = WIDE

    def look(self, t: np.ndarray) -> tuple[float, np.ndarray]:
        """Value and gradient at t (n, c)."""
        a = t - self.mean
        value, slope = 0.5 * float((a**2).sum()) / self.wide**2, a / self.wide**2
        if self.kind == "free" or not len(self.pairs):
            return value, slope
        i, j = self.pairs.T
        jump = (a[i] - a[j]) / self.s
        if self.kind == "tv":
            size = np.sqrt((jump**2).sum(axis=1, keepdims=True) + EDGE**2)
            value += float((size - EDGE).sum())
            jump = jump / size
        else:
            value += 0.5 * float((jump**2).sum())
        np.add.at(slope, i, jump / self.s)
        np.add.at(slope, j, -jump / self.s)
        return value, slope

    def curvature(self, t: np.ndarray) -> np.ndarray:
        """Weight of each pair in the Hessian at t, (k,); of total variation the lagged one (Vogel, Oman 1996)."""
        if self.kind == "free":
            return np.zeros(len(self.pairs))
        a, (i, j) = t - self.mean, self.pairs.T
        size = np.sqrt((((a[i] - a[j]) / self.s)**2).sum(axis=1) + EDGE**2) if self.kind == "tv" else np.ones(len(self.pairs))
        return 1.0 / (size * self.s**2)


def elements_sharing_points(ids: np.ndarray, count: int) -> np.ndarray:
    """Elements (m, k) of points that share one of `count` points, each with the next about that point, (.., 2)."""
    element, point = np.repeat(np.arange(len(ids)), ids.shape[1]), ids.ravel()
    order = np.lexsort((element, point))
    element, point = element[order], point[order]
    same = point[1:] == point[:-1]
    return np.unique(np.stack([element[:-1][same], element[1:][same]], axis=1), axis=0)


def tets_sharing_faces(tets: np.ndarray) -> np.ndarray:
    """Tets (t, 4) that share a face, (.., 2)."""
    corner = np.sort(tets[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]], axis=2).reshape(-1, 3)
    order = np.lexsort(corner.T)
    same = (corner[order[1:]] == corner[order[:-1]]).all(axis=1)
    return np.sort(np.stack([order[:-1][same], order[1:][same]], axis=1) // 4, axis=1)
