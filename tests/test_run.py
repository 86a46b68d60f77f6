"""Runs in parts of frames and with a delay: what the simulated scene becomes."""

import numpy as np
import pytest

from wsim.curve import Curve, Motion
from wsim.run import finer, later
from wsim.scene import Scene, Surface


def test_later_moves_every_curve():
    scene = Scene()
    motion = Motion([0.0, 1.0], np.stack([np.eye(4), np.diag([1.0, 1.0, 1.0, 1.0])]))
    motion.values[1, 0, 3] = 1.0
    poses = Curve([0.0, 1.0], np.arange(18.0).reshape(2, 3, 3))
    scene.collider("/a", Surface(np.zeros((3, 3)), [3], [0, 1, 2], poses=poses), motion=motion)
    scene.pin("/p", "/cloth", [0], motion=motion)
    moved = later(scene, 0.5)
    for t in (0.0, 0.3, 1.0):
        assert np.allclose(moved.colliders[0].motion.at(t + 0.5), motion.at(t), atol=1e-15)
        assert np.allclose(moved.colliders[0].shape.poses.at(t + 0.5), poses.at(t), atol=1e-14)
        assert np.allclose(moved.pins[0].motion.at(t + 0.5), motion.at(t), atol=1e-15)
    assert scene.colliders[0].motion.times[0] == 0.0                   # the scene that is written stays


@pytest.mark.parametrize(("substeps", "count", "each"), [(10, 2, 5), (10, 3, 4), (2, 4, 1)])
def test_finer_keeps_the_substep_or_makes_it_shorter(substeps, count, each):
    scene = finer(Scene(substeps=substeps, fps=24.0, frames=10), count)
    assert (scene.substeps, scene.fps, scene.frames) == (each, 24.0 * count, 10 * count)
