"""A cage of tetrahedra around an arbitrary surface: coarse cells that move, and carry a fine surface. NumPy only.

Cubes cut in five tets (lattice.py) cover the bounds; kept are the tets that the surface passes through (tested exactly,
by separating axes: Akenine-Moeller 2001) and those inside (inside.py). Small holes, self-intersections and several
pieces do no harm. Where two sheets of the surface come nearer than a cell, the cage joins them. The cage is larger than the
body, by about half a cell on each side (a ball 16 cells across: by 20 %): `filled_fraction` says how much of each tet is body,
to weigh mass and stiffness with (Nesme, Kry, Jerabkova, Faure 2009).
"""

from functools import reduce

import numpy as np

from wsim.geometry.tetra.inside import AxisRays
from wsim.geometry.tetra.lattice import CORNERS, FIVE, cells_of_integer_boxes, five_tets_of_cubes, integer_grid
from wsim.geometry.tetra.tets import checked_tet_arrays
from wsim.geometry.triangulate import flat_triangles

MOST = 30_000_000      # cells of the bounds: 5 bytes each, and the queries of a slab
EPS = 1e-9             # of a cell: surfaces that touch a tet from outside by no more do not pass through it
FINE = 512             # places along the longest side at which `filled_fraction` may look: columns of rays go with its square
LONG = 1.5             # cells: longer triangles are cut, so that none has many cells in its bounds
TET_EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))

_X = CORNERS[FIVE].astype(np.float64)                                          # corners in a cell, (2, 5, 4, 3)
# (1, p) @ _B[k] are the barycentric coordinates of p in tet k of an even cell, (5, 4, 4)
_B = np.linalg.inv(np.concatenate([np.ones((5, 4, 1)), _X[0]], axis=2))


def tet_cage(points, triangles, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) [m] float64 and tets (t, 4) int32 that cover a surface and what it encloses; points (m, 3) [m],
    triangles (f, 3). `cells`: cubes along the longest side of its bounds; other sides get as many as they need.

    All tets have positive volume and every point is in a tet. Triangles without area are passed over.
    Raises ValueError naming the argument."""
    points, triangles = _checked_surface(points, triangles)
    low, high = (bound(points[triangles.ravel()], axis=0) for bound in (np.min, np.max))
    if not (np.ndim(cells) == 0 and np.isfinite(cells) and int(cells) == cells and cells >= 1):
        raise ValueError(f"cells is {cells}; it must be a whole number >= 1")
    width = float((high - low).max()) / int(cells)
    counts = np.maximum(np.ceil((high - low) / width - EPS), 1).astype(np.int64)
    if counts.prod() > MOST:
        raise ValueError(f"cells is {cells}: {' x '.join(map(str, counts))} cubes cover the surface; at most {MOST:.0e}")
    origin = 0.5 * (low + high - width * counts)
    kept = _tets_kept_by_cage((points - origin) / width, triangles, counts)
    cell, k = np.divmod(np.flatnonzero(kept), 5)
    where = np.stack(np.unravel_index(cell, tuple(counts)), axis=1)
    tets = five_tets_of_cubes(where, counts)[np.arange(len(k)), k]
    used = np.zeros(int(np.prod(counts + 1)), bool)
    used[tets.ravel()] = True
    number = np.cumsum(used) - 1
    lattice = np.stack(np.unravel_index(np.flatnonzero(used), tuple(counts + 1)), axis=1)
    return origin + width * lattice, number[tets].astype(np.int32)


def filled_fraction(points, triangles, cage_points, tets) -> np.ndarray:
    """Part of each tet (t, 4) of cage_points [m] that lies inside of a surface (points (m, 3) [m], triangles (f, 3)), (t,).

    Counted at 35 places a tet, so in steps of 1/35; the errors of many tets cancel (a ball: its volume within 0.5 % at 12
    cells). 0 where a tet is barely cut: keep such points from having no mass. Cells under 1/100 of the whole are seen more
    coarsely (FINE). Triangles without area are passed over. Raises ValueError naming the argument."""
    points, triangles = _checked_surface(points, triangles)
    cage_points, tets = checked_tet_arrays(cage_points, tets)
    if not np.isfinite(cage_points).all():
        raise ValueError("cage_points are not all finite")
    if len(tets) == 0:
        return np.zeros(0)
    origin, step = cage_points.min(axis=0), float(np.ptp(cage_points, axis=0).max()) / FINE
    scaled = (cage_points - origin) / step
    rays = AxisRays((points - origin) / step, triangles, np.zeros(3), np.ceil(scaled.max(axis=0)))
    k = integer_grid((5, 5, 5, 5))
    spots = (k[k.sum(axis=1) == 4] + 0.25) / 5.0                   # barycentric, (35, 4): symmetric, none on a face
    part = np.empty(len(tets))
    for some in np.array_split(np.arange(len(tets)), len(tets) // 10_000 + 1):
        places = np.rint(np.einsum("si,tik->tsk", spots, scaled[tets[some, :4]])).astype(np.int64)
        part[some] = rays.inside(places.reshape(-1, 3)).reshape(len(some), -1).mean(axis=1)
    return part


def _checked_surface(points, triangles) -> tuple[np.ndarray, np.ndarray]:
    """Both as arrays, without flat triangles. Raises ValueError for what no cage could cover."""
    points, triangles = np.asarray(points, np.float64), np.asarray(triangles)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points have shape {points.shape}; it must be (n, 3) [m]")
    if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu" or len(triangles) == 0:
        raise ValueError(f"triangles have shape {triangles.shape} and type {triangles.dtype}; they must be integers of shape "
                         "(f, 3), one or more")
    wrong = ((triangles < 0) | (triangles >= len(points))).any(axis=1)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise ValueError(f"triangles: number {k} names the points {triangles[k].tolist()}; there are 0 to {len(points) - 1}")
    bad = ~np.isfinite(points[triangles]).all(axis=(1, 2))
    if bad.any():
        raise ValueError(f"points: triangle {int(np.argmax(bad))} has a corner that is not finite")
    triangles = triangles[~flat_triangles(points, triangles)]
    if len(triangles) == 0:
        raise ValueError("triangles: none has an area; a cage needs a surface")
    return points, triangles.astype(np.int64)


def _tets_kept_by_cage(points: np.ndarray, triangles: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Which of the five tets of each cell the cage keeps, (5 cells,) bool; points in cells."""
    pieces = _halve_long_triangles(points[triangles])
    kept = _tets_passed_through(pieces, counts)
    rays = AxisRays(4.0 * points, triangles, np.zeros(3), 4 * counts)    # four times the centroid of a tet is whole
    slab = max(1, 400_000 // int(counts[1] * counts[2]))
    for first in range(0, int(counts[0]), slab):
        cells = integer_grid((min(slab, int(counts[0]) - first), counts[1], counts[2]))
        cells[:, 0] += first
        numbers = np.arange(len(cells) * 5) + first * int(counts[1] * counts[2]) * 5
        left = np.flatnonzero(~kept[numbers])
        cell, k = cells[left // 5], left % 5
        sums = CORNERS[FIVE].sum(axis=2)                                 # (2, 5, 3)
        kept[numbers[left]] = rays.inside(4 * cell + sums[cell.sum(axis=1) % 2, k])
    return _cover_bare_places(np.concatenate([pieces.reshape(-1, 3), pieces.mean(axis=1)]), kept, counts)


def _halve_long_triangles(pieces: np.ndarray) -> np.ndarray:
    """Triangles (f, 3, 3) halved at their longest edges until none is longer than LONG."""
    done = []
    while len(pieces):
        edge = np.stack([((pieces[:, k] - pieces[:, (k + 1) % 3]) ** 2).sum(axis=1) for k in range(3)])
        long = np.maximum(np.maximum(edge[0], edge[1]), edge[2]) > LONG**2
        done.append(pieces[~long])
        turn = (np.argmax(edge[:, long], axis=0)[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(pieces[long], turn[:, :, None], axis=1).transpose(1, 0, 2)
        m = 0.5 * (a + b)
        pieces = np.concatenate([np.stack([a, m, c], axis=1), np.stack([m, b, c], axis=1)])
    return np.concatenate(done)


def _locate_in_cells(places: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First tet number of the cell of each place, (m,), and the least barycentric coordinate in its five tets, (m, 5)."""
    cell = np.clip(np.floor(places), 0, counts - 1).astype(np.int64)
    odd = (cell[:, 0] + cell[:, 1] + cell[:, 2]) % 2 == 1
    x, y, z = (np.where(odd, 1.0 - at, at) for at in (places - cell).T)       # an odd cell is an even one, mirrored
    least = np.stack([reduce(np.minimum, [b[0] + b[1] * x + b[2] * y + b[3] * z for b in B.T]) for B in _B], axis=1)
    return 5 * (cell @ (counts[1] * counts[2], counts[2], 1)), least


def _tets_passed_through(pieces: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Which tets the triangles (f, 3, 3) pass through, (5 cells,) bool. First, cheaply, those that hold a corner."""
    kept = np.zeros(5 * int(counts.prod()), bool)
    for part in np.array_split(pieces.reshape(-1, 3), len(pieces) // 50_000 + 1):
        first, least = _locate_in_cells(part, counts)
        kept[(first[:, None] + np.arange(5))[least > EPS]] = True
    a, b, c = pieces[:, 0], pieces[:, 1], pieces[:, 2]
    low = np.clip(np.floor(np.minimum(np.minimum(a, b), c) + EPS), 0, counts - 1).astype(np.int64)
    high = np.clip(np.ceil(np.maximum(np.maximum(a, b), c) - EPS) - 1, low, counts - 1).astype(np.int64)
    for owner, cell in cells_of_integer_boxes(low, high, 1 << 17):
        number = (cell @ (counts[1] * counts[2], counts[2], 1)) * 5
        odd = cell.sum(axis=1) % 2
        for k in range(5):
            some = np.flatnonzero(~kept[number + k])
            hit = _triangles_meeting_tet(pieces[owner[some]] - cell[some, None], odd[some], k)
            kept[number[some[hit]] + k] = True
    return kept


def _triangles_meeting_tet(T: np.ndarray, odd: np.ndarray, k: int) -> np.ndarray:
    """Which triangles (m, 3, 3), in their cells, meet the inside of tet k of cells of that parity: positions, ascending.
    No axis (normals and products of edges) may have the two apart, or touching to EPS."""
    left = np.arange(len(T))
    sides = [np.roll(T, -1, axis=1)[:, i] - T[:, i] for i in range(3)]
    X = _X[:, k]
    normals = [np.cross(X[:, j] - X[:, i], X[:, m] - X[:, i]) for i, j, m in ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2))]
    edges = [X[:, j] - X[:, i] for i, j in TET_EDGES]
    for axis in range(23):                                   # 4 faces, 6 x 3 pairs of edges, the triangle
        if axis < 4:
            n = normals[axis][odd[left]]
        elif axis < 22:
            n = np.cross(edges[(axis - 4) % 6][odd[left]], sides[(axis - 4) // 6][left])
        else:
            n = np.cross(sides[0][left], sides[1][left])
        size = np.linalg.norm(n, axis=1)
        a, b = np.einsum("mij,mj->im", T[left], n), np.einsum("mij,mj->im", X[odd[left]], n)
        gap = np.maximum(a.min(axis=0) - b.max(axis=0), b.min(axis=0) - a.max(axis=0))
        left = left[~((gap > -EPS * size) & (size > 1e-12))]
    return left


def _cover_bare_places(places: np.ndarray, kept: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Adds tets for places of the surface that no tet holds: a sheet in the very plane of faces, without an inside."""
    bare = places
    for nudge in np.concatenate([[[0, 0, 0]], 2 * CORNERS - 1]) * 10.0 * EPS:
        held = []
        for part in np.array_split(bare, len(bare) // 50_000 + 1):
            first, least = _locate_in_cells(part + nudge, counts)
            held.append(np.logical_or.reduce([kept[first + k] & (least[:, k] > -100.0 * EPS) for k in range(5)]))
        bare = bare[~np.concatenate(held)]
    first, least = _locate_in_cells(bare, counts)
    kept[(first[:, None] + np.arange(5))[least > -100.0 * EPS]] = True
    return kept
