"""Joint coordinates of bodies as they stand: the inverse of kernels/rigid/joint/tree/kinematics.py. NumPy only."""

import numpy as np

from wsim.geometry import rotation
from wsim.physics.rigid.joints.trees.links import FITS, TreeLinks


def start_coordinates(links: TreeLinks, frames: dict[str, np.ndarray], places: np.ndarray, turns: np.ndarray,
                      joints: list) -> np.ndarray:
    """Coordinates of links (coordinates,). places, turns: centres of mass [m] and principal axes of links, (links, 3) and
    (links, 4).
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
        coordinates, off = _link_coordinates(links, link, shift, between)
        if off[0] > FITS[0] or off[1] > FITS[1]:
            raise ValueError(f"{joints[links.joint[link]].path}: its bodies stand {off[0]:.3g} m and {off[1]:.3g} rad off from "
                             "what it allows")
        found += coordinates
    return np.array(found)


def _link_coordinates(links: TreeLinks, link: int, shift: np.ndarray,
                      between: np.ndarray) -> tuple[list[float], tuple[float, float]]:
    """(coordinates of a link, what is left over [m], [rad]) of a shift (3,) and a quaternion (4,) between its frames."""
    axes = links.axis[links.first_dof[link]:links.first_dof[link + 1]]
    slides, ball = links.slides[link], bool(links.ball[link])
    found = [float(axis @ shift) for axis in axes[:slides]]
    left = shift - sum((value * axis for value, axis in zip(found, axes, strict=False)), np.zeros(3))
    if ball:
        return [*found, *between.tolist()], (float(np.linalg.norm(left)), 0.0)
    rest, angles = between, []
    for axis in axes[slides:][::-1]:                              # the innermost hinge is the twist
        angle = 2.0 * np.arctan2(axis @ rest[:3], rest[3])
        angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
        back = np.array([*(-np.sin(0.5 * angle) * axis), np.cos(0.5 * angle)])
        rest = rotation.quat_product(rest, back)
        angles.insert(0, float(angle))
    turned = 2.0 * float(np.arctan2(np.linalg.norm(rest[:3]), abs(rest[3])))
    return [*found, *angles], (float(np.linalg.norm(left)), turned)
