"""Convex hulls of points against closed forms and Qhull (SciPy)."""

import numpy as np
import pytest

from tests.physics.rigid.narrow.reference import SIGNS
from tests.physics.rigid.pairs import matrix, turns
from wsim.geometry.convex_hull import NEAR, DegenerateHull, convex_hull
from wsim.kernels.rigid.narrow.shape import CORNERS
from wsim.physics.rigid.surfaces import simplify_face_loop


def closed(hull):
    """Every edge of the loops is that of two faces, once each way."""
    edges = [(int(i), int(j)) for loop in hull.loops for i, j in zip(loop, np.roll(loop, -1), strict=True)]
    return len(set(edges)) == len(edges) and all((j, i) in set(edges) for i, j in edges)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("seed", range(5))
def test_hulls_of_random_points_are_those_of_qhull(seed, scale):
    rng = np.random.default_rng(seed)
    X = scale * rng.normal(size=(rng.integers(5, 300), 3)) * rng.uniform(0.1, 1.0, 3) + scale * rng.normal(size=3)
    hull, want = convex_hull(X), pytest.importorskip("scipy.spatial").ConvexHull(X)
    assert {tuple(v) for v in hull.vertices} <= {tuple(v) for v in X}
    assert len(hull.vertices) == len(want.vertices)
    assert hull.volume == pytest.approx(want.volume, rel=1e-12)
    assert closed(hull) and len(hull.vertices) - sum(map(len, hull.loops)) // 2 + len(hull.loops) == 2
    assert (X @ hull.normals.T - hull.offsets).max() <= 2 * NEAR * 20 * scale


def test_a_turned_cube_with_points_all_over_it_has_six_faces_of_four():
    rng = np.random.default_rng(2)
    inner = rng.uniform(-1, 1, (400, 3))
    inner[np.arange(200), rng.integers(0, 3, 200)] = 1.0
    R = matrix(turns(rng, 1)[0])
    X = np.float32((np.concatenate([SIGNS, inner, SIGNS])) @ R.T)
    hull = convex_hull(X)
    assert sorted(map(len, hull.loops)) == [4] * 6 and len(hull.vertices) == 8 and closed(hull)
    assert hull.volume == pytest.approx(8.0, rel=1e-6)
    np.testing.assert_allclose(hull.offsets, 1.0, atol=2e-6)
    np.testing.assert_allclose(np.abs(hull.normals @ R).max(1), 1.0, atol=1e-6)


def test_a_prism_of_forty_sides_has_two_caps_which_clipping_thins():
    a = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    ring = np.column_stack([np.cos(a), np.sin(a), 0 * a])
    hull = convex_hull(np.concatenate([ring, ring + (0, 0, 1)]))
    assert sorted(map(len, hull.loops)) == [4] * 40 + [40, 40] and closed(hull)
    cap = max(hull.loops, key=len)
    kept = simplify_face_loop(hull.vertices, cap)
    assert len(kept) == CORNERS and set(kept) < set(cap)


@pytest.mark.parametrize(("points", "dimension"), [
    (np.tile((1.0, 2, 3), (9, 1)), 0), (np.outer(np.linspace(0, 1, 9), (1.0, 2, 3)), 1),
    (np.outer(np.linspace(-1, 1, 9), (1.0, 2, 0)) + np.outer(np.linspace(0, 1, 9) ** 2, (0, 1.0, 0)), 2)])
def test_points_without_a_volume_are_told_apart(points, dimension):
    with pytest.raises(DegenerateHull) as told:
        convex_hull(points)
    assert told.value.dimension == dimension


@pytest.mark.parametrize("points", [np.zeros((0, 3)), [[0, 0, np.nan], [1, 0, 0], [0, 1, 0], [0, 0, 1]]])
def test_no_points_and_points_that_are_not_finite_raise(points):
    with pytest.raises(ValueError, match="finite"):
        convex_hull(points)


def test_a_hull_of_few_vertices_says_how_far_it_is_from_all():
    """Of a ball by 4000 points; 100 vertices leave at most what a cap of a hundredth of the sphere rises by, twice over."""
    X = np.random.default_rng(0).normal(size=(4000, 3))
    X /= np.linalg.norm(X, axis=1, keepdims=True)
    hull = convex_hull(X, most=100)
    beyond = (X @ hull.normals.T - hull.offsets).max()
    assert len(hull.vertices) <= 100
    assert beyond <= hull.error + 1e-12 and 0.0 < hull.error < 2 * 2 * 2 / 100
