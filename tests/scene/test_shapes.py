"""Scene shapes: counts, closedness, winding, volume, and the spring net."""

import numpy as np
import pytest

from wsim.scene import Scene, shapes

SOLIDS = {   # surface at the resolution m, its exact volume [m^3]
    "sphere": (lambda m: shapes.sphere(0.5, m), 4.0 / 3.0 * np.pi * 0.125),
    "box": (lambda m: shapes.box((0.5, 1.0, 1.5), m // 8), 6.0),
    "capsule": (lambda m: shapes.capsule(0.5, 1.0, m), np.pi * (0.5 + 4.0 / 3.0 * 0.125)),
    "cylinder": (lambda m: shapes.cylinder(0.5, 1.0, m), np.pi * 0.5),
    "cone": (lambda m: shapes.cone(0.5, 1.0, m), np.pi * 0.25 * 2.0 / 3.0),
}


def fan(counts, indices):
    """Triangles of polygons that all have the same number of corners."""
    faces = indices.reshape(len(counts), -1)
    return np.concatenate([faces[:, [0, k, k + 1]] for k in range(1, faces.shape[1] - 1)])


def volume(points, triangles):
    a, b, c = points[triangles].transpose(1, 0, 2)
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0


@pytest.mark.parametrize("name", [*SOLIDS, "torso"])
def test_solids_are_closed_and_consistently_wound(name):
    points, counts, indices = SOLIDS[name][0](16) if name in SOLIDS else shapes.torso(segments=16)
    corners = indices.reshape(len(counts), -1)
    directed = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    keys, times = np.unique(directed @ (len(points), 1), return_counts=True)
    assert np.all(times == 1)                                          # no edge twice in one direction
    assert np.array_equal(keys, np.unique(directed[:, ::-1] @ (len(points), 1)))   # each has its opposite
    assert len(np.unique(indices)) == len(points)                      # no loose point
    assert volume(points, fan(counts, indices)) > 0                    # outward
    assert len(points) - len(keys) // 2 + len(counts) == 2             # Euler: one piece without handles


@pytest.mark.parametrize("name", SOLIDS)
def test_volume_converges_to_the_exact_one_from_inside(name):
    build, exact = SOLIDS[name]
    errors = []
    for m in (16, 32):
        points, counts, indices = build(m)
        errors.append(1.0 - volume(points, fan(counts, indices)) / exact)
    if name == "box":
        assert np.max(np.abs(errors)) < 1e-14
    else:   # inscribed, angle step d = 2 pi / m: a circle lacks d^2/6 of its area, a sphere d^2/6 + d^2/4 of its volume
        assert 0 < errors[1] < 5.0 / 12.0 * (2.0 * np.pi / 32) ** 2
        assert 3.6 < errors[0] / errors[1] < 4.4


@pytest.mark.parametrize("cut, corners", [("quads", 4), ("diagonal", 3), ("alternating", 3)])
@pytest.mark.parametrize("horizontal, up, normal", [(False, "Y", (0, 0, 1)), (True, "Y", (0, 1, 0)),
                                                    (False, "Z", (0, -1, 0)), (True, "Z", (0, 0, 1))])
def test_sheet_covers_its_rectangle_once_and_faces_as_documented(cut, corners, horizontal, up, normal):
    points, counts, indices = shapes.sheet(2.0, 1.0, 5, 3, horizontal=horizontal, up=up, cut=cut, at=(1.0, 2.0, 3.0))
    assert points.shape == (24, 3) and np.all(counts == corners)
    a, b, c = points[fan(counts, indices)].transpose(1, 0, 2)
    areas = 0.5 * np.cross(b - a, c - a)
    assert np.all(areas @ normal > 0)
    assert np.allclose(areas.sum(axis=0), 2.0 * np.asarray(normal), atol=1e-14)
    assert np.allclose(points.mean(axis=0), (1.0, 2.0, 3.0), atol=1e-14)


def test_row_zero_is_the_top_of_a_vertical_sheet_and_the_far_edge_of_a_horizontal_one():
    points = shapes.sheet(1.0, 1.0, 4, 4)[0]
    assert np.all(points[:5, 1] == 0.5)
    assert np.all(shapes.sheet(1.0, 1.0, 4, 4, up="Z")[0][:5, 2] == 0.5)
    assert np.all(shapes.sheet(1.0, 1.0, 4, 4, horizontal=True)[0][:5, 2] == -0.5)
    assert np.all(shapes.sheet(1.0, 1.0, 4, 4, horizontal=True, up="Z")[0][:5, 1] == 0.5)


def test_alternating_cut_turns_every_second_diagonal():
    _, _, indices = shapes.sheet(1.0, 1.0, 2, 2)
    degree = np.bincount(indices, minlength=9)
    assert degree[4] == 8 and list(degree[[1, 3, 5, 7]]) == [2, 2, 2, 2]     # all diagonals meet in the middle


def test_sheet_fits_a_scene():
    cloth = Scene().cloth("/cloth", *shapes.sheet(1.0, 1.0, 4, 4))
    assert cloth.points.shape == (25, 3) and cloth.counts.sum() == len(cloth.indices)


def test_spring_sheet_has_the_springs_it_says():
    n = 5
    points, edges, stiffness, masses = shapes.spring_sheet(2.0, n, stretch=7.0, diagonal=5.0, cross=3.0, density=0.25)
    counts = (2 * n * (n - 1), 2 * (n - 1) ** 2, 2 * n * (n - 2))
    assert len(edges) == len(stiffness) == sum(counts)
    assert np.array_equal(stiffness, np.repeat([7.0, 5.0, 3.0], counts))
    lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1) / (2.0 / (n - 1))
    assert np.allclose(lengths, np.repeat([1.0, np.sqrt(2.0), 2.0], counts), rtol=1e-14)
    assert len(np.unique(np.sort(edges, axis=1) @ (n * n, 1))) == len(edges)
    assert np.isclose(masses.sum(), 0.25 * 4.0, rtol=1e-14) and np.all(points[:, 1] == 0.0)


@pytest.mark.parametrize("call, words", [
    (lambda: shapes.sheet(0.0, 1.0, 2, 2), "width is 0"), (lambda: shapes.sheet(1.0, 1.0, 0, 2), "nx is 0"),
    (lambda: shapes.sheet(1.0, 1.0, 2, 2, cut="x"), "alternating"), (lambda: shapes.sheet(1, 1, 2, 2, up="X"), "up is"),
    (lambda: shapes.sphere(-1.0), "radius is -1"), (lambda: shapes.cylinder(1.0, 1.0, 2), "segments is 2"),
    (lambda: shapes.box((1.0, np.nan, 1.0)), "half y is nan"), (lambda: shapes.spring_sheet(1.0, 1), "n is 1"),
    (lambda: shapes.spring_sheet(1.0, 4, cross=-1.0), "cross is -1"), (lambda: shapes.torso(np.inf), "height is inf"),
    (lambda: shapes.block((1.0, 0.0, 1.0), 2), "size is"), (lambda: shapes.block((1, 1, 1), 0), "cells is 0"),
    (lambda: shapes.block((1, 1, 1), 1, at=(0, 0)), "at is")])
def test_what_is_wrong_is_named(call, words):
    with pytest.raises(ValueError, match=words):
        call()


@pytest.mark.parametrize("kind", ["five", "bcc"])
def test_a_block_fills_its_box_and_fits_a_scene(kind):
    soft = Scene().soft("/jelly", *shapes.block((1.0, 2.0, 0.5), (2, 4, 1), kind, at=(3.0, 0.0, -1.0)))
    corners = soft.points[soft.tets].astype(float)
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    assert np.all(volumes > 0) and np.isclose(volumes.sum(), 1.0, rtol=1e-6)        # points are float32
    assert np.array_equal([soft.points.min(axis=0), soft.points.max(axis=0)], [[2.5, -1.0, -1.25], [3.5, 1.0, -0.75]])
    assert np.all(soft.points[:5 * 2, 0] == 2.5)                                    # the end at the least x comes first
