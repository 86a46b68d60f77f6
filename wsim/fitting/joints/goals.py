"""Goals of bodies that hang on joints, and solutions: plain data in SI units, NumPy only."""

from dataclasses import dataclass, field

import numpy as np

from wsim.scene import Problem, SceneError

UNIT = 1e-3                          # departure of the length of a quaternion from 1 that is allowed


@dataclass(eq=False)
class Goal:
    """A place and an orientation that a body is to reach, of one arm or of n at once, as in `Goal("/arm/hand", (0.3, 1, 0))`.

    body     prim path of a rigid body
    at       wanted place [m] of `point`, world, (3,) or (n, 3)
    turn     wanted orientation, a quaternion (x, y, z, w) [1] from its frame to the world, (4,) or (n, 4); None: any
    point    in the body's frame (3,) [m]
    radius   [m] by which an error of the angle [rad] counts beside one of the place [m]; it changes what is nearest to a goal
             that no coordinates reach
    """

    body: str
    at: np.ndarray
    turn: np.ndarray | None = None
    point: np.ndarray = field(default_factory=lambda: np.zeros(3))
    radius: float = 0.3

    def __post_init__(self):
        self.at = finite_rows(self.body, "at", self.at, 3)
        self.turn = None if self.turn is None else finite_rows(self.body, "turn", self.turn, 4)
        self.point = finite_rows(self.body, "point", self.point, 3)[0]
        if not 0.0 < self.radius < np.inf:
            raise SceneError(Problem(self.body, f"radius of a goal is {self.radius}; allowed is a finite length above 0 [m]"))
        if self.turn is not None and np.abs(np.linalg.norm(self.turn, axis=1) - 1.0).max(initial=0.0) > UNIT:
            raise SceneError(Problem(self.body, "turn of a goal is no unit quaternion; allowed are (x, y, z, w) of length 1; "
                                     "fix: divide it by its length"))


def finite_rows(path: str, name: str, values, width: int) -> np.ndarray:
    """Finite values (n, width) float64. Raises SceneError for others."""
    try:
        found = np.array(values, np.float64)
    except (TypeError, ValueError):
        found = np.full(1, np.nan)
    if found.shape[-1:] != (width,) or found.ndim not in (1, 2) or not np.isfinite(found).all():
        raise SceneError(Problem(path, f"{name} has the shape {found.shape}, or is not finite; allowed are finite numbers "
                                 f"({width},) or (n, {width})"))
    return found if found.ndim == 2 else found[None]


@dataclass(eq=False)
class JointSolution:
    """Coordinates that `JointTree.inverse_kinematics` found, and how well they do.

    q             coordinates (n, coordinates) [m], [rad]; of balls quaternions (x, y, z, w)
    off           distance left to the goal, of several the largest, (n,) [m]
    turned_off    angle left likewise, (n,) [rad]
    reached       whether both are within the tolerance, (n,)
    steps         Levenberg-Marquardt steps that were tried, (n,)
    """

    q: np.ndarray
    off: np.ndarray
    turned_off: np.ndarray
    reached: np.ndarray
    steps: np.ndarray

    def __repr__(self) -> str:
        most = self.off.max(initial=0.0)
        return f"<JointSolution: {int(self.reached.sum())} of {len(self.q)} reached, off by at most {most:.2e} m>"
