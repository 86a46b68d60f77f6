"""Meshes as index arrays: what is counted, kept and refused is known beforehand for each mesh."""

import numpy as np
import pytest

from wsim.geometry import topology
from wsim.geometry.triangulate import triangulate_polygons
from wsim.scene.check import mesh


def grid(rows, columns, quads=False):
    """Points and faces of a sheet with unit cells."""
    y, x = np.mgrid[0:rows, 0:columns]
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1).astype(np.float32)
    i = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.stack([i, i + 1, i + columns + 1, i + columns], axis=1)
    if quads:
        return points, np.full(len(faces), 4), faces.ravel()
    return points, np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])


def polygon(*corners):
    """One face over points in the plane."""
    points = np.array([(*c, 0.0) for c in corners], np.float32)
    return points, [len(corners)], np.arange(len(corners))


def signed_area(points):
    x, y = points[:, 0], points[:, 1]
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


L_SHAPE = ((0, 0), (2, 0), (2, 1), (1, 1), (1, 3), (0, 3))
ARROW = ((0, 0), (2, 1), (0, 2), (0.5, 1))
COMB = ((0, 0), (5, 0), (5, 3), (4, 3), (4, 1), (3, 1), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3))
MIDPOINTS = ((0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (0, 1))
KEYHOLE = ((0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1))
DOUBLED = ((0, 0), (1, 0), (1, 0), (1, 1), (0, 1))


@pytest.mark.parametrize("corners", [L_SHAPE, ARROW, COMB, MIDPOINTS, KEYHOLE, DOUBLED])
@pytest.mark.parametrize("turned", [False, True])
def test_the_triangles_of_a_polygon_fill_it_once_with_its_winding(corners, turned):
    points, counts, indices = polygon(*(corners[::-1] if turned else corners))
    triangles, _ = triangulate_polygons(points, counts, indices)
    normals = topology.area_normals(points, triangles)
    assert (normals[:, 2] < 0).all() if turned else (normals[:, 2] > 0).all()
    assert normals[:, 2].sum() == pytest.approx(signed_area(points), abs=1e-6)      # none overlaps: areas of one sign


def test_a_concave_polygon_keeps_its_plane_in_space():
    points, counts, indices = polygon(*L_SHAPE)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = points @ turn.T + [10, -20, 5]
    triangles, _ = triangulate_polygons(moved, counts, indices)
    total = topology.area_normals(moved, triangles).sum(axis=0)
    assert total @ turn[:, 2] == pytest.approx(4.0, abs=1e-5)
    assert topology.triangle_areas(moved, triangles).sum() == pytest.approx(4.0, abs=1e-5)


def test_quads_become_fans_from_their_first_corner_in_order():
    points, counts, indices = grid(3, 3, quads=True)
    triangles, face = triangulate_polygons(points, counts, indices)
    assert face.tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    assert triangles[:2].tolist() == [[0, 1, 4], [0, 4, 3]]


def test_faces_without_area_are_left_out_and_can_be_told():
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], np.float32)
    counts, indices = [3, 3, 2, 3, 1, 0], [0, 1, 3, 0, 1, 2, 0, 1, 1, 1, 3, 2]
    triangles, face = triangulate_polygons(points, counts, indices)
    assert triangles.tolist() == [[0, 1, 3]] and face.tolist() == [0]


def test_a_polygon_that_crosses_itself_still_ends():
    angles = np.arange(5) * 4 * np.pi / 5
    points, counts, indices = polygon(*np.stack([np.cos(angles), np.sin(angles)], axis=1))
    assert len(triangulate_polygons(points, counts, indices)[0]) <= 3


@pytest.mark.parametrize(("counts", "indices", "words"), [
    ([3], [0, 1, 7], "0 to 2"), ([3], [0, 1, -1], "0 to 2"), ([3], [0, 1], "2 indices"),
    ([-3], [0, 1, 2], "-3 corners")])
def test_wrong_indices_are_refused_with_what_is_allowed(counts, indices, words):
    points = np.eye(3, dtype=np.float32)
    with pytest.raises(ValueError, match=words):
        triangulate_polygons(points, counts, indices)
    problems = mesh.check_polygon_mesh("/cloth", points, counts, indices)
    assert len(problems) == 1 and problems[0].fatal and problems[0].path == "/cloth" and words in problems[0].text


def test_a_triangulated_sheet_obeys_euler():
    points, triangles = grid(7, 9)
    edges, hinges = topology.edges_of_triangles(triangles), topology.hinges_of_triangles(triangles)
    border = 2 * (6 + 8)
    assert len(points) - len(edges) + len(triangles) == 1
    assert len(hinges) == len(edges) - border                       # every edge inside has two triangles
    assert (edges[:, 0] < edges[:, 1]).all() and len(np.unique(edges, axis=0)) == len(edges)


def test_a_hinge_has_its_edge_as_each_triangle_goes_round():
    _, triangles = grid(4, 5)
    rings = {tuple(np.roll(t, k)) for t in triangles.tolist() for k in range(3)}
    hinges = topology.hinges_of_triangles(triangles)
    assert len(hinges) > 0
    assert all((i, j, left) in rings and (j, i, right) in rings for i, j, left, right in hinges.tolist())


def test_a_hinge_between_opposed_windings_still_joins_the_opposite_corners():
    i, j, left, right = topology.hinges_of_triangles(np.array([[0, 1, 2], [0, 1, 3]]))[0]
    assert {i, j} == {0, 1} and {left, right} == {2, 3}


def test_three_triangles_on_an_edge_make_two_hinges_and_a_doubled_triangle_none():
    fan = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    hinges = topology.hinges_of_triangles(fan)
    assert hinges[:, 2:].tolist() == [[2, 3], [3, 4]]
    assert len(topology.hinges_of_triangles(np.array([[0, 1, 2], [2, 1, 0]]))) == 0


def test_incident_lists_every_row_of_every_point_in_order():
    ids = np.random.default_rng(2).integers(0, 20, (100, 3))
    starts, items = topology.incident_rows(ids, 25)
    for p in range(25):
        expected = np.repeat(np.arange(100), (ids == p).sum(axis=1))
        assert items[starts[p]:starts[p + 1]].tolist() == expected.tolist()


def test_order_sorts_stably_also_where_keys_fill_63_bits():
    rng = np.random.default_rng(3)
    for keys in (rng.integers(0, 9, 1000), rng.integers(0, 4, 1000) + (2**62 + 5)):
        assert topology.order_of(keys).tolist() == np.argsort(keys, kind="stable").tolist()
    assert len(topology.order_of(np.zeros(0, np.int64))) == 0


def test_weld_with_no_tolerance_keeps_even_equal_points_apart():
    assert topology.weld_points(np.zeros((4, 3)), 0.0).tolist() == [0, 1, 2, 3]


def test_weld_joins_what_is_nearer_than_the_tolerance_also_across_cells():
    rng = np.random.default_rng(4)
    base = rng.uniform(-1, 1, (300, 3)) * [1.0, 1.0, 1e3]
    away = np.linalg.norm(base[:, None] - base[None], axis=2)[np.triu_indices(300, 1)].min()
    tolerance, step = away / 4, rng.normal(size=(300, 3))
    near = base + 0.99 * tolerance * step / np.linalg.norm(step, axis=1, keepdims=True)
    far = base + 1.01 * tolerance * step / np.linalg.norm(step, axis=1, keepdims=True)
    assert topology.weld_points(np.concatenate([base, near]), tolerance).tolist() == [*range(300), *range(300)]
    assert topology.weld_points(np.concatenate([base, far]), tolerance).tolist() == [*range(600)]


def test_weld_numbers_particles_by_first_appearance_and_joins_chains():
    line = np.array([[5.0, 0, 0], [0, 0, 0], [0.09, 0, 0], [5.05, 0, 0], [0.18, 0, 0], [2, 0, 0]])
    assert topology.weld_points(line, 0.1).tolist() == [0, 1, 1, 0, 1, 2]


@pytest.mark.parametrize("tolerance", [-1.0, np.inf, np.nan])
def test_weld_refuses_a_tolerance_that_is_no_distance(tolerance):
    with pytest.raises(ValueError, match="finite and >= 0"):
        topology.weld_points(np.zeros((2, 3)), tolerance)


def test_weld_refuses_a_tolerance_that_would_swallow_a_large_mesh():
    points = np.random.default_rng(5).random((20_000, 3))
    with pytest.raises(ValueError, match="lower it"):
        topology.weld_points(points, 10.0)


def test_islands_are_what_edges_join_numbered_by_first_appearance():
    rng = np.random.default_rng(6)
    path = rng.permutation(1000)
    joined = np.stack([path[:-1], path[1:]], axis=1)[np.arange(999) % 100 != 99]     # ten paths of a hundred points
    label = topology.labels_of_islands(1005, joined)
    parts = [set(label[path[k:k + 100]].tolist()) for k in range(0, 1000, 100)]
    assert all(len(part) == 1 for part in parts) and len(set.union(*parts)) == 10
    assert label[1000:].tolist() == list(range(10, 15))
    first = [int(np.flatnonzero(label == k)[0]) for k in range(15)]
    assert first == sorted(first)


def test_distances_along_edges_are_those_of_dijkstra():
    rng = np.random.default_rng(7)
    points = rng.random((150, 3))
    edges = rng.integers(0, 140, (400, 2))                                    # the last ten points hang on nothing
    sources = np.array([3, 77])
    distance, source = topology.geodesic_distance(points, edges, sources)
    expected = np.full(150, np.inf)
    expected[sources] = 0.0
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    for _ in range(150):                                                      # Bellman and Ford: no path is longer
        for a, b in ((0, 1), (1, 0)):
            np.minimum.at(expected, edges[:, b], expected[edges[:, a]] + length)
    assert np.array_equal(distance, expected)
    assert (source[140:] == -1).all() and np.isinf(distance[140:]).all()
    for s in sources:
        alone = topology.geodesic_distance(points, edges, [s])[0]
        assert np.array_equal(alone[source == s], distance[source == s])


def test_normals_of_a_sphere_point_outwards():
    points, triangles = grid(25, 49)
    theta, phi = np.pi * points[:, 1] / 24, 2 * np.pi * points[:, 0] / 48
    places = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
    inner = (points[:, 1] > 0) & (points[:, 1] < 24) & (points[:, 0] > 0) & (points[:, 0] < 48)
    found = topology.vertex_normals(places, triangles[:, ::-1])
    cosine = (found[inner] * places[inner]).sum(axis=1)
    assert (cosine > np.cos(2 * np.pi / 48)).all()                            # within one cell's turn
    assert np.array_equal(topology.vertex_normals(np.eye(3), np.zeros((0, 3), int)), np.zeros((3, 3)))


def text_of(points, counts, indices):
    problems = mesh.check_polygon_mesh("/cloth", points, counts, indices)
    assert all(not p.fatal and p.path == "/cloth" for p in problems)
    return [p.text for p in problems]


def test_a_sound_mesh_has_no_problems():
    assert text_of(*grid(5, 6, quads=True)) == []


def test_flaws_are_told_with_their_number_the_first_and_the_mend():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [9, 9, 9], [0, 0, 0], [2, 0, 0]], float)
    flat, = text_of(points[:3], [3, 3], [0, 1, 2, 0, 0, 1])
    assert "1 face (number 1)" in flat
    many = text_of(points[:5], [3, 3, 3], [0, 1, 2, 1, 0, 3, 0, 1, 4])
    assert len(many) == 1 and "points 0 and 1" in many[0] and "more than two" in many[0]
    turned, = text_of(points[:4], [3, 3], [0, 1, 2, 0, 1, 3])
    assert "windings" in turned and "points 0 and 1" in turned
    alone, = text_of(points[[0, 1, 2, 5]], [3], [0, 1, 2])
    assert "1 point (number 3)" in alone
    seam, = text_of(points[[0, 1, 2, 6, 7, 3]], [3, 3], [0, 1, 2, 3, 5, 4])
    assert "1 point (number 3)" in seam and "that one: 0" in seam and "weld" in seam


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_points_that_are_not_finite_are_fatal(value):
    points, counts, indices = grid(3, 3, quads=True)
    points[4, 1] = value
    problem, = mesh.check_polygon_mesh("/cloth", points, counts, indices)
    assert problem.fatal and "number 4" in problem.text


def test_a_mesh_without_any_area_is_fatal():
    problem, = mesh.check_polygon_mesh("/cloth", np.zeros((3, 3)), [3], [0, 1, 2])
    assert problem.fatal
    problem, = mesh.check_polygon_mesh("/cloth", np.zeros((0, 3)), [], [])
    assert problem.fatal
