"""A frame as USD says it: transforms one in another, each a constant, a shift, turn or scale along an axis by a curve, or a
motion. NumPy only.

    M(t) = A_1(t) A_2(t) ... A_n(t)          dM/dt = sum_i A_1 .. dA_i/dt .. A_n

The first is the outermost. Nothing between keys is approximated, whatever the number of keys of each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from wsim.geometry.rotation import axis_rotation_matrix
from wsim.scene.curve.curve import Curve
from wsim.scene.curve.motion import Motion

SHIFT, TURN, SCALE, ELEMENTS = "shift", "turn", "scale", "elements"


@dataclass(eq=False)
class Part:
    """A transform of a stack.

    what      "shift" [m], "turn" [rad] or "scale" [1] along or about one axis; "elements" of a matrix, lengths [m]
    curve     of numbers (keys,), or of matrices (keys, 4, 4)
    axis      0 .. 2
    """

    what: str
    curve: Curve
    axis: int = 0

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(A, dA/dt) at times (n,) [s], (n, 4, 4) each."""
        value, rate, k = self.curve.sampled(t), self.curve.rate(t), self.axis
        if self.what == ELEMENTS:
            return value, rate
        A, dA = np.tile(np.eye(4), (len(t), 1, 1)), np.zeros((len(t), 4, 4))
        if self.what == SHIFT:
            A[:, k, 3], dA[:, k, 3] = value, rate
        elif self.what == SCALE:
            A[:, k, k], dA[:, k, k] = value, rate
        else:
            axis = np.eye(3)[k]
            A[:, :3, :3] = axis_rotation_matrix(np.broadcast_to(axis, (len(t), 3)), value)
            dA[:, :3, :3] = rate[:, None, None] * (np.cross(axis, np.eye(3), axisb=0, axisc=0) @ A[:, :3, :3])
        return A, dA

    def __eq__(self, other) -> bool:
        return isinstance(other, Part) and (self.what, self.axis, self.curve) == (other.what, other.axis, other.curve)


class Stack(Motion):
    """Transforms one in another, over time.

    inner     the parts, outermost first: `Part`s, `Motion`s and constant matrices (4, 4), lengths [m]
    times     when any part has a key, (keys,) [s], and
    values    what all is then, (keys, 4, 4) [m]: for checks and pictures; frames are evaluated by the parts
    """

    def __init__(self, inner: list):
        self.inner = _merge_constant_parts([A if isinstance(A, (Part, Motion)) else np.asarray(A, np.float64) for A in inner])
        keys = [(A.curve if isinstance(A, Part) else A).times for A in self.inner if not isinstance(A, np.ndarray)]
        times = np.unique(np.concatenate(keys)) if keys else np.zeros(1)
        self.kind = "stack"
        self.values = self._moved(times)[0]
        super().__init__(times, self.values)
        self.kind = "stack"

    @property
    def moves(self) -> bool:
        return any((A.curve if isinstance(A, Part) else A).moves for A in self.inner if not isinstance(A, np.ndarray))

    def _moved(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        M, rate = np.tile(np.eye(4), (len(t), 1, 1)), np.zeros((len(t), 4, 4))
        for A in self.inner:
            if isinstance(A, np.ndarray):
                M, rate = M @ A, rate @ A
                continue
            value, own = A.at(t) if isinstance(A, Part) else (A.sampled(t), A.rate(t))
            M, rate = M @ value, rate @ value + M @ own
        return M, rate

    @property
    def plain(self) -> bool:
        return False

    def mapped(self, each) -> Stack:
        """The stack with other curves: each(curve) of parts and motions."""
        return Stack([Part(A.what, each(A.curve), A.axis) if isinstance(A, Part) else
                      A if isinstance(A, np.ndarray) else each(A) for A in self.inner])

    def later(self, delay: float) -> Self:
        return self.mapped(lambda curve: curve.later(delay))  # type: ignore[return-value]

    def __eq__(self, other) -> bool:
        return isinstance(other, Stack) and len(self.inner) == len(other.inner) and all(
            np.array_equal(a, b) if isinstance(a, np.ndarray) or isinstance(b, np.ndarray) else a == b
            for a, b in zip(self.inner, other.inner, strict=True))


def _merge_constant_parts(inner: list) -> list:
    """Stacks within by their parts, constants beside one another multiplied."""
    found: list = []
    for A in inner:
        for own in A.inner if isinstance(A, Stack) else [A]:
            if isinstance(own, Motion) and not own.moves:
                own = own.values[0]
            if isinstance(own, np.ndarray) and found and isinstance(found[-1], np.ndarray):
                found[-1] = found[-1] @ own
            elif not (isinstance(own, np.ndarray) and np.array_equal(own, np.eye(4))):
                found.append(own)
    return found


def then(motion: Motion, matrix: np.ndarray) -> Motion:
    """M(t) with a constant matrix (4, 4) on the right: of a frame within that one."""
    return Motion(motion.times, motion.values @ matrix) if motion.plain else Stack([motion, matrix])
