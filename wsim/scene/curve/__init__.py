"""A value known for all time: keys and what lies between them. NumPy only.

    Curve    values at times, linear between keys, held outside; any shape (points of a mesh, a scalar)
    Motion   transforms at times. M = T R S (translation, rotation, remaining symmetric stretch, by polar
             decomposition); between keys T and S are linear and R turns at constant speed about a fixed axis (slerp)

Matrices act on columns: p_world = M[:3, :3] p + M[:3, 3]. Times in [s] from the start of the scene.
"""

from dataclasses import dataclass, field

import numpy as np

from wsim.geometry.rotation import about_axis, axis_angle, polar


def _segment(times: np.ndarray, t: float) -> tuple[int, int, float]:
    """Keys (a, b) around time t and the fraction of the way from a to b."""
    b = int(np.searchsorted(times, t, side="right"))
    if b == 0 or b == len(times):
        a = max(b - 1, 0)
        return a, a, 0.0
    return b - 1, b, float((t - times[b - 1]) / (times[b] - times[b - 1]))


@dataclass(eq=False)
class Curve:
    """A value over time: linear between keys, constant before the first and after the last. Raises ValueError where times do
    not increase, or there is not one value a time.

    times     of the keys, (keys,) [s] from the start of the scene, increasing
    values    at the keys, (keys, ...), in the unit of what it stands for
    """

    times: np.ndarray
    values: np.ndarray

    def __post_init__(self):
        self.times = np.atleast_1d(np.asarray(self.times, np.float64))
        self.values = np.asarray(self.values)
        if len(self.times) != len(self.values) or len(self.times) == 0:
            raise ValueError(f"a curve needs one value a time: {len(self.times)} times, {len(self.values)} values")
        if not np.all(np.diff(self.times) > 0):
            raise ValueError("the times of a curve must increase")

    @property
    def moves(self) -> bool:
        """Whether there is more than one key."""
        return len(self.times) > 1

    def at(self, t: float) -> np.ndarray:
        """Value at time t [s], shape (...)."""
        a, b, s = _segment(self.times, t)
        if a == b:
            return self.values[a]
        return self.values[a] + s * (self.values[b] - self.values[a])

    def weights(self, times: np.ndarray) -> np.ndarray:
        """Part of each key in the values at some times, (times, keys): the values are weights @ keys' values."""
        t = np.clip(np.asarray(times, np.float64), self.times[0], self.times[-1])
        found = np.zeros((len(t), len(self.times)))
        if not self.moves:
            return found + 1.0
        a = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        s, each = (t - self.times[a]) / (self.times[a + 1] - self.times[a]), np.arange(len(t))
        found[each, a], found[each, a + 1] = 1.0 - s, s
        return found

    def __eq__(self, other) -> bool:
        return (type(self) is type(other) and np.array_equal(self.times, other.times)
                and np.array_equal(self.values, other.values))


@dataclass(eq=False)
class Motion(Curve):
    """Local-to-world transforms over time, as matrices that act on columns; a rotation between keys turns at constant speed.

    times     of the keys, (keys,) [s] from the start of the scene, increasing
    values    (keys, 4, 4), lengths [m]
    parts     rotation and stretch of each key, (3, 3) and (3, 3) [1], kept once asked for
    turned    axis [1] and angle [rad] from a key to the next, kept once asked for
    """

    parts: list = field(default_factory=list, repr=False, compare=False)
    turned: dict = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self):
        super().__post_init__()
        self.values = np.asarray(self.values, np.float64).reshape(-1, 4, 4)

    @staticmethod
    def still(matrix=None) -> "Motion":
        """One transform for all time, (4, 4), lengths [m]; None: the identity."""
        return Motion(np.zeros(1), (np.eye(4) if matrix is None else np.asarray(matrix, np.float64))[None])

    @staticmethod
    def at_place(translate=(0.0, 0.0, 0.0)) -> "Motion":
        """A place [m], without rotation, for all time."""
        M = np.eye(4)
        M[:3, 3] = translate
        return Motion.still(M)

    def at(self, t: float) -> np.ndarray:
        """Transform at time t, shape (4, 4)."""
        a, b, s = _segment(self.times, t)
        if a == b:
            return self.values[a]
        A, B = self.values[a], self.values[b]
        if not self.parts:
            self.parts = [polar(M[:3, :3]) for M in self.values]
        (Ra, Sa), (Rb, Sb) = self.parts[a], self.parts[b]
        if a not in self.turned:
            turn = axis_angle(Ra.T @ Rb)
            self.turned[a] = turn[0], float(turn[1])
        axis, angle = self.turned[a]
        M = np.eye(4)
        M[:3, :3] = Ra @ about_axis(axis, s * angle) @ (Sa + s * (Sb - Sa))
        M[:3, 3] = A[:3, 3] + s * (B[:3, 3] - A[:3, 3])
        return M

    def points(self, local: np.ndarray, t: float = 0.0) -> np.ndarray:
        """World positions [m] in float64 of local points, shape (n, 3)."""
        M = self.at(t)
        return np.asarray(local, np.float64) @ M[:3, :3].T + M[:3, 3]
