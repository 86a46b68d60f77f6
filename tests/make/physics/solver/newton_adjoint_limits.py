"""What tests/physics/solver/test_newton_adjoint_limits.py shares with other tests: landed, pulled."""

from dataclasses import replace

import numpy as np

from tests.make.gradient.gradients import sheet
from tests.make.physics.contact.project_adjoint import dropped
from wsim.scene import Scene

HARD = {"limit": (0.01, False), "tethers": (np.inf, True), "both": (0.01, True), "none": (np.inf, False)}


def hard(scene: Scene, what: str, **material) -> Scene:
    limit, scene.cloths[0].tethers = HARD[what]
    scene.cloths[0].material = replace(scene.cloths[0].material, **{"strain_limit": limit, "stretch": 4.0} | material)
    return scene


def pulled(integrator: str, what: str, model: str = "springs", **more) -> Scene:
    """A soft sheet held at two corners and pulled away from them: steps of 1/120 s."""
    scene = hard(sheet(model, damping=2e-4, integrator=integrator, **{"solver": "implicit", "substeps": 2} | more), what)
    y = scene.cloths[0].points[:, 1]
    scene.cloths[0].velocities = np.outer((y.max() - y) / 0.2, [0.0, -1.0, 0.0])
    scene.gravity = (0.0, -20.0, -5.0)
    return scene


def landed(shape: str, integrator: str, mu: float, what: str = "limit", **more) -> Scene:
    """A soft sheet that falls on a turning collider, with limits of 0.2 %."""
    scene = dropped(shape, friction=(mu, mu), spin=3.0, gap=0.007,
                    **{"solver": "implicit", "integrator": integrator, "substeps": 2, "iterations": 2} | more)
    scene.colliders[0].thickness = 1e-3
    return hard(scene, what, **{"strain_limit": 0.002} if what != "none" else {})
