"""Frames over time: local-to-world transforms by keys. NumPy only.

M = T R S (translation, rotation, remaining symmetric stretch, by polar decomposition). Between keys, by the kind of `Curve`:

    kind                                        T             R                                            S
    linear, hold, eased                         as a Curve    slerp, at that pace                          linear, at that pace
    catmull_rom, kochanek_bartels, monotone,    as a Curve    squad: its angular velocity is continuous    linear
    hermite, bezier

Outside: T as a Curve; R held, going on turning ("linear"), or with the turn of a whole period more each time ("repeat").
Rates are those of the formulas: dM/dt = [omega] R S + R dS/dt, omega in world axes (`wsim.geometry.rotation_spline`).

Matrices act on columns: p_world = M[:3, :3] p + M[:3, 3]. Times in [s] from the start of the scene. Quaternions are
(x, y, z, w).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.geometry import rotation
from wsim.geometry.rotation import axis_angle, axis_rotation_matrix, polar_decomposition
from wsim.scene.curve.curve import Curve, checked_keys

if TYPE_CHECKING:
    from wsim.scene.curve.turns import RotationCurve

UNIT = 1e-6                              # how far from 1 the length of a given quaternion may be: float32 files reach 1e-7


def _key_interval(times: np.ndarray, t: float) -> tuple[int, int, float]:
    """Keys (a, b) around time t and the fraction of the way from a to b."""
    b = int(np.searchsorted(times, t, side="right"))
    if b == 0 or b == len(times):
        a = max(b - 1, 0)
        return a, a, 0.0
    return b - 1, b, float((t - times[b - 1]) / (times[b] - times[b - 1]))


class Motion(Curve):
    """Local-to-world transforms over time, as matrices that act on columns; rotations turn by slerp, or smoothly by squad, as
    in `scene.collider("/hand", Sphere(0.1), motion=Motion.through([0.0, 1.0], [(0, 0, 0), (0, 0, 1)]))`. Raises ValueError as
    a `Curve` does.

    times     of the keys, (keys,) [s] from the start of the scene, increasing
    values    (keys, 4, 4), lengths [m]
    kind      of the way between keys, as `Curve` has them; slopes of "hermite" and "bezier" are those of places, (keys, 3)
              [m/s]
    before    outside, at earlier times: "held", "linear", "repeat", "reset" or "oscillate"
    after     outside, at later times: as before
    """

    def __init__(self, times, values, kind: str = "linear", before="held", after="held", **how):
        self.times, self.values = checked_keys(times, np.asarray(values, np.float64).reshape(-1, 4, 4))
        if not (isinstance(before, str) and isinstance(after, str)):
            raise ValueError("outside of its keys a motion is held, linear, repeat, reset, oscillate; a slope is for a Curve")
        self.path = Curve(self.times, self.values[:, :3, 3], kind, before, after, **how)     # of the places
        self.kind, self.before, self.after, self.how = kind, before, after, self.path.how
        self.turned: Any = None              # of keys and between them, once asked for: `_turns`
        self.made: Any = None                # turns between keys, once asked for

    @staticmethod
    def still(matrix=None) -> Motion:
        """One transform for all time, (4, 4), lengths [m]; None: the identity."""
        return Motion(np.zeros(1), (np.eye(4) if matrix is None else np.asarray(matrix, np.float64))[None])

    @staticmethod
    def at_place(translate=(0.0, 0.0, 0.0)) -> Motion:
        """A place [m], without rotation, for all time."""
        M = np.eye(4)
        M[:3, 3] = translate
        return Motion.still(M)

    @staticmethod
    def through(times, places, turns=None, kind: str = "catmull_rom", before="held", after="held", **how) -> Motion:
        """Rigid, through places (keys, 3) [m] and unit quaternions turns (keys, 4), (x, y, z, w), at times (keys,) [s]; None:
        no rotation. Raises ValueError where a quaternion is not of length 1, and as a Curve does."""
        places = np.asarray(places, np.float64).reshape(-1, 3)
        M = np.tile(np.eye(4), (len(places), 1, 1))
        M[:, :3, 3] = places
        if turns is not None:
            q = np.asarray(turns, np.float64).reshape(-1, 4)
            length = np.linalg.norm(q, axis=1)
            if len(q) != len(places) or not np.all(np.abs(length - 1.0) < UNIT):
                k = int(np.argmax(~(np.abs(length - 1.0) < UNIT)))
                raise ValueError(f"a motion needs one unit quaternion (x, y, z, w) a place: {len(q)} of them for {len(places)} "
                                 f"places, number {k} of length {length[k] if len(q) else 0.0:g}; divide each by its length")
            M[:, :3, :3] = rotation.quaternion_to_matrix(rotation.unit_quat(q))
        return Motion(times, M, kind, before, after, **how)

    def at(self, t: float) -> np.ndarray:
        """Transform at time t, shape (4, 4)."""
        if not self.plain:
            return self.sampled(t)[0]
        a, b, s = _key_interval(self.times, t)
        if a == b:
            return self.values[a]
        A, B, (R, S, axis, angle) = self.values[a], self.values[b], self._turns()
        M = np.eye(4)
        M[:3, :3] = R[a] @ axis_rotation_matrix(axis[a], s * angle[a]) @ (S[a] + s * (S[b] - S[a]))
        M[:3, 3] = A[:3, 3] + s * (B[:3, 3] - A[:3, 3])
        return M

    def _turns(self) -> tuple:
        """Rotations and stretches of the keys, (keys, 3, 3), axes (keys - 1, 3) and angles [rad] from each key to the next."""
        if self.turned is None:
            R, S = polar_decomposition(self.values[:, :3, :3])
            self.turned = R, S, *axis_angle(R[:-1].swapaxes(1, 2) @ R[1:])
        return self.turned

    def sampled(self, t) -> np.ndarray:
        """Transforms at times (n,) [s], (n, 4, 4)."""
        t = np.atleast_1d(np.asarray(t, np.float64))
        return self._straight(t) if self.plain else self._moved(t)[0]

    def _straight(self, t: np.ndarray) -> np.ndarray:
        """As `at` says, to the bit, all times at once."""
        begin, last = np.searchsorted(self.times, t, side="right"), len(self.times) - 1
        M = self.values[np.minimum(begin, last)]
        inside = np.flatnonzero((begin > 0) & (begin <= last))
        if len(inside):
            b, (R, S, axis, angle) = begin[inside], self._turns()
            a, A, B = b - 1, self.values[b - 1, :3, 3], self.values[b, :3, 3]
            s = (t[inside] - self.times[a]) / (self.times[b] - self.times[a])
            M[inside, :3, :3] = R[a] @ axis_rotation_matrix(axis[a], s * angle[a]) @ (S[a] + s[:, None, None] * (S[b] - S[a]))
            M[inside, :3, 3] = A + s[:, None] * (B - A)
        return M

    def rate(self, t) -> np.ndarray:
        """dM/dt at times (n,) [s], (n, 4, 4) [m/s] and [1/s]: at a key the one behind it, 0 where it is held."""
        return self._moved(np.atleast_1d(np.asarray(t, np.float64)))[1]

    def velocities(self, t) -> tuple[np.ndarray, np.ndarray]:
        """Velocities of the frame's origin [m/s] and angular velocities [rad/s], in world axes, at times (n,) [s]; (n, 3)."""
        t = np.atleast_1d(np.asarray(t, np.float64))
        M, rate = self._moved(t)
        D = rate[:, :3, :3] @ np.linalg.inv(M[:, :3, :3])
        return rate[:, :3, 3], 0.5 * np.stack([D[:, 2, 1] - D[:, 1, 2], D[:, 0, 2] - D[:, 2, 0], D[:, 1, 0] - D[:, 0, 1]], 1)

    @property
    def by_keys(self) -> bool:
        """True if all of it is keys, or a stack of such: the device evaluates it (kernels/animation)."""
        return type(self) is Motion or self.kind == "stack"

    @property
    def turns(self) -> RotationCurve:
        """Rotations and stretches over time."""
        if self.made is None:
            from wsim.scene.curve.turns import RotationCurve
            self.made = RotationCurve(self)
        return self.made

    def _moved(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(M, dM/dt), (n, 4, 4) each."""
        M, rate = np.tile(np.eye(4), (len(t), 1, 1)), np.zeros((len(t), 4, 4))
        M[:, :3, 3], rate[:, :3, 3] = self.path.sampled(t), self.path.rate(t)
        M[:, :3, :3], rate[:, :3, :3] = self.turns.at(t)
        return M, rate

    def points(self, local: np.ndarray, t: float = 0.0) -> np.ndarray:
        """World positions [m] in float64 of local points, shape (n, 3)."""
        M = self.at(t)
        return np.asarray(local, np.float64) @ M[:3, :3].T + M[:3, 3]
