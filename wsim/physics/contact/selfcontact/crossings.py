"""Triangles that intersect, decided exactly on the coordinates as they are stored.

Two triangles that share no point intersect where an edge of one meets the other, so all is decided by signs of

    orient(a, b, c, d) = (b - a) x (c - a) . (d - a)

Floats are dyadic rationals: times a power of two they are whole numbers, in which Python's arithmetic knows no rounding.
Candidates come from a grid; those that one of the 11 axes of the separating axis theorem (2 normals, 9 products of edges)
separates in float64 by more than a bound of its rounding are left out first (or one of 6 in their planes). Touching counts as
intersecting. Triangles that share points intersect where they have more in common than these: then the edge of one that is
opposite to the shared point meets the other. Independent of the device code whose results it judges; for tests and for what
an author's start looks like.
"""

from collections.abc import Iterable, Iterator

import numpy as np

CELLS = 2.0            # edge of a cell of the grid over the median extent of a triangle, or more:
EACH = 16.0            # cells that a triangle may be in, on average
SOME = 1 << 18         # pairs of boxes that are looked at together
ROUNDING = 64.0 * 2.0 ** -52           # of a projection, over what it is a sum of


def crossed_triangles(points: np.ndarray, triangles: np.ndarray, neighbours: bool = True, own: int | None = None,
                      most: int | None = None, among: Iterable[np.ndarray] | None = None) -> np.ndarray:
    """Pairs of triangles that intersect, (k, 2), ascending. points: (n, 3), any unit; triangles: (t, 3). neighbours: those that
    share points too, all of which are looked at exactly: 0.3 ms a triangle, where the others take a tenth. own: how many of the
    first are looked for; pairs of two others are left out. most: where floats leave more pairs than this, so many of them are
    returned as they are, and none is looked at exactly. among: pairs whose boxes overlap, some at a time, if they are known."""
    triangles = np.asarray(triangles, np.int64).reshape(-1, 3)
    corners = np.asarray(points, np.float64)[triangles]
    pairs = np.zeros((0, 2), np.int64)
    for some in box_overlap_batches(corners.min(axis=1), corners.max(axis=1)) if among is None else among:
        if own is not None:
            some = some[some[:, 0] < own]
        if not neighbours:
            some = some[~share_common_point(triangles, some)]
        pairs = unique_pairs([pairs, some[separation_unclear(corners, triangles, some)]], len(triangles))
        if most is not None and len(pairs) > most:
            return pairs[:most + 1]
    whole = _exact_integers(corners[np.unique(pairs)]) if len(pairs) else np.zeros((0, 3, 3), object)
    place = {int(t): k for k, t in enumerate(np.unique(pairs))}
    hit = [triangles_intersect_exactly(whole[place[int(a)]], whole[place[int(b)]], triangles[a], triangles[b])
           for a, b in pairs]
    return pairs[np.array(hit, bool)] if len(pairs) else pairs


def overlapping_boxes(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Pairs of boxes that overlap, (k, 2), first < second, ascending. low, high: corners, (n, 3)."""
    return unique_pairs([np.zeros((0, 2), np.int64), *box_overlap_batches(low, high)], len(low))


def unique_pairs(pairs: list[np.ndarray], n: int) -> np.ndarray:
    """Pairs of numbers below n, each once, ascending, (k, 2)."""
    a, b = np.concatenate(pairs).T
    return np.stack(np.divmod(np.unique(a * n + b), n), axis=1)


def box_overlap_batches(low: np.ndarray, high: np.ndarray) -> Iterator[np.ndarray]:
    """The same, some at a time, (k, 2); a pair may come again."""
    if len(low) < 2:
        return
    box, key = _box_grid_cells(low, high)
    found, offset = [], 1
    while True:                                            # neighbours in the sorted list, offset apart, of the same cell
        same = np.flatnonzero(key[offset:] == key[:-offset])
        if not len(same):
            break
        a, b = box[same], box[same + offset]
        over = ((low[a] <= high[b]) & (low[b] <= high[a])).all(axis=1)
        found.append(np.stack([a[over], b[over]], axis=1))
        offset += 1
        if sum(map(len, found)) > SOME:
            yield unique_pairs(found, len(low))
            found = []
    if found:
        yield unique_pairs(found, len(low))


def _box_grid_cells(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Boxes and the cells that they are in, ordered by cell and box; so large that a box is in EACH of them on average."""
    size = CELLS * max(float(np.median((high - low).max(axis=1))), 1e-30 + 1e-9 * float(np.ptp(low)))
    while (np.floor((high - low) / size) + 2.0).prod(axis=1).mean() > EACH:
        size *= 2.0
    first = np.floor((low - low.min(axis=0)) / size).astype(np.int64)
    count = np.floor((high - low.min(axis=0)) / size).astype(np.int64) - first + 1
    number = count.prod(axis=1)
    box = np.repeat(np.arange(len(low)), number)
    k = np.arange(len(box)) - np.repeat(np.cumsum(number) - number, number)
    c = count[box]
    cell = first[box] + np.stack([k % c[:, 0], k // c[:, 0] % c[:, 1], k // (c[:, 0] * c[:, 1])], axis=1)
    _, key = np.unique(cell, axis=0, return_inverse=True)
    order = np.lexsort((box, key.ravel()))
    return box[order], key.ravel()[order]


def share_common_point(triangles: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """True for pairs that name a common point, (k,)."""
    return (triangles[pairs[:, 0]][:, :, None] == triangles[pairs[:, 1]][:, None, :]).any(axis=(1, 2))


def separation_unclear(corners: np.ndarray, triangles: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """True for pairs that float64 does not separate for certain, (k,)."""
    p, q = corners[pairs[:, 0]], corners[pairs[:, 1]]
    p, q = p - p[:, :1], q - p[:, :1]                      # exact for float32 of like size; else within the bound below
    edges = [np.roll(t, -1, axis=1) - t for t in (p, q)]
    axes = [np.cross(e[:, 0], e[:, 1]) for e in edges]
    axes += [np.cross(edges[0][:, i], edges[1][:, j]) for i in range(3) for j in range(3)]
    axes += [np.cross(n, e[:, i]) for n, e in zip(axes[:2], edges, strict=True) for i in range(3)]  # of one plane
    scale = np.abs(p).max(axis=(1, 2)) + np.abs(q).max(axis=(1, 2)) + np.abs(corners[pairs[:, 0], 0]).max(axis=1) * 2.0 ** -20
    apart = np.zeros(len(pairs), bool)
    for axis in axes:
        a, b = np.einsum("kic,kc->ki", p, axis), np.einsum("kic,kc->ki", q, axis)
        slack = ROUNDING * scale * np.maximum(np.abs(axis).max(axis=1), scale * scale)
        apart |= (a.min(axis=1) > b.max(axis=1) + slack) | (b.min(axis=1) > a.max(axis=1) + slack)
    return share_common_point(triangles, pairs) | ~apart


def _exact_integers(values: np.ndarray) -> np.ndarray:
    """Values times one power of two, as whole numbers of Python, of the same shape."""
    mantissa, exponent = np.frexp(values)
    least = int(exponent[values != 0.0].min(initial=0)) - 53
    whole = (mantissa * 2.0 ** 53).astype(np.int64).astype(object)
    return whole * np.vectorize(lambda e: 1 << max(int(e) - 53 - least, 0), otypes=[object])(exponent)


def triangles_intersect_exactly(s: np.ndarray, t: np.ndarray, names_s, names_t) -> bool:
    """True if two triangles have more in common than the points that both name. s, t: corners, whole numbers, (3, 3)."""
    shared = [(i, list(names_t).index(name)) for i, name in enumerate(names_s) if name in names_t]
    if not shared:
        return any(_segment_meets_triangle(s[i], s[i - 1], t) or _segment_meets_triangle(t[i], t[i - 1], s) for i in range(3))
    if len(shared) == 3:
        return True
    if len(shared) == 2:                                   # hinged: they meet where one lies folded onto the other
        i, j = 3 - sum(i for i, _ in shared), 3 - sum(j for _, j in shared)
        n = _integer_cross(s[shared[1][0]] - s[shared[0][0]], s[i] - s[shared[0][0]])
        m = _integer_cross(s[shared[1][0]] - s[shared[0][0]], t[j] - s[shared[0][0]])
        return _exact_orientation(s[0], s[1], s[2], t[j]) == 0 and _integer_dot(n, m) > 0
    i, j = shared[0]
    return _segment_meets_triangle(s[i - 1], s[i - 2], t) or _segment_meets_triangle(t[j - 1], t[j - 2], s)


def _integer_cross(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]], object)


def _integer_dot(a, b) -> int:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _exact_orientation(a, b, c, d) -> int:
    """Sign of six times the volume of a tet."""
    value = _integer_dot(_integer_cross(b - a, c - a), d - a)
    return (value > 0) - (value < 0)


def _segment_meets_triangle(p, q, t) -> bool:
    """True if the closed segment p q and the closed triangle t have a point in common."""
    n = _integer_cross(t[1] - t[0], t[2] - t[0])
    if not any(n):                                         # a triangle without area is its longest edges
        return any(_segments_intersect(p, q, t[i], t[i - 1]) for i in range(3))
    above, below = _integer_dot(n, p - t[0]), _integer_dot(n, q - t[0])
    if (above > 0) == (below > 0) and above != 0 and below != 0:
        return False
    if above == 0 and below == 0:
        axis = max(range(3), key=lambda k: abs(n[k]))      # seen along it nothing of the plane is lost
        return (_inside_triangle_exactly(p, t, axis) or _inside_triangle_exactly(q, t, axis)
                or any(_segments_intersect(p, q, t[i], t[i - 1]) for i in range(3)))
    signs = {_exact_orientation(p, q, t[i], t[(i + 1) % 3]) for i in range(3)}
    return not {1, -1} <= signs


def _inside_triangle_exactly(p, t, axis: int) -> bool:
    """True if a point of a triangle's plane lies in it."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    signs = set()
    for i in range(3):
        a, b = t[i], t[(i + 1) % 3]
        turn = (b[u] - a[u]) * (p[v] - a[v]) - (b[v] - a[v]) * (p[u] - a[u])
        signs.add((turn > 0) - (turn < 0))
    return not {1, -1} <= signs


def _segments_intersect(p, q, a, b) -> bool:
    """True if two closed segments have a point in common; either may be a point."""
    d, e, r = q - p, b - a, a - p
    n = _integer_cross(d, e)
    if any(n):
        if _integer_dot(n, r) != 0:
            return False                                   # not in one plane
        nn, s, u = _integer_dot(n, n), _integer_dot(_integer_cross(r, e), n), _integer_dot(_integer_cross(r, d), n)
        return 0 <= s <= nn and 0 <= u <= nn
    line = d if any(d) else e
    if any(_integer_cross(r, line)):
        return False                                       # parallel, on two lines
    if not any(line):
        return not any(r)
    places = [_integer_dot(line, x - p) for x in (p, q, a, b)]
    return max(places[0], places[1]) >= min(places[2], places[3]) and max(places[2], places[3]) >= min(places[0], places[1])
