"""From gradients by what elements are at rest to those by where points are at rest: the chain rule of
`wsim.physics.cloth.constraints`, `wsim.physics.soft.fem` and `wsim.scene.nodal.masses`, in float64 NumPy.

    length |r|       n.dr,  n = r / |r|              area with unit normal n     1/2 (n x e_k).dr_k,  e_k the edge across from k
    rest values      `wsim.physics.cloth.kind`
    tet              by its edges from corner 0
"""

from typing import Any, cast

import numpy as np

from wsim.geometry.tetra.tets import ten_node_mesh
from wsim.model.midnodes import HRZ
from wsim.model.model import PointBody
from wsim.physics.cloth.constraints import Constraints
from wsim.physics.cloth.rest_shape import current_rest_shape
from wsim.scene import Soft
from wsim.scene.nodal.masses import soft_masses, soft_weights


class RestShape:
    """Gathers a gradient by the rest positions of a body: `by`, (points, 3), of particles. Raises SceneError where there is
    none."""

    def __init__(self, body: PointBody):
        current_rest_shape(body)
        self.body, self.by = body, np.zeros((body.count, 3))

    # what shapes are made of

    def add(self, ids: np.ndarray, values: np.ndarray) -> None:
        """values (m, k, 3) by the points ids (m, k) of the arrays."""
        np.add.at(self.by, ids - self.body.first, values)

    def lengths(self, ids: np.ndarray, by: np.ndarray) -> None:
        p = self.body.rest[ids - self.body.first]
        r = p[:, 1] - p[:, 0]
        n = r * (by / np.linalg.norm(r, axis=1))[:, None]
        self.add(ids, np.stack([-n, n], axis=1))

    def areas(self, ids: np.ndarray, by: np.ndarray) -> None:
        self.add(ids, by_area(self.body.rest[ids - self.body.first], by))

    # elements

    def rows(self, r: Constraints, by_rest: np.ndarray, by_shape: np.ndarray, by_value: np.ndarray | None = None) -> None:
        """by_rest, by_shape: of `Constraints.rest` and `Constraints.shape`; by_value: of `Coupling.value`."""
        r.row.at_rest(self, r, by_rest, by_shape, by_value)

    def tets(self, rows: np.ndarray, by_edge: np.ndarray) -> None:
        """by_edge: of edges from corner 0 (t, 3, 3)."""
        ids = self.body.tets[rows, :4]
        self.add(ids, np.concatenate([-by_edge.sum(axis=1, keepdims=True), by_edge], axis=1))

    # of the author's points

    def points(self) -> np.ndarray:
        """Gradients of particles, (n, 3) by the author's points; of a weld it is the first that says where they are at rest."""
        own, found = self.body.own - self.body.first, np.zeros((len(self.body.own), 3))
        first = np.unique(own, return_index=True)[1]
        found[first] = self.by[own[first]]
        return found


def by_area(corners: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Gradient by the corners of triangles, (t, 3, 3), from those by their areas."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    n = normal * (0.5 * by / np.linalg.norm(normal, axis=1))[:, None]
    return np.stack([np.cross(n, corners[:, (k + 2) % 3] - corners[:, (k + 1) % 3]) for k in range(3)], axis=1)


def by_volume(corners: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Gradient as `by_area` has it, of tets, (t, 4, 3)."""
    a, b, c = (corners[:, k] - corners[:, 0] for k in (1, 2, 3))
    each = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1) * (by / 6.0)[:, None, None]
    return np.concatenate([-each.sum(axis=1, keepdims=True), each], axis=1)


def by_masses(body: PointBody, by: np.ndarray, density: float | None) -> np.ndarray:
    """Gradient by the author's points at rest, (n, 3), from those by the masses of the points, then of middles (n + m,).
    density: that was set, or None."""
    source: Any = body.source
    n, rest = len(body.own), current_rest_shape(body)
    if not source.has_surface or (source.masses is not None and not len(body.middles)):
        return np.zeros((n, 3))
    if density is not None:
        by = by * (density / source.material.density)
    if source.is_sheet:
        ids = source.surface_triangles()
        thick = np.full(n, source.material.thickness) if source.thicknesses is None else source.thicknesses.astype(np.float64)
        weights, shares = thick[ids].mean(axis=1) * source.material.density, np.full(3, 1.0 / 3.0)
        each = by_area(rest[ids], np.ones(len(ids)))
        areas = np.einsum("tki,tki->t", each, rest[ids]) / 2.0                   # Euler: an area is of degree 2
    else:
        ids, weights, shares = source.tets, soft_weights(source), np.full(4, 0.25)
        each = by_volume(rest[ids], np.ones(len(ids)))
        areas = np.einsum("tki,tki->t", each, rest[ids]) / 3.0
    own = weights * areas                                                       # mass of each element
    by_own = np.zeros(len(ids))
    if len(body.middles):
        by, by_own = _by_lumped(body, by, own, rest)
        if source.masses is not None:
            return _scatter_to_points(ids, each, by_own * weights, n)
    if source.mass is not None:
        shared = np.bincount(ids.ravel(), np.outer(own, shares).ravel(), n)
        by = source.mass / shared.sum() * (by - (by * shared).sum() / shared.sum())
    return _scatter_to_points(ids, each, (by_own + (by[ids] * shares).sum(axis=1)) * weights, n)


def _scatter_to_points(ids: np.ndarray, each: np.ndarray, by: np.ndarray, n: int) -> np.ndarray:
    found = np.zeros((n, 3))
    np.add.at(found, ids, each * by[:, None, None])
    return found


def _by_lumped(body: PointBody, by: np.ndarray, own: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Adjoint of `wsim.model.midnodes.lump_node_masses`: gradients by the masses of the author's points, and by those of tets
    (t,)."""
    source, n = cast(Soft, body.source), len(body.own)
    tets, (_, ten) = source.tets, ten_node_mesh(rest, source.tets)
    masses, _ = soft_masses(source, rest)
    total = np.bincount(tets.ravel(), np.repeat(own, 4), n)
    held = total > 0.0
    total = np.where(held, total, 1.0)
    part = (by[ten] * HRZ).sum(axis=1)                                          # by the mass that a tet gets
    ratio = np.bincount(tets.ravel(), np.repeat(part * own, 4), n)              # by masses / total
    by_total = -ratio * masses / total**2
    return np.where(held, ratio / total, by[:n]), part * (masses / total)[tets].sum(axis=1) + by_total[tets].sum(axis=1)
