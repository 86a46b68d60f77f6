"""Spheres, capsules, cylinders, cones and boxes as triangle meshes, for a scale or shear that the shape cannot take.

A body of revolution about z is given by its profile (radius, height) from bottom to top; its ends lie on the axis.
Points lie on the shape, so the mesh is inside a cylinder by at most r (1 - cos(pi / AROUND)), 0.5 % of the radius, and
inside a sphere by twice that.
"""

import numpy as np

AROUND = 32            # points on a circle


def revolution(profile: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(points (n, 3), counts, indices) of triangles about z, normals outward; profile (k, 2), ends on the axis."""
    inner = profile[1:-1]
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    rings = [np.stack([r * np.cos(angle), r * np.sin(angle), np.full(AROUND, z)], axis=1) for r, z in inner]
    points = np.concatenate([[[0.0, 0.0, profile[0, 1]]], *rings, [[0.0, 0.0, profile[-1, 1]]]])
    i, j = np.arange(AROUND), (np.arange(AROUND) + 1) % AROUND
    last = len(points) - 1
    faces = [np.stack([np.zeros_like(i), 1 + j, 1 + i], axis=1)]
    for ring in range(len(inner) - 1):
        a, b = 1 + ring * AROUND, 1 + (ring + 1) * AROUND
        faces += [np.stack([a + i, a + j, b + j], axis=1), np.stack([a + i, b + j, b + i], axis=1)]
    top = 1 + (len(inner) - 1) * AROUND
    faces.append(np.stack([top + i, top + j, np.full_like(i, last)], axis=1))
    triangles = np.concatenate(faces)
    return points, np.full(len(triangles), 3), triangles.ravel()


def capsule(bottom: float, top: float, half: float) -> np.ndarray:
    """Profile of two half spheres of radius `bottom` and `top` about a straight part of half height `half`; half = 0
    and equal radii: a sphere."""
    angle = np.linspace(-np.pi / 2.0, 0.0, AROUND // 4 + 1)
    low = np.stack([bottom * np.cos(angle), bottom * np.sin(angle) - half], axis=1)
    high = np.stack([top * np.cos(-angle[::-1]), top * np.sin(-angle[::-1]) + half], axis=1)
    skip = 1 if half == 0 and bottom == top else 0
    return np.concatenate([low, high[skip:]])


def cylinder(bottom: float, top: float, half: float) -> np.ndarray:
    """Profile of a cylinder (or of a cone: top = 0) from -half to half."""
    rings = [(bottom, -half)] + ([(top, half)] if top > 0 else [])
    return np.array([(0.0, -half), *rings, (0.0, half)])


def box(half) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(points (8, 3), counts, indices) of six outward quadrangles."""
    corners = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float64)
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return corners * np.asarray(half), np.full(6, 4), np.array(faces).ravel()
