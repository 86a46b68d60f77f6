"""Which points touch each other as balls: grains, clouds of points that collide, and in their company points of all bodies
without a surface that collides. Surfaces that do (`self_collision`) are met by self-contact, as triangles.

A point of a cloth or net is a ball about it, as in Macklin et al. 2014, and large enough that no grain passes between: the hole
in a triangle of circumradius c, and in the middle of an edge of 2 c, is closed by balls of c - CLOSED R for grains of radius R.
The points of a body do not touch each other so: cloth has self-contact, a fluid its pressure. NumPy only.
"""

import numpy as np

from wsim.geometry import topology
from wsim.model.model import Model, PointBody
from wsim.scene.nodal.touching import bodies_that_touch_as_balls

CLOSED = 0.2           # of a grain's radius that may stand in a hole
SAMPLED = 256          # points of a cloud whose nearest neighbours tell how far apart its points are
FLUIDS, OTHERS = 0, 1  # groups
LARGEST = 3.0          # grains' radii that the ball of a point may have: a coarser mesh has holes, and is warned of


def meeting_bodies(model: Model) -> list[PointBody]:
    """Bodies whose points touch as balls: none where there are no balls, or a fluid alone."""
    paths = {source.path for source in bodies_that_touch_as_balls(model.scene)}
    return [body for body in model.bodies if body.path in paths]


def ball_radii(bodies: list[PointBody]) -> tuple[list[np.ndarray], list[str]]:
    """Radius of each point of the bodies [m], and paths of those whose meshes are too coarse to stop the smallest particle."""
    least = min(float(body.reach.min()) for body in bodies if body.source.meets_as_balls)
    radii, coarse = [], []
    for body in bodies:
        reach = body.reach.astype(np.float64)
        if not body.source.meets_as_balls:
            wanted = np.maximum(reach, _hole_radii(body) - CLOSED * least)
            reach = np.minimum(wanted, max(LARGEST * least, float(reach.max(initial=0.0))))
            coarse += [body.path] * bool(np.any(reach < wanted) and body.world == 0)
        radii.append(np.maximum(reach, 1e-3 * least))
    return radii, coarse


def ball_groups(bodies: list[PointBody]) -> list[int]:
    """Group of each body, whose points do not touch each other: of all fluids, of all that are no balls by themselves, of each
    cloud of points; -1: grains."""
    return [-1 if body.source.collides_as_grains else FLUIDS if body.source.is_fluid else
            OTHERS + 1 + body.number if body.source.meets_as_balls else OTHERS for body in bodies]


def _hole_radii(body: PointBody) -> np.ndarray:
    """Radius of the largest hole at each point of a mesh at rest [m], (points,); of a cloud of points, of a square of them."""
    found, rest = np.zeros(body.count), body.rest.astype(np.float64)
    edges = body.edges - body.first
    if len(body.triangles):
        triangles = body.triangles - body.first
        a, b, c = (rest[triangles[:, k]] for k in range(3))
        sides = [np.linalg.norm(x - y, axis=1) for x, y in ((b, c), (c, a), (a, b))]
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        hole = np.minimum(sides[0] * sides[1] * sides[2] / np.maximum(4.0 * area, 1e-30), np.max(sides, axis=0))
        np.maximum.at(found, triangles, hole[:, None])
    elif len(edges):
        np.maximum.at(found, edges, 0.5 * np.linalg.norm(rest[edges[:, 1]] - rest[edges[:, 0]], axis=1)[:, None])
    elif len(rest) > 1:
        some = rest[np.random.default_rng(0).permutation(len(rest))[:SAMPLED]]
        apart = np.linalg.norm(some[:, None] - rest[None], axis=-1)
        found[:] = np.median(np.partition(apart, 1, axis=1)[:, 1]) / np.sqrt(2.0)
    return found


def rigid_pieces(bodies: list[PointBody]) -> tuple[np.ndarray, np.ndarray]:
    """Number of the rigid cluster of each point of the bodies, -1: none, (points,); and the inverse mass [1/kg] that it shows
    there along any direction, at most: 1 / M + |r|^2 / I_least, with r from its centre. Clusters that share points are one."""
    pieces, wholes, found = [], [], 0
    for body in bodies:
        piece, whole = np.full(body.count, -1, np.int32), np.zeros(body.count)
        if body.source.is_rigid_cluster:
            label = np.empty(body.count, np.int64)
            label[body.index - body.first] = topology.labels_of_islands(body.count, body.source.held_points()[0])
            for own in (np.flatnonzero(label == each) for each in np.unique(label)):
                m, r = body.masses[own].astype(np.float64), body.rest[own].astype(np.float64)
                r = r - m @ r / m.sum()
                inertia = np.eye(3) * (m @ (r**2).sum(axis=1)) - (m[:, None] * r).T @ r
                piece[own] = found
                whole[own] = 1.0 / m.sum() + (r**2).sum(axis=1) / max(np.linalg.eigvalsh(inertia)[0], 1e-30)
                found += 1
        pieces.append(piece)
        wholes.append(whole)
    return np.concatenate(pieces), np.concatenate(wholes)
