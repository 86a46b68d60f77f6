"""Colours: no point twice in one, near the lower bound in number, equal in size; orders: neighbours stay near."""

import numpy as np
import pytest

from wsim.geometry import color, ordering
from wsim.geometry.color_chains import kempe_chain as chain_back
from wsim.geometry.topology import edges_of_triangles, hinges_of_triangles


def grid_springs(side, seed=0):
    """Springs along rows, columns and both diagonals of a sheet, points and springs numbered at random: ids, places."""
    g = np.arange(side * side).reshape(side, side)
    pairs = [(g[:, :-1], g[:, 1:]), (g[:-1], g[1:]), (g[:-1, :-1], g[1:, 1:]), (g[1:, :-1], g[:-1, 1:])]
    ids = np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in pairs])
    rng = np.random.default_rng(seed)
    number = rng.permutation(side * side)
    places = np.zeros((side * side, 3))
    places[number, :2] = np.stack(np.divmod(np.arange(side * side), side), axis=1)
    return number[ids][rng.permutation(len(ids))], places


def grid_triangles(side, seed=0):
    g = np.random.default_rng(seed).permutation(side * side).reshape(side, side)
    corners = np.concatenate([np.stack([g[:-1, :-1], g[:-1, 1:], g[1:, 1:]], -1),
                              np.stack([g[:-1, :-1], g[1:, 1:], g[1:, :-1]], -1)])
    return corners.reshape(-1, 3)


def chain(n, seed=0):
    number = np.random.default_rng(seed).permutation(n)
    return np.stack([number[:-1], number[1:]], axis=1)


def clashes(ids, colours):
    """Pairs (colour, point) that occur in more than one constraint."""
    met = set()
    twice = 0
    for row, c in zip(ids.tolist(), colours.tolist(), strict=True):
        for p in set(row):
            twice += (c, p) in met
            met.add((c, p))
    return twice


def met_most(ids):
    return int(np.bincount(ids.ravel()).max())


SETS = {"springs": grid_springs(24)[0], "chain": chain(500),
        "cycle": np.stack([np.arange(99), (np.arange(99) + 1) % 99], axis=1),
        "edges": edges_of_triangles(grid_triangles(20)), "triangles": grid_triangles(20),
        "hinges": hinges_of_triangles(grid_triangles(20)),
        "points": np.arange(50)[:, None], "star": np.stack([np.zeros(300, int), np.arange(1, 301)], 1),
        "repeated": np.array([[0, 1]] * 70), "loops": np.array([[0, 0], [0, 1], [1, 1], [2, 2]]),
        "tetrahedra": np.random.default_rng(1).integers(0, 60, (400, 4)), "none": np.zeros((0, 2), int)}


@pytest.mark.parametrize("name", SETS)
def test_no_point_occurs_twice_in_a_colour(name):
    ids = SETS[name]
    colours = color.color_constraints(ids, 600)
    assert colours.shape == (len(ids),) and colours.dtype == np.int32
    assert clashes(ids, colours) == 0
    assert np.array_equal(np.unique(colours), np.arange(colours.max(initial=-1) + 1))           # no colour is empty


@pytest.mark.parametrize(("name", "more"), [("springs", 0), ("chain", 0), ("cycle", 1), ("edges", 0), ("triangles", 1),
                                            ("hinges", 2), ("points", 0), ("star", 0), ("repeated", 0)])
def test_colours_are_as_few_as_meet_at_a_point_or_nearly(name, more):
    """An odd cycle needs one more by its parity; triangles and hinges of a grid take one and two more."""
    ids = SETS[name]
    assert int(color.color_constraints(ids, 600).max()) + 1 <= met_most(ids) + more


@pytest.mark.parametrize("seed", range(4))
def test_springs_of_a_grid_take_eight_colours_whatever_the_numbers(seed):
    ids, _ = grid_springs(32, seed)
    colours = color.color_constraints(ids, 1024)
    assert int(colours.max()) + 1 == 8 and clashes(ids, colours) == 0


def test_a_multigraph_takes_no_more_than_shannons_bound():
    """Three bundles of k edges between three points need 3k colours, where 2k meet at a point (Shannon 1949)."""
    ids = np.repeat(np.array([[0, 1], [1, 2], [2, 0]]), 10, axis=0)
    colours = color.color_constraints(ids, 3)
    assert clashes(ids, colours) == 0 and int(colours.max()) + 1 == 30


@pytest.mark.parametrize("name", ["springs", "chain", "edges", "triangles", "hinges"])
def test_colours_have_about_equal_sizes(name):
    size = np.bincount(color.color_constraints(SETS[name], 600))
    assert size.min() >= 0.8 * size.mean() and size.max() <= 1.2 * size.mean()


def test_the_same_constraints_get_the_same_colours():
    ids, _ = grid_springs(40)
    assert np.array_equal(color.color_constraints(ids, 1600), color.color_constraints(ids.copy(), 1600))


@pytest.mark.parametrize(("ids", "words"), [
    ([[0, 5]], "0 to 4"), ([[-1, 2]], "0 to 4"), ([0, 1], "shape"), ([[]], "shape")])
def test_wrong_ids_are_refused(ids, words):
    with pytest.raises(ValueError, match=words):
        color.color_constraints(np.array(ids), 5)


def test_batches_hold_every_constraint_once_by_colour_then_by_lowest_point():
    ids, _ = grid_springs(20)
    order, starts = color.color_batches(ids, 400)
    assert np.array_equal(np.sort(order), np.arange(len(ids))) and starts[0] == 0 and starts[-1] == len(ids)
    for a, b in zip(starts[:-1], starts[1:], strict=True):
        batch = ids[order[a:b]]
        assert len(np.unique(batch)) == batch.size                              # no point twice
        assert (np.diff(batch.min(axis=1)) > 0).all()
    order, starts = color.color_batches(np.zeros((0, 3), int), 0)
    assert len(order) == 0 and starts.tolist() == [0]


@pytest.mark.parametrize("dimensions", [1, 2, 3])
def test_hilberts_curve_goes_from_cell_to_neighbouring_cell(dimensions):
    side = {1: 64, 2: 32, 3: 16}[dimensions]
    cells = np.stack(np.meshgrid(*[np.arange(side)] * dimensions, indexing="ij"), -1).reshape(-1, dimensions)
    points = np.zeros((len(cells), 3))
    points[:, :dimensions] = np.random.default_rng(2).permutation(cells)
    order = color.locality_order(points)
    assert np.array_equal(np.sort(order), np.arange(len(points)))
    assert (np.abs(np.diff(points[order], axis=0)).sum(axis=1) == 1).all()


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.ones((1, 3)), np.ones((7, 3)), np.full((3, 3), 1e30),
                                    np.array([[0, 0, 0], [1e-30, 0, 0], [1e-30, 0, 0]])])
@pytest.mark.parametrize("joined", [None, [[0, 1], [1, 2]]])
def test_orders_take_points_without_extent(points, joined):
    order = color.locality_order(points, None if joined is None or len(points) < 3 else np.array(joined))
    assert np.array_equal(np.sort(order), np.arange(len(points)))


def rolled_up(places):
    """A sheet wound to a spiral: it has rows in the mesh, not along any axis."""
    u, v, _ = places.T
    return np.stack([(5 + 0.2 * v) * np.cos(0.2 * v), (5 + 0.2 * v) * np.sin(0.2 * v), 3 * u], axis=1)


@pytest.mark.parametrize("shape", [lambda places: places, rolled_up])
def test_levels_of_a_grid_are_its_rows(shape):
    ids, places = grid_springs(24, seed=3)
    order = color.locality_order(shape(places), ids)
    rows = places[order][:, 0].reshape(24, 24)
    columns = places[order][:, 1].reshape(24, 24)
    assert ((rows == rows[:, :1]).all() and (np.abs(np.diff(columns, axis=1)) == 1).all()) or \
        ((columns == columns[:, :1]).all() and (np.abs(np.diff(rows, axis=1)) == 1).all())


def test_levels_reach_every_island_and_lone_points():
    ids, places = grid_springs(10)
    two = np.concatenate([ids, ids + 100])
    order = color.locality_order(np.concatenate([places, places + [50, 0, 0], [[1, 2, 3]]]), two)
    assert np.array_equal(np.sort(order), np.arange(201))


def sectors(ids, colours, width=32):
    """Mean number of 32-byte sectors of 12-byte points that `width` threads in a row touch at one end, of both ends."""
    low, high = ids.min(axis=1), ids.max(axis=1)
    order = np.lexsort((low, colours))
    total = 0.0
    for end in (low, high):
        rows = (12 * end[order][: len(order) // width * width]).reshape(-1, width)
        total += np.mean([len(np.union1d(row // 32, (row + 11) // 32)) for row in rows])
    return total


def test_colours_of_a_grid_in_levels_are_read_in_long_runs():
    """Threads in a row read points in a row: 13 sectors for 32 points at one end, and a few where rows end. Half of the
    sectors is wasted where each second point belongs to another thread, as with colours drawn at random."""
    ids, places = grid_springs(96, seed=5)
    place = np.empty(len(places), int)
    place[color.locality_order(places, ids)] = np.arange(len(places))
    numbered = place[ids]
    assert sectors(numbered, color.color_constraints(numbered, len(places))) < 1.7 * 2 * 13
    assert sectors(ids, color.color_constraints(ids, len(places))) > 2 * 2 * 13


def test_a_large_set_fills_its_first_colours_and_stays_free_of_clashes():
    ids, places = grid_springs(230)
    assert len(ids) > color.LARGE
    colours = color.color_constraints(ids, len(places))
    at = np.sort((colours[:, None] * len(places) + ids).ravel())
    assert (at[1:] != at[:-1]).all()
    size = np.bincount(colours)
    assert len(size) <= 9 and (np.diff(size) <= 0.02 * size[0]).all()


def test_an_irregular_mesh_goes_along_the_curve_a_regular_one_by_levels():
    ids, places = grid_springs(40)
    assert np.array_equal(color.locality_order(places, ids), ordering.level_order(places, ids))
    few = ids[np.random.default_rng(4).random(len(ids)) < 0.5]
    assert np.array_equal(color.locality_order(places, few), color.locality_order(places))


@pytest.mark.parametrize("seed", range(5))
def test_kempe_colours_an_edge_that_no_colour_is_free_for(seed):
    """Springs of a grid in eight colours; taken out one by one at random, each finds its way back."""
    ids, _ = grid_springs(16, seed)
    part = color._PartialColoring(np.ascontiguousarray(ids, np.int32), 256, seed)
    part.solve()
    assert part.count == 8
    gone = np.random.default_rng(seed).choice(len(ids), 50, replace=False).astype(np.int32)
    part._recolour_constraints(gone, None)
    stuck = part.fill(gone)
    chain_back(part.ids, stuck, 8, part.owner, part.mask, part.colours, part.rng)
    assert clashes(ids, np.where(part.colours < 0, 100 + np.arange(len(ids)), part.colours)) == 0
    assert (part.colours >= 0).mean() > 0.999
    for c in range(8):
        there = part.owner[c * 256:(c + 1) * 256]
        assert np.array_equal(np.flatnonzero(there >= 0), np.unique(ids[part.colours == c]))
        assert np.array_equal(part.mask >> np.uint32(c) & np.uint32(1), there >= 0)


def test_a_pattern_that_serves_no_one_is_not_taken():
    ids, _ = grid_springs(20)
    part = color._PartialColoring(np.ascontiguousarray(ids, np.int32), 400, 0)
    assert not part.adopt_woven_pattern() and (part.colours < 0).all() and not part.mask.any()


def test_the_pattern_of_rows_has_no_clash_inside():
    side = 20
    i = np.arange(side * side).reshape(side, side)
    pairs = [(i[:, :-1], i[:, 1:]), (i[:-1], i[1:])]
    ids = np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in pairs])
    pick = ordering.colours_by_level(ids, side * side)
    inside = ((ids % side > 0) & (ids % side < side - 1)).all(axis=1) & (ids > 2 * side).all(axis=1)
    assert pick[inside].max() == 3 and clashes(ids[inside], pick[inside]) == 0
