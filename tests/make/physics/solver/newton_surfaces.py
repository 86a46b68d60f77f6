"""What tests/physics/solver/test_newton_surfaces.py shares with other tests: caught, draped, thrown."""

import numpy as np

from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Collider, Motion, Plane, Scene, Sphere, shapes
from wsim.scene.fabric import fabric

TURN = np.array([[np.cos(0.4), 0.0, np.sin(0.4)], [0.0, 1.0, 0.0], [-np.sin(0.4), 0.0, np.cos(0.4)]])


def draped(integrator: str, size: float = 1.0, substeps: int = 12) -> Scene:
    """A sheet of cotton, 0.45 m times `size`, that falls on a box on a floor, whose edges and corners it meets."""
    scene = Scene(solver="implicit", integrator=integrator, substeps=substeps, iterations=3, fps=24.0 / size**0.5)
    points, counts, indices = shapes.sheet(0.45 * size, 0.45 * size, 7, 7, horizontal=True)
    scene.cloth("/c", points @ TURN.T + size * np.array([0.03, 0.23, 0.02]), counts, indices, material=fabric("cotton"),
                self_collision=True)
    half = 0.1 * size
    scene.collider("/box", Box((half, half, half)), at=(0.0, half, 0.0))
    scene.collider("/floor", Plane())
    return scene


def caught(integrator: str) -> Scene:
    """A ball of 0.3 kg that falls into 55 g of cotton, held by its corners. Of seven starts within 5 mm none gains energy; with
    12 substeps, which leave larger residuals, one did, 0.14 J for a frame, and a warning told of it."""
    scene = Scene(solver="implicit", integrator=integrator, substeps=16, iterations=3, fps=24.0, gravity=(0.0, -9.81, 0.0))
    points, counts, indices = shapes.sheet(0.5, 0.5, 8, 8, horizontal=True)
    points = np.array(points) - np.mean(points, axis=0)
    cloth = scene.cloth("/c", points, counts, indices, material=fabric("cotton"), self_collision=True)
    scene.pin("/p", cloth, [0, 8, 72, 80])
    scene.add(Body("/ball", [Collider("/ball/shape", Sphere(0.06))], Motion.at_place((0.02, 0.15, 0.01)), mass=0.3))
    return scene


def thrown(integrator: str, substeps: int = 12) -> Scene:
    """Denim of 25 points, turned anyhow, that hits pinned cotton at 15 m/s."""
    scene = Scene(solver="implicit", integrator=integrator, substeps=substeps, iterations=3)
    points, counts, indices = shapes.sheet(0.3, 0.3, 4, 4)
    pinned = scene.cloth("/a", points, counts, indices, material=fabric("cotton"), self_collision=True)
    scene.pin("/p", pinned, [0, 4])
    turn = np.linalg.qr(np.eye(3) + 0.25 * np.random.default_rng(1).normal(size=(3, 3)))[0]
    scene.cloth("/b", points @ turn + [0.0, 0.0, 0.3], counts, indices, material=fabric("denim"), self_collision=True,
                velocities=np.tile([0.0, 0.0, -15.0], (25, 1)))
    return scene
