"""Meshes of tetrahedra: volumes, faces and nodes are known beforehand; every planted flaw is found where it is."""

import numpy as np
import pytest

from wsim.geometry.tetra import lattice, repair, tets

SIZE = (2.0, 1.0, 1.5)
REGULAR = np.array([[1, 1, 1], [1, -1, -1], [-1, -1, 1], [-1, 1, -1]], float)          # volume 8/3


def block(kind="five", cells=(4, 2, 3)):
    return lattice.tet_box(SIZE, cells, kind)


def crumpled(seed=0):
    """A box with its points moved by up to a tenth of a cell and numbered at random, and tets in random order."""
    rng = np.random.default_rng(seed)
    points, rows = block()
    points = points + 0.05 * (rng.random(points.shape) - 0.5)
    new = rng.permutation(len(points))
    shuffled = np.empty_like(points)
    shuffled[new] = points
    return shuffled, new[rows][rng.permutation(len(rows))].astype(np.int32)


def faces(rows):
    return np.concatenate([rows[:, list(face)] for face in tets.FACES])


def edge_count(triangles):
    return len(np.unique(np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0))


# Boxes

@pytest.mark.parametrize("kind", lattice.KINDS)
@pytest.mark.parametrize("cells", [1, 2, (4, 2, 3), (1, 5, 1)])
def test_a_box_is_filled_by_tets_of_positive_volume(kind, cells):
    points, rows = block(kind, cells)
    volumes = tets.signed_tet_volumes(points, rows)
    assert volumes.min() > 0
    assert volumes.sum() == pytest.approx(np.prod(SIZE), rel=1e-14 * len(rows))
    assert repair.repair_tets(points, rows)[2] == []                           # no loose point, no copy


@pytest.mark.parametrize("kind", lattice.KINDS)
def test_faces_inside_are_shared_by_two_tets_that_see_them_from_opposite_sides(kind):
    points, rows = block(kind)
    every, skin = faces(rows), tets.tet_surface_triangles(rows)
    turned = [np.sort(every, axis=1)]
    _, which, times = np.unique(turned[0], axis=0, return_inverse=True, return_counts=True)
    assert times.max() == 2 and (times == 1).sum() == len(skin)
    normal = np.cross(points[every[:, 1]] - points[every[:, 0]], points[every[:, 2]] - points[every[:, 0]])
    total = np.zeros((len(times), 3))
    np.add.at(total, which.ravel(), normal)
    assert np.abs(total[times == 2]).max() < 1e-15                              # opposite normals cancel
    assert np.all(skin @ (1, 0, 0) >= 0) and {tuple(f) for f in skin} <= {tuple(f) for f in every}


@pytest.mark.parametrize("mesh", [block(), block("bcc"), crumpled()])
def test_the_surface_is_closed_outward_and_encloses_the_volume(mesh):
    points, rows = mesh
    skin = tets.tet_surface_triangles(rows)
    a, b, c = points[skin].transpose(1, 0, 2)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0 == pytest.approx(tets.signed_tet_volumes(points, rows).sum(),
                                                                          rel=1e-13)
    assert len(np.unique(skin)) - edge_count(skin) + len(skin) == 2             # Euler: a ball without handles
    directed = skin[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2) @ (len(points), 1)
    assert len(np.unique(directed)) == len(directed)                            # no edge twice in one direction


def test_the_number_of_tets_is_the_documented_one():
    assert len(block("five")[1]) == 5 * 24
    inner, outer = 3 * 2 * 3 + 4 * 1 * 3 + 4 * 2 * 2, 2 * (2 * 3 + 4 * 3 + 4 * 2)
    assert len(block("bcc")[1]) == 4 * inner + 2 * outer


def test_quality_is_that_of_the_regular_tet_and_of_the_lattices():
    assert tets.mean_ratio_quality(REGULAR, [[0, 2, 1, 3]])[1] == pytest.approx(-1.0, abs=1e-15)
    assert tets.mean_ratio_quality(REGULAR, [[0, 1, 2, 3]])[1] == pytest.approx(1.0, abs=1e-15)
    points, rows = lattice.tet_box((3, 3, 3), 3)
    values, least, histogram = tets.mean_ratio_quality(points, rows)
    corner = 12.0 * 0.5 ** (2 / 3) / 9.0                       # volume 1/6, edges 1, 1, 1 and three diagonals
    assert least == pytest.approx(corner, rel=1e-14) and sorted({round(v, 9) for v in values}) == [round(corner, 9), 1.0]
    assert histogram.tolist() == [0] * 8 + [4 * 27, 27]
    points, rows = lattice.tet_box((3, 3, 3), 3, "bcc")
    values = tets.mean_ratio_quality(points, rows)[0]
    inside = 12.0 * 0.25 ** (2 / 3) / 5.0                      # volume 1/12, two edges 1, four sqrt(3)/2
    half = 12.0 * 0.25 ** (2 / 3) / 6.25                       # half a pyramid: edges 1, 1, sqrt(2), three of sqrt(3)/2
    assert sorted({round(v, 9) for v in values}) == [round(half, 9), round(inside, 9)]


@pytest.mark.parametrize("size, cells, kind, words", [
    ((1, 1), 2, "five", "size is [1.0, 1.0]"), ((1, 0, 1), 2, "five", "size"), ((1, np.inf, 1), 2, "five", "size"),
    ((1, 1, 1), 0, "five", "cells is 0"), ((1, 1, 1), 1.5, "five", "cells is 1.5"), ((1, 1, 1), (1, 2), "five", "cells"),
    ((1, 1, 1), np.nan, "five", "cells is nan"), ((1, 1, 1), 10_000, "five", "at most"), ((1, 1, 1), 2, "six", "five, bcc")])
def test_a_box_that_cannot_be_is_refused_by_the_name_of_the_argument(size, cells, kind, words):
    with pytest.raises(ValueError) as refused:
        lattice.tet_box(size, cells, kind)
    assert words in str(refused.value)


def test_integer_boxes_give_each_of_their_cells_once_in_any_portions():
    low, high = np.array([[0, 0, 0], [1, 2, 3], [5, 5, 5], [2, 0, 1]]), np.array([[1, 2, 0], [0, 9, 9], [5, 5, 5], [4, 1, 1]])
    wanted = [(b, *cell) for b in range(4) for cell in np.ndindex(*np.maximum(high[b] - low[b] + 1, 0))]
    wanted = [(b, *(np.array(cell) + low[b])) for b, *cell in wanted]
    for most in (1, 4, 1000):
        found = [(b, *c) for box, cell in lattice.cells_of_integer_boxes(low, high, most)
                 for b, c in zip(box, cell, strict=True)]
        assert found == wanted


# Quantities

def test_gradients_take_the_deformation_gradient_from_any_affine_map():
    points, rows = crumpled()
    A = np.array([[1.2, 0.3, -0.1], [0.0, 0.7, 0.5], [-0.4, 0.2, 1.1]])
    moved = points @ A.T + (3.0, -2.0, 1.0)
    F = np.einsum("tik,til->tkl", moved[rows], tets.barycentric_gradients(points, rows))
    assert np.abs(F - A).max() < 1e-12                                          # condition of a tet (100) times rounding


def test_gradients_are_one_at_their_corner_and_zero_at_the_others():
    points, rows = crumpled()
    g, X = tets.barycentric_gradients(points, rows), points[rows]
    values = np.einsum("tik,tjk->tij", g, X - X[:, :1]) + np.array([1.0, 0, 0, 0])[:, None]
    assert np.abs(values - np.eye(4)).max() < 1e-12
    assert np.abs(g.sum(axis=1)).max() < 1e-12


def test_masses_add_up_and_ten_nodes_share_as_documented():
    points, rows = crumpled()
    density = np.linspace(500.0, 2000.0, len(rows))
    total = density @ tets.signed_tet_volumes(points, rows)
    for mesh in ((points, rows), tets.ten_node_mesh(points, rows)):
        mass = tets.lumped_tet_masses(*mesh, density)
        assert mass.min() > 0 and mass.sum() == pytest.approx(total, rel=1e-13)
    one = tets.lumped_tet_masses(*tets.ten_node_mesh(REGULAR, [[0, 1, 2, 3]]), 36.0 / (8.0 / 3.0))  # volume 8/3, mass 36
    assert one == pytest.approx([1.0] * 4 + [16.0 / 3.0] * 6, rel=1e-14)


@pytest.mark.parametrize("density, words", [(0.0, "density is 0"), (np.nan, "density is nan"), ([1.0, 2.0], "shape (2,)")])
def test_a_density_that_is_none_is_refused(density, words):
    with pytest.raises(ValueError) as refused:
        tets.lumped_tet_masses(*block(), density)
    assert words in str(refused.value)


def test_corners_name_every_place_of_a_point_once():
    points, rows = crumpled()
    starts, found = tets.occurrences_of_points(rows, len(points))
    assert np.array_equal(np.sort(found), np.arange(4 * len(rows)))
    assert np.array_equal(rows.ravel()[found], np.repeat(np.arange(len(points)), np.diff(starts)))


def test_quadratic_nodes_follow_eulers_formula_and_lie_in_the_middle_of_shared_edges():
    points, rows = crumpled()
    nodes, ten = tets.ten_node_mesh(points, rows)
    inner = (4 * len(rows) - len(tets.tet_surface_triangles(rows))) // 2
    edges = len(points) + (4 * len(rows) - inner) - len(rows) - 1               # V - E + F - T = 1 for a ball
    assert len(nodes) == len(points) + edges and len(tets.edges_of_tets(rows)) == edges
    assert np.array_equal(ten[:, :4], rows) and np.array_equal(np.unique(ten), np.arange(len(nodes)))
    for k, (i, j) in enumerate(tets.EDGES):
        assert np.array_equal(nodes[ten[:, 4 + k]], 0.5 * (points[rows[:, i]] + points[rows[:, j]]))


def test_middle_nodes_come_in_the_order_of_the_edges():
    points, rows = crumpled()
    edges = tets.edges_of_tets(rows)
    assert np.array_equal(tets.ten_node_mesh(points, rows)[0][len(points):], points[edges].sum(axis=1) / 2)
    assert np.all(edges[:, 0] < edges[:, 1]) and np.all(np.diff(edges @ (len(points), 1)) > 0)


@pytest.mark.parametrize("n", [3, 2**21 + 5])
def test_the_surface_is_the_same_at_large_point_numbers(n):
    points, rows = block()
    assert np.array_equal(tets.tet_surface_triangles(rows + n), tets.tet_surface_triangles(rows) + n)


@pytest.mark.parametrize("cells, most", [(1, 1), (2, 3), (3, 3), (4, 5), (9, 5)])
def test_cells_across_are_counted_and_few_of_them_are_told(cells, most):
    count = tets.cells_across_thickness(lattice.tet_box((4.0, 1.0, 1.0), (4 * cells, cells, cells))[1])
    assert count == most
    assert bool(tets.describe_coarseness(count)) == (cells < 4)


# Flaws

def planted(change):
    """Flaws of the box after `change(points, rows)`, which returns both anew."""
    points, rows = block()
    points, rows = change(points.copy(), rows.copy())
    return repair.repair_tets(points, rows)


def put(array, at, value):
    array[at] = value
    return array


FLAWS = {    # what is done to points p and tets t: element, fatal, words
    "not finite": (lambda p, t: (put(p, (7, 1), np.nan), t), 7, True, "point 7 is not finite"),
    "infinite": (lambda p, t: (put(p, (7, 1), -np.inf), t), 7, True, "point 7 is not finite"),
    "too high": (lambda p, t: (p, put(t, (11, 2), 60)), 11, True,
                 "tet 11 is naming points that there are not; allowed are 0 to 59"),
    "negative": (lambda p, t: (p, put(t, (11, 2), -1)), 11, True, "tet 11 is naming points"),
    "twice": (lambda p, t: (p, put(t, (5, 3), t[5, 0])), 5, True, "tet 5 is naming a point twice"),
    "flat": (lambda p, t: (np.concatenate([p, [p[t[9, :3]].mean(axis=0)]]), np.concatenate([t, [[*t[9, :3], 60]]])), 120, True,
             "tet 120 is flat"),
    "copy": (lambda p, t: (p, np.concatenate([t, t[[17]][:, [1, 2, 0, 3]]])), 120, True,
             "tet 120 is given before (the first as tet 17)"),
    "copy turned": (lambda p, t: (p, np.concatenate([t, t[[17]][:, [1, 0, 2, 3]]])), 120, True, "given before"),
    "loose": (lambda p, t: (np.concatenate([p, [[9.0, 9, 9]]]), t), 60, False, "point 60 is in no tet"),
    "twin": (lambda p, t: (np.concatenate([p, p[[17]]]), put(t, tuple(np.argwhere(t == 17)[0]), 60)), 60, False,
             "point 60 is where another one is (the first at point 17)"),
    "none": (lambda p, t: (p[:0], t[:0]), 0, True, "there is no tet"),
}


@pytest.mark.parametrize("name", FLAWS)
def test_a_planted_flaw_is_found_alone_and_where_it_is(name):
    change, element, fatal, words = FLAWS[name]
    flaws = planted(change)[2]
    assert [(f.element, f.fatal) for f in flaws] == [(element, fatal)]
    assert words in flaws[0].text


def test_tets_turned_inside_out_are_swapped_and_named():
    points, rows = crumpled()
    bad = rows.copy()
    bad[[3, 50]] = bad[[3, 50]][:, [1, 0, 2, 3]]
    mended, turned, flaws = repair.repair_tets(points, bad)
    assert turned.tolist() == [3, 50] and flaws == []
    assert tets.signed_tet_volumes(points, mended).min() > 0
    assert np.array_equal(np.sort(mended, axis=1), np.sort(rows, axis=1))
    assert tets.signed_tet_volumes(points, bad)[3] < 0                          # the argument stays as it was


def test_many_flaws_at_once_are_counted_kind_by_kind_fatal_ones_first():
    points, rows = crumpled()
    points[rows[0, 0]] = np.nan
    rows[[20, 30]], rows[40, 0] = 2, 999
    flaws = repair.repair_tets(points, rows)[2]
    assert [f.fatal for f in flaws] == sorted((f.fatal for f in flaws), reverse=True)
    assert any(f.text.startswith("2 tets (first: 20) are naming a point twice") for f in flaws)
    assert any(f.text.startswith("tet 40 is") for f in flaws)


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e6])
def test_what_is_flat_depends_on_the_shape_and_not_on_the_size(scale):
    base = np.array([[0, 0, 0], [1, 0, 0], [0.5, np.sqrt(0.75), 0], [0.5, np.sqrt(1 / 12), 1]]) * scale
    for height, flaw in ((8e-6, False), (6e-6, True)):          # volume sqrt(3)/12 height edge^2: the bound is at 6.93e-6
        flaws = repair.repair_tets(base * (1, 1, height), [[0, 1, 2, 3]])[2]
        assert bool(flaws) == flaw


def test_a_flat_mesh_of_huge_coordinates_is_no_number_but_a_flaw():
    assert "flat" in repair.repair_tets(1e200 * REGULAR, [[0, 1, 2, 3]])[2][0].text


@pytest.mark.parametrize("points, rows, words", [
    (np.zeros((4, 2)), [[0, 1, 2, 3]], "points have shape (4, 2)"), (REGULAR, [[0, 1, 2]], "tets have shape (1, 3)"),
    (REGULAR, [[0.0, 1.0, 2.0, 3.0]], "tets have shape (1, 4) and type float64"),
    (REGULAR, [0, 1, 2, 3], "tets have shape (4,)"),
    (np.array([["a"] * 3]), [[0, 1, 2, 3]], "points have shape (1, 3)")])
def test_arrays_of_another_shape_are_refused(points, rows, words):
    for function in (repair.repair_tets, tets.signed_tet_volumes):
        with pytest.raises(ValueError) as refused:
            function(points, rows)
        assert words in str(refused.value)


def test_indices_out_of_range_are_refused_by_their_tet():
    with pytest.raises(ValueError, match="tet 1 names the points"):
        tets.signed_tet_volumes(REGULAR, [[0, 1, 2, 3], [0, 1, 2, 4]])
