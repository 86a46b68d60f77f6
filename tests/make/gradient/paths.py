"""What tests/gradient/test_paths.py shares with other tests: KINDS, pinned, struck."""

import numpy as np

from wsim.geometry import rotation
from wsim.scene import Scene, Sphere, shapes
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric

TIMES = np.array([0.0, 0.07, 0.13, 0.4])
WAY = np.array([[0.0, 0, 0], [0.03, 0.02, 0.01], [0.02, -0.03, 0.05], [0.3, 0.1, 0.0]])
SLOPES = np.array([[0.5, 0.1, 0], [0.2, -0.6, 0.3], [1.0, 0.2, 0.1], [0, 0, 0.0]])
KINDS = {"catmull_rom": ("keys", {"kind": "catmull_rom", "alpha": 0.5}), "linear": ("keys", {"kind": "linear"}),
         "tangents": ("tangents", {"kind": "hermite", "leave": SLOPES, "arrive": 0.5 * SLOPES}),
         "squad": ("turns", {"kind": "catmull_rom"}), "slerp": ("turns", {"kind": "linear"}),
         "eased": ("turns", {"kind": "eased", "easing": "ease-in-out"}),
         "handles": ("handles", {"kind": "eased", "easing": [(0.3, 0.1, 0.6, 1.2), "ease", (0.1, 0.4, 0.9, 0.7)]})}
SOLVERS = {"explicit": ("leapfrog", 84), "xpbd": ("backward_euler", 3), "implicit": ("backward_euler", 3)}


def sheet(solver: str) -> tuple[Scene, object]:
    integrator, substeps = SOLVERS[solver]
    scene = Scene(fps=30.0, frames=4, substeps=substeps, solver=solver, integrator=integrator,
                  iterations=60 if solver == "implicit" else 6)
    cloth = scene.cloth("/cloth", *shapes.sheet(0.4, 0.4, 4, 4, cut="quads"), material=Fabric(stretch=2.0, damping=1e-3))
    return scene, cloth


def pinned(solver: str, how: dict, soft: bool) -> Scene:
    scene, cloth = sheet(solver)
    corner = cloth.points[0].astype(np.float64)
    turns = np.array([[0.0, 0, 0, 1], [0.0, 0, 0.1, 0.9949874371066199], [0, 0, 0, 1], [0, 0, 0, 1]])
    scene.pin("/pin", cloth, [0, 3], motion=Motion.through(TIMES, WAY + corner, turns, **how),
              **({"stiffness": 50.0} if soft else {}))
    return scene


def struck(solver: str, how: dict, turned: bool = False) -> Scene:
    """turned: the ball turns, and rubs."""
    scene, cloth = sheet(solver)
    scene.pin("/pin", cloth, [0, 3])
    low = cloth.points.astype(np.float64).mean(axis=0) - [0.0, 0.0, 0.0]
    normal = np.argmin(np.ptp(cloth.points, axis=0))
    low[normal] -= 0.1
    way = WAY.copy()
    way[:, normal] += 0.02
    turns = None
    if turned:
        turns = rotation.quaternion_exponential(np.array([[0.0, 0.1, 0.2], [0.3, 0.0, -0.1], [-0.2, 0.4, 0.1],
                                                          [0.0, 0.0, 0.0]]))
    scene.collider("/ball", Sphere(0.1), motion=Motion.through(TIMES, low + way, turns, **how))
    return scene
