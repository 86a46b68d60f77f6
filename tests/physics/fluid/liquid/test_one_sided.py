"""Walls at the rim of a domain have one side, and need no parting of sides; walls inside have two."""

import numpy as np
import pytest

from wsim.physics.fluid.grid.shapes import one_sided
from wsim.scene import Box, Collider, Motion

LOW, HIGH, CELL = np.zeros(3), np.array([1.0, 0.5, 1.0]), 0.05
TURNED = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])


def wall(at: tuple, half: tuple = (0.05, 1.0, 1.0), turn: np.ndarray | None = None, moves: bool = False) -> Collider:
    M = np.eye(4)
    M[:3, 3] = at
    M[:3, :3] = np.eye(3) if turn is None else turn
    motion = Motion(np.array([0.0, 1.0]), np.stack([M, M + np.eye(4, k=3)])) if moves else Motion.still(M)
    return Collider("/wall", Box(half), motion=motion)


@pytest.mark.parametrize("thing, rim", [
    (wall((-0.05, 0.25, 0.5)), True), (wall((0.06, 0.25, 0.5)), False), (wall((0.05, 0.25, 0.5)), True),
    (wall((1.02, 0.25, 0.5)), True), (wall((0.5, 0.25, 0.5)), False), (wall((-0.05, 0.25, 0.5), moves=True), False),
    (wall((0.5, 0.25, 0.5), turn=TURNED), False), (wall((-1.0, 0.25, 0.5), turn=TURNED), True),
    (wall((0.5, -0.05, 0.5), (0.05, 0.05, 1.0)), False)])
def test_a_wall_at_the_rim_has_one_side(thing, rim):
    """The last is a bar below the domain's middle: it is thin along x, too, and both its ends lie within the domain."""
    assert one_sided(thing, LOW, HIGH, CELL) == rim
