"""Points held by tetrahedra: the tet of each and its barycentric coordinates, by which it follows. NumPy only.

    p = sum_i b_i x_i,   sum b = 1,   b_i = 1 + g_i . (p - x_i)        g of `wsim.geometry.tetra.tets.barycentric_gradients`

Affine motions of the tets carry every point exactly. A grid about as fine as the tets finds them; inside means that no
coordinate is below 0 but for rounding. A point outside takes the tet nearest to it; some coordinate is below 0 then: it
follows by extrapolation.
"""

import numpy as np

from wsim.geometry.tetra.lattice import CORNERS, cells_of_integer_boxes
from wsim.geometry.tetra.repair import FLAT
from wsim.geometry.tetra.tets import (
    FACES,
    barycentric_gradients,
    checked_tet_arrays,
    tet_surface_triangles,
    volumes_and_squared_edges,
)

ROUNDING = 1e-10       # of a tet's height, by which a point may lie outside for the search: a thousand times the rounding
CELLS = 4              # of the grid a tet, at most: more cost memory, fewer cost time


def embed_in_tets(points, tets, places, reach: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Tet of each place, (m,) int32, and its barycentric coordinates, (m, 4) float64, summing to 1 within rounding.

    points [m] (n, 3), tets (t, 4), places [m] (m, 3). reach [m]: how far outside of all tets a place may lie; by default
    as far as the longest edge. Places are reproduced to 1e-12 of the mesh's size unless tets are nearly flat.
    Raises ValueError for an array that is not finite, for tets that are flat or turned inside out (see
    wsim.geometry.tetra.repair), and naming the first place that lies farther outside."""
    points, tets = checked_tet_arrays(points, tets)
    places = np.asarray(places, np.float64).reshape(-1, 3)
    for name, array in (("points", points), ("places", places)):
        if not np.isfinite(array).all():
            raise ValueError(f"{name}: number {int(np.argmin(np.isfinite(array).all(axis=1)))} is not finite")
    tets = tets[:, :4]
    if len(tets) == 0:
        raise ValueError("tets are none; at least one must hold the places")
    volume, squares = volumes_and_squared_edges(points, tets)
    edge = np.sqrt(squares.max(axis=0))
    thin = ~(volume > FLAT * edge**3)
    if thin.any():
        raise ValueError(f"tets: tet {int(np.argmax(thin))} is flat or turned inside out; mend the mesh first")
    reach = float(edge.max()) if reach is None else reach
    if not reach >= 0 or not np.isfinite(reach):
        raise ValueError(f"reach is {reach}; it must be finite and >= 0 [m]")
    search = _TetSearch(points, tets, places)
    search.look(np.arange(len(tets)), 0.0)
    lost, margin = np.flatnonzero(search.far > ROUNDING * search.width), search.width
    outer = _tets_at_surface(tets) if len(lost) else tets
    while len(lost):                             # farther and farther out, each time only those that are nowhere yet
        search.look(outer, min(margin, reach), lost)
        lost = lost[(search.far[lost] > margin) & (margin < reach)]
        margin *= 2.0
    far = search.far > max(reach, ROUNDING * search.width)
    if far.any():
        k = int(np.argmax(far))
        raise ValueError(f"places: {int(far.sum())} of {len(places)} lie more than {reach:g} m outside of all tets (first: "
                         f"{k}, at {places[k].tolist()}); give the places in the frame of the tets, or a larger reach")
    return search.tet.astype(np.int32), search.weights()


def follow_embedding(points: np.ndarray, tets: np.ndarray, tet: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Positions of embedded places, (m, 3): tets (t, 4), tet (m,), weights (m, 4)."""
    return np.einsum("mi,mik->mk", weights, np.asarray(points, np.float64)[np.asarray(tets)[tet][:, :4]])


def _tets_at_surface(tets: np.ndarray) -> np.ndarray:
    """Tets that own a point of the surface."""
    skin = np.zeros(int(tets.max()) + 1, bool)
    skin[tet_surface_triangles(tets).ravel()] = True
    return np.flatnonzero(skin[tets].any(axis=1))


def point_triangle_distance(p: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Distances from points to triangles [m], all (m, 3): to the plane above the triangle, else to the nearest side."""
    normal = np.cross(b - a, c - a)
    above, found = np.ones(len(p), bool), np.full(len(p), np.inf)
    for u, v in ((a, b), (b, c), (c, a)):
        e, d = v - u, p - u
        above &= np.einsum("mk,mk->m", np.cross(normal, e), d) >= 0.0
        s = np.clip(np.einsum("mk,mk->m", d, e) / np.einsum("mk,mk->m", e, e), 0.0, 1.0)
        found = np.minimum(found, np.linalg.norm(d - s[:, None] * e, axis=1))
    plane = np.abs(np.einsum("mk,mk->m", normal, p - a)) / np.linalg.norm(normal, axis=1)
    return np.where(above, plane, found)


class _TetSearch:
    """The best tet of each place so far and how far outside of it the place is [m]; inf where none was tried."""

    def __init__(self, points: np.ndarray, tets: np.ndarray, places: np.ndarray):
        self.points, self.tets, self.places = points, tets, places
        corner = [points.take(tets[:, k], axis=0) for k in range(4)]
        self.low, self.high = np.minimum.reduce(corner), np.maximum.reduce(corner)
        g = barycentric_gradients(points, tets)
        # rows of planes: the barycentric coordinate over the length of its gradient, a distance [m]
        self.height = 1.0 / np.sqrt(np.einsum("tik,tik->ti", g, g))
        self.normal = g * self.height[:, :, None]
        self.anchor = corner[0]                                  # b_0 = 1 + g_0 . (p - x0), b_i = g_i . (p - x0)
        self.tet = np.full(len(places), -1, np.int64)
        self.far = np.full(len(places), np.inf)
        self.width = float((self.high - self.low).mean()) or 1.0

    def look(self, tets: np.ndarray, margin: float, which: np.ndarray | None = None) -> None:
        """Tries the given tets on all places (or those in `which`) that are not farther than `margin` from their bounds."""
        which = np.arange(len(self.places)) if which is None else which
        p = self.places[which]
        low, high = self.low[tets] - margin, self.high[tets] + margin
        start, width = low.min(axis=0), max(self.width, margin)
        inside = ((p >= start) & (p <= high.max(axis=0))).all(axis=1)
        which, p = which[inside], p[inside]
        if not len(which):
            return
        span = high.max(axis=0) - start
        while np.prod(np.floor(span / width) + 1) > CELLS * len(tets) + 1000:
            width *= 1.3
        shape = (np.floor(span / width) + 1).astype(np.int64)
        rows = np.array([shape[1] * shape[2], shape[2], 1])
        cell = np.floor((p - start) / width).astype(np.int64) @ rows
        order = np.argsort(cell, kind="stable")
        which, cell = which[order], cell[order]
        starts = np.searchsorted(cell, np.arange(int(shape.prod()) + 1))
        before = np.pad(np.diff(starts).reshape(shape), ((1, 0),) * 3).cumsum(0).cumsum(1).cumsum(2)
        slack = 1e-9 * width                                     # a place on a bound may be rounded into the next cell
        first = np.clip(np.floor((low - slack - start) / width), 0, shape - 1).astype(np.int64)
        last = np.clip(np.floor((high + slack - start) / width), 0, shape - 1).astype(np.int64)
        busy = np.zeros(len(tets), np.int64)                     # places in the cells of each tet, by sums over cells
        for corner in CORNERS:
            x, y, z = (last[:, k] + 1 if corner[k] else first[:, k] for k in range(3))
            busy += (1 if corner.sum() % 2 else -1) * before[x, y, z]
        tets, first, last = tets[busy > 0], first[busy > 0], last[busy > 0]
        for owner, at in cells_of_integer_boxes(first, last):
            held = at @ rows
            begin, end = starts[held], starts[held + 1]
            some = np.flatnonzero(end > begin)
            if len(some):
                for row, pair in cells_of_integer_boxes(begin[some, None], end[some, None] - 1):
                    self._try_candidate_tets(tets[owner[some[row]]], which[pair[:, 0]], margin)

    def _try_candidate_tets(self, tet: np.ndarray, place: np.ndarray, margin: float) -> None:
        p = self.places.take(place, axis=0)
        near = np.flatnonzero(((p >= self.low.take(tet, axis=0) - margin - ROUNDING * self.width)
                               & (p <= self.high.take(tet, axis=0) + margin + ROUNDING * self.width)).all(axis=1))
        tet, place = tet[near], place[near]
        d = p[near] - self.anchor.take(tet, axis=0)
        inner = np.einsum("mik,mk->mi", self.normal.take(tet, axis=0), d)
        inner[:, 0] += self.height[tet, 0]
        far = -np.minimum(np.minimum(inner[:, 0], inner[:, 1]), np.minimum(inner[:, 2], inner[:, 3]))    # of the planes
        better = np.flatnonzero((far < self.far[place]) & (far <= max(margin, ROUNDING * self.width)))
        tet, place, far = tet[better], place[better], far[better]
        if margin > 0.0:                                          # nearest of many: the true distance
            X, p = self.points[self.tets[tet]], self.places[place]
            far = np.where(far > 0.0,
                           np.minimum.reduce([point_triangle_distance(p, *(X[:, k] for k in face)) for face in FACES]), far)
            better = np.flatnonzero(far < self.far[place])
            tet, place, far = tet[better], place[better], far[better]
        order = np.lexsort((tet, far, place))                     # the nearest first, of equals the first tet
        place = place[order]
        first = np.ones(len(place), bool)
        first[1:] = place[1:] != place[:-1]
        self.far[place[first]], self.tet[place[first]] = far[order][first], tet[order][first]

    def weights(self) -> np.ndarray:
        """Barycentric coordinates of the places in their tets, (m, 4)."""
        rows = self.tets[self.tet]
        d = self.places - self.points[rows[:, 0]]
        found = np.einsum("mik,mk->mi", self.normal[self.tet], d) / self.height[self.tet]
        found[:, 0] = 1.0 - found[:, 1] - found[:, 2] - found[:, 3]
        return found
