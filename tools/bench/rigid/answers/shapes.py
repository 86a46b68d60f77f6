"""Shapes and floors that cases share: round bodies with their axis along own z, prisms, floors of several kinds."""

from math import pi

import numpy as np

from tools.bench.rigid.answers.stage import Stage, framed
from wsim.scene import Box, Capsule, Cylinder, Plane, Sphere, Surface

SIDE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])      # own z to y: an axle across the way


def barrel(r: float) -> list:
    """Three cylinders, the middle one of radius r."""
    return [(Cylinder(r, 0.4 * r), np.eye(4)), (Cylinder(0.8 * r, 0.3 * r), framed((0.0, 0.0, 0.7 * r))),
            (Cylinder(0.8 * r, 0.3 * r), framed((0.0, 0.0, -0.7 * r)))]


# bodies of radius r that roll on a plane without loss
ROUND = {
    "wheel": lambda r: Cylinder(r, r / 3.0),
    "disc": lambda r: Cylinder(r, r / 30.0),
    "coin": lambda r: Cylinder(r, r / 12.0),
    "drum": lambda r: Cylinder(r, 3.0 * r),
    "barrel": barrel,
    "ball": Sphere,
    "capsule": lambda r: Capsule(r, r),
}


def prism(sides: int, r: float, half: float) -> Surface:
    """A right prism about z whose corners lie on a circle of radius r."""
    a = 2.0 * pi * np.arange(sides) / sides
    ring = np.stack([r * np.cos(a), r * np.sin(a)], axis=1)
    points = np.concatenate([np.column_stack([ring, np.full(sides, z)]) for z in (-half, half)])
    k = np.arange(sides)
    walls = np.stack([k, (k + 1) % sides, (k + 1) % sides + sides, k + sides], axis=1).reshape(-1)
    counts = np.array([4] * sides + [sides] * 2)
    return Surface(points, counts, np.concatenate([walls, k[::-1], k + sides]))


def grid(cells: int, size: float, at=(0.0, 0.0), jitter: float = 0.0, seed: int = 0) -> Surface:
    """A flat square of triangles about `at` in the plane z = 0; inner points lie off the grid by up to jitter x a cell."""
    rng, n = np.random.default_rng(seed), cells + 1
    s = (np.arange(n) / cells - 0.5) * size
    points = np.stack([np.repeat(s, n), np.tile(s, n), np.zeros(n * n)], axis=1)
    inner = (np.abs(points[:, :2]) < 0.5 * size * (1.0 - 1e-9)).all(axis=1)
    points[inner, :2] += rng.uniform(-jitter, jitter, (int(inner.sum()), 2)) * size / cells
    points[:, :2] += at
    corner = (np.arange(cells)[:, None] * n + np.arange(cells)).reshape(-1)
    quads = np.stack([corner, corner + n, corner + n + 1, corner + 1], axis=1)
    cut = np.where((rng.random(len(quads)) < 0.5)[:, None], quads[:, [0, 1, 2, 0, 2, 3]], quads[:, [0, 1, 3, 1, 2, 3]])
    return Surface(points, np.full(2 * len(quads), 3), cut.reshape(-1))


def floor(stage: Stage, kind: str, size: float, **more) -> None:
    """A floor at z = 0, `size` [m] wide: a plane, a box, a mesh of triangles."""
    if kind == "plane":
        stage.collider("/floor", Plane(), **more)
    elif kind == "box":
        stage.collider("/floor", Box((0.5 * size, 0.5 * size, 0.02 * size)), (0.0, 0.0, -0.02 * size), **more)
    else:
        stage.collider("/floor", grid(23, size, jitter=0.2), **more)
