"""Exact intersections of triangles: what counts, where floats are not enough, and against random draws by another formula."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from wsim.physics.contact.selfcontact.crossings import crossed_triangles, overlapping_boxes

FLAT = [(0, 0, 0), (4, 0, 0), (0, 4, 0)]
ULP = float(np.spacing(np.float32(1.0)))


def found(*triangles, named=None) -> int:
    """Number of intersecting pairs of triangles given by their corners."""
    points = np.array(triangles, np.float32).reshape(-1, 3)
    return len(crossed_triangles(points, np.arange(len(points)).reshape(-1, 3) if named is None else np.array(named)))


@pytest.mark.parametrize(("other", "hits"), [
    ([(1, 1, -1), (1, 1, 1), (9, 9, 1)], 1),               # pierced
    ([(1, 1, 1), (2, 1, 1), (1, 2, 1)], 0),                # above
    ([(1, 1, 0), (2, 1, 1), (1, 2, 1)], 1),                # a corner on the face
    ([(1, 1, ULP), (2, 1, 1), (1, 2, 1)], 0),              # a corner just above the face
    ([(5, 0, 0), (9, 0, 0), (5, -1, 3)], 0),               # collinear with an edge, apart
    ([(4, 0, 0), (9, 0, 0), (5, -1, 3)], 1),               # collinear with an edge, end to end
    ([(1, 1, 0), (2, 1, 0), (1, 2, 0)], 1),                # coplanar, inside
    ([(-1, -1, 0), (9, -1, 0), (-1, 9, 0)], 1),            # coplanar, around
    ([(5, 1, 0), (9, 1, 0), (5, 5, 0)], 0),                # coplanar, apart
    ([(3, 3, 0), (9, 3, 0), (3, 9, 0)], 0),                # coplanar, boxes overlap, apart
    ([(-1, 1, 0), (9, 1, 0), (9, 1.5, 0)], 1),             # coplanar, no corner inside of the other
    ([(2, 2, 0), (3, 3, 0), (3, 3, 1)], 1),                # a corner on an edge
    ([(1, 1, -1), (1, 1, 1), (1, 1, 2)], 1),               # no area, through the face
    ([(1, 1, 1), (1, 1, 2), (1, 1, 3)], 0),                # no area, above
    ([(3, 3, -1), (3, 3, 1), (3, 3, 2)], 0),               # no area, beside
])
def test_what_counts_as_intersecting(other, hits):
    for turn in range(3):
        axes = np.roll(np.arange(3), turn)
        assert found(np.array(FLAT)[:, axes], np.array(other)[:, axes]) == hits
        assert found(np.array(other)[:, axes], np.array(FLAT)[:, axes]) == hits


@pytest.mark.parametrize(("points", "names", "hits"), [
    ([*FLAT, (4, 4, 0)], [(0, 1, 2), (1, 3, 2)], 0),                         # flat quad
    ([*FLAT, (1, 1, 0)], [(0, 1, 2), (1, 2, 3)], 1),                         # folded exactly onto itself
    ([*FLAT, (1, 1, 1e-30)], [(0, 1, 2), (1, 2, 3)], 0),                     # folded, and just above
    ([*FLAT, (-1, 0, 0), (0, -1, 0)], [(0, 1, 2), (0, 3, 4)], 0),            # a fan around a point
    ([*FLAT, (1, 1, 1), (1, 1, -1)], [(0, 1, 2), (0, 3, 4)], 1),             # one point shared, pierced
    ([*FLAT, (1, 1, 0), (9, 9, 9)], [(0, 1, 2), (0, 3, 4)], 1),              # one point shared, an edge within the face
])
def test_triangles_that_share_points_intersect_where_they_have_more_in_common(points, names, hits):
    assert len(crossed_triangles(np.array(points, np.float32), np.array(names))) == hits


def test_slivers_a_kilometre_away_are_decided_in_whole_numbers():
    """Edges of 1 mm at 1000 m, where one rounding of float32 is 61 um: by one of them the corner is above the face."""
    for lift, hits in ((0.0, 1), (1.0, 0)):
        one = np.float32(1000.0)
        up = np.spacing(one) * np.float32(lift)
        flat = np.array([(one, one, one), (one + 1e-3, one, one), (one, one + 1e-3, one)], np.float32)
        other = np.array([(one + 2.5e-4, one + 2.5e-4, one + up), (one, one, one + 1e-2), (one + 1e-3, one, one + 1e-2)],
                         np.float32)
        assert found(flat, other) == hits


def test_random_triangles_against_rational_arithmetic_of_another_formula():
    """Small whole coordinates: many draws are coplanar, collinear or degenerate. A point of an edge in a triangle is sought by
    solving for its place in fractions, here of triangles with area and edges that are not parallel to them."""
    rng = np.random.default_rng(3)
    seen = set()
    for _ in range(300):
        p = rng.integers(0, 4, (2, 3, 3))
        if not all(np.any(np.cross(t[1] - t[0], t[2] - t[0])) for t in p):
            continue
        hit = any(_meets(s[i], s[i - 1], t) for s, t in ((p[0], p[1]), (p[1], p[0])) for i in range(3))
        coplanar = not any(int(np.dot(np.cross(p[0][1] - p[0][0], p[0][2] - p[0][0]), c - p[0][0])) for c in p[1])
        if coplanar:
            continue
        assert bool(found(p[0], p[1])) == hit, p
        seen.add(hit)
    assert seen == {True, False}


def _meets(p, q, t) -> bool:
    """True if p + s (q - p) = a + u e + v f has a solution in the triangle, by Cramer's rule in fractions."""
    e, f, d, r = t[1] - t[0], t[2] - t[0], p - q, p - t[0]
    volume = int(np.dot(np.cross(e, f), d))
    if not volume:
        return False                                       # parallel to it: the other edges tell
    u, v, s = (Fraction(int(np.dot(np.cross(a, b), c)), volume) for a, b, c in ((r, f, d), (e, r, d), (e, f, r)))
    return 0 <= s <= 1 and u >= 0 and v >= 0 and u + v <= 1


def test_candidates_are_all_overlapping_boxes():
    rng = np.random.default_rng(1)
    low = rng.uniform(0, 1, (80, 3))
    high = low + rng.uniform(0, 0.4, (80, 3))
    brute = [(a, b) for a, b in product(range(80), repeat=2)
             if a < b and (low[a] <= high[b]).all() and (low[b] <= high[a]).all()]
    assert np.array_equal(overlapping_boxes(low, high), np.array(sorted(brute)))


def test_triangles_of_sizes_a_million_apart_are_found_as_by_all_pairs():
    """A grid by the median would have 1e12 cells in a large one."""
    rng = np.random.default_rng(5)
    middle, size = rng.uniform(size=(60, 3)), np.where(np.arange(60) < 50, 1e-7, 1.0)
    corners = middle[:, None] + size[:, None, None] * rng.normal(size=(60, 3, 3))
    low, high = corners.min(axis=1), corners.max(axis=1)
    over = (low[:, None] <= high[None]).all(axis=2) & (low[None] <= high[:, None]).all(axis=2)
    np.testing.assert_array_equal(overlapping_boxes(low, high), np.argwhere(np.triu(over, 1)))


def test_beyond_a_number_of_pairs_none_is_looked_at():
    triangles = np.random.default_rng(6).uniform(size=(60, 3, 3))
    points, named = triangles.reshape(-1, 3), np.arange(180).reshape(-1, 3)
    every = crossed_triangles(points, named)
    assert len(crossed_triangles(points, named, most=7)) == 8 < len(every)
    np.testing.assert_array_equal(crossed_triangles(points, named, most=1770), every)
