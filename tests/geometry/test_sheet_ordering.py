"""Orders and colours of flat sheets: rows in memory, two colours a distance, and a way back for everything else."""

import numpy as np
import pytest

from wsim.geometry import color as colors
from wsim.geometry.ordering import locality_order
from wsim.geometry.sheet_ordering import color_sheet, lowest_point_of_constraint, order_of_points
from wsim.scene import shapes

SHAPES = [(9, 9), (2, 30), (30, 2), (7, 12), (40, 25)]           # columns, rows


def turn(angle: float, axis) -> np.ndarray:
    """Rotation by Rodrigues' formula."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def grid(columns: int, rows: int, spacing=(0.1, 0.1), seed: int | None = 0):
    """Points, edges along rows and columns and both diagonals, numbered at random; name[r, c] is the point there."""
    n = columns * rows
    rng = np.random.default_rng(seed)
    name = (np.arange(n) if seed is None else rng.permutation(n)).reshape(rows, columns)
    points = np.zeros((n, 3))
    r, c = np.mgrid[:rows, :columns]
    points[name.ravel(), 0], points[name.ravel(), 1] = (spacing[0] * c).ravel(), (spacing[1] * r).ravel()
    pairs = [(name[:, :-1], name[:, 1:]), (name[:-1], name[1:]), (name[:-1, :-1], name[1:, 1:]),
             (name[:-1, 1:], name[1:, :-1])]
    edges = np.concatenate([np.stack([a.ravel(), b.ravel()], 1) for a, b in pairs])
    return points, rng.permutation(edges), name


def placed(points, edges):
    """Edges between places in memory."""
    order = order_of_points(points, edges)
    assert np.array_equal(np.sort(order), np.arange(len(points)))
    place = np.empty(len(points), np.int64)
    place[order] = np.arange(len(points))
    return place[edges], place


def proper(ids, found) -> bool:
    """No point occurs twice in a colour, and no colour is empty."""
    key = (found.astype(np.int64)[:, None] * (ids.max() + 1) + ids).ravel()
    return len(np.unique(key)) == key.size and np.array_equal(np.unique(found), np.arange(found.max() + 1))


@pytest.mark.parametrize("columns, rows", SHAPES)
@pytest.mark.parametrize("where", ["flat", "turned in its plane", "anywhere"])
def test_a_sheet_comes_out_in_rows_whatever_its_numbers_and_place(columns, rows, where):
    points, edges, name = grid(columns, rows)
    if where == "turned in its plane":
        points = points @ turn(0.7, (0, 0, 1)).T
    if where == "anywhere":
        points = points @ turn(1.1, (1, -2, 0.5)).T + (3.0, -7.0, 12.0)
    _, place = placed(points, edges)
    step_c, step_r = np.diff(place[name], axis=1), np.diff(place[name], axis=0)
    along, across = (step_c, step_r) if np.all(np.abs(step_c) == 1) else (step_r, step_c)
    width = columns if along is step_c else rows
    assert np.all(np.abs(along) == 1) and np.all(along == along.flat[0])
    assert np.all(np.abs(across) == width) and np.all(across == across.flat[0])


def test_rows_run_along_the_shorter_edges():
    points, edges, name = grid(8, 6, spacing=(0.2, 0.1))
    _, place = placed(points, edges)
    assert np.all(np.abs(np.diff(place[name], axis=0)) == 1)


@pytest.mark.parametrize("columns, rows", [s for s in SHAPES if min(s) > 2])
def test_each_distance_has_two_colours_of_its_own(columns, rows):
    points, edges, _ = grid(columns, rows)
    ids, _ = placed(points, edges)
    found = color_sheet(ids, len(points))
    step = np.abs(ids[:, 0] - ids[:, 1])
    assert proper(ids, found) and found.dtype == np.int32
    assert len(np.unique(step)) == 4 and found.max() + 1 == 8
    for s in np.unique(step):
        mine = found[step == s]
        assert len(np.unique(mine)) == 2 and not np.isin(mine, found[step != s]).any()


def test_in_a_colour_of_a_distance_springs_follow_each_other_in_memory():
    """Blocks of s neighbours: within a block the next spring starts at the next point; blocks are one apart."""
    points, edges, _ = grid(40, 25)
    ids, _ = placed(points, edges)
    found, low, step = color_sheet(ids, len(points)), lowest_point_of_constraint(ids), np.abs(ids[:, 0] - ids[:, 1])
    for c in np.unique(found):
        mine = np.sort(low[found == c])
        gaps = np.diff(mine)
        assert (gaps > 1).sum() <= len(points) / step[found == c][0] + 25


@pytest.mark.parametrize("n", [5, 12, 33])
def test_the_net_with_cross_springs_is_coloured_by_distance_too(n):
    points, edges, _, _ = shapes.spring_sheet(1.0, n)
    name = np.random.default_rng(n).permutation(n * n)
    shuffled = np.empty_like(points)
    shuffled[name] = points
    ids, _ = placed(shuffled, name[edges])
    found = color_sheet(ids, n * n)
    assert proper(ids, found) and found.max() + 1 <= 12            # six distances


def test_a_few_springs_out_of_pattern_get_colours_of_their_own():
    points, edges, _ = grid(30, 30)
    ids, _ = placed(points, edges)
    odd = np.stack([np.arange(0, 30), 500 + 7 * np.arange(30)], 1)   # thirty distances, under 1 % each
    both = np.concatenate([ids, odd])
    found = color_sheet(both, 900)
    assert proper(both, found) and len(np.unique(found[:len(ids)])) == 8
    assert not np.isin(found[len(ids):], found[:len(ids)]).any()


def test_two_springs_between_the_same_points_fall_back():
    points, edges, _ = grid(12, 12)
    ids, _ = placed(points, edges)
    for twice in (ids[:1], ids[:1, ::-1]):
        both = np.concatenate([ids, twice])
        found = color_sheet(both, 144)
        assert proper(both, found) and np.array_equal(found, colors.color_constraints(both, 144))


def test_an_irregular_mesh_falls_back():
    spatial = pytest.importorskip("scipy.spatial")
    points = np.zeros((400, 3))
    points[:, :2] = np.random.default_rng(1).uniform(size=(400, 2))
    t = spatial.Delaunay(points[:, :2]).simplices
    edges = np.unique(np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1), axis=0)
    ids, _ = placed(points, edges)
    found = color_sheet(ids, 400)
    assert proper(ids, found) and np.array_equal(found, colors.color_constraints(ids, 400))


def test_a_bent_sheet_goes_by_levels():
    points, edges, _ = grid(15, 15)
    points[:, 2] = 0.1 * np.sin(3.0 * points[:, 0])
    assert np.array_equal(order_of_points(points, edges), locality_order(points, edges))


def test_triangles_and_hinges_are_coloured_by_the_general_way():
    triangles = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]])
    found = color_sheet(triangles, 6)
    assert proper(triangles, found) and np.array_equal(found, colors.color_constraints(triangles, 6))


@pytest.mark.parametrize("points", [
    np.zeros((5, 3)), np.arange(12.0).reshape(4, 3), np.zeros((3, 3)), [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [3, 0, 0]]],
    ids=["one place", "a line across", "three points", "a line with an edge of no length"])
def test_shapes_without_rows_are_ordered_all_the_same(points):
    points = np.asarray(points, float)
    edges = np.stack([np.arange(len(points) - 1), np.arange(1, len(points))], 1)
    ids, _ = placed(points, edges)
    assert proper(ids, color_sheet(ids, len(points)))


def test_nothing_to_colour_and_nothing_to_join():
    assert len(color_sheet(np.zeros((0, 2), np.int32), 5)) == 0
    assert np.array_equal(np.sort(order_of_points(np.random.default_rng(0).normal(size=(9, 3)), np.zeros((0, 2), int))),
                          np.arange(9))
