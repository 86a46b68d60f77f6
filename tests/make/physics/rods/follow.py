"""What tests/physics/rods/test_follow.py shares with other tests: carried, combed."""

import numpy as np

from wsim.physics.rods.follow.objects import Followers
from wsim.physics.rods.objects import Rods
from wsim.scene import Scene
from wsim.simulation.simulation import Simulation

EDGE, POINTS = 0.02, 8


def combed(gravity=(0.0, 0.0, 0.0), worlds=1, curl=0.3, **more):
    """Three curved guides with their roots in a triangle, and hairs of other lengths between them."""
    roots = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]])
    s = np.arange(POINTS) * EDGE
    curve = np.stack([curl * s * s / s[-1], 0.2 * curl * s, -s], axis=1)
    made = Scene(gravity=gravity, fps=60.0, substeps=1)
    rods = made.add(Rods("/guides", (roots[:, None] + curve).reshape(-1, 3), [POINTS] * 3, 2e-3, 1e7, **more))
    rng = np.random.default_rng(3)
    counts = [5, 12, 1, 9]
    hairs = [np.array([0.03, 0.04, 0.0]) * rng.uniform(0.5, 1.2, 3) + np.outer(np.arange(n), [0.003, 0.001, -0.018])
             for n in counts]
    followers = made.add(Followers("/hair", np.concatenate(hairs), counts, "/guides"))
    return made, rods, followers


def carried(simulation: Simulation, world: int = 0):
    return next(s for s in simulation.samples(world) if s.path == "/hair")
