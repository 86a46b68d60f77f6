"""A box that a skeleton moves."""

import numpy as np

from wsim.geometry import rotation
from wsim.physics.animation.objects import Skeleton, Skinned
from wsim.scene import shapes
from wsim.scene.curve import Motion


def lying_cube() -> tuple:
    """A box whose faces are quads, bound to one joint that moves and turns, in a skeleton that moves, too."""
    points, counts, indices = shapes.box((0.2, 0.1, 0.3), 2)
    times = np.array([0.0, 0.1, 0.2])
    turn = rotation.quaternion_exponential(np.array([[0.0, 0, 0], [0.3, 0.2, -0.4], [0.5, 0.9, 0.1]]))
    skeleton = Skeleton("/man/bones", ("hip",), np.eye(4)[None], times=times, rotations=turn[:, None],
                        translations=np.array([[[0.0, 0, 0]], [[0.1, 0, 0]], [[0.1, 0.2, 0]]]),
                        motion=Motion.through([0.0, 0.2], [(0, 0, 0), (0, 0, 0.3)]))
    return skeleton, Skinned(skeleton, points, np.zeros((len(points), 1), int), np.ones((len(points), 1))), counts, indices
