"""Where a picture is taken from: placed by hand, read from a stage, or fitted to what is to be seen. NumPy only."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import radians, tan

import numpy as np

ANGLE = radians(28.0)          # of the automatic camera, vertical: long enough a lens to keep proportions true
MARGIN = 0.86                  # share of the image that the fitted points may fill
LEFT, ELEVATION = radians(32.0), radians(20.0)          # three-quarter view
OUTLIER = 5.0                  # a thing this many times larger than all others together does not steer the view


@dataclass(frozen=True)
class Camera:
    """A pinhole at `eye` [m] that looks along `forward`; tan_x and tan_y: tangents of half the angles it must show."""

    eye: np.ndarray
    forward: np.ndarray
    up: np.ndarray
    tan_x: float
    tan_y: float

    @staticmethod
    def look(eye, target, up=(0.0, 1.0, 0.0), angle: float = ANGLE) -> "Camera":
        """A camera from eye to target [m]; angle: vertical [rad]. Raises ValueError when the two are at one place."""
        eye, to = np.asarray(eye, float), np.asarray(target, float) - np.asarray(eye, float)
        if not np.linalg.norm(to) > 0:
            raise ValueError("a camera needs its eye and its target at different places")
        return Camera(eye, to / np.linalg.norm(to), np.asarray(up, float), 0.0, tan(0.5 * angle))

    def axes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Unit vectors to the right, upwards in the image, and forward. A view straight up or down has some right."""
        right = np.cross(self.forward, self.up)
        if np.linalg.norm(right) < 1e-6 * np.linalg.norm(self.up):
            right = np.cross(self.forward, np.roll(self.up, 1))
        right = right / np.linalg.norm(right)
        return right, np.cross(right, self.forward), self.forward

    def filled(self, aspect: float) -> "Camera":
        """The same view in an image of that width over height: the missing side is widened."""
        tan_y = max(self.tan_y, self.tan_x / aspect)
        return replace(self, tan_x=aspect * tan_y, tan_y=tan_y)


def up_vector(up: str) -> np.ndarray:
    """Unit vector of an up axis "X", "Y" or "Z"."""
    return np.eye(3)["XYZ".index(up)]


def subjects_in_view(groups: Sequence[np.ndarray]) -> list[int]:
    """Numbers of the point sets to frame: a floor or a wall far larger than all else is dropped, one after another."""
    sets = [k for k in range(len(groups)) if len(groups[k])]
    low, high = ({k: f(groups[k], axis=0) for k in sets} for f in (np.min, np.max))
    def joint_extent(some) -> float:
        return float(np.linalg.norm(np.max([high[k] for k in some], axis=0) - np.min([low[k] for k in some], axis=0)))
    while len(sets) > 1:
        largest = max(sets, key=lambda k: joint_extent([k]))
        others = [k for k in sets if k != largest]
        if joint_extent([largest]) < OUTLIER * joint_extent(others) or joint_extent(others) == 0.0:
            break
        sets = others
    return sets


def fit_camera_to_points(points: np.ndarray, up: str, aspect: float, turn: float = LEFT) -> Camera:
    """The nearest camera in three-quarter view that shows all points (n, 3) [m] with a margin.

    turn: angle [rad] to the side of the stage's front, which is +z where y is up and -y where z is up. For each pair
    of opposite sides of the image the support of the points in the two planes gives distance and centre in closed form.
    """
    above = up_vector(up)
    front, side = {"Y": ([0, 0, 1], [1, 0, 0]), "Z": ([0, -1, 0], [1, 0, 0]), "X": ([0, 0, 1], [0, -1, 0])}[up]
    level = np.cos(turn) * np.asarray(front, float) + np.sin(turn) * np.asarray(side, float)
    back = np.cos(ELEVATION) * level + np.sin(ELEVATION) * above                # from the scene to the eye
    tan_y = MARGIN * tan(0.5 * ANGLE)
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    view = Camera(center, -back, above, aspect * tan_y, tan_y)
    right, image_up, _ = view.axes()
    local = points - center
    z, distance, offset = local @ back, 0.0, []
    for axis, t in ((right, view.tan_x), (image_up, view.tan_y)):
        x = local @ axis
        plus, minus = float(np.max(x + t * z)), float(np.max(-x + t * z))       # |x - c| <= t (distance - z)
        distance = max(distance, (plus + minus) / (2.0 * t))
        offset.append(0.5 * (plus - minus))
    size = max(float(np.linalg.norm(np.ptp(points, axis=0))), 1e-9)
    distance = max(distance, float(z.max()) + 0.05 * size, size)                # a single point, a thing seen edge on
    eye = center + distance * back + offset[0] * right + offset[1] * image_up
    return replace(view, eye=eye, tan_x=view.tan_x / MARGIN, tan_y=view.tan_y / MARGIN)
