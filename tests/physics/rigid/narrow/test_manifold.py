"""Manifolds of planes, spheres, boxes and capsules against closed forms."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.rigid.narrow.manifold import about, both, eps
from tests.physics.rigid.narrow.reference import polyhedra
from tests.physics.rigid.pairs import matrix, poses, touch, turns
from wsim.kernels.rigid.narrow.pair import pairs_of_kinds

STILL = np.array([0.0, 0, 0, 0, 0, 0, 1])
CLOSED = pairs_of_kinds(("plane", "sphere", "box", "capsule"))
UNIT = ("box", (0.5, 0.5, 0.5))
SIZES = {"sphere": (0.4,), "box": (0.3, 0.5, 0.7), "capsule": (0.25, 0.6)}


def one(a, pose_a, b, pose_b, margin=0.1, real=wp.float64):
    return touch([a], pose_a, [b], pose_b, margin, real, pairs=CLOSED)[0]


def at(x, y, z, q=(0.0, 0, 0, 1)):
    return np.array([x, y, z, *q])


@both
def test_boxes_face_to_face_touch_at_four_corners_with_equal_gaps(real):
    m = one(UNIT, STILL, UNIT, at(0.2, 0.1, 1.01), real=real)
    assert m["count"] == 4
    np.testing.assert_allclose(m["gap"], 0.01, atol=8 * eps(real))
    np.testing.assert_allclose(m["n"], (0, 0, -1), atol=4 * eps(real))
    want = {(x, y, 0.505) for x in (-0.3, 0.5) for y in (-0.4, 0.5)}
    assert {tuple(np.round(x, 5) + 0.0) for x in m["x"].astype(float)} == want


@both
def test_a_box_turned_by_45_degrees_keeps_four_of_eight_points_about_its_axis(real):
    m = one(UNIT, STILL, UNIT, at(0, 0, 0.99, about((0, 0, 1), np.pi / 4)), real=real)
    assert m["count"] == 4
    np.testing.assert_allclose(m["gap"], -0.01, atol=8 * eps(real))
    np.testing.assert_allclose(m["x"].mean(0), (0, 0, 0.495), atol=0.06)


@both
def test_a_box_on_a_plane_has_four_points_and_a_tilted_one_two(real):
    flat = one(("plane", 0.0), STILL, UNIT, at(3, 4, 0.495), real=real)
    assert flat["count"] == 4
    np.testing.assert_allclose(flat["gap"], -0.005, atol=8 * eps(real))
    np.testing.assert_allclose(flat["x"][:, 2], -0.0025, atol=8 * eps(real))
    tilted = one(("plane", 0.0), STILL, UNIT, at(3, 4, 0.6, about((0, 1, 0), 0.3)), margin=0.02, real=real)
    assert tilted["count"] == 2
    np.testing.assert_allclose(tilted["gap"][:2], 0.6 - 0.5 * (np.cos(0.3) + np.sin(0.3)), atol=8 * eps(real))


@both
def test_parallel_capsules_touch_at_the_two_ends_of_what_they_share(real):
    a = ("capsule", (0.25, 0.6))
    m = one(a, STILL, a, at(0.49, 0, 0.4), real=real)
    assert m["count"] == 2
    np.testing.assert_allclose(m["gap"][:2], -0.01, atol=8 * eps(real))
    assert sorted(np.round(m["x"][:2, 2].astype(float), 5)) == [-0.2, 0.6]
    crossed = one(a, STILL, a, at(0.49, 0, 0.1, about((1, 0, 0), 1.0)), real=real)
    assert crossed["count"] == 1
    np.testing.assert_allclose(crossed["gap"][0], -0.01, atol=8 * eps(real))
    on_box = one(UNIT, STILL, a, at(0, 0, 0.74, about((0, 1, 0), np.pi / 2)), real=real)
    assert on_box["count"] == 2
    np.testing.assert_allclose(sorted(on_box["x"][:2, 0]), (-0.5, 0.5), atol=1e-6)


@both
def test_crossed_edges_touch_at_one_point(real):
    a, b = about((1, 0, 0), np.pi / 4), about((0, 1, 0), np.pi / 4)
    m = one(UNIT, at(0, 0, 0, a), UNIT, at(0.1, 0.2, np.sqrt(2) - 0.01, b), real=real)
    assert m["count"] == 1
    np.testing.assert_allclose(m["gap"][0], -0.01, atol=1e-5 if real is wp.float32 else 1e-12)
    np.testing.assert_allclose(m["x"][0], (0.1, 0.0, (np.sqrt(2) - 0.01) / 2), atol=2e-6)
    np.testing.assert_allclose(m["n"], (0, 0, -1), atol=2e-6)


def random_pairs(seed, n=300, scale=1.0):
    """Pairs of all kinds but planes, mostly near one another."""
    rng = np.random.default_rng(seed)
    kinds = [[(k, tuple(scale * s for s in SIZES[k])) for k in rng.choice(list(SIZES), n)] for _ in range(2)]
    pose_a, pose_b = poses(rng, n, scale), poses(rng, n, scale)
    pose_b[:, :3] = pose_a[:, :3] + scale * rng.uniform(0.1, 1.3, (n, 1)) * (matrix(turns(rng, n)) @ (0, 0, 1.0))
    return *kinds, pose_a, pose_b


def hollow(kind):
    return kind in ("sphere", "capsule")


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@both
def test_no_gap_of_overlapping_pairs_is_wrong(real, scale):
    """Against the hull of differences. The deepest point may miss the depth by what faces are preferred."""
    a, b, pose_a, pose_b = random_pairs(3, scale=scale)
    m = touch(a, pose_a, b, pose_b, 1e30, real, pairs=CLOSED)
    tested = 0
    for k in range(len(a)):
        if hollow(a[k][0]) and hollow(b[k][0]):
            continue                                             # differences without volume
        want = polyhedra(a[k], pose_a[k], b[k], pose_b[k])
        boxes = a[k][0] == b[k][0] == "box"
        count = m[k]["count"]
        if count == 0:
            assert boxes and want > 0, (k, want)
            continue
        got = m[k]["gap"][:count].min()
        exact = not boxes
        if want < 0 or exact:
            assert abs(got - want) < (1e-5 if not boxes and count == 1 else 2.5e-3) * scale, (k, a[k], b[k], want, got, count)
            assert want * got > 0 or abs(want) < 1e-3 * scale
            tested += 1
        else:
            assert got > -1e-5 * scale                           # separating axes: apart, by a bound
    assert tested > 150


@both
def test_places_and_gaps_are_the_same_from_the_other_side(real):
    a, b, pose_a, pose_b = random_pairs(4)
    m = touch(a, pose_a, b, pose_b, 0.2, real, pairs=CLOSED)
    w = touch(b, pose_b, a, pose_a, 0.2, real, pairs=CLOSED)
    same = 0
    for k in range(len(a)):
        n = m[k]["count"]
        if n == 1 and w[k]["count"] == 1 and np.dot(m[k]["n"], w[k]["n"]) < -0.999:
            np.testing.assert_allclose(m[k]["gap"][0], w[k]["gap"][0], atol=200 * eps(real))
            np.testing.assert_allclose(m[k]["x"][0] + pose_a[k, :3], w[k]["x"][0] + pose_b[k, :3], atol=1e5 * eps(real))
            same += 1
    deepest = [np.where(np.arange(4) < x["count"][:, None], x["gap"], np.inf).min(1) for x in (m, w)]
    met = np.isfinite(deepest[0]) & np.isfinite(deepest[1])
    np.testing.assert_allclose(deepest[0][met], deepest[1][met], atol=2e-3)
    assert same > 50 and met.sum() > 150


@both
def test_gaps_and_keys_are_invariant_under_rigid_motion(real):
    """Up to rounding; 3 m from the origin."""
    a, b, pose_a, pose_b = random_pairs(5)
    turn, shift = turns(np.random.default_rng(6), 1)[0], np.array([1.0, -2.0, 2.0])
    R = matrix(turn)

    def moved(pose):
        q = pose[:, 3:]
        x, w = q[:, :3], q[:, 3:]
        vector = turn[3] * x + w * turn[:3] + np.cross(turn[:3], x)
        return np.hstack([pose[:, :3] @ R.T + shift, vector, turn[3] * w - (x @ turn[:3])[:, None]])
    m = touch(a, pose_a, b, pose_b, 0.2, real, pairs=CLOSED)
    w = touch(a, moved(pose_a), b, moved(pose_b), 0.2, real, pairs=CLOSED)
    equal = [k for k in range(len(a)) if m[k]["count"] == w[k]["count"] and (m[k]["key"] == w[k]["key"]).all()]
    assert len(equal) >= (0.98 if real is wp.float32 else 1.0) * len(a)
    np.testing.assert_allclose(m["gap"][equal], w["gap"][equal], atol=2000 * eps(real))
    np.testing.assert_allclose(m["x"][equal] @ R.T, w["x"][equal], atol=2e-3 if real is wp.float32 else 1e-9)


@both
def test_keys_last_while_a_stack_of_boxes_shakes(real):
    """Equal boxes on one another, corners on corners: places differ by up to 2e-5, a fifth of the slack of corners."""
    rng = np.random.default_rng(7)
    n = 200
    pose = np.tile(at(0, 0, 1.0), (n, 1))
    pose[:, :3] += rng.uniform(-2e-5, 2e-5, (n, 3))
    pose[:, 3:] = [about(axis / np.linalg.norm(axis), 2e-5) for axis in rng.normal(size=(n, 3))]
    m = touch([UNIT] * n, STILL, [UNIT] * n, pose, 0.02, real, pairs=CLOSED)
    assert (m["count"] == 4).all()
    assert (m["key"] == m["key"][0]).all() and len(set(m["key"][0])) == 4


@both
def test_far_from_the_origin_nothing_is_lost(real):
    """1 km away in steps that float32 holds: the pair has the gaps that it has at the origin, to the bit."""
    near = one(UNIT, STILL, UNIT, at(0.25, 0.125, 0.9375), real=real)
    far = one(UNIT, at(1024, -512, 256), UNIT, at(1024.25, -511.875, 256.9375), real=real)
    for name in ("n", "gap", "x", "key", "count"):
        np.testing.assert_array_equal(near[name], far[name])
