"""What tests/gradient/test_bodies.py shares with other tests: VALUES, bodies, both, recorded, seeds."""

from functools import cache

import numpy as np

from wsim.geometry import rotation
from wsim.gradient.recording import Recording
from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Collider, Scene
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation

G = np.array([0.0, 0.0, -9.81])
LAST = 12
VALUES = ("velocity", "spin", "force", "torque", "drag", "spin_drag", "mass", "inertia")
TURNED = (0.0, np.sin(0.4), 0.0, np.cos(0.4))


def placed(turn=(0.0, 0.0, 0.0, 1.0), at=(0.0, 0.0, 0.0)) -> Motion:
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = rotation.quaternion_to_matrix(np.array(turn)), at
    return Motion.still(M)


def bodies() -> list[Body]:
    """One with given moments, out of order, off its centre; one of a box that touches nothing, which follows its mass."""
    given = Body("/given", mass=2.0, center=(0.1, -0.2, 0.3), inertia=(1.2, 2.1, 0.7), axes=TURNED, motion=placed(TURNED),
                 velocity=(1.0, 2.0, 3.0), spin=(0.5, 4.0, -0.7), force=(1.0, -2.0, 3.0), torque=(0.4, 0.2, -0.3), drag=0.3,
                 spin_drag=0.2)
    shape = Collider("/boxed/shape", Box((0.3, 0.5, 0.9)), motion=placed(at=(0.2, 0.0, 0.1)), meets=False)
    return [given, Body("/boxed", [shape], mass=3.0, velocity=(-1.0, 0.0, 2.0), spin=(2.0, 1.0, 3.0), torque=(0.3, 0.0, 0.2))]


def recorded(things: list[Body], frames: int = LAST, keep: str = "auto", worlds: int = 1, precision: str = "float64",
             device: str = "cpu", **more):
    scene = Scene(**{"gravity": tuple(G), "fps": 60.0, "substeps": 4} | more)
    for body in things:
        scene.add(body)
    return Recording(Simulation(scene, device=device, precision=precision, worlds=worlds, gradients=True), frames, keep)


@cache
def seeds(path: str) -> tuple[dict, dict]:
    """Derivatives by poses and by twists of two frames, of one body."""
    rng = np.random.default_rng(len(path))
    poses, twists = {5: rng.normal(size=(4, 4)), LAST: rng.normal(size=(4, 4))}, {7: rng.normal(size=(2, 3)),
                                                                                 LAST: rng.normal(size=(2, 3))}
    return {f: {path: by} for f, by in poses.items()}, {f: {path: 0.1 * by} for f, by in twists.items()}


@cache
def both() -> Recording:
    return recorded(bodies())
