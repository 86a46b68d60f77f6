"""Cages around surfaces, what lies inside of them, and points embedded in them."""

import numpy as np
import pytest

from wsim.geometry import primitives
from wsim.geometry.tetra import tets
from wsim.geometry.tetra.cage import filled_fraction, tet_cage
from wsim.geometry.tetra.embed import embed_in_tets, follow_embedding
from wsim.geometry.tetra.inside import AxisRays
from wsim.geometry.tetra.lattice import integer_grid, tet_box

TURN = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
TURN *= np.linalg.det(TURN)


def torus(major=1.0, minor=0.3, around=48, across=24):
    """Closed, wound outward."""
    i, j = (k.ravel() for k in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    u, v = 2 * np.pi * i / around, 2 * np.pi * j / across
    r = major + minor * np.cos(v)
    points = np.stack([r * np.cos(u), r * np.sin(u), minor * np.sin(v)], axis=1)
    a, b = i * across + j, (i + 1) % around * across + j
    c, d = (i + 1) % around * across + (j + 1) % across, i * across + (j + 1) % across
    return points, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def euler(rows):
    """V - E + F - T of the solid: 1 for a ball, 0 for a ring, 2 for two balls."""
    return len(np.unique(rows)) - len(tets.edges_of_tets(rows)) + (4 * len(rows)
                                                                   + len(tets.tet_surface_triangles(rows))) // 2 - len(rows)


def surface_euler(rows):
    skin = tets.tet_surface_triangles(rows)
    edges = np.unique(np.sort(skin[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    return len(np.unique(skin)) - len(edges) + len(skin)


# Cage

def test_the_cage_of_a_ball_covers_it_and_its_volume_converges_from_above():
    points, triangles = primitives.sphere_outline(1.0, 48)
    for cells in (6, 12, 24):
        mesh = tet_cage(points, triangles, cells)
        assert tets.signed_tet_volumes(*mesh).min() > 0
        assert euler(mesh[1]) == 1 and surface_euler(mesh[1]) == 2
        assert embed_in_tets(*mesh, points)[1].min() > -1e-9
        volume = tets.signed_tet_volumes(*mesh).sum() / (4.0 / 3.0 * np.pi)
        reach = np.sqrt(2.0) * 2.0 / cells                         # a tet that touches goes no farther than its longest edge
        assert 1.0 < volume < (1.0 + reach) ** 3
        assert np.linalg.norm(mesh[0], axis=1).max() < 1.0 + reach


def test_the_cage_of_a_box_in_the_planes_of_its_cells_is_the_box():
    points, triangles = primitives.box_outline((0.5, 0.25, 0.75))
    mesh = tet_cage(points, triangles, 6)
    assert len(mesh[1]) == 5 * 4 * 2 * 6
    assert tets.signed_tet_volumes(*mesh).sum() == pytest.approx(0.75, rel=1e-13)


def test_a_turned_box_is_covered_by_no_more_than_a_layer():
    points, triangles = primitives.box_outline((0.5, 0.5, 0.5))
    points = points @ TURN.T + (10.0, -20.0, 5.0)
    mesh = tet_cage(points, triangles, 16)
    width = np.ptp(points, axis=0).max() / 16
    inner = np.random.default_rng(0).random((2000, 3)) - 0.5
    assert embed_in_tets(*mesh, inner @ TURN.T + (10.0, -20.0, 5.0))[1].min() > -1e-9     # all inside is in a tet
    far = np.abs((mesh[0] - (10.0, -20.0, 5.0)) @ TURN).max()
    assert far < 0.5 + np.sqrt(3.0) * width                                               # a tet that touches reaches so far


@pytest.mark.parametrize("cells", [12, 20])
def test_the_cage_of_a_torus_keeps_its_hole(cells):
    rows = tet_cage(*torus(), cells)[1]
    assert euler(rows) == 0 and surface_euler(rows) == 0


def test_the_hole_of_a_torus_is_closed_where_cells_are_as_large_as_it():
    assert euler(tet_cage(*torus(1.0, 0.75), 4)[1]) == 1


def test_two_bodies_stay_two_and_a_hollow_stays_hollow():
    points, triangles = primitives.sphere_outline(1.0, 32)
    both = np.concatenate([triangles, triangles + len(points)])
    assert euler(tet_cage(np.concatenate([points, points + (3.0, 0, 0)]), both, 40)[1]) == 2
    shell = np.concatenate([triangles, triangles[:, ::-1] + len(points)])
    rows = tet_cage(np.concatenate([points, 0.5 * points]), shell, 20)[1]
    assert surface_euler(rows) == 4 and euler(rows) == 2                                  # two spheres bound it


def test_bodies_that_overlap_have_no_hole_between_them():
    points, triangles = primitives.sphere_outline(1.0, 32)
    both = np.concatenate([triangles, triangles + len(points)])
    assert surface_euler(tet_cage(np.concatenate([points, points + (0.8, 0, 0)]), both, 24)[1]) == 2


def test_the_inside_of_a_surface_with_a_small_hole_is_filled():
    points, triangles = primitives.sphere_outline(1.0, 48)
    centres = points[triangles].mean(axis=1)
    holed = triangles[np.linalg.norm(centres - (0.0, 0.0, 1.0), axis=1) > 0.3]            # more than three cells wide
    assert len(holed) < len(triangles)
    mesh = tet_cage(points, holed, 24)
    assert euler(mesh[1]) == 1 and surface_euler(mesh[1]) == 2
    inner = np.random.default_rng(0).normal(size=(20_000, 3))
    inner *= np.minimum(0.97 / np.linalg.norm(inner, axis=1, keepdims=True), 1.0)         # most of them just below the surface
    inner = inner[inner[:, 2] < np.cos(0.35) - np.sqrt(2.0) / 12.0]                       # also those under the hole
    assert embed_in_tets(*mesh, inner)[1].min() > -1e-9


@pytest.mark.parametrize("winding", ["inward", "at random"])
def test_the_inside_is_found_whatever_the_winding(winding):
    points, triangles = primitives.sphere_outline(1.0, 24)
    some = np.random.default_rng(1).random(len(triangles)) < (0.5 if winding == "at random" else 2.0)
    turned = np.where(some[:, None], triangles[:, ::-1], triangles)
    assert np.array_equal(tet_cage(points, turned, 12)[1], tet_cage(points, triangles, 12)[1])


def test_a_sheet_without_an_inside_is_covered():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    for place in (points, points @ TURN.T):
        mesh = tet_cage(place, np.array([[0, 1, 2], [0, 2, 3]]), 8)
        u = np.random.default_rng(0).random((500, 2))
        inner = place[0] + u[:, :1] * (place[1] - place[0]) + u[:, 1:] * (place[3] - place[0])
        assert embed_in_tets(*mesh, inner)[1].min() > -1e-9


def test_a_sheet_in_the_plane_of_lattice_faces_is_covered():
    points, triangles = primitives.box_outline((0.5, 0.5, 0.5))
    sheet = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0], [0, 0, 0.5], [0, 0.1, 0.5], [0.1, 0, 0.5],
                      [0, 0, -0.5], [0, 0.1, -0.5], [0.1, 0, -0.5]])
    mesh = tet_cage(sheet, np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [7, 8, 9]]), 8)
    assert embed_in_tets(*mesh, sheet)[1].min() > -1e-7


@pytest.mark.parametrize("points, triangles, cells, words", [
    (np.zeros((3, 2)), [[0, 1, 2]], 4, "points have shape (3, 2)"), (np.eye(3), [[0, 1, 3]], 4, "number 0 names the points"),
    (np.eye(3), [[0, 1]], 4, "triangles have shape (1, 2)"),
    (np.eye(3), np.zeros((0, 3), int), 4, "triangles have shape (0, 3)"),
    (np.eye(3), [[0, 1, 1]], 4, "none has an area"), (np.full((3, 3), np.inf), [[0, 1, 2]], 4, "not finite"),
    (np.eye(3), [[0, 1, 2]], 0, "cells is 0"), (np.eye(3), [[0, 1, 2]], 2.5, "cells is 2.5"),
    (np.eye(3), [[0, 1, 2]], np.nan, "cells is nan"), (np.eye(3), [[0, 1, 2]], 2000, "2000 x 2000 x 2000")])
def test_a_cage_that_cannot_be_is_refused_by_the_name_of_the_argument(points, triangles, cells, words):
    with pytest.raises(ValueError) as refused:
        tet_cage(points, np.asarray(triangles), cells)
    assert words in str(refused.value)


def test_what_is_filled_adds_up_to_the_body_and_is_whole_deep_inside():
    points, triangles = primitives.sphere_outline(1.0, 48)
    body = np.einsum("ij,ij->", points[triangles[:, 0]], np.cross(points[triangles[:, 1]], points[triangles[:, 2]])) / 6.0
    mesh = tet_cage(points, triangles, 12)
    part, volumes = filled_fraction(points, triangles, *mesh), tets.signed_tet_volumes(*mesh)
    # a cut tet is off by some 1/35 of its volume at random: of the thousands cut, 1/35 / sqrt(1000) of a third of the whole;
    # places are rounded to 1/512, without a preferred direction
    assert part @ volumes == pytest.approx(body, rel=5e-3)
    far = np.linalg.norm(mesh[0][mesh[1]], axis=2).max(axis=1)
    assert np.all(part[far < 0.98] == 1.0) and part.min() >= 0.0


def test_a_cage_that_is_the_body_is_filled():
    points, triangles = primitives.box_outline((0.5, 0.25, 0.75))
    assert np.all(filled_fraction(points, triangles, *tet_cage(points, triangles, 6)) == 1.0)


# Inside

def test_winding_is_one_inside_of_a_closed_surface_also_on_lines_through_its_edges_and_corners():
    points, triangles = primitives.box_outline((4.0, 4.0, 4.0))
    places = integer_grid((11, 11, 11))
    away = np.abs(places - 5).max(axis=1)
    winding = AxisRays(points + 5.0, triangles, (0, 0, 0), (10, 10, 10)).winding(places)
    assert np.all(winding[away < 4] == 1.0) and np.all(winding[away > 4] == 0.0)


def test_winding_agrees_with_the_distance_from_the_middle_of_a_ball():
    points, triangles = primitives.sphere_outline(9.0, 128)
    places = integer_grid((21, 21, 21))
    r = np.linalg.norm(places - 10.0, axis=1)
    winding = AxisRays(points + 10.0, triangles, (0, 0, 0), (20, 20, 20)).winding(places)
    sure = np.abs(r - 9.0) > 9.0 * 2 * (1 - np.cos(np.pi / 128))                        # sagitta of the flat triangles
    assert np.array_equal(winding[sure], (r[sure] < 9.0).astype(float))


def test_nested_surfaces_add_their_turns():
    points, triangles = primitives.sphere_outline(1.0, 24)
    both = np.concatenate([triangles, triangles + len(points)])
    rays = AxisRays(np.concatenate([9.0 * points, 5.0 * points]) + 10.0, both, (0, 0, 0), (20, 20, 20))
    assert rays.winding(np.array([[10, 10, 10], [17, 10, 10], [0, 0, 0]])).tolist() == [2.0, 1.0, 0.0]


# Embedding

def crumpled():
    points, rows = tet_box((2.0, 1.0, 1.5), (8, 4, 6))
    rng = np.random.default_rng(0)
    return points + 0.05 * (rng.random(points.shape) - 0.5), rows


def test_embedded_places_follow_every_affine_map():
    points, rows = crumpled()
    places = 0.9 * (np.random.default_rng(1).random((3000, 3)) - 0.5) * (2.0, 1.0, 1.5)
    tet, weights = embed_in_tets(points, rows, places)
    assert weights.min() > -1e-12
    assert np.abs(weights.sum(axis=1) - 1.0).max() < 1e-15 * 4
    A, b = np.random.default_rng(2).normal(size=(3, 3)), np.array([5.0, -3.0, 1.0])
    for M, t in ((np.eye(3), 0.0 * b), (A, b)):
        assert np.abs(follow_embedding(points @ M.T + t, rows, tet, weights) - (places @ M.T + t)).max() < 1e-12


def test_the_tet_found_is_the_one_that_holds_the_place():
    points, rows = crumpled()
    rng = np.random.default_rng(4)
    weights = rng.dirichlet([1.0] * 4, size=2 * len(rows))
    tet = rng.permutation(np.repeat(np.arange(len(rows)), 2))
    found, again = embed_in_tets(points, rows, np.einsum("mi,mik->mk", weights, points[rows[tet]]))
    assert np.array_equal(found, tet)
    assert np.abs(again - weights).max() < 1e-12


def test_points_of_the_mesh_itself_lie_in_one_of_their_tets():
    points, rows = crumpled()
    tet, weights = embed_in_tets(points, rows, points)
    assert weights.min() > -1e-9 and np.abs(weights.max(axis=1) - 1.0).max() < 1e-9
    assert np.array_equal(rows[tet, weights.argmax(axis=1)], np.arange(len(points)))


def test_a_place_outside_takes_the_tet_whose_face_is_nearest_and_is_still_exact():
    points, rows = tet_box((1.0, 1.0, 1.0), 4)
    places = np.array([[0.1, 0.55, 0.3], [0.7, 0.1, 0.1], [-0.5 - 1e-3, 0.0, 0.4]])
    tet, weights = embed_in_tets(points, rows, places)
    assert np.all(weights.min(axis=1) < 0)
    assert np.abs(follow_embedding(points, rows, tet, weights) - places).max() < 1e-12
    nearest = np.clip(places, -0.5, 0.5)                                                # of the box
    X = points[rows[tet]]
    assert np.all(nearest >= X.min(axis=1) - 1e-12) and np.all(nearest <= X.max(axis=1) + 1e-12)


def test_a_place_beyond_reach_is_refused_by_its_number_and_a_larger_reach_takes_it():
    points, rows = tet_box((1.0, 1.0, 1.0), 4)
    places = np.array([[0.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
    with pytest.raises(ValueError, match="1 of 2 lie more than .* m outside of all tets .first: 1, at"):
        embed_in_tets(points, rows, places)
    tet, weights = embed_in_tets(points, rows, places, reach=3.0)
    assert np.abs(follow_embedding(points, rows, tet, weights) - places).max() < 1e-12
    with pytest.raises(ValueError, match="reach is nan"):
        embed_in_tets(points, rows, places, reach=np.nan)


def test_tets_of_very_different_size_hold_their_places():
    big, rows = tet_box((1.0, 1.0, 1.0), 1)
    small, more = tet_box((1e-3, 1e-3, 1e-3), 6)
    points, every = np.concatenate([big, small + 2.0]), np.concatenate([rows, more + len(big)])
    places = np.concatenate([0.9 * big, 0.9 * small + 2.0])
    tet, weights = embed_in_tets(points, every, places)
    assert weights.min() > -1e-12 and np.array_equal(tet >= len(rows), np.arange(len(places)) >= len(big))


@pytest.mark.parametrize("change, words", [
    (lambda p, t, q: (p, t[:, [1, 0, 2, 3]], q), "tet 0 is flat or turned"), (lambda p, t, q: (p, t[:0], q), "tets are none"),
    (lambda p, t, q: (p, t, q * np.nan), "places: number 0 is not finite"),
    (lambda p, t, q: (p * np.inf, t, q), "points: number 0"),
    (lambda p, t, q: (p, t + 1, q), "names the points")])
def test_embedding_refuses_what_cannot_hold_a_place(change, words):
    with pytest.raises(ValueError) as refused, np.errstate(invalid="ignore"):
        embed_in_tets(*change(*tet_box((1.0, 1.0, 1.0), 2), np.zeros((1, 3))))
    assert words in str(refused.value)


def test_no_places_give_no_rows():
    tet, weights = embed_in_tets(*tet_box((1.0, 1.0, 1.0), 2), np.zeros((0, 3)))
    assert tet.shape == (0,) and weights.shape == (0, 4)
