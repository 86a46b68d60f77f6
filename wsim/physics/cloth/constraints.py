"""Which constraints a cloth or a spring net is made of, and how stiff each is. NumPy only.

Springs along the edges of a cloth carry k = stretch * A / l^2, A the area of the triangles at the edge (Van Gelder 1998,
Approximate simulation of elastic membranes by triangulated spring meshes); the two diagonals of an authored quad of area A,
each strained by half the shear angle, carry 2 shear A / l^2 instead. Sheets store 1/2 bend |S|^2 per area, S the curvature that
the angles of hinges make of each triangle, the same on every fine mesh (cloth/bending.py). A hinge alone is at least as stiff.
"""

from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

import numpy as np

from wsim.geometry import topology
from wsim.geometry.sheet_ordering import color
from wsim.model.model import Body, Model, hard_places
from wsim.scene import Cloth, Problem, SceneError, Soft, Springs

HARD = ("tether", "limit")           # kinds without compliance and multiplier
LOOKS = "looks, not accuracy: where they act the result is not that of the authored material"
AT_REST = ("rest_shape", "lengths")  # live values of bodies, see `wsim.physics.cloth.rest_shape`
SLACK = 1e-20                        # bend [N m] that is none, whose root still has a derivative
LEAST = 1e-6                         # shear over stretch that a membrane has at least: without shear it still has a direction


@dataclass
class Constraints:
    """Constraints of one kind on one body. Compliance is shape / stiffness, so a live stiffness needs no rebuilding."""

    kind: str                     # row of the table of constraints
    ids: np.ndarray               # places in the arrays, (m, k)
    rest: np.ndarray              # length [m], angle [rad] (m,), or inverse edge matrix [1/m] (m, 2, 2)
    shape: np.ndarray             # compliance at stiffness 1, (m,)
    stiffness: dict               # by name in the scene, each (m,) or (1,): one for a spring; stretch, shear, weft, poisson
                                  # (membrane); strain_limit of a limit, which makes its rest of the length of its edge
    tau: float = 0.0              # relaxation time [s]
    body: Body | None = None
    coupling: Any = None          # `wsim.physics.cloth.bending.Coupling` of hinges
    colors: np.ndarray | None = None

    @property
    def alpha(self) -> np.ndarray:
        """Compliances, (m,), or (m, 4) of a membrane: (uu, uv, shear, vv) of plane stress."""
        if self.kind == "membrane":
            stretch, weft = self.threads()
            shear, nu = np.maximum(self.stiffness["shear"], LEAST * stretch), self.stiffness["poisson"]
            one = np.stack(np.broadcast_arrays(1.0 / stretch, -nu / np.sqrt(stretch * weft), 1.0 / shear, 1.0 / weft), axis=-1)
            return self.shape[:, None] * one
        if self.kind in HARD:
            return self.shape
        if self.kind == "dihedral":
            return self.shape / np.maximum(self.stiffness["bend"], SLACK)
        with np.errstate(divide="ignore"):               # of what was slackened live
            return self.shape / next(iter(self.stiffness.values()))

    def threads(self) -> tuple[np.ndarray, np.ndarray]:
        """Stiffness of a membrane along warp and weft [N/m]; a weft of 0 is as the warp."""
        stretch, weft = self.stiffness["stretch"], self.stiffness["weft"]
        return stretch, np.where(weft > 0.0, weft, stretch)

    def moved(self, body: Body) -> "Constraints":
        """The same constraints on a copy of the body in another world."""
        assert self.body is not None
        return replace(self, ids=self.ids + (body.first - self.body.first), body=body)


def rows_of(body: Body, pinned: np.ndarray | None = None) -> list[Constraints]:
    """Every constraint of a body, without colours; pinned: places in the arrays of hard-pinned points, of any body."""
    source, pinned = body.source, np.zeros(0, np.int64) if pinned is None else pinned
    if isinstance(source, Soft):
        return []                    # its tets: `wsim.physics.cloth.table`
    made = [*(_net(body, source) if isinstance(source, Springs) else _cloth(body, source, pinned)),
            *tethers(body, pinned[(pinned >= body.first) & (pinned < body.last)])]
    for r in made:
        r.body = body
    return [r for r in made if len(r.ids)]


def in_worlds(model: Model, rows: dict[str, list[Constraints]]) -> list[Constraints]:
    """The rows of the bodies of world 0, by path, for the bodies of every world."""
    return [r if b.world == 0 else r.moved(b) for b in model.bodies for r in rows[b.path]]


def colored(rows: list[Constraints]) -> list[Constraints]:
    """The rows of one body with colours; those of a kind are launched together and coloured jointly."""
    for kind in {r.kind for r in rows if r.colors is None}:
        same = [r for r in rows if r.kind == kind]
        assert same[0].body is not None
        colors = color(np.concatenate([r.ids for r in same]) - same[0].body.first, same[0].body.count)
        ends = np.cumsum([len(r.ids) for r in same])
        for r, part in zip(same, np.split(colors, ends[:-1]), strict=True):
            r.colors = part
    return rows


def _lengths(body: Body, ids: np.ndarray) -> np.ndarray:
    p = body.rest[ids - body.first]
    return np.linalg.norm(p[:, 1] - p[:, 0], axis=1)


def _net(body: Body, net: Springs) -> list[Constraints]:
    rest = _lengths(body, body.edges) if net.lengths is None else net.lengths.astype(np.float64)
    return [Constraints("distance", body.edges, rest, np.ones(len(rest)), {"stiffness": net.stiffness.astype(np.float64)},
                 net.damping)]


def _cloth(body: Body, cloth: Cloth, pinned: np.ndarray) -> list[Constraints]:
    fabric = cloth.material
    hinges = topology.hinges(body.triangles)
    rows = _membrane(body, cloth) if cloth.model == "membrane" else _edges(body, cloth, hinges)
    if fabric.bend > 0.0 and len(hinges):
        rows.append(_hinges(body, cloth, hinges, pinned))
    if isfinite(fabric.strain_limit):
        limit = {"strain_limit": np.array([fabric.strain_limit])}
        rows.append(Constraints("limit", body.edges, longest(body, body.edges, limit), np.zeros(len(body.edges)), limit))
    return rows


def longest(body: Body, ids: np.ndarray, stiffness: dict) -> np.ndarray:
    """How long edges may become [m], (m,)."""
    return (1.0 + stiffness["strain_limit"]) * _lengths(body, ids)


def tethers(body: Body, pinned: np.ndarray) -> list[Constraints]:
    """Long-range attachments (Kim, Chentanez, Mueller 2012): no point goes farther from the nearest pinned point than the
    way along the rest edges. pinned: places in the arrays."""
    if not getattr(body.source, "tethers", False) or not len(pinned):
        return []
    way, source = topology.geodesic(body.rest, body.edges - body.first, np.unique(pinned) - body.first)
    free = np.flatnonzero(np.isfinite(way) & (way > 0.0))
    ids = np.stack([source[free], free], axis=1).astype(np.int32) + body.first
    return [Constraints("tether", ids, way[free], np.zeros(len(free)), {}, colors=np.zeros(len(free), np.int32))]


def _membrane(body: Body, cloth: Cloth) -> list[Constraints]:
    """Triangle strain: rest is the inverse of the edge matrix in the triangle's plane, shape 1 / area."""
    local, areas = flat(body.rest[body.triangles - body.first])
    good, fabric = areas > 0.0, cloth.material
    k = {name: np.array([getattr(fabric, name)]) for name in ("stretch", "shear", "weft", "poisson")}
    return [Constraints("membrane", body.triangles[good], np.linalg.inv(local[good]), 1.0 / areas[good], k, fabric.damping)]


def flat(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edge matrices Dm (columns: edges 01 and 02 in the plane of the triangle [m]) and areas [m^2] of corners (t, 3, 3).

    The first axis (warp) is the projection of the longest axis-aligned direction that all triangles share: x of the rest
    shape where the triangle is not perpendicular to it, else y.
    """
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    double = np.linalg.norm(np.cross(e1, e2), axis=1)
    _, u, v, _ = frame(corners)
    Dm = np.stack([np.stack([(u * e1).sum(1), (u * e2).sum(1)], 1), np.stack([(v * e1).sum(1), (v * e2).sum(1)], 1)], 1)
    return Dm, 0.5 * double


@dataclass
class Net:
    """Springs of a cloth that share a stiffness. Each stands for `times` the area of some triangles."""

    parameter: str
    ids: np.ndarray               # (m, 2)
    triangles: np.ndarray         # (a, 3)
    owner: np.ndarray             # spring of each triangle, (a,)
    times: float

    def areas(self, body: Body) -> np.ndarray:
        """(m,) [m^2]."""
        each = topology.areas(body.rest, self.triangles - body.first)
        return self.times * np.bincount(self.owner, each, len(self.ids))

    def good(self, body: Body) -> np.ndarray:
        """Those of some length and area, (m,)."""
        return (_lengths(body, self.ids) > 0.0) & (self.areas(body) > 0.0)


def nets(body: Body, hinges: np.ndarray) -> list[Net]:
    """Springs along authored edges (stretch) and across authored quads, both diagonals (shear)."""
    t, n, edges = body.triangles.astype(np.int64), body.last + 1, body.edges
    inner = hinges[_same_polygon(body, hinges)]
    own = edges.min(1).astype(np.int64) * n + edges.max(1)
    across = np.isin(own, inner[:, :2].min(1).astype(np.int64) * n + inner[:, :2].max(1))
    ends = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    order = np.argsort(own)
    row = order[np.searchsorted(own[order], ends.min(1) * n + ends.max(1))]
    kept = ~across[row]
    found = [Net("stretch", edges[~across], np.tile(body.triangles, (3, 1))[kept], (np.cumsum(~across) - 1)[row[kept]], 1.0)]
    if len(inner):
        diagonals = np.concatenate([inner[:, :2], inner[:, 2:]]).astype(np.int32)
        halves = np.concatenate([inner[:, [0, 1, 2]], inner[:, [1, 0, 3]]])
        owner = np.arange(len(inner))
        owner = np.concatenate([owner, owner, owner + len(inner), owner + len(inner)])
        found.append(Net("shear", diagonals, np.tile(halves, (2, 1)), owner, 2.0))
    return found


def frame(corners: np.ndarray) -> tuple[np.ndarray, ...]:
    """Unit normal n, warp u, weft v of triangles (t, 3, 3), each (t, 3), and n.a / |a - n n.a| of the axis a of warp, (t,)."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double = np.linalg.norm(normal, axis=1)
    n = normal / np.where(double > 0, double, 1.0)[:, None]
    u, across = np.array([1.0, 0.0, 0.0]) - n * n[:, :1], n[:, 0].copy()
    bad = np.linalg.norm(u, axis=1) < 0.1
    u[bad], across[bad] = np.array([0.0, 1.0, 0.0]) - n[bad] * n[bad, 1:2], n[bad, 1]
    size = np.linalg.norm(u, axis=1)
    u /= size[:, None]
    return n, u, np.cross(n, u), across / size


def _edges(body: Body, cloth: Cloth, hinges: np.ndarray) -> list[Constraints]:
    fabric, found = cloth.material, []
    for net in nets(body, hinges):
        stiffness = getattr(fabric, net.parameter)
        if net.parameter == "stretch" or stiffness > 0.0:
            good = net.good(body)
            ids, area = net.ids[good], net.areas(body)[good]
            length = _lengths(body, ids)
            found.append(Constraints("distance", ids, length, length**2 / area, {net.parameter: np.array([stiffness])},
                              fabric.damping))
    return found


def _same_polygon(body: Body, hinges: np.ndarray) -> np.ndarray:
    """Whether both triangles of a hinge were cut from one authored quad."""
    size = np.bincount(body.polygon, minlength=1)
    t = np.sort(body.triangles, axis=1).astype(np.int64)
    n = body.last + 1
    key = (t[:, 0] * n + t[:, 1]) * n + t[:, 2]
    order = np.argsort(key)

    def polygon(corners):
        s = np.sort(corners, axis=1).astype(np.int64)
        return body.polygon[order[np.searchsorted(key[order], (s[:, 0] * n + s[:, 1]) * n + s[:, 2])]]

    left, right = (polygon(hinges[:, [0, 1, k]]) for k in (2, 3))
    return (left == right) & (size[left] == 2)


def _hinges(body: Body, cloth: Cloth, hinges: np.ndarray, pinned: np.ndarray) -> Constraints:
    p = body.rest[hinges - body.first]
    n2, n3 = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), np.cross(p[:, 3] - p[:, 0], p[:, 1] - p[:, 0])
    area = 0.5 * (np.linalg.norm(n2, axis=1) + np.linalg.norm(n3, axis=1))
    length = np.linalg.norm(p[:, 1] - p[:, 0], axis=1)
    sine = -((p[:, 3] - p[:, 0]) * n2).sum(1) * length
    rest = np.zeros(len(p)) if cloth.flat else np.arctan2(sine, (n2 * n3).sum(1))
    good = (length > 0.0) & (area > 0.0)
    from wsim.physics.cloth import bending
    held = np.zeros(body.count, bool)
    held[pinned[(pinned >= body.first) & (pinned < body.last)] - body.first] = True
    patches = bending.patches(body.rest, body.triangles - body.first, hinges[good] - body.first, held)
    coupling, shape = bending.coupling(body.rest, patches)
    k = {"bend": np.array([cloth.material.bend])}
    return Constraints("dihedral", hinges[good], rest[good], shape, k, cloth.material.damping, body, coupling)


def changed(model: Model, rows: list[Constraints], path: str, name: str, value, world: int | None,
            damped: bool = True) -> list[Constraints]:
    """Gives constraints a live value, and returns those that have it: a stiffness of theirs, damping [s] where some are damped,
    or what a new rest shape or new lengths of their body make of them. Raises SceneError, before anything is changed, for a
    strain limit where there is none from the start."""
    mine = [r for r in rows if r.body is not None and r.body.path == path and world in (None, r.body.world)]
    if name in AT_REST:
        for r in mine:
            renew(r, hard_places(model))
        return mine
    if name == "damping":
        for r in mine if damped else ():
            r.tau = float(value)
        return mine if damped else []
    if mine and name == "strain_limit":
        _check(mine[0].body)
    mine = [r for r in mine if name in r.stiffness]
    for r in mine:
        r.stiffness = r.stiffness | {name: np.atleast_1d(np.asarray(value, np.float64))}
        if r.kind == "limit" and r.body is not None:
            r.rest = longest(r.body, r.ids, r.stiffness)
    return mine


def _check(body: Body | None) -> None:
    """Of a cloth, whose limits are there from the start or not at all."""
    if body is None or not isinstance(body.source, Cloth):
        return
    if not isfinite(body.source.material.strain_limit):
        raise SceneError(Problem(body.path, "strain_limit is inf, so that no edge has a limit, and to give them one changes "
                                 "the constraints; give the scene a finite one and make another Simulation"))


def renew(r: Constraints, pinned: np.ndarray) -> None:
    """Rest values and shapes as the body is now."""
    assert r.body is not None
    same = next(s for s in rows_of(r.body, pinned) if s.kind == r.kind and np.array_equal(s.ids, r.ids))
    r.rest, r.shape, r.coupling = same.rest, same.shape, same.coupling
    if r.kind == "limit":                                # a live one
        r.rest = longest(r.body, r.ids, r.stiffness)
