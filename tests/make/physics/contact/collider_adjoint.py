"""What tests/physics/contact/test_collider_adjoint.py shares with other tests: HIGH, TRIED, below, led, slid, wavy."""

import numpy as np

from tests.make.physics.contact.project_adjoint import SHAPES, SOLVERS, TOP, dropped
from tests.make.physics.contact.restitution import cube
from wsim.geometry.rotation import axis_rotation_matrix
from wsim.scene import Plane, Scene, Sphere, Surface
from wsim.scene.curve import Curve, Motion

G, FRAMES = 9.81, 4


def wavy(change=0.0) -> Surface:
    """An open mesh with hills and valleys; change: of its shape until frame 4 [m]."""
    g = np.linspace(-0.2, 0.2, 7)
    X, Y = np.meshgrid(g, g, indexing="ij")
    points = np.stack([X, Y, 0.01 * np.cos(20 * X) * np.cos(17 * Y) - 0.01], -1).reshape(-1, 3)
    id = np.arange(49).reshape(7, 7)
    quads = np.stack([id[:-1, :-1], id[1:, :-1], id[1:, 1:], id[:-1, 1:]], -1).reshape(-1)
    end = points + change * np.array([0.3, 0.2, 1.0]) * np.cos(9 * points[:, :1])
    return Surface(points, np.full(36, 4), quads, Curve([0.0, FRAMES / 60], np.stack([points, end])))


TRIED = {"sphere": SHAPES["sphere"], "plane": Plane("Z"), "solid": cube(0.05), "sheet": wavy(), "deforming": wavy(0.01)}
HIGH = TOP | {"solid": 0.05, "sheet": 0.0, "deforming": 0.0}


def below(scene: Scene) -> Scene:
    """With every kind of collider far below."""
    for k, shape in enumerate((Plane("Z"), Sphere(0.1), cube(0.1), wavy(0.01))):
        scene.collider(f"/below{k}", shape, at=(0.0, 0.0, -20.0 - 5.0 * k))
    return scene


def slid(shape, solver, spin=3.0, **more) -> Scene:
    """A sheet thrown at a collider that rises and turns."""
    scene = dropped("plane", (0.5, 0.4), spin, **more | SOLVERS[solver])
    scene.colliders[0].shape, scene.colliders[0].thickness = TRIED[shape], 1e-3
    scene.colliders[0].motion.values[:, 2, 3] -= HIGH[shape] + 1e-3
    scene.cloths[0].velocities = np.tile([0.6, 0.3, -0.2], (25, 1))
    return below(scene)


def led(own: Motion, substeps: int, shift: np.ndarray, turn: np.ndarray) -> Motion:
    """A motion with a shift and a turn about its origin at each frame on top, (frames + 1, 3); a key at every substep."""
    at = np.arange((len(shift) - 1) * substeps + 1) / substeps
    k = np.minimum(at.astype(int), len(shift) - 2)
    values = np.stack([own.at(t / 60) for t in at])
    for M, a, w in zip(values, *(q[k] + (at - k)[:, None] * (q[k + 1] - q[k]) for q in (shift, turn)), strict=True):
        M[:3, 3] += a
        angle = np.linalg.norm(w)
        M[:3, :3] = axis_rotation_matrix(w / max(angle, 1e-300), angle) @ M[:3, :3]
    return Motion(at / 60, values)
