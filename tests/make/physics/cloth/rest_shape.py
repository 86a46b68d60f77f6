"""What tests/physics/cloth/test_rest_shape.py shares with other tests: SOLVERS, by_rest_shape, crooked."""

import numpy as np

from tests.make.gradient.gradients import Run, sheet
from wsim.physics.cloth.rest_shape import current_rest_shape
from wsim.scene import Scene

SOLVERS: dict = {"leapfrog": {"integrator": "leapfrog"}, "rk4": {"integrator": "rk4"},
                 "xpbd": {"solver": "xpbd", "integrator": "backward_euler", "substeps": 8, "iterations": 4},
                 "newton": {"solver": "implicit", "integrator": "bdf2", "substeps": 2}}


def crooked(model: str, size: float = 1.0, **kwargs) -> Scene:
    """The sheet, at rest neither flat nor along the axes: warp is not in its plane, and its angles are those."""
    scene = sheet(model, damping=2e-4, **kwargs)
    cloth, p = scene.cloths[0], scene.cloths[0].rest_points.astype(float)
    p = p + 0.004 * size * np.random.default_rng(3).normal(size=p.shape)
    p[:, 2] += size * (1.5 * p[:, 0] ** 2 + 0.5 * p[:, 0])
    cloth.rest_points, cloth.flat = p.astype(np.float32), False
    return scene


def by_rest_shape(run: Run, step: float = 5e-6, within: float = 1e-10) -> None:
    """Along a random direction."""
    start = current_rest_shape(run.sim.model.body(run.path))
    way = np.random.default_rng(6).normal(size=start.shape)
    found = (run.gradient.rest_shape(run.path) * way).sum()
    run.check(found, lambda s: (run.path, "rest_shape", start + s * way), step, within)
