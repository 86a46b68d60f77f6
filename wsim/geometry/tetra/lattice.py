"""Tetrahedra on lattices: boxes of five-tet cells or of a BCC lattice, and the cells of many integer boxes. NumPy only.

    five   each cube is a regular tet of quality 1 and four corner tets of quality 0.84; every second cube is mirrored, so
           that the diagonals of shared faces agree and no direction is preferred
    bcc    corners and centres of the cubes; each tet joins two neighbouring centres to an edge between them: all equal,
           quality 0.95 (Molino, Bridson, Teran, Fedkiw 2003), 12 a cube; at the faces of the box pyramids, cut in two, 0.76

Quality: mean ratio, `wsim.geometry.tetra.tets.mean_ratio_quality`. Rounding aside every cell of a box is the same; sizes in
[m].
"""

from collections.abc import Iterator

import numpy as np

KINDS = ("five", "bcc")
MOST = 2**31 // 16      # cells of a box: 16 points or tets for each must have a 32-bit number
CORNERS = np.array([[c >> 2 & 1, c >> 1 & 1, c & 1] for c in range(8)])       # of a cube: number 4 x + 2 y + z


def _corners_of_five_tets() -> np.ndarray:
    """Corners of the five tets of an even and of an odd cube, (2, 5, 4); the first is the regular one in the middle."""
    even = np.array([[0, 3, 5, 6], [4, 0, 5, 6], [2, 0, 3, 6], [1, 0, 3, 5], [7, 3, 5, 6]])
    both = np.stack([even, 7 - even])
    X = CORNERS[both]
    turned = np.linalg.det(X[..., 1:, :] - X[..., :1, :]) < 0
    both[turned] = both[turned][:, [0, 1, 3, 2]]
    return both


FIVE = _corners_of_five_tets()


def counts_of(cells) -> np.ndarray:
    """Three numbers of cells. Raises ValueError unless whole, >= 1 and not too many."""
    found = np.broadcast_to(np.asarray(cells, np.float64), (3,)) if np.ndim(cells) == 0 or np.shape(cells) == (3,) else None
    if found is None or not np.all(np.isfinite(found) & (found >= 1) & (found == np.floor(found))):
        raise ValueError(f"cells is {cells}; it must be a whole number >= 1, or three, one for each side")
    if found.prod() > MOST:
        raise ValueError(f"cells is {cells}: {found.prod():.3g} cells; at most {MOST} fit 32-bit indices")
    return found.astype(np.int64)


def integer_grid(counts) -> np.ndarray:
    """Every integer triple below counts, z fastest, (product, 3)."""
    return np.stack(np.unravel_index(np.arange(int(np.prod(counts))), tuple(counts)), axis=1)


def cube_points(cells: np.ndarray, counts) -> np.ndarray:
    """Numbers of the eight corners of cubes (m, 3) in a lattice of `counts` cubes, (m, 8), in the order of CORNERS."""
    row, layer = counts[2] + 1, (counts[1] + 1) * (counts[2] + 1)
    return (cells @ (layer, row, 1))[:, None] + CORNERS @ (layer, row, 1)


def five_tets_of_cubes(cells: np.ndarray, counts) -> np.ndarray:
    """The five tets of each of the cubes (m, 3), (m, 5, 4), as numbers of lattice points; the middle one first."""
    tets, ids, odd = np.empty((len(cells), 5, 4), np.int64), cube_points(cells, counts), cells.sum(axis=1) % 2 == 1
    tets[~odd], tets[odd] = ids[~odd][:, FIVE[0]], ids[odd][:, FIVE[1]]
    return tets


def tet_box(size, cells, kind: str = "five") -> tuple[np.ndarray, np.ndarray]:
    """A box of sides `size` (three [m]) about the origin, cut in `cells` (one number or three) along each side: points (n, 3)
    float64 and tets (t, 4) int32 of positive volume.

    The first (cx + 1)(cy + 1)(cz + 1) points are the corners of the cells, z fastest, then y; "bcc" adds the centres of the
    cells in the same order. Tets: 5 a cell, or 4 for each square
    between two cells and 2 for each in the surface.
    Raises ValueError naming the argument."""
    size = np.asarray(size, np.float64)
    if size.shape != (3,) or not np.all(np.isfinite(size) & (size > 0)):
        raise ValueError(f"size is {size.tolist()}; it must be three lengths, finite and > 0 [m]")
    if kind not in KINDS:
        raise ValueError(f"kind is {kind!r}; allowed is one of {', '.join(KINDS)}")
    counts = counts_of(cells)
    points = (integer_grid(counts + 1) / counts - 0.5) * size
    every = integer_grid(counts)
    if kind == "five":
        return points, five_tets_of_cubes(every, counts).reshape(-1, 4).astype(np.int32)
    centres = ((every + 0.5) / counts - 0.5) * size
    return np.concatenate([points, centres]), _bcc_tets(every, counts).astype(np.int32)


def _bcc_tets(cells: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Tets of the BCC lattice in a box, (t, 4): centres are numbered after the corners."""
    ids = cube_points(cells, counts)
    centre = int(np.prod(counts + 1)) + np.arange(len(cells))
    odd, tets = cells.sum(axis=1) % 2 == 1, []
    strides = (counts[1] * counts[2], counts[2], 1)
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        ring = []                                            # of the upper face, counter-clockwise about the axis
        for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
            corner = np.zeros(3, int)
            corner[axis], corner[u], corner[v] = 1, a, b
            ring.append(int(corner @ (4, 2, 1)))
        inner = cells[:, axis] < counts[axis] - 1
        for k in range(4):
            i, j = ring[k], ring[(k + 1) % 4]
            tets.append(np.stack([centre[inner], centre[inner] + strides[axis], ids[inner, i], ids[inner, j]], axis=1))
        low = [corner ^ (4 >> axis) for corner in ring[::-1]]        # of the lower face, seen from below
        for at, loop in ((~inner, ring), (cells[:, axis] == 0, low)):
            for turn in (0, 1):                                      # every second square has the other diagonal
                some = at & (odd == bool(turn))
                r = [ids[some, loop[(k + turn) % 4]] for k in range(4)]
                tets += [np.stack([centre[some], r[0], r[1], r[2]], axis=1), np.stack([centre[some], r[0], r[2], r[3]], axis=1)]
    return np.concatenate(tets)


def cells_of_integer_boxes(low: np.ndarray, high: np.ndarray, most: int = 1 << 19) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Every cell of integer boxes low to high, both counted, (m, d): pairs (box, (k,); cell, (k, d)), in pieces of about
    `most` (a single box comes whole). Boxes with high < low have no cells."""
    sizes = np.maximum(high - low + 1, 0)
    counts = sizes.prod(axis=1)
    total = np.cumsum(counts)
    first = 0
    while first < len(counts):
        begun = total[first] - counts[first]
        last = max(int(np.searchsorted(total, begun + most, side="right")), first + 1)
        some = np.arange(first, last)
        owner = np.repeat(some, counts[some])
        rest = np.arange(len(owner)) + begun - (total - counts)[owner]
        cell = np.empty((len(owner), low.shape[1]), np.int64)
        for k in range(low.shape[1] - 1, -1, -1):
            size = sizes[owner, k]
            cell[:, k] = low[owner, k] + rest % size
            rest = rest // size
        if len(owner):
            yield owner, cell
        first = last
