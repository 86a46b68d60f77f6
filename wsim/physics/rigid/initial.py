"""Rigid bodies that start within something: deeper than a part of their size, unless they are filtered from it or joined to it.

A depth is that of the deepest sampled point of one surface below the other, or the lesser depth of a point inside both. So it
is never overstated. Shapes are those that contacts use (`wsim.physics.rigid.solids`), whose signed distances are exact inside.
NumPy only.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from wsim.physics.rigid.joints.filters.groups import collision_filters
from wsim.physics.rigid.solids import ContactShape, collider_parts, contact_shape_of
from wsim.scene import Collider, Plane, Problem, Scene, Sphere, Surface
from wsim.scene.check import signed_distance
from wsim.scene.check.objects import object_warning
from wsim.scene.curve import Motion
from wsim.scene.solids import shape_row

DEEP = 0.05              # of the largest extent of a body
SIDES = 16               # on a circle of a round shape that is sampled
FINE = 4                 # parts of an edge of a triangle that is sampled, where a shape has few
FEW = 64                 # triangles
STEP = 256               # shapes whose bounds are compared with all others at once


@dataclass
class PlacedSolid:
    """A shape that is met: of which body (-1: none), its frame to world M, points of its surface and their bounds [m]."""

    path: str
    body: int
    met: ContactShape
    M: np.ndarray
    points: np.ndarray

    def __post_init__(self):
        endless = isinstance(self.met.shape, Plane)
        self.low = np.full(3, -np.inf) if endless else self.points.min(axis=0)
        self.high = np.full(3, np.inf) if endless else self.points.max(axis=0)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance [m] of places in the world, (n,)."""
        q = (points - self.M[:3, 3]) @ self.M[:3, :3]
        if self.met.hull is not None:
            return (q @ self.met.hull.normals.T - self.met.hull.offsets).max(axis=1)
        if self.met.shape is not None:
            return shape_row(self.met.shape).distance(self.met.shape, q - np.array(self.met.center))
        mesh: Any = self.met.mesh
        shape = Surface(mesh[0] + np.array(self.met.center), np.full(len(mesh[1]), 3), mesh[1].ravel())
        return signed_distance.collider_signed_distance(Collider(self.path, shape, Motion.still(self.M)), points, 0.0)


def check(scene: Scene) -> Iterator[Problem]:
    """A warning of the body that starts deepest, which counts the others."""
    bodies, solids = scene.things("Body"), list(_placed_solids(scene))
    sizes = _body_extents(solids, len(bodies))
    met = collision_filters(scene, [(s.path, 0 if s.body >= 0 else -1) for s in solids],
                            [bodies[s.body].path if s.body >= 0 else ""
                                                                               for s in solids])
    deepest: dict[int, tuple[float, int, str]] = {}
    for i, j in _overlapping_pairs(solids, sizes):
        if met is not None and (met.table[met.kind[i], met.kind[j]] or j in met.parted[met.first[i]:met.first[i + 1]]):
            continue
        depth = _overlap_depth(solids[i], solids[j])
        for one, other in ((solids[i], solids[j]), (solids[j], solids[i])):
            if one.body >= 0 and depth > DEEP * sizes[one.body] and depth > deepest.get(one.body, (0.0,))[0]:
                deepest[one.body] = depth, one.body, bodies[other.body].path if other.body >= 0 else other.path
                break                                             # said of one of the two
    for depth, body, name in sorted(deepest.values(), key=lambda each: -each[0])[:1]:
        more = f" (and {len(deepest) - 1} other bodies in something)" if len(deepest) > 1 else ""
        yield object_warning(bodies[body].path,
                             f"starts {depth:.3g} m deep in {name}, {100.0 * depth / sizes[body]:.0f} % of its "
                             f"size{more}: contacts push it out at once", f"up to {100.0 * DEEP:g} %",
                             "move them apart, filter the " "pair (PhysicsFilteredPairsAPI) or join the two", overlap=True)


def _placed_solids(scene: Scene) -> Iterator[PlacedSolid]:
    known: dict[tuple, np.ndarray] = {}
    for k, body in enumerate(scene.things("Body")):
        for c in collider_parts(body.colliders):
            if (met := contact_shape_of(c, True)) is not None:
                M = body.motion.at(0.0) @ c.motion.at(0.0)
                yield PlacedSolid(c.path, k, met, M, _sample_shape_surface(met, known) @ M[:3, :3].T + M[:3, 3])
    for c in collider_parts(scene.colliders):
        if (met := contact_shape_of(c, False)) is not None:
            M = c.motion.at(0.0)
            yield PlacedSolid(c.path, -1, met, M, _sample_shape_surface(met, known) @ M[:3, :3].T + M[:3, 3])


def _sample_shape_surface(met: ContactShape, known: dict[tuple, np.ndarray]) -> np.ndarray:
    """Places on the surface of a shape, in the frame of its collider, (n, 3). known: of simple shapes, by their lengths."""
    if isinstance(met.shape, Plane):
        return np.zeros((1, 3))
    if met.shape is None:
        mesh: Any = met.mesh if met.hull is None else (met.hull.vertices, met.hull.triangles)
        return _sample_triangles(*mesh) + np.array(met.center)
    own = shape_row(met.shape)
    key = (own.kind, *own.lengths(met.shape))
    if key not in known:
        known[key] = np.unique(_sample_triangles(*own.outline(own.given(met.shape), SIDES)), axis=0)
    return known[key] + np.array(met.center)


def _sample_triangles(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Corners of triangles and places between them."""
    if len(triangles) > FEW:
        return np.concatenate([points, points[triangles].mean(axis=1)])
    u = np.array([(a, b, FINE - a - b) for a in range(FINE + 1) for b in range(FINE + 1 - a)]) / FINE
    return np.einsum("ki,tij->tkj", u, points[triangles]).reshape(-1, 3)


def _body_extents(solids: list[PlacedSolid], bodies: int) -> np.ndarray:
    """Largest extent of each body [m]."""
    low, high = np.full((bodies, 3), np.inf), np.full((bodies, 3), -np.inf)
    for s in solids:
        if s.body >= 0:
            low[s.body], high[s.body] = np.minimum(low[s.body], s.low), np.maximum(high[s.body], s.high)
    return np.maximum(high - low, 0.0).max(axis=1, initial=0.0)


def _overlapping_pairs(solids: list[PlacedSolid], sizes: np.ndarray) -> Iterator[tuple[int, int]]:
    """Pairs whose bounds lie in each other as deep as a warning needs, or as one of them is thick."""
    low, high = np.array([s.low for s in solids]).reshape(-1, 3), np.array([s.high for s in solids]).reshape(-1, 3)
    body = np.array([s.body for s in solids], int)
    need = np.where(body >= 0, DEEP * sizes[body] if len(sizes) else 0.0, np.inf)
    thick = (high - low).min(axis=1, initial=np.inf)
    for first in range(0, len(solids), STEP):
        some = np.arange(first, min(first + STEP, len(solids)))
        inside = (np.minimum(high[some, None], high) - np.maximum(low[some, None], low)).min(axis=2)
        wanted = np.minimum(np.minimum(need[some, None], need), np.minimum(thick[some, None], thick))
        found = (inside >= wanted) & (body[some, None] != body) & (some[:, None] < np.arange(len(solids)))
        yield from ((int(some[i]), int(j)) for i, j in zip(*np.nonzero(found), strict=True))


def _overlap_depth(one: PlacedSolid, other: PlacedSolid) -> float:
    """Depth of the deepest place of one surface in the other [m]."""
    found = 0.0
    for a, b in ((one, other), (other, one)):
        if isinstance(a.met.shape, Plane):
            continue
        points = a.points[((a.points > b.low) & (a.points < b.high)).all(axis=1)]
        if isinstance(a.met.shape, Sphere):                        # what of a ball is deepest lies towards the other
            middle = a.M[:3, 3] + a.M[:3, :3] @ np.array(a.met.center)
            way = b.M[:3, 3] - middle
            points = np.vstack([points, middle + way * (a.met.shape.radius / max(float(np.linalg.norm(way)), 1e-30))])
        if len(points):
            found = max(found, -float(b.distance(points).min()))
    middle = 0.5 * (np.maximum(one.low, other.low) + np.minimum(one.high, other.high))[None]
    if np.isfinite(middle).all():                                   # equal shapes in one place, or crossed plates
        found = max(found, min(-float(one.distance(middle)[0]), -float(other.distance(middle)[0])))
    return found
