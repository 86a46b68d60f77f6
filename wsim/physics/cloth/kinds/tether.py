"""Long-range attachments (Kim, Chentanez, Mueller 2012): no point goes farther from the nearest pinned point than the way along
the rest edges. NumPy."""

import numpy as np

from wsim.geometry import topology
from wsim.kernels.cloth.constraint import TETHER
from wsim.model.model import PointBody
from wsim.physics.cloth.constraints import Constraints, no_compliance
from wsim.physics.cloth.kind import ClothConstraintKind


def tether_constraints(body: PointBody, pinned: np.ndarray) -> list[Constraints]:
    """pinned: places in the arrays."""
    mine = pinned[(pinned >= body.first) & (pinned < body.last)]
    if not len(mine):
        return []
    way, source = topology.geodesic_distance(body.rest, body.edges - body.first, np.unique(mine) - body.first)
    free = np.flatnonzero(np.isfinite(way) & (way > 0.0))
    ids = np.stack([source[free], free], axis=1).astype(np.int32) + body.first
    return [Constraints("tether", ids, way[free], np.zeros(len(free)), {})]


def tether_rest_gradient(shape, r: Constraints, by_rest: np.ndarray, by_shape: np.ndarray, by_value: np.ndarray | None) -> None:
    """Along the way that each goes: from the farthest point on, a point hands on what it has to the one before it."""
    body = shape.body
    edges, sources = body.edges - body.first, np.unique(r.ids[:, 0] - body.first)
    way, _ = topology.geodesic_distance(body.rest, edges, sources)
    both = np.concatenate([edges, edges[:, ::-1]])
    length = np.linalg.norm(body.rest[both[:, 0]] - body.rest[both[:, 1]], axis=1)
    last = both[np.isfinite(way[both[:, 1]]) & (way[both[:, 0]] + length == way[both[:, 1]]) & (length > 0.0)]
    before = np.full(body.count, -1)
    before[last[:, 1]] = last[:, 0]
    by = np.zeros(body.count)
    by[r.ids[:, 1] - body.first] = by_rest
    each = []
    for i in np.argsort(-np.where(np.isfinite(way), way, -1.0)):
        if before[i] >= 0 and by[i] != 0.0:
            each.append((before[i], i, by[i]))
            by[before[i]] += by[i]
    if each:
        ids = np.array([e[:2] for e in each]) + body.first
        shape.lengths(ids, np.array([e[2] for e in each]))


KIND = ClothConstraintKind(TETHER, tether_constraints, held="tethers taut", compliance=no_compliance,
                           at_rest=tether_rest_gradient)
