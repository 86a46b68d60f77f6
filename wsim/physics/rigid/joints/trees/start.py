"""Joint coordinates of bodies as they stand: the inverse of kernels/rigid/joint/tree/kinematics.py. NumPy only."""

import numpy as np

from wsim.geometry import rotation
from wsim.physics.rigid.joints.trees.links import FITS, TreeLinks


def start_coordinates(links: TreeLinks, frames: dict[str, np.ndarray], places: np.ndarray, turns: np.ndarray,
                      joints: list, broken: np.ndarray) -> np.ndarray:
    """Coordinates of links (coordinates,). places, turns: centres of mass [m] and principal axes of links, (links, 3) and
    (links, 4); broken: whether joints broke (joints,).
    Raises ValueError where bodies stand off by more than FITS from what a joint allows."""
    found: list[float] = []
    for link, parent in enumerate(links.parent):
        at, turn = frames["at_a"][link], frames["turn_a"][link]
        if parent >= 0:
            at = places[parent] + rotation.quat_rotate(turns[parent], at)
            turn = rotation.quat_product(turns[parent], turn)
        to = places[link] + rotation.quat_rotate(turns[link], frames["at_b"][link])
        own = rotation.quat_product(turns[link], frames["turn_b"][link])
        shift = rotation.quat_rotate(rotation.quat_conjugate(turn), to - at)
        between = rotation.unit_quat(rotation.quat_product(rotation.quat_conjugate(turn), own))
        if links.breaks[link] and broken[links.joint[link]]:
            found += [*shift.tolist(), *between.tolist()]
            continue
        coordinates, off = _link_coordinates(links, link, shift, between)
        coordinates += [0.0] * (links.first_coordinate[link + 1] - links.first_coordinate[link] - len(coordinates))
        if off[0] > FITS[0] or off[1] > FITS[1]:
            raise ValueError(f"{joints[links.joint[link]].path}: its bodies stand {off[0]:.3g} m and {off[1]:.3g} rad off from "
                             "what it allows")
        found += coordinates
    return np.array(found)


def _link_coordinates(links: TreeLinks, link: int, shift: np.ndarray,
                      between: np.ndarray) -> tuple[list[float], tuple[float, float]]:
    """(coordinates of a link, what is left over [m], [rad]) of a shift (3,) and a quaternion (4,) between its frames."""
    first, slides, end = links.first_dof[link], links.slides[link], links.first_dof[link + 1]
    axes, angles, turned = links.axis[first:first + slides], between.tolist(), 0.0
    if not links.ball[link]:
        turns = links.axis[first + slides:end]
        angles, turned = _hinge_angles(turns, between)
        shift = shift - _hinge_shift(turns, links.point[first + slides:end], angles)
    found = [float(axis @ shift) for axis in axes]
    left = shift - sum((value * axis for value, axis in zip(found, axes, strict=True)), np.zeros(3))
    return [*found, *angles], (float(np.linalg.norm(left)), turned)


def _hinge_angles(axes: list[np.ndarray], between: np.ndarray) -> tuple[list[float], float]:
    """(angles of hinges, outermost first, the turn that is left over [rad]) of a quaternion (4,) between their frames."""
    if len(axes) == 3 and all(axis.any() for axis in axes):       # z, y, x: R = R_z(c) R_y(b) R_x(a)
        R = rotation.quaternion_to_matrix(between)
        middle = np.arctan2(-R[2, 0], np.hypot(R[2, 1], R[2, 2]))
        return [float(v) for v in (np.arctan2(R[1, 0], R[0, 0]), middle, np.arctan2(R[2, 1], R[2, 2]))], 0.0
    rest, angles = between, list[float]()
    for axis in axes[::-1]:                                       # the innermost hinge is the twist
        angle = 2.0 * np.arctan2(axis @ rest[:3], rest[3])
        angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
        rest = rotation.quat_product(rest, _turn_about(axis, -angle))
        angles.insert(0, float(angle))
    return angles, 2.0 * float(np.arctan2(np.linalg.norm(rest[:3]), abs(rest[3])))


def _hinge_shift(axes: list[np.ndarray], points: list[np.ndarray], angles: list[float]) -> np.ndarray:
    """How far hinges about points (3,) move the origin of their frame (3,) [m]."""
    at, turn = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])
    for axis, point, angle in zip(axes, points, angles, strict=True):
        at = at + rotation.quat_rotate(turn, point)
        turn = rotation.quat_product(turn, _turn_about(axis, angle))
        at = at - rotation.quat_rotate(turn, point)
    return at


def _turn_about(axis: np.ndarray, angle: float) -> np.ndarray:
    return np.array([*(np.sin(0.5 * angle) * axis), np.cos(0.5 * angle)])
