"""What tests/physics/cloth/test_muscles.py shares with other tests: FACTORS, SOLVERS, crawler, muscled."""

import numpy as np

from tests.make.gradient.gradients import net
from wsim.scene import Motion, Plane, Scene, shapes
from wsim.scene.curve import Curve
from wsim.scene.solid import Bulk

TIMES = np.array([0.0, 0.013, 0.04, 0.06])
FACTORS = np.array([[1.0, 1.0], [0.8, 1.1], [1.2, 0.9], [0.9, 1.05]])
GROUPS = np.array([0, 1, -1, 0, 1, -1, 0, 1, -1, 0, 1])
SWEEPS = {"solver": "xpbd", "substeps": 8, "iterations": 4, "integrator": "backward_euler"}
SOLVERS = {"leapfrog": {"integrator": "leapfrog"}, "rk4": {"integrator": "rk4"},
           "xpbd": SWEEPS, "midpoint": SWEEPS | {"integrator": "implicit_midpoint", "iterations": 16},
           "newton": {"solver": "implicit", "integrator": "bdf2", "substeps": 4},
           "sdirk3": {"solver": "implicit", "integrator": "sdirk3", "substeps": 4}}


def muscled(**more) -> Scene:
    """A chain in which two groups of springs pull, and some are passive."""
    scene = net(**more)
    scene.springs[0].actuation, scene.springs[0].muscles = Curve(TIMES, FACTORS), GROUPS.astype(np.int32)
    return scene


def crawler(**more) -> Scene:
    """A soft block whose long edges are muscles, on a plane with friction."""
    scene = Scene(**{"fps": 24.0, "frames": 8, "solver": "explicit", "substeps": 110, "contact_width": 1e-3} | more)
    points, tets = shapes.block((0.2, 0.1, 0.1), (2, 1, 1), at=(0.0, 0.05, 0.0))
    soft = scene.soft("/block", points, tets, material=Bulk(3e4, 0.3, 1e3, damping=5e-3))
    below = np.flatnonzero(points[:, 1] < 1e-6)
    below = below[np.lexsort([points[below, 0], points[below, 2]])]
    net = scene.net("/muscles", points[below], [[0, 1], [1, 2], [3, 4], [4, 5]], [800.0], [1e-6], muscles=[0, 1, 0, 1],
                    actuation=Curve([0.0, 0.1, 0.2, 0.3], np.array([[1.0, 1.0], [0.7, 1.0], [1.0, 0.7], [1.1, 1.0]])))
    scene.tie("/tendons", net, range(6), soft, below)
    scene.collider("/ground", Plane(), motion=Motion.still([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]))
    return scene
