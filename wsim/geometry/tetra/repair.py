"""What is wrong with a mesh of tetrahedra, and the winding put right. NumPy only.

Points and tets as in `wsim.geometry.tetra.tets`. A million tets take about a second: equal rows are looked for by sorting one
64-bit number of each, and looked at only where two numbers agree.
"""

from typing import NamedTuple

import numpy as np

from wsim.geometry.tetra.tets import tet_arrays, volumes_and_squared_edges
from wsim.geometry.topology import distinct_rows, order_of

# Least volume of a rest tet over the cube of its longest edge (a regular tet: 0.12). At the bound its height is some 6e-6 of
# the edge, and points in float32, good to 6e-8 of the edge at best, move it by 1 %: below, the rest shape is rounding, and
# Dm^-1 blows such rounding up to a strain of 1 % and more. Raising it refuses slivers that would only be slow.
FLAT = 1e-6


class TetFlaw(NamedTuple):
    """One kind of flaw: the first tet (or point: `text` says which) that has it, what was found and the mend."""
    element: int
    text: str
    fatal: bool         # no simulation is possible


def repair_tets(points, tets) -> tuple[np.ndarray, np.ndarray, list[TetFlaw]]:
    """Tets with positive volume where they have any, (t, 4) int32; the numbers of those turned inside out before, whose last
    two corners were swapped, ascending; and every flaw left, fatal ones first.

    Fatal: points not finite, indices out of range, a tet that names a point twice, flat tets (see FLAT), duplicate tets,
    no tet. Not fatal: points in no tet, points where another one is. The arguments stay as they are.
    Raises ValueError only for arrays of another shape or type."""
    points, tets = tet_arrays(points, tets)
    if tets.shape[1] != 4:
        raise ValueError(f"tets have {tets.shape[1]} nodes; give rows of 4 "
                         "(wsim.geometry.tetra.tets.ten_node_mesh adds the middles)")
    n, tets = len(points), tets.astype(np.int64)
    finite = np.isfinite(points).all(axis=1)
    outside = ((tets < 0) | (tets >= n)).any(axis=1)
    pairs = [(i, j) for i in range(4) for j in range(i)]
    twice = np.logical_or.reduce([tets[:, i] == tets[:, j] for i, j in pairs])
    sound = ~(outside | twice)
    sound[sound] = finite.take(tets[sound]).all(axis=1)
    turned, thin = _inverted_and_flat_tets(points, tets, sound)
    tets[turned] = tets[turned][:, [0, 1, 3, 2]]
    copy, first = _duplicate_tets(tets, ~outside)
    flaws = [*_flaw_of_several(~finite, "point", "not finite; give each three finite coordinates"),
             *_flaw_of_several(outside, "tet", f"naming points that there are not; allowed are 0 to {n - 1}"),
             *_flaw_of_several(twice & ~outside, "tet", "naming a point twice; remove such tets"),
             *_flaw_of_several(thin, "tet",
                               f"flat: volume below {FLAT:g} of the longest edge cubed; remove them, or move their "
                               "corners apart"),
             *_flaw_of_several(copy, "tet", f"given before (the first as tet {first}); remove the copies")]
    if len(tets) == 0:
        flaws.append(TetFlaw(0, "there is no tet; a body needs at least one", True))
    used = np.zeros(n, bool)
    used[tets[~outside].ravel()] = True
    flaws += _flaw_of_several(~used, "point", "in no tet; left out of the motion (remove them)", False)
    twin, other = _coincident_points(points, finite)
    flaws += _flaw_of_several(twin, "point",
                              f"where another one is (the first at point {other}): the body is cut there (weld them)", False)
    return tets.astype(np.int32) if n < 2**31 else tets, np.flatnonzero(turned), flaws


def _inverted_and_flat_tets(points: np.ndarray, tets: np.ndarray, sound: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which of the sound tets are turned inside out, and which are flat, (t,) bool."""
    turned, thin = np.zeros(len(tets), bool), np.zeros(len(tets), bool)
    rows = tets if sound.all() else tets[sound]
    with np.errstate(over="ignore", invalid="ignore"):                  # finite coordinates may have infinite products
        volume, squares = volumes_and_squared_edges(points, rows)
        bound = FLAT * squares.max(axis=0) ** 1.5
        turned[sound] = volume < -bound
        thin[sound] = ~(np.abs(volume) > bound) | ~np.isfinite(volume)
    return turned & ~thin, thin


def _hash_of_rows(columns) -> np.ndarray:
    """One 64-bit number of each row of 64-bit columns; different rows share one with a chance of 5e-20 a pair."""
    key = np.zeros(len(columns[0]), np.uint64)
    for column in columns:
        key = (key ^ column) * np.uint64(0x9E3779B97F4A7C15)
        key ^= key >> np.uint64(29)
        key *= np.uint64(0xBF58476D1CE4E5B9)
        key ^= key >> np.uint64(32)
    return key


def _duplicate_tets(tets: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, int]:
    """Which tets have the four points of an earlier one, (t,) bool, and the earlier one of the first."""
    copy = np.zeros(len(tets), bool)
    a, b, c, d = tets.T
    (a, b), (c, d) = (np.minimum(a, b), np.maximum(a, b)), (np.minimum(c, d), np.maximum(c, d))
    low, p, q, high = np.minimum(a, c), np.maximum(a, c), np.minimum(b, d), np.maximum(b, d)
    rows = (low, np.minimum(p, q), np.maximum(p, q), high)
    key = _hash_of_rows([row.astype(np.uint64) for row in rows])
    ordered = np.sort(key)
    if not (ordered[1:] == ordered[:-1]).any():
        return copy, -1
    order = np.argsort(key, kind="stable")
    same = np.logical_and.reduce([row[order][1:] == row[order][:-1] for row in rows])
    copy[order[1:][same]] = True
    copy &= valid
    if not copy.any():
        return copy, -1
    where = int(np.flatnonzero(order == np.argmax(copy))[0])
    return copy, int(order[where - 1])


def _coincident_points(points: np.ndarray, finite: np.ndarray) -> tuple[np.ndarray, int]:
    """Which finite points stand where an earlier one does, (n,) bool, and the earlier one of the first."""
    twin = np.zeros(len(points), bool)
    bits = np.ascontiguousarray(points[finite] + 0.0).view(np.uint64)           # + 0: -0.0 is 0.0
    ordered = np.sort(_hash_of_rows(list(bits.reshape(-1, 3).T)))
    if not (ordered[1:] == ordered[:-1]).any():
        return twin, -1
    numbers = np.flatnonzero(finite)
    place = distinct_rows(points[finite] + 0.0)[1]
    order = order_of(place)
    same = place[order][1:] == place[order][:-1]
    twin[numbers[order[1:][same]]] = True
    mine = np.flatnonzero(numbers == np.argmax(twin))[0]
    return twin, int(numbers[np.flatnonzero(place == place[mine])[0]])


def _flaw_of_several(which: np.ndarray, noun: str, text: str, fatal: bool = True) -> list[TetFlaw]:
    """A flaw that says how many and which is the first, or none."""
    count, first = int(which.sum()), int(np.argmax(which)) if which.any() else 0
    if count == 0:
        return []
    head = f"{noun} {first} is" if count == 1 else f"{count} {noun}s (first: {first}) are"
    return [TetFlaw(first, f"{head} {text}", fatal)]
