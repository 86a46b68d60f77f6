"""What tests/physics/contact/selfcontact/test_colliders.py shares with other tests: crossed, dropped, spike, turning."""

import numpy as np

from tests.physics.contact.selfcontact.rig import THIN, surfaces
from wsim.geometry.triangulate import triangulate_polygons
from wsim.physics.contact.selfcontact.crossings import crossed_triangles
from wsim.scene import Box, Motion, Scene, Surface, shapes

SPIKE = np.array([[0.0, 0.15, 0.0], [-0.04, 0.0, -0.03], [0.05, 0.0, -0.02], [0.01, 0.0, 0.05]], np.float32)
FACES = np.array([0, 2, 1, 0, 3, 2, 0, 1, 3, 1, 2, 3])


def spike(points=SPIKE, poses=None) -> Surface:
    """A pyramid of four triangles, its tip up."""
    return Surface(points, [3] * 4, FACES, poses)


def cube(half: float) -> Surface:
    points, counts, indices = shapes.box((half, half, half))
    return Surface(np.array(points, np.float32), counts, indices)


def dropped(collider, motion=None, *, side: int = 6, above: float = 0.2, on: bool = True, **more) -> Scene:
    """A square of 40 cm whose triangles are 8 cm wide, over a collider."""
    scene = Scene(gravity=(0.0, -9.81, 0.0), **{"fps": 24.0, "substeps": 20, "iterations": 4, "solver": "xpbd", **more})
    points, counts, indices = shapes.sheet(0.4, 0.4, side - 1, side - 1, horizontal=True)
    points = np.array(points, np.float64) - np.mean(points, axis=0) + (0.011, above, 0.007)
    scene.cloth("/cloth", points, counts, indices, material=THIN, self_collision=on)
    scene.collider("/under", collider, motion=motion or Motion.still())
    return scene


def crossed(sim) -> int:
    """Pairs of triangles of cloths and of colliders, or of cloths, that intersect at the end of the last frame."""
    points, triangles = surfaces(sim)
    points, own, time = points.astype(np.float64), len(triangles), sim.frame * sim.plan.clock.dt
    for c in (c for c in sim.scene.colliders if isinstance(c.shape, Box | Surface)):
        shape = cube(1.0) if isinstance(c.shape, Box) else c.shape
        p = shape.points if shape.poses is None else shape.poses.at(time)
        p = np.asarray(p, np.float32) * (c.shape.half if isinstance(c.shape, Box) else 1.0)
        M = c.motion.at(time)
        triangles = np.concatenate([triangles,
                                    triangulate_polygons(shape.points, shape.counts, shape.indices)[0] + len(points)])
        points = np.concatenate([points, p.astype(np.float64) @ M[:3, :3].T + M[:3, 3]])
    return len(crossed_triangles(points, triangles, own=own))


def turning(axis: int, rate: float, at=(0.0, 0.0, 0.0), tilt: float = 0.0) -> Motion:
    """Turns about an axis of the world at a rate [rad/s], from an angle, for 2 s."""
    times = np.linspace(0.0, 2.0, 49)
    M, (i, j) = np.tile(np.eye(4), (len(times), 1, 1)), ((axis + 1) % 3, (axis + 2) % 3)
    c, s = np.cos(tilt + rate * times), np.sin(tilt + rate * times)
    M[:, i, i], M[:, j, j], M[:, i, j], M[:, j, i], M[:, :3, 3] = c, c, -s, s, at
    return Motion(times, M)
