"""Triangles for shapes that have a formula: what a picture or a viewer draws of them, and what a collider becomes whose
scale its shape cannot take. NumPy only.

Each function returns (points (n, 3) float64, triangles (t, 3) int32), counter-clockwise seen from outside, closed where
the solid is: no point twice, a pole is one point. The axis of round solids is z; `turn_to_axis` turns it to x or y. Points lie
on the solid, so the triangles lie inside a cylinder by at most r (1 - cos(pi / sides)), inside a ball by twice that.
"""

import numpy as np

Outline = tuple[np.ndarray, np.ndarray]
_OCTAHEDRON = (np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float),
               np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]))


def surface_of_revolution(profile, sides: int = 64) -> Outline:
    """Surface of revolution about z. profile: (r, z) from the lower to the upper end, shape (m, 2); of rows that are
    equal the first counts. Points by row, from below; triangles likewise."""
    profile = np.asarray(profile, float)
    r, z = profile[np.r_[True, (profile[1:] != profile[:-1]).any(axis=1)]].T
    phi = 2.0 * np.pi * np.arange(sides) / sides
    points = np.stack([np.outer(r, np.cos(phi)), np.outer(r, np.sin(phi)), np.tile(z[:, None], sides)], axis=-1)
    real = (r[:, None] > 0) | (np.arange(sides) == 0)                 # a pole is the first point of its row
    number = np.cumsum(real).reshape(real.shape) - 1
    number = np.where(r[:, None] > 0, number, number[:, :1])
    a, b = number, np.roll(number, -1, axis=1)
    lower, upper = np.stack([a[:-1], b[:-1], b[1:]], axis=-1), np.stack([a[:-1], b[1:], a[1:]], axis=-1)
    both = np.stack([lower, upper], axis=1)                           # by row; at a pole one of the two has no area
    return points[real], both[np.stack([r[:-1] > 0, r[1:] > 0], axis=1)].reshape(-1, 3).astype(np.int32)


def _circle_arc(radius: float, center: float, start: float, end: float, steps: int) -> np.ndarray:
    """Points (r, z) of a circle about (0, center) between two latitudes [rad]; the poles are exact."""
    angle = np.linspace(start, end, steps + 1)
    r = np.where(np.isclose(np.abs(angle), 0.5 * np.pi), 0.0, np.cos(angle))
    return np.stack([radius * r, center + radius * np.sin(angle)], axis=1)


def sphere_outline(radius: float, sides: int = 64) -> Outline:
    return surface_of_revolution(_circle_arc(radius, 0.0, -0.5 * np.pi, 0.5 * np.pi, max(sides // 2, 2)), sides)


def capsule_outline(bottom: float, top: float, half_height: float, sides: int = 64) -> Outline:
    """Two half balls of those radii and the cone between them; half_height of the straight part."""
    return surface_of_revolution(np.concatenate([_circle_arc(bottom, -half_height, -0.5 * np.pi, 0.0, max(sides // 4, 1)),
                                                 _circle_arc(top, half_height, 0.0, 0.5 * np.pi, max(sides // 4, 1))]), sides)


def cylinder_outline(bottom: float, top: float, half_height: float, sides: int = 64) -> Outline:
    """Closed; a radius of 0 gives a cone."""
    return surface_of_revolution([(0.0, -half_height), (bottom, -half_height), (top, half_height), (0.0, half_height)], sides)


def box_outline(half) -> Outline:
    """half: half edges, shape (3,)."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) * np.asarray(half, float)
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return corners, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)


def plate_outline(half_x: float, half_y: float) -> Outline:
    """Rectangle at z = 0, facing up."""
    points = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float) * (half_x, half_y, 1.0)
    return points, np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def turn_to_axis(axis: str, points: np.ndarray) -> np.ndarray:
    """Turns shapes made along z to "X", "Y" or "Z", by a cyclic exchange of coordinates (a rotation)."""
    return points[:, {"X": (2, 0, 1), "Y": (1, 2, 0), "Z": (0, 1, 2)}[axis]]


def bead_outlines(points: np.ndarray, radii) -> Outline:
    """A small ball (an octahedron, shaded round) at each point; radii (n,) or one for all."""
    ball, faces = _OCTAHEDRON
    radii = np.broadcast_to(np.asarray(radii, float), (len(points),))
    places = points[:, None, :] + radii[:, None, None] * ball
    return places.reshape(-1, 3), (faces + 6 * np.arange(len(points))[:, None, None]).reshape(-1, 3).astype(np.int32)


def rod_outlines(points: np.ndarray, segments: np.ndarray, radii, sides: int = 6) -> Outline:
    """A prism along each segment (m, 2) of points (n, 3); radii (n,) or one. Segments of no length stay flat."""
    radii = np.broadcast_to(np.asarray(radii, float), (len(points),))
    ends = points[segments]                                                  # (m, 2, 3)
    t = ends[:, 1] - ends[:, 0]
    helper = np.eye(3)[np.argmin(np.abs(t), axis=1)]
    u = np.cross(t, helper)
    u /= np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-30)
    v = np.cross(t, u)
    v /= np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-30)
    phi = np.arange(sides) * (2.0 * np.pi / sides)
    ring = np.cos(phi)[:, None] * u[:, None, :] + np.sin(phi)[:, None] * v[:, None, :]       # (m, sides, 3)
    places = ends[:, :, None, :] + radii[segments][:, :, None, None] * ring[:, None, :, :]   # (m, 2, sides, 3)
    k = np.arange(sides)
    a, b = k, (k + 1) % sides
    faces = np.concatenate([np.stack([a, b, b + sides], 1), np.stack([a, b + sides, a + sides], 1)])
    base = 2 * sides * np.arange(len(segments))
    return places.reshape(-1, 3), (faces + base[:, None, None]).reshape(-1, 3).astype(np.int32)
