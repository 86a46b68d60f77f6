"""The distance that keeps a collider from standing out through cloth between its points. NumPy only.

Points of a triangle that lie at distance g from a ball of radius R leave its chord in the ball, unless

    g = sqrt(R'^2 + c^2) - R',   R' = max(R, 2 c)         c^2 / (2 R) for small c: h^2 / (8 R) of an edge h

with c the radius of the least circle about the triangle (half the edge of a spring), STRAINED over its rest shape. What bends
more sharply than R = 2 c, the mesh cannot follow: there g stays 0.24 c. R is the least radius of curvature of the collider:

    sphere, capsule, cylinder R        cone: that of the flank at half its height        plane, box: none, g = 0
    mesh: distance of face centres across an edge / dihedral angle there, least of all edges below CREASE that bend outward
          (open: either way); 2/3 of what it stands for where quads are cut into triangles, on the safe side

Sharp edges (of a box, a rim, a crease) have no g that hides them and lets cloth lie on the faces beside them: `penetration`
tells how far they stand out.
"""

from math import inf, isinf, sqrt

import numpy as np

from wsim.geometry import topology
from wsim.geometry.triangulate import triangulate_polygons
from wsim.scene import Collider, Deformable, Surface
from wsim.scene.solids import shape_row

STRAINED = 1.1         # edges of a sheet that drapes over a ball are up to so much longer, by its shear
CREASE = np.deg2rad(50.0)
SIDES = 16             # on a circle of a round shape whose girth is asked
MOST = 0.95            # of the triangles are hidden: a few large ones do not lift a fine sheet


def enclosing_circle_radii(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Radius [m] of the least circle about each triangle (t, 3) of points (n, 3); (i, j, j) is a segment."""
    p = points[faces].astype(np.float64)
    a, b, c = np.sort(np.linalg.norm(p - np.roll(p, -1, axis=1), axis=2), axis=1).T
    area = 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    acute = a * a + b * b > c * c
    return np.where(acute, np.divide(a * b * c, 4.0 * area, out=0.5 * c, where=acute & (area > 0.0)), 0.5 * c)


def triangle_breadth(points: np.ndarray, faces: np.ndarray) -> float:
    """c [m] of a body: that of all but its largest triangles; 0 without any."""
    return STRAINED * float(np.quantile(enclosing_circle_radii(points, faces), MOST, method="higher")) if len(faces) else 0.0


def least_curvature_radius(collider: Collider) -> float:
    """The least radius of curvature [m] of what bends outward and is no edge; inf where all is flat."""
    shape = collider.shape
    return _mesh_curvature_radius(shape) if isinstance(shape, Surface) else shape_row(shape).curvature(shape)


def least_hole_radius(collider: Collider) -> float:
    """Least radius [m] of a round hole that a collider fits through along one of its principal axes; inf for a plane."""
    shape = collider.shape
    if isinstance(shape, Surface):
        points = shape.points.astype(np.float64)
    elif isinf(shape_row(shape).ball(shape)):
        return inf
    else:
        points = shape_row(shape).outline(shape_row(shape).given(shape), SIDES)[0]
    if not len(points):
        return inf
    centred = points - points.mean(axis=0)
    own = centred @ np.linalg.svd(centred, full_matrices=False)[2].T
    own -= 0.5 * (own.min(axis=0) + own.max(axis=0))
    return min(float(np.linalg.norm(np.delete(own, k, axis=1), axis=1).max()) for k in range(own.shape[1]))


def _mesh_curvature_radius(surface: Surface) -> float:
    """Of a mesh, whose faces are the author's polygons."""
    points = surface.points.astype(np.float64)
    triangles, polygon = triangulate_polygons(surface.points, surface.counts, surface.indices)
    if not len(triangles):
        return inf
    p, count = points[triangles], int(polygon.max()) + 1
    cross = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    size = np.linalg.norm(cross, axis=1)

    def sum_by_polygon(values: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(polygon, values[:, k], count) for k in range(3)], axis=1)
    centre = sum_by_polygon(size[:, None] * p.mean(axis=1)) / np.maximum(np.bincount(polygon, size, count), 1e-300)[:, None]
    particle = topology.weld_points(points, 1e-6 * float(np.ptp(points, axis=0).max(initial=0.0)))[triangles].astype(np.int64)
    start, end, face = particle.ravel(), np.roll(particle, -1, axis=1).ravel(), np.repeat(polygon, 3)
    key = np.minimum(start, end) * (len(points) + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    both = np.flatnonzero(key[order[1:]] == key[order[:-1]])
    rims = np.bincount(np.unique(key, return_inverse=True)[1]) == 1
    volume = 0.0 if rims.any() else float((p[:, 0] * cross).sum())           # closed meshes may be wound inward
    along = (np.roll(p, -1, axis=1) - p).reshape(-1, 3)[order[both]]
    return _least_bend_radius(sum_by_polygon(cross), centre, (face[order[both]], face[order[both + 1]], along), volume)


def _least_bend_radius(normal: np.ndarray, centre: np.ndarray, pairs: tuple, outward: float) -> float:
    """Over pairs of faces, (one, other, the edge between them). outward: > 0 where normals are, < 0 where they point inward; 0:
    both sides count."""
    one, other, edge = pairs
    m, n = normal[one], normal[other]
    angle = np.arctan2(np.linalg.norm(np.cross(m, n), axis=1), (m * n).sum(axis=1))
    away = centre[other] - centre[one]
    away -= ((away * edge).sum(axis=1) / np.maximum((edge * edge).sum(axis=1), 1e-300))[:, None] * edge
    counts = (one != other) & (angle > 1e-6) & (angle < CREASE)
    if outward != 0.0:
        counts &= np.sign(outward) * (away * m).sum(axis=1) < 0.0
    return float((np.linalg.norm(away, axis=1)[counts] / angle[counts]).min(initial=inf))


def chord_sagitta(c: float, R: float) -> float:
    """g [m], see above."""
    R = max(R, 2.0 * c)
    return 0.0 if c == 0.0 or isinf(R) else c * c / (sqrt(R * R + c * c) + R)


def body_breadth(body: Deformable) -> float:
    """c [m] of a body of a scene, from its rest shape in the world."""
    return triangle_breadth(body.rest_places(), body_faces(body)[1])


def body_faces(body: Deformable) -> tuple[np.ndarray, np.ndarray]:
    """Points of a body of a scene where it starts, (n, 3) [m, world], and triangles of its surface, (t, 3); (i, j, j) is a
    spring."""
    points = body.motion.points(body.points, 0.0)
    return points, body.surface_triangles() if body.has_surface else body.held_points()[0][:, [0, 1, 1]]
