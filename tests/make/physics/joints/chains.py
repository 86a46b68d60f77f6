"""A four-bar linkage, and a chain that carries much."""

import numpy as np

import wsim
from wsim.scene import Box, Scene


def linkage(coordinates="reduced", substeps=4, kinds=("revolute",) * 4, **settings) -> Scene:
    """A four-bar linkage in the x-y plane, whose first joint hangs on the world at 0, and its last at (0.8, 0, 0)."""
    scene = Scene(**({"fps": 60, "substeps": substeps, "coordinates": coordinates} | settings))
    places = np.array([(0.0, 0.0, 0.0), (0.0, 0.4, 0.0), (0.9, 0.7, 0.0), (0.8, 0.0, 0.0)])
    bodies: list = [None]
    for k in range(3):
        way = places[k + 1] - places[k]
        M, x = np.eye(4), way / np.linalg.norm(way)
        M[:3, :3], M[:3, 3] = np.stack([x, np.cross([0, 0, 1], x), [0, 0, 1]], 1), 0.5 * (places[k] + places[k + 1])
        bodies.append(scene.body(f"/b{k}", Box((0.5 * np.linalg.norm(way), 0.02, 0.03)), motion=wsim.Motion.still(M)))
        bodies[-1].colliders[0].meets = False
    bodies.append(None)
    for k, kind in enumerate(kinds):
        scene.joint(kind, f"/j{k}", bodies[k], bodies[k + 1], at=places[k], axis=(0, 0, 1))
    return scene


def heavy_chain(substeps: int) -> Scene:
    """Ten links of 1 kg carry 1000 kg, which swing."""
    scene = Scene(fps=60, substeps=substeps, coordinates="reduced")
    last = None
    for k in range(11):
        size = 0.05 if k < 10 else 0.5
        body = scene.body(f"/b{k}", Box((0.05, size, 0.05)), at=(0.0, -0.05 - 0.1 * k - 0.45 * (k == 10), 0.0),
                          mass=1.0 if k < 10 else 1000.0)
        body.colliders[0].meets = False
        scene.joint("revolute", f"/j{k}", last, body, at=(0.0, -0.1 * k, 0.0), axis=(0, 0, 1))
        last = body
    last.velocity[0] = 0.5
    return scene
