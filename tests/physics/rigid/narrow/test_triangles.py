"""Shapes against triangles of meshes: flat floors without bumps, edges and corners."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.rigid.narrow.triangles import cube, floor, kernel
from tests.physics.rigid.narrow.reference import polyhedra
from tests.physics.rigid.pairs import PRECISIONS, WHERE, matrix, poses, shapes
from wsim.geometry.convex_hull import convex_hull
from wsim.kernels.math.real import types
from wsim.kernels.rigid.lists.manifold import manifold_type
from wsim.kernels.rigid.narrow.shape import hull_type
from wsim.physics.rigid.surfaces import adjacent_faces, hull_tables, mesh_surface_tables

STILL = np.array([0.0, 0, 0, 0, 0, 0, 1])
both = pytest.mark.parametrize("real", PRECISIONS, ids=("f32", "f64"))


def meet(rows, pose, surface, margin, real, of=()):
    """(manifolds in the shapes' frames, (shape, face) of each) of all shapes with all faces of a mesh at rest."""
    t, n, keep = types(real), len(rows), mesh_surface_tables([surface], real, WHERE["device"])
    H = hull_tables(of, real, WHERE["device"]) if of else hull_type(real)()
    where = np.array([(i, f) for i in range(n) for f in range(len(surface[1]))], np.int32)
    poses_of = wp.array(np.ascontiguousarray(np.broadcast_to(pose, (n, 7))), dtype=t.transform, **WHERE)
    out = wp.zeros(len(where), dtype=manifold_type(real), **WHERE)
    wp.launch(kernel(real), len(where), [shapes(rows, real), H, keep[0], poses_of, t.transform(*STILL),
                                         wp.array(where, dtype=wp.vec2i, **WHERE), margin], [out], **WHERE)
    m = out.numpy()
    hit = m["count"] > 0
    return m[hit], where[hit]


def test_neighbours_across_edges():
    faces = np.array([(0, 1, 2), (2, 1, 3), (4, 5, 6), (4, 5, 7)])
    assert adjacent_faces(faces).tolist() == [[-1, 1, -1], [0, -1, -1], [-1, -1, -1], [-1, -1, -1]]
    closed = cube()[1]
    around = adjacent_faces(closed)
    assert (around >= 0).all()
    for f, row in enumerate(around):
        for k, g in enumerate(row):
            assert {closed[f][k], closed[f][(k + 1) % 3]} < set(closed[g])


@pytest.mark.parametrize("gap", [-2e-3, -1e-4, 0.0, 1e-3])
@both
def test_a_box_anywhere_on_a_flat_floor_of_triangles_is_held_up_and_by_nothing_else(real, gap):
    """Also over corners and edges and with its own edges near theirs: all normals are up, all gaps the height, and the
    points span the footprint, but for corners that the reduction to four of a face's points cuts."""
    rng, half, n = np.random.default_rng(1), np.array((0.3, 0.2, 0.1)), 60
    a = rng.uniform(0, np.pi, n)
    turn = [0 * a, 0 * a, np.sin(a / 2), np.cos(a / 2)]
    pose = np.column_stack([rng.uniform(-0.5, 0.5, (n, 2)), np.full(n, half[2] + gap), *turn])
    m, where = meet([("box", half)] * n, pose, floor(), 5e-3, real)
    for k in range(len(m)):
        R = matrix(pose[where[k, 0], 3:])
        np.testing.assert_allclose(R @ m[k]["n"], (0, 0, 1), atol=1e-5)
        np.testing.assert_allclose(m[k]["gap"][:m[k]["count"]], gap, atol=2e-6)
    for i in range(n):
        of = m[where[:, 0] == i]
        X = np.concatenate([row["x"][:row["count"]] for row in of])
        assert pytest.importorskip("scipy.spatial").ConvexHull(X[:, :2]).volume > 0.9 * 4 * half[0] * half[1]


@both
def test_a_ball_on_a_flat_floor_touches_at_its_lowest_place(real):
    rng, n = np.random.default_rng(2), 100
    pose = np.column_stack([rng.uniform(-0.8, 0.8, (n, 2)), np.full(n, 0.0995), np.tile((0, 0, 0, 1.0), (n, 1))])
    m, where = meet([("sphere", 0.1)] * n, pose, floor(12), 5e-3, real)
    assert set(where[:, 0]) == set(range(n)) and len(m) < 1.1 * n
    np.testing.assert_allclose(m["n"], np.tile((0, 0, 1.0), (len(m), 1)), atol=1e-6)
    np.testing.assert_allclose(m["gap"][:, 0], -5e-4, atol=2e-6)


@both
def test_a_sheet_holds_from_both_sides_and_a_closed_mesh_from_outside(real):
    below = np.array([0.1, 0.2, -0.0995, 0, 0, 0, 1])
    m, _where = meet([("sphere", 0.1)], below, floor(), 5e-3, real)
    assert len(m) >= 1
    np.testing.assert_allclose(m["n"][0], (0, 0, -1), atol=1e-5)
    inside = np.array([0.1, 0.2, 0.95, 0, 0, 0, 1])
    assert len(meet([("sphere", 0.1)], inside, cube(), 5e-3, real)[0]) == 0


@both
def test_edges_and_corners_of_a_cube_push_the_way_that_is_theirs(real):
    s = (1 + 0.0995 / np.sqrt(2)), (1 + 0.0995 / np.sqrt(3))
    pose = np.array([[s[0], 0.3, s[0], 0, 0, 0, 1], [s[1], s[1], s[1], 0, 0, 0, 1]])
    m, where = meet([("sphere", 0.1)] * 2, pose, cube(), 5e-3, real)
    for i, want in enumerate([(1, 0, 1) / np.sqrt(2), np.ones(3) / np.sqrt(3)]):
        of = m[where[:, 0] == i]
        assert len(of) >= 1
        np.testing.assert_allclose(of["n"], np.tile(want, (len(of), 1)), atol=2e-5)
        np.testing.assert_allclose(of["gap"][:, 0], -5e-4, atol=3e-6)


@pytest.mark.parametrize("tilt", [0.0, 1e-4, 1e-2])
@both
def test_a_box_that_stands_half_over_an_edge_is_not_pushed_aside(real, tilt):
    """Its bottom lies 1 mm in the top of a cube, half a metre of it beyond the wall."""
    pose = np.array([1.0, 0.2, 1.499, 0, np.sin(tilt / 2), 0, np.cos(tilt / 2)])
    m, _where = meet([("box", (0.5, 0.5, 0.5))], pose, cube(), 1e-2, real)
    assert len(m) >= 1
    up = m["n"] @ matrix(pose[3:]).T
    assert (up[:, 2] > 0.999).all() and m["gap"][:, 0].min() > -2e-2


@both
def test_hulls_boxes_and_capsules_have_the_gap_of_a_lone_triangle(real):
    """A triangle has rims: whatever is nearest belongs to it. Against the hull of differences."""
    rng, n = np.random.default_rng(5), 200
    X = np.array([(-1.0, -1, 0), (1, -1, 0.2), (0, 1, -0.1)])
    of = [convex_hull(rng.normal(size=(12, 3)) * 0.3) for _ in range(5)]
    kinds = [("box", (0.3, 0.2, 0.1)), ("capsule", (0.1, 0.3))] + [("hull", 0.0, k) for k in range(5)]
    rows = [kinds[k] for k in rng.integers(0, len(kinds), n)]
    pose = poses(rng, n)
    pose[:, :3] = rng.uniform(-1.5, 1.5, (n, 3)) * (1, 1, 0.6)
    m, where = meet(rows, pose, (X, np.array([(0, 1, 2)])), 10.0, real, of)
    least = {int(i): row["gap"][:row["count"]].min() for row, (i, _face) in zip(m, where, strict=True)}
    error = []
    for k, row in enumerate(rows):
        shape_of = ("hull", of[row[2]].vertices) if row[0] == "hull" else row
        want = polyhedra(shape_of, pose[k], ("triangle", X), STILL)
        if want > 1e-3:
            error.append(abs(least[k] - want))
    assert len(error) > 100
    assert np.median(error) < 1e-6 and max(error) < 2e-3        # where faces are preferred, 1e-3 of the size
