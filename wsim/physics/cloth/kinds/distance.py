"""Springs: those of a net, and along the edges of a cloth of the model "springs". NumPy.

Springs along the edges of a cloth carry k = stretch * A / l^2, A the area of the triangles at the edge (Van Gelder 1998,
Approximate simulation of elastic membranes by triangulated spring meshes); the two diagonals of an authored quad of area A,
each strained by half the shear angle, carry 2 shear A / l^2 instead.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from wsim.geometry import topology
from wsim.kernels.cloth.constraint import DISTANCE
from wsim.model.model import PointBody
from wsim.physics.cloth.constraints import Constraints, rest_distances
from wsim.physics.cloth.kind import SPRINGS, ClothConstraintKind

if TYPE_CHECKING:
    from wsim.scene import Cloth, Springs


def spring_constraints(body: PointBody, pinned: np.ndarray) -> list[Constraints]:
    source = body.source
    if source.is_net:
        return _net_springs(body, cast("Springs", source))
    return _cloth_edge_springs(body, cast("Cloth", source))


def _net_springs(body: PointBody, net: "Springs") -> list[Constraints]:
    rest = rest_distances(body, body.edges) if net.lengths is None else net.lengths.astype(np.float64)
    return [Constraints("distance", body.edges, rest, np.ones(len(rest)),
                        {"stiffness": net.stiffness.astype(np.float64)}, net.damping)]


def _cloth_edge_springs(body: PointBody, cloth: "Cloth") -> list[Constraints]:
    fabric, found = cloth.material, []
    for net in cloth_spring_groups(body, topology.hinges_of_triangles(body.triangles)):
        stiffness = getattr(fabric, net.parameter)
        if net.parameter == "stretch" or stiffness > 0.0:
            good = net.good(body)
            ids, area = net.ids[good], net.areas(body)[good]
            length, k = rest_distances(body, ids), np.array([stiffness])
            if cloth.stretches is not None:
                from wsim.physics.cloth.painted import of_springs
                k = stiffness * of_springs(body, cloth, net.triangles, net.owner, len(good))[good]
            found.append(Constraints("distance", ids, length, length**2 / area, {net.parameter: k}, fabric.damping))
    return found


@dataclass
class SpringGroup:
    """Springs of a cloth that share a stiffness. Each stands for `times` the area of some triangles."""

    parameter: str
    ids: np.ndarray               # (m, 2)
    triangles: np.ndarray         # (a, 3)
    owner: np.ndarray             # spring of each triangle, (a,)
    times: float

    def areas(self, body: PointBody) -> np.ndarray:
        """(m,) [m^2]."""
        each = topology.triangle_areas(body.rest, self.triangles - body.first)
        return self.times * np.bincount(self.owner, each, len(self.ids))

    def good(self, body: PointBody) -> np.ndarray:
        """Springs of some length and area, (m,)."""
        return (rest_distances(body, self.ids) > 0.0) & (self.areas(body) > 0.0)


def cloth_spring_groups(body: PointBody, hinges: np.ndarray) -> list[SpringGroup]:
    """Springs along authored edges (stretch) and across authored quads, both diagonals (shear)."""
    t, n, edges = body.triangles.astype(np.int64), body.last + 1, body.edges
    inner = hinges[_same_polygon(body, hinges)]
    own = edges.min(1).astype(np.int64) * n + edges.max(1)
    across = np.isin(own, inner[:, :2].min(1).astype(np.int64) * n + inner[:, :2].max(1))
    ends = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    order = np.argsort(own)
    row = order[np.searchsorted(own[order], ends.min(1) * n + ends.max(1))]
    kept = ~across[row]
    found = [SpringGroup("stretch", edges[~across], np.tile(body.triangles, (3, 1))[kept], (np.cumsum(~across) - 1)[row[kept]],
                         1.0)]
    if len(inner):
        diagonals = np.concatenate([inner[:, :2], inner[:, 2:]]).astype(np.int32)
        halves = np.concatenate([inner[:, [0, 1, 2]], inner[:, [1, 0, 3]]])
        owner = np.arange(len(inner))
        owner = np.concatenate([owner, owner, owner + len(inner), owner + len(inner)])
        found.append(SpringGroup("shear", diagonals, np.tile(halves, (2, 1)), owner, 2.0))
    return found


def _same_polygon(body: PointBody, hinges: np.ndarray) -> np.ndarray:
    """Whether both triangles of a hinge were cut from one authored quad."""
    left, right = body.polygon[topology.triangles_beside_hinges(body.triangles, hinges)]
    return (left == right) & (np.bincount(body.polygon, minlength=1)[left] == 2)


def spring_slopes(r: Constraints, body: PointBody) -> np.ndarray:
    """Zero-length springs count in every direction: three rows."""
    p = body.rest[r.ids - body.first]
    d = p[:, 1] - p[:, 0]
    length = np.linalg.norm(d, axis=1, keepdims=True)
    n = d / np.where(length > 0.0, length, 1.0)
    G = np.zeros((len(p), 3, 2, 3))
    G[:, 0, 0], G[:, 0, 1] = -n, n
    loose = (length[:, 0] == 0.0) | (r.rest <= 0.0)
    G[loose, :, 0], G[loose, :, 1] = -np.eye(3), np.eye(3)
    return G


def spring_rest_gradient(shape, r: Constraints, by_rest: np.ndarray, by_shape: np.ndarray, by_value: np.ndarray | None) -> None:
    """Rest values and shapes of a cloth, whose shapes are l^2 / A, too; a net may have lengths of its own."""
    body, source = shape.body, shape.body.source
    if source.is_sheet:
        shape.lengths(r.ids, by_rest)
        net = next(n for n in cloth_spring_groups(body, topology.hinges_of_triangles(body.triangles))
                   if n.parameter in r.stiffness)
        good = net.good(body)
        place, used = np.cumsum(good) - 1, good[net.owner]
        _length_area_gradient(shape, r, net.triangles[used], place[net.owner[used]], net.times, by_shape)
    elif source.lengths is None:
        shape.lengths(r.ids, by_rest)


def _length_area_gradient(shape, r: Constraints, triangles: np.ndarray, owner: np.ndarray, times: float,
                          by: np.ndarray) -> None:
    """by: of l^2 / A, l the length between the first two points and A `times` the areas of the triangles of each."""
    p = shape.body.rest[r.ids[:, :2] - shape.body.first]
    square = ((p[:, 1] - p[:, 0])**2).sum(axis=1)
    shape.lengths(r.ids[:, :2], by * 2.0 * r.shape / np.sqrt(square))
    shape.areas(triangles, (-times * by * r.shape**2 / square)[owner])


KIND = ClothConstraintKind(DISTANCE, spring_constraints, SPRINGS, 1.0, slopes=spring_slopes, at_rest=spring_rest_gradient)
