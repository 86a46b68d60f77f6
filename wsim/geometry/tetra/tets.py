"""Meshes of tetrahedra as index arrays: volumes, gradients, surface, edges, masses, ten-node meshes. NumPy only.

    points   positions [m], (n, 3)          tets   corners, (t, 4) int32; volume (x1 - x0) . (x2 - x0) x (x3 - x0) / 6 > 0

Faces of such a tet are, counter-clockwise from outside, (1 2 3), (0 3 2), (0 1 3), (0 2 1): the order and orientation of
UsdGeomTetMesh, rightHanded. Ten-node rows are four corners, then the middles of 01, 12, 02, 03, 13, 23 (the order of VTK's
quadratic tetra). Everything runs over whole arrays; what is wrong with a mesh is found by `wsim.geometry.tetra.repair`.
"""

import numpy as np

from wsim.geometry.topology import incident_rows, order_of

FACES = ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))
EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
ACROSS = 4             # cells: below, linear tets bend too stiffly to be of use (see `describe_coarseness`)
DEFLECTION = {1: 0.36, 2: 0.68, 3: 0.8}       # of the exact one: a bar of five-tet cells, by cells across


def tet_arrays(points, tets) -> tuple[np.ndarray, np.ndarray]:
    """Points and tets as arrays, float64 and integers. Raises ValueError for another shape or type, not for bad values."""
    points, tets = np.asarray(points), np.asarray(tets)
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise ValueError(f"points have shape {points.shape} and type {points.dtype}; they must be numbers of shape (n, 3) [m]")
    if tets.size == 0:
        tets = np.zeros((0, 4), np.int32)
    if tets.ndim != 2 or tets.shape[1] not in (4, 10) or tets.dtype.kind not in "iu":
        raise ValueError(f"tets have shape {tets.shape} and type {tets.dtype}; they must be integers of shape (t, 4), "
                         "or (t, 10) with the middles of the edges")
    return points.astype(np.float64, copy=False), tets


def checked_tet_arrays(points, tets) -> tuple[np.ndarray, np.ndarray]:
    """Points and tets as `tet_arrays` has them; also raises ValueError for indices out of range."""
    points, tets = tet_arrays(points, tets)
    if len(tets) and (tets.min() < 0 or tets.max() >= len(points)):
        bad = int(np.argmax(((tets < 0) | (tets >= len(points))).any(axis=1)))
        raise ValueError(f"tets: tet {bad} names the points {tets[bad].tolist()}; there are points 0 to {len(points) - 1}")
    return points, tets


def tet_sides(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Edges from corner 0 to corners 1, 2, 3 [m]: component k of edge i is [i, k], (3, 3, t)."""
    return np.stack([[(p := points[:, k]).take(tets[:, i]) - p.take(tets[:, 0]) for k in range(3)] for i in (1, 2, 3)])


def cross_of_components(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product of components along the first axis, (3, ...). (NumPy's own takes several times longer.)"""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def dot_of_components(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Dot product of components along the first axis, (...)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def volumes_and_squared_edges(points, tets) -> tuple[np.ndarray, np.ndarray]:
    """Signed volume of each tet [m^3], (t,), and the squares of its edges [m^2] in the order of EDGES, (6, t), float64."""
    a, b, c = tet_sides(*checked_tet_arrays(points, tets))
    return (dot_of_components(a, cross_of_components(b, c)) / 6.0,
            np.stack([dot_of_components(s, s) for s in (a, b - a, b, c, c - a, c - b)]))


def signed_tet_volumes(points, tets) -> np.ndarray:
    """Signed volume of each tet [m^3], (t,) float64; negative where it is turned inside out."""
    a, b, c = tet_sides(*checked_tet_arrays(points, tets))
    return dot_of_components(a, cross_of_components(b, c)) / 6.0


def barycentric_gradients(points, tets) -> np.ndarray:
    """Gradient of each barycentric coordinate [1/m], (t, 4, 3) float64: rows 1 to 3 are Dm^-1 with Dm = (x1 - x0, x2 - x0,
    x3 - x0) as columns, row 0 is minus their sum, so that F = sum_i x_i g_i^T. A tet without volume: not finite."""
    a, b, c = tet_sides(*checked_tet_arrays(points, tets))
    normals = np.stack([cross_of_components(b, c), cross_of_components(c, a), cross_of_components(a, b)])  # (3, 3, t)
    found = np.empty((len(tets), 4, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        normals /= dot_of_components(a, normals[0])
        found[:, 1:] = normals.transpose(2, 0, 1)
        found[:, 0] = -normals.sum(axis=0).T
    return found


def mean_ratio_quality(points, tets) -> tuple[np.ndarray, float, np.ndarray]:
    """Mean ratio of each tet, (t,); the least; and how many lie in each tenth of 0 to 1, (10,) (negative: in the first).

    eta = 12 (3 V)^(2/3) / sum l^2 (Liu and Joe 1994, "Relationship between tetrahedron shape measures"): 1 for a regular
    tet, 0 for a flat one, here negative for one turned inside out. Corner tets of a cube 0.84, tets of a BCC lattice 0.95.
    """
    volume, squares = volumes_and_squared_edges(points, tets)
    total = squares.sum(axis=0)
    eta = np.divide(12.0 * np.cbrt(3.0 * volume) ** 2, total, out=np.zeros(len(total)), where=total > 0)
    eta = np.where(volume < 0, -eta, eta)
    return eta, float(eta.min(initial=1.0)), np.histogram(np.clip(eta, 0.0, 1.0), bins=10, range=(0.0, 1.0))[0]


def lumped_tet_masses(points, tets, density) -> np.ndarray:
    """Mass of each point [kg], (n,): density [kg/m^3], one or one a tet (t,), times volume, shared by the nodes of a tet.

    Four nodes get a quarter each; of ten the corners get 1/36 and the middles 4/27, in proportion to the diagonal of the
    consistent matrix (Hinton, Rock, Zienkiewicz 1976): equal row sums would give the corners negative mass.
    Raises ValueError when a density is not finite and > 0."""
    points, tets = checked_tet_arrays(points, tets)
    density = np.asarray(density, np.float64)
    if density.ndim and density.shape != (len(tets),):
        raise ValueError(f"density has shape {density.shape}; give one number, or one for each of the {len(tets)} tets")
    if not (np.isfinite(density) & (density > 0)).all():
        raise ValueError(f"density is {density.flat[np.argmin(np.isfinite(density) & (density > 0))]:g}; "
                         "it must be finite and > 0 [kg/m^3]")
    share = np.full(4, 0.25) if tets.shape[1] == 4 else np.repeat([1.0 / 36.0, 4.0 / 27.0], [4, 6])
    mass = density * signed_tet_volumes(points, tets)
    return sum((np.bincount(tets[:, k], share[k] * mass, len(points)) for k in range(len(share))), np.zeros(len(points)))


def occurrences_of_points(tets: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Places where each of n points occurs: those of point p are found[starts[p]:starts[p + 1]], ascending, as k tet + corner
    for rows of k corners."""
    return incident_rows(np.asarray(tets).reshape(-1, 1), n)


# Faces and edges

def _sort_three_arrays(a, b, c):
    """Three arrays as smallest, middle, largest."""
    low, high = np.minimum(a, b), np.maximum(a, b)
    return np.minimum(low, c), np.maximum(low, np.minimum(high, c)), np.maximum(high, c)


def _face_order(low, middle, high, n: int) -> tuple[np.ndarray, np.ndarray]:
    """An order that brings equal triples together, and which of its neighbours are equal. One key of 63 bits, or, past two
    million points, a slower sort of three."""
    if n < 2**21:
        key = (low.astype(np.int64) * n + middle) * n + high
        order = np.argsort(key)
        key = key[order]
        return order, key[1:] == key[:-1]
    order = np.lexsort((high, middle, low))
    return order, np.logical_and.reduce([s[order][1:] == s[order][:-1] for s in (low, middle, high)])


def tet_surface_triangles(tets) -> np.ndarray:
    """Triangles that belong to one tet only, (f, 3) int32, counter-clockwise from outside, in the order of their tets.
    A ten-node mesh gives its corners. A face of three or more tets (no solid has one) gives none."""
    tets = np.asarray(tets)[:, :4]
    n = int(tets.max(initial=0)) + 1
    three = [np.concatenate([tets[:, face[k]] for face in FACES]) for k in range(3)]
    low, middle, high = _sort_three_arrays(*three)
    order, same = _face_order(low, middle, high, n)
    alone = np.ones(len(order), bool)
    alone[1:] &= ~same
    alone[:-1] &= ~same
    found = order[alone]
    found = found[np.argsort(found % len(tets) * 4 + found // len(tets))] if len(found) else found
    return np.stack([corner[found] for corner in three], axis=1).astype(np.int32)


def _edge_keys(tets: np.ndarray, n: int) -> np.ndarray:
    """Lower point times n plus higher point of every edge of every tet, (6 t,), edge by edge in the order of EDGES."""
    pairs = [(tets[:, i].astype(np.int64), tets[:, j].astype(np.int64)) for i, j in EDGES]
    return np.concatenate([np.minimum(a, b) * n + np.maximum(a, b) for a, b in pairs])


def _first_of_equal(ordered: np.ndarray) -> np.ndarray:
    """Which of ascending values are the first of their kind."""
    first = np.ones(len(ordered), bool)
    first[1:] = ordered[1:] != ordered[:-1]
    return first


def edges_of_tets(tets) -> np.ndarray:
    """Edges between corners, each once, (m, 2) int32, lower point first, ascending."""
    tets = np.asarray(tets)[:, :4]
    n = int(tets.max(initial=0)) + 1
    key = np.sort(_edge_keys(tets, n))
    key = key[_first_of_equal(key)]
    return np.stack([key // n, key % n], axis=1).astype(np.int32)


def ten_node_mesh(points, tets) -> tuple[np.ndarray, np.ndarray]:
    """The ten-node mesh: points followed by the middle of each edge in the order of `edges_of_tets`, and rows of ten, (t, 10)
    int32: four corners, then the middles of 01, 12, 02, 03, 13, 23. Tets that share an edge share its node; edges stay
    straight."""
    points, tets = checked_tet_arrays(points, tets)
    if tets.shape[1] != 4:
        raise ValueError(f"tets have {tets.shape[1]} nodes already; give rows of 4")
    n = max(len(points), 1)
    keys = _edge_keys(tets, n)
    order = order_of(keys)
    ordered = keys[order]
    first = _first_of_equal(ordered)
    node = np.empty(len(keys), np.int64)
    node[order] = len(points) + np.cumsum(first) - 1
    key = ordered[first]
    middles = 0.5 * (points[key // n] + points[key % n])
    return np.concatenate([points, middles]), np.column_stack([tets, node.reshape(6, -1).T]).astype(np.int32)


# Fineness

def cells_across_thickness(tets, most: int = ACROSS + 1) -> int:
    """Number of cells across the thickest part, at most (the true number may be one less): 1 + twice the edges from the
    surface to the point farthest inside, for cells like those of `wsim.geometry.tetra.lattice` "five"; "bcc" has an edge more
    for each two cells. Counting stops at `most`."""
    tets = np.asarray(tets)[:, :4]
    reached = np.ones(int(tets.max(initial=-1)) + 1, bool)
    reached[tets.ravel()] = False
    reached[tet_surface_triangles(tets).ravel()] = True
    count = 1
    while count < most and not reached.all():
        near = tets[reached.take(tets).any(axis=1)].ravel()
        if reached[near].all():
            break
        reached[near] = True
        count += 2
    return min(count, most)


def describe_coarseness(count: int) -> str:
    """Text about what a mesh so many cells across (of linear tets) gets wrong, or ""."""
    if count >= ACROSS:
        return ""
    return (f"{count} cell{'s' * (count > 1)} across: it bends {DEFLECTION[max(count, 1)]:.0%} as far as it should; give "
            f"{ACROSS} cells or more across its thickness, or quadratic tets")
