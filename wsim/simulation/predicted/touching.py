"""Pairs of rigid shapes that touch where a scene starts, with the patch on which each pair touches. NumPy only.

A shape is a middle and, along any unit direction L, an interval: a box has sum e_i |a_i . L| on either side (a_i its axes, e_i
half its edges), a ball adds its radius, a round side of radius r about the axis z adds r sqrt(1 - (z . L)^2), a hull has the
least and the greatest of its vertices. Two shapes are apart by the largest distance of their intervals along the axes of both,
their cross products (Gottschalk, Lin, Manocha 1996) and the line between their middles; that axis is the normal. The largest
distance never exceeds the true one, so that no pair is missed; at a rim or a cone a pair may be named that is a little apart.

The patch is a rectangle across the normal: what is common to the two faces (or edges, or points) that look at each other.
"""

from dataclasses import dataclass

import numpy as np

from wsim.physics.rigid.solids import collider_parts, contact_shape_of
from wsim.scene import Plane
from wsim.scene.solids import Capsule, Cone, Cylinder, Sphere

NEAR = 0.25            # gap over the least extent of a shape that moves, below which a pair counts: what starts so near will
                       # soon be there, and nothing fits between
FLAT = 0.2             # sine of the angle to a face, below which it is the face that touches
COMMON = 0.02          # part of a face that two have to share: boxes that meet at a corner bear nothing
SQUARE = 0.7071        # half the edge of the square within a round face, over its radius
ENDLESS = 1e4          # half the edge of the box that stands for a plane, over the extent of the scene
SAME = 1e-6            # part of a size that is none
SWEPT = 64             # shapes whose bounds are compared at once


@dataclass
class ShapeAtStart:
    """A convex shape in the world, lengths in [m]."""

    body: int                                  # -1: it stands
    center: np.ndarray                         # (3,)
    axes: np.ndarray                           # (3, 3), columns
    half: tuple[float, ...] = (0.0, 0.0, 0.0)
    ball: float = 0.0                          # radius of what is round on all sides
    disc: float = 0.0                          # radius about the third axis
    points: np.ndarray | None = None           # of a hull about its center, (n, 3)
    path: str = ""                             # of its collider

    @classmethod
    def of(cls, body: int, M: np.ndarray, met, path: str) -> "ShapeAtStart":
        """A shape that M (4, 4) places."""
        middle, R, shape = M[:3, :3] @ np.array(met.center, np.float64) + M[:3, 3], M[:3, :3], met.shape
        if isinstance(shape, (Sphere, Capsule)):
            return cls(body, middle, R, (0.0, 0.0, getattr(shape, "half_height", 0.0)), ball=shape.radius, path=path)
        if isinstance(shape, (Cylinder, Cone)):
            return cls(body, middle, R, (0.0, 0.0, shape.half_height), disc=shape.radius, path=path)
        if shape is not None:
            return cls(body, middle, R, tuple(shape.half), path=path)
        outer = met.outer_points
        low, high = outer.min(axis=0), outer.max(axis=0)
        inner = 0.5 * (low + high)
        return cls(body, middle + R @ inner, R, tuple(high - inner), points=outer - inner, path=path)


class ShapesAtStart:
    """Rows as arrays, those of bodies first; paths: of their colliders; reach: the gap that counts [m]."""

    def __init__(self, rows: list[ShapeAtStart]):
        self.body, self.paths = np.array([r.body for r in rows], int), [r.path for r in rows]
        self.center = np.array([r.center for r in rows], np.float64).reshape(-1, 3)
        self.axes = np.array([r.axes for r in rows], np.float64).reshape(-1, 3, 3)
        self.half = np.array([r.half for r in rows], np.float64).reshape(-1, 3)
        self.ball, self.disc = (np.array([getattr(r, name) for r in rows], np.float64) for name in ("ball", "disc"))
        hulls = [r.points for r in rows if r.points is not None]              # filled up with their first vertex
        most = max(map(len, hulls), default=1)
        self.vertices = np.array([np.concatenate([p, np.tile(p[:1], (most - len(p), 1))]) for p in hulls]).reshape(-1, most, 3)
        self.hulls = np.cumsum([r.points is not None for r in rows]) - 1
        self.hulls[[r.points is None for r in rows]] = -1
        mine = np.flatnonzero(self.body >= 0)
        low, high = self.intervals_along(mine, np.swapaxes(self.axes[mine], 1, 2))
        self.reach = NEAR * float((high - low).min(initial=np.inf))

    def intervals_along(self, i: np.ndarray, L: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ends (p, k) [m] of shapes i (p,) along unit vectors L (p, k, 3), from the world's origin."""
        own = L @ self.axes[i]                                        # (p, k, 3)
        r = np.abs(own) @ self.half[i][..., None] + self.ball[i][:, None, None]
        r = r[..., 0] + self.disc[i][:, None] * np.sqrt(np.maximum(1.0 - own[..., 2]**2, 0.0))
        low, high = -r, r
        hull = np.flatnonzero(self.hulls[i] >= 0)
        if len(hull):
            along = own[hull] @ np.swapaxes(self.vertices[self.hulls[i[hull]]], 1, 2)
            low[hull], high[hull] = along.min(axis=2), along.max(axis=2)
        middle = np.einsum("pkj,pj->pk", L, self.center[i])
        return middle + low, middle + high

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corners (n, 3) [m]."""
        return self.intervals_along(np.arange(len(self.body)), np.tile(np.eye(3), (len(self.body), 1, 1)))


def solids_of(scene, bodies: list) -> tuple[ShapesAtStart, list]:
    """Convex shapes of a scene, and of the meshes that stand the corners of their triangles (t, 3, 3) [m] and paths."""
    frames = [body.motion.at(0.0) for body in bodies]
    rows = [ShapeAtStart.of(k, M @ c.motion.at(0.0), met, c.path)
            for k, (body, M) in enumerate(zip(bodies, frames, strict=True))
            for c in collider_parts(body.colliders) if (met := contact_shape_of(c, True)) is not None]
    still = [(c.motion.at(0.0), met, c.path) for c in collider_parts(scene.colliders)
             if (met := contact_shape_of(c, False)) is not None]
    reach = ENDLESS * (1.0 + max(float(np.abs(M).max()) for M in [*frames, *[M for M, *_ in still]]))
    for M, met, path in still:
        if isinstance(met.shape, Plane):
            rows.append(ShapeAtStart(-1, M[:3, 3] - reach * M[:3, 2], M[:3, :3], (reach,) * 3, path=path))
        elif met.mesh is None:
            rows.append(ShapeAtStart.of(-1, M, met, path))
    meshes = [(((met.mesh[0] + met.center) @ M[:3, :3].T + M[:3, 3])[met.mesh[1]], path) for M, met, path in still if met.mesh]
    return ShapesAtStart(rows), meshes


@dataclass
class TouchingPairs:
    """Pairs of shapes a, b, the normal from b to a, and where they touch."""

    a: np.ndarray                 # (m,) rows of `ShapesAtStart`
    b: np.ndarray                 # (m,); -1: a mesh that stands
    n: np.ndarray                 # (m, 3)
    points: np.ndarray            # (m, 4, 3) [m] corners of the patch
    count: np.ndarray             # (m,) how many of the corners differ: 4, 2 of a line, 1

    def joined(self, other: "TouchingPairs") -> "TouchingPairs":
        return TouchingPairs(*(np.concatenate(each) for each in zip(self.arrays, other.arrays, strict=True)))

    def part(self, keep: np.ndarray) -> "TouchingPairs":
        return TouchingPairs(*(each[keep] for each in self.arrays))

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        return self.a, self.b, self.n, self.points, self.count


def touching_pairs(scene, bodies: list) -> tuple[ShapesAtStart, TouchingPairs]:
    """Shapes of a scene, and the pairs of them that touch, each of a body at least, and which no filter keeps apart."""
    s, meshes = solids_of(scene, bodies)
    i, j = near_pairs(s)
    found = _patches_of_pairs(s, *_separating_axes(s, i, j))
    other = found.b
    for k, (corners, _) in enumerate(meshes):
        more = _on_mesh(s, corners)
        found, other = found.joined(more), np.concatenate([other, np.full(len(more.a), len(s.body) + k)])
    if scene.things("Group") or scene.things("FilteredPairs"):
        found = found.part(~filtered_pairs(scene, bodies, s, [path for _, path in meshes])[found.a, other])
    return s, found


def upright_axes(up: np.ndarray) -> np.ndarray:
    """Axes (3, 3) in rows: the unit vector up (3,), and two across."""
    return np.concatenate([up[None], np.linalg.svd(up[None])[2][1:]])


def touching_after_fall(s: ShapesAtStart, falls: np.ndarray, up: np.ndarray) -> TouchingPairs:
    """Pairs of shapes of bodies that fall, falls (bodies,), and what of other bodies is next below them along gravity, as if
    bounds were solid; what has nothing below lands on what stands."""
    axes, found = upright_axes(up), list[tuple[int, int]]()
    low, high = s.intervals_along(np.arange(len(s.body)), np.tile(axes, (len(s.body), 1, 1)))
    for i in np.flatnonzero((s.body >= 0) & falls[s.body]):
        wide = np.minimum(high[i], high) - np.maximum(low[i], low)
        over = (wide[:, 1:] > COMMON * (high[i] - low[i])[1:]).all(axis=1) & (s.body != s.body[i]) & (s.body >= 0)
        gap = np.where(over & (high[:, 0] <= low[i, 0] + s.reach), low[i, 0] - high[:, 0], np.inf)
        next_below = np.flatnonzero(gap <= gap.min() + s.reach) if np.isfinite(gap.min()) else [-1]
        found += [(int(i), int(j)) for j in next_below]
    a, b = np.array(found, int).reshape(-1, 2).T
    lows, highs = ([v[a], np.where(b[:, None] >= 0, v[b], v[a])] for v in (low, high))
    first, last = np.maximum(*lows), np.minimum(*highs)
    corners = np.stack([np.stack([low[a, 0], p[:, 1], q[:, 2]], axis=1) for p in (first, last) for q in (first, last)], axis=1)
    return TouchingPairs(a, b, np.tile(up, (len(a), 1)), corners @ axes, np.full(len(a), 4))


def filtered_pairs(scene, bodies: list, s: ShapesAtStart, meshes: list[str]) -> np.ndarray:
    """Table of the shapes, meshes behind the others, that filters keep from touching each other."""
    from wsim.physics.rigid.joints.filters.groups import collision_filters
    paths, body = [*s.paths, *meshes], [*s.body, *[-1] * len(meshes)]
    found = collision_filters(scene, [(path, min(k, 0)) for path, k in zip(paths, body, strict=True)],
                              [bodies[k].path if k >= 0 else "" for k in body])
    if found is None:
        return np.zeros((len(paths), len(paths)), bool)
    table = found.table[np.ix_(found.kind, found.kind)].copy()
    table[np.repeat(np.arange(len(paths)), np.diff(found.first)), found.parted] = True
    return table


def near_pairs(s: ShapesAtStart) -> tuple[np.ndarray, np.ndarray]:
    """Pairs (m,), (m,) of shapes whose bounds, grown by the gap that counts, overlap; the first is of a body. Shapes are gone
    through in the order in which they begin along the longest axis (sweep and prune), some at a time."""
    if not (s.body >= 0).any():
        return np.zeros(0, int), np.zeros(0, int)
    low, high = s.bounds()
    low, high = low - s.reach, high + s.reach
    axis = int(np.argmax(np.ptp(s.center[s.body >= 0], axis=0)))
    order, found = np.argsort(low[:, axis], kind="stable"), [np.zeros((0, 2), int)]
    low, high, body = low[order], high[order], s.body[order]
    for first in range(0, len(order), SWEPT):
        i = np.arange(first, min(first + SWEPT, len(order)))
        j = np.arange(first, np.searchsorted(low[:, axis], high[i, axis].max(), side="right"))
        over = ((low[i][:, None] <= high[j]) & (high[i][:, None] >= low[j])).all(axis=2)
        rows = np.argwhere(over & (j > i[:, None]) & (body[i][:, None] != body[j]))
        found.append(np.stack([i[rows[:, 0]], j[rows[:, 1]]], axis=1))
    pairs = order[np.concatenate(found)]
    pairs = np.where(s.body[pairs[:, :1]] < 0, pairs[:, ::-1], pairs)
    return pairs[:, 0], pairs[:, 1]


def _unit_vectors(v: np.ndarray) -> np.ndarray:
    """Unit vectors along the last axis; what is too short stays 0."""
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.divide(v, length, out=np.zeros_like(v), where=length > 1e-6)


def _separating_axes(s: ShapesAtStart, i: np.ndarray, j: np.ndarray):
    """(i, j, n, middle) of the pairs that touch: the normal from j to i, and n . x of the place between them."""
    A, B = (np.swapaxes(s.axes[k], 1, 2) for k in (i, j))
    cross = _unit_vectors(np.cross(A[:, :, None], B[:, None]).reshape(len(i), 9, 3))
    L = np.concatenate([A, B, cross, _unit_vectors(s.center[i] - s.center[j])[:, None]], axis=1)
    (low_i, high_i), (low_j, high_j) = s.intervals_along(i, L), s.intervals_along(j, L)
    above, below = low_i - high_j, low_j - high_i
    size = np.minimum((high_i - low_i)[:, :6].min(axis=1), (high_j - low_j)[:, :6].min(axis=1))
    gap = np.maximum(above, below) - 1e-3 * size[:, None] * (np.arange(16) >= 6)              # faces before edges
    gap[~L.any(axis=2)] = -np.inf
    rows, best = np.arange(len(i)), np.argmax(gap, axis=1)
    sign = np.where(above >= below, 1.0, -1.0)[rows, best]
    middle = 0.5 * np.where(sign > 0.0, (low_i + high_j)[rows, best], -(low_j + high_i)[rows, best])
    good = gap[rows, best] <= s.reach
    return i[good], j[good], (sign[:, None] * L[rows, best])[good], middle[good]


def _faces_along_normal(s: ShapesAtStart, i: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middle (m, 3) [m] and half extents along the own axes (m, 3) [m] of what of shapes i is farthest along n."""
    own = np.einsum("pj,pjk->pk", n, s.axes[i])
    free, half = np.abs(own) < FLAT, s.half[i]
    extent, out = np.where(free, half, 0.0), np.where(free, 0.0, np.sign(own) * half)
    round_face = (s.disc[i] > 0.0) & (np.abs(own[:, 2]) > 1.0 - 0.5 * FLAT**2 - 1e-9)
    extent[round_face, :2] = SQUARE * s.disc[i][round_face, None]
    return s.center[i] + np.einsum("pjk,pk->pj", s.axes[i], out), extent


def _patches_of_pairs(s: ShapesAtStart, i: np.ndarray, j: np.ndarray, n: np.ndarray, middle: np.ndarray) -> TouchingPairs:
    """Patches of pairs; pairs whose faces have nothing in common are left out."""
    faces = [_faces_along_normal(s, i, -n), _faces_along_normal(s, j, n)]
    t = _directions_across(s, i, j, n)
    low, high, wide = [], [], []
    for k, (place, extent) in zip((i, j), faces, strict=True):
        at = np.einsum("ptj,pj->pt", t, place)
        reach = np.einsum("ptk,pk->pt", np.abs(t @ s.axes[k]), extent)
        low.append(at - reach)
        high.append(at + reach)
        wide.append(reach)
    first, last, least = np.maximum(*low), np.minimum(*high), np.minimum(*wide)
    sizes = [s.half[k].max(axis=1) + s.ball[k] + s.disc[k] for k in (i, j)]
    tiny = SAME * np.minimum(*sizes)[:, None]
    good = (last - first >= 2.0 * COMMON * least - tiny).all(axis=1)
    point = least <= tiny                                                        # of one of the two in this direction
    mean = 0.5 * (first + last)
    first, last = np.where(point, mean, first), np.where(point, mean, last)
    uv = np.stack([np.stack([a[:, 0], b[:, 1]], axis=1) for a in (first, last) for b in (first, last)], axis=1)
    points = np.einsum("pcu,puj->pcj", uv, t) + (middle[:, None] * n)[:, None]
    count = np.where(last - first > tiny, 2, 1).prod(axis=1)
    return TouchingPairs(i[good], j[good], n[good], points[good], count[good])


def _directions_across(s: ShapesAtStart, i: np.ndarray, j: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Two directions (m, 2, 3) across n, along the edges of the face that lies best on the patch."""
    own, other = (np.abs(np.einsum("pj,pjk->pk", n, s.axes[k])) for k in (i, j))
    best = np.where((own.max(axis=1) >= other.max(axis=1))[:, None, None], s.axes[i], s.axes[j])
    along = np.abs(np.einsum("pj,pjk->pk", n, best)).argmax(axis=1)
    first = best[np.arange(len(n)), :, (along + 1) % 3]
    first = _unit_vectors(first - np.einsum("pj,pj->p", first, n)[:, None] * n)
    return np.stack([first, np.cross(n, first)], axis=1)


def _on_mesh(s: ShapesAtStart, corners: np.ndarray) -> TouchingPairs:
    """Shapes of bodies on a mesh that stands, corners (t, 3, 3) [m]: of each triangle within reach the side that it is on."""
    low, high = s.bounds()
    least, most = corners.min(axis=1) - s.reach, corners.max(axis=1) + s.reach
    n = _unit_vectors(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    found: list[tuple[int, np.ndarray]] = []
    for i in np.flatnonzero(s.body >= 0):
        close = np.flatnonzero(((least <= high[i]) & (most >= low[i])).all(axis=1))
        if not len(close):
            continue
        side = np.sign(np.einsum("tj,tj->t", n[close], s.center[i] - corners[close, 0]))[:, None] * n[close]
        ends = s.intervals_along(np.full(len(close), i), side[:, None])[0][:, 0]
        touch = np.abs(ends - np.einsum("tj,tj->t", side, corners[close, 0])) <= s.reach
        if touch.any() and (mean := _unit_vectors(side[touch].sum(axis=0))).any():
            found.append((int(i), mean))
    on, up = np.array([i for i, _ in found], int), np.array([n for _, n in found]).reshape(-1, 3)
    t = _patches_of_pairs(s, on, on, up, s.intervals_along(on, up[:, None])[0][:, 0])
    return TouchingPairs(t.a, np.full(len(t.a), -1), t.n, t.points, t.count)
