"""Gaps by GJK and EPA against float64 references found another way: the hull of all differences of corners, or closed forms."""

from functools import cache

import numpy as np
import pytest
import warp as wp

from tests.physics.rigid.narrow.reference import SIGNS, polyhedra, round_shapes
from tests.physics.rigid.pairs import PRECISIONS, WHERE, matrix, poses, shapes, touch, turns
from wsim.geometry.convex_hull import convex_hull
from wsim.kernels.math.real import types
from wsim.kernels.rigid.narrow.clip import clip_types
from wsim.kernels.rigid.narrow.gjk import gjk_nearest_func
from wsim.kernels.rigid.narrow.pair import pairs_of_kinds, pairs_without_closed_form
from wsim.kernels.rigid.narrow.shape import hull_type, shape_type
from wsim.physics.rigid.surfaces import hull_tables as tables

KINDS = frozenset(("sphere", "box", "capsule", "cylinder", "cone", "hull"))
STILL = np.array([0.0, 0, 0, 0, 0, 0, 1])
both = pytest.mark.parametrize("real", PRECISIONS, ids=("f32", "f64"))
MEDIAN, MOST = 3e-7, 1e-5                     # of the size


@cache
def kernel(real):
    t, Shape, Hulls, Nearest, of = (types(real), shape_type(real), hull_type(real), clip_types(real).Nearest,
                                    gjk_nearest_func(KINDS, real))

    @wp.kernel(module="unique", enable_backward=False)
    def gaps(a: wp.array(dtype=Shape), b: wp.array(dtype=Shape), H: Hulls, R: wp.array(dtype=t.mat33),
             p: wp.array(dtype=t.vec3), margin: real, out: wp.array(dtype=Nearest)):
        i = wp.tid()
        out[i] = of(a[i], b[i], H, R[i], p[i], margin)

    return gaps


def apart_by(a, pose_a, b, pose_b, real, H=None):
    """Nearest of each pair, by GJK and EPA alone."""
    t, n = types(real), len(a)
    A, B = (matrix(np.broadcast_to(pose, (n, 7))[:, 3:]) for pose in (pose_a, pose_b))
    d = np.broadcast_to(pose_b, (n, 7))[:, :3] - np.broadcast_to(pose_a, (n, 7))[:, :3]
    R = wp.array(np.ascontiguousarray(np.swapaxes(A, 1, 2) @ B), dtype=t.mat33, **WHERE)
    p = wp.array(np.ascontiguousarray(np.einsum("nji,nj->ni", A, d)), dtype=t.vec3, **WHERE)
    out = wp.zeros(n, dtype=clip_types(real).Nearest, **WHERE)
    wp.launch(kernel(real), n, [shapes(a, real), shapes(b, real), H or hull_type(real)(), R, p, 1e30], [out], **WHERE)
    return out.numpy()


def clouds(rng, n, scale=1.0):
    """Hulls of random points, some flat, some long, some of float32's cubes and prisms."""
    found = []
    for k in range(n):
        X = rng.normal(size=(rng.integers(4, 20), 3)) * rng.uniform(0.1, 1.0, 3)
        if k % 4 == 0:
            X = SIGNS * rng.uniform(0.2, 1.0, 3)
        if k % 4 == 1:
            X = np.concatenate([X * (1, 1, 0), X * (1, 1, 0) + (0, 0, 0.5)])
        found.append(convex_hull(scale * X / np.abs(X).max()))
    return found


def judged(got, want, size, real):
    """The numbers to reach; a sign is wrong where the gap is more than rounding."""
    error = np.abs(got - want) / size
    assert np.isfinite(got).all()
    assert np.median(error) < (MEDIAN if real is wp.float32 else 1e-13), np.median(error)
    assert error.max() < (MOST if real is wp.float32 else 1e-9), (error.max(), int(error.argmax()))
    wrong = (got * want < 0) & (np.abs(want) > MEDIAN * size)
    assert not wrong.any(), np.flatnonzero(wrong)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@both
def test_hulls_anywhere_have_the_gap_of_their_differences(real, scale):
    """300 pairs, half of them overlapping; turned and at places to 2 sizes."""
    rng = np.random.default_rng(1)
    n, of = 300, clouds(rng, 40, scale)
    rows = rng.integers(0, 40, (2, n))
    a, b = ([("hull", 0.0, int(k)) for k in row] for row in rows)
    pose_a, pose_b = poses(rng, n, scale), poses(rng, n, scale)
    pose_b[:, :3] = pose_a[:, :3] + scale * rng.uniform(0.0, 1.6, (n, 1)) * (matrix(turns(rng, n)) @ (0, 0, 1.0))
    want = np.array([polyhedra(("hull", of[i].vertices), pose_a[k], ("hull", of[j].vertices), pose_b[k])
                     for k, (i, j) in enumerate(rows.T)])
    assert 0.25 < (want < 0).mean() < 0.75
    judged(apart_by(a, pose_a, b, pose_b, real, tables(of, real, WHERE["device"]))["gap"], want, 2 * scale, real)


@both
def test_hulls_that_nearly_touch_are_told_apart_from_those_that_do(real):
    """Any two hulls pushed together along their normal until 1e-8 to 1e-2 of their size is left between them, or overlaps:
    corners, edges and faces against one another, where directions are rounding."""
    rng = np.random.default_rng(11)
    n, of = 600, clouds(rng, 40)
    rows = rng.integers(0, 40, (2, n))
    a, b = ([("hull", 0.0, int(k)) for k in row] for row in rows)
    pose_a, pose_b = poses(rng, n), poses(rng, n)
    pose_b[:, :3] = pose_a[:, :3] + rng.uniform(0.3, 1.6, (n, 1)) * (matrix(turns(rng, n)) @ (0, 0, 1.0))
    before = apart_by(a, pose_a, b, pose_b, wp.float64, tables(of, wp.float64, WHERE["device"]))
    left = rng.choice([-1, 1], n) * 10.0 ** rng.uniform(-8, -2, n)
    normal = np.einsum("nij,nj->ni", matrix(pose_a[:, 3:]), before["n"])
    pose_b[:, :3] -= normal * (left - before["gap"])[:, None]
    want = np.array([polyhedra(("hull", of[i].vertices), pose_a[k], ("hull", of[j].vertices), pose_b[k])
                     for k, (i, j) in enumerate(rows.T)])
    assert (np.abs(want) < 1e-2 + 1e-9).all() and 0.4 < (want < 0).mean() < 0.6
    judged(apart_by(a, pose_a, b, pose_b, real, tables(of, real, WHERE["device"]))["gap"], want, 2.0, real)


@both
def test_boxes_with_parallel_faces_and_edges_have_the_gap_that_is_theirs(real):
    """Faces, edges and corners that face each other, shifted along them, from deep to 1e-7 apart; closed forms."""
    rng = np.random.default_rng(2)
    gaps = np.concatenate([s * 10.0 ** np.arange(-7, 0) for s in (-1, 1)] + [[0.0, -0.9]])
    half = np.array((0.5, 0.4, 0.3))
    at, want = [], []
    for gap in gaps:
        for axis in range(3):
            for shift in (0.0, 0.1, 0.37, rng.uniform(0, 0.5)):
                p = shift * half
                p[axis] = 2 * half[axis] + gap
                at.append([*p, 0, 0, 0, 1])
                want.append(gap if gap > -0.5 else None)
        if gap > 0:
            at += [[1.0 + gap, 0.8 + gap, 0.1, 0, 0, 0, 1], [1 + gap, 0.8 + gap, 0.6 + gap, 0, 0, 0, 1]]
            want += [np.sqrt(2) * gap, np.sqrt(3) * gap]
    at = np.array(at)
    for k in range(len(at)):                                  # deep ones: out of any face, the least way
        want[k] = (np.abs(at[k, :3]) - 2 * half).max() if want[k] is None else want[k]
    a = [("box", half)] * len(at)
    judged(apart_by(a, STILL, a, at, real)["gap"], np.array(want), 2 * np.linalg.norm(half), real)


@both
def test_shapes_in_one_place_are_pushed_out_the_least_way(real):
    """Centre on centre: a box by its least edge, a cylinder and a hull likewise."""
    rng = np.random.default_rng(3)
    of = clouds(rng, 4)
    a = [("box", (0.5, 0.4, 0.3)), ("box", (0.5, 0.4, 0.3)), ("cylinder", (0.5, 0.2)), ("hull", 0.0, 2), ("cone", (0.5, 0.5))]
    b = [("box", (0.5, 0.4, 0.3)), ("sphere", (0.1,)), ("cylinder", (0.5, 0.2)), ("hull", 0.0, 2), ("sphere", (0.1,))]
    same = ("hull", of[2].vertices)
    want = np.array([-0.6, -0.4, -0.4, polyhedra(same, STILL, same, STILL), -0.1 - 0.5 / np.sqrt(5)])
    got = apart_by(a, STILL, b, STILL, real, tables(of, real, WHERE["device"]))["gap"]
    np.testing.assert_allclose(got, want, atol=2e-6)


@both
def test_round_shapes_have_the_gap_of_a_search_over_directions(real):
    """Cylinders, cones, capsules and boxes. The search itself is right to some 1e-6; never above the truth where apart."""
    rng = np.random.default_rng(4)
    size = {"box": (0.3, 0.5, 0.7), "capsule": (0.25, 0.6), "cylinder": (0.4, 0.5), "cone": (0.5, 0.6)}
    n = 120
    a, b = ([(k, size[k]) for k in rng.choice(kinds, n)] for kinds in (["cylinder", "cone"], list(size)))
    pose_a, pose_b = poses(rng, n), poses(rng, n)
    pose_b[:, :3] = pose_a[:, :3] + rng.uniform(0.2, 1.6, (n, 1)) * (matrix(turns(rng, n)) @ (0, 0, 1.0))
    want = np.array([round_shapes(a[k], pose_a[k], b[k], pose_b[k]) for k in range(n)])
    got = apart_by(a, pose_a, b, pose_b, real)["gap"]
    assert np.median(np.abs(got - want)) < 1e-6
    assert np.abs(got - want).max() < 2e-5
    assert not ((got * want < 0) & (np.abs(want) > 1e-5)).any()


@both
def test_the_other_way_round_is_the_same_gap(real):
    rng = np.random.default_rng(5)
    n, of = 200, clouds(rng, 20)
    a, b = ([("hull", 0.0, int(k)) for k in rng.integers(0, 20, n)] for _ in range(2))
    pose_a, pose_b = poses(rng, n, 0.5), poses(rng, n, 0.5)
    H = tables(of, real, WHERE["device"])
    one, other = apart_by(a, pose_a, b, pose_b, real, H), apart_by(b, pose_b, a, pose_a, real, H)
    np.testing.assert_allclose(one["gap"], other["gap"], atol=4e-6 if real is wp.float32 else 1e-12)


@both
def test_a_huge_hull_and_a_tiny_one_keep_the_digits_of_the_huge(real):
    """1e3 against 1e-3: on a face, the gap to rounding of the large."""
    large, small = ("box", (500.0, 400.0, 300.0)), ("box", (5e-4, 4e-4, 3e-4))
    at = np.array([[1.0, 2.0, 300.0 + z, 0, 0, 0, 1] for z in (0.0, 0.01, -0.01, -100.0, 50.0)])
    got = apart_by([large] * 5, STILL, [small] * 5, at, real)["gap"]
    np.testing.assert_allclose(got, at[:, 2] - 300.0 - 3e-4, atol=1000 * (3e-7 if real is wp.float32 else 1e-13))


@both
def test_hulls_face_to_face_touch_at_four_points_with_equal_gaps(real):
    """A prism of six sides lies on a cube's face, both hulls, turned in space."""
    rng = np.random.default_rng(6)
    a = np.linspace(0, 2 * np.pi, 6, endpoint=False)
    ring = 0.4 * np.column_stack([np.cos(a), np.sin(a), 0 * a])
    of = [convex_hull(0.5 * SIGNS), convex_hull(np.concatenate([ring, ring + (0, 0, 0.5)]))]
    q = turns(rng, 1)[0]
    pose_a, pose_b = np.array([1.0, 2, 3, *q]), np.array([*(matrix(q) @ (0.02, 0.03, 0.505) + (1, 2, 3)), *q])
    m = touch([("hull", 0.0, 0)], pose_a, [("hull", 0.0, 1)], pose_b, 0.02, real, tables(of, real, WHERE["device"]),
              pairs_of_kinds(("hull",)))[0]
    assert m["count"] == 4 and len(set(m["key"])) == 4
    np.testing.assert_allclose(m["gap"], 0.005, atol=2e-6 if real is wp.float32 else 1e-12)
    np.testing.assert_allclose(m["n"], -matrix(q)[:, 2], atol=2e-6)


@both
def test_keys_of_hulls_last_under_small_motions(real):
    """Two equal cubes as hulls, corners on corners, shaken by 2e-5: a fifth of the slack of corners."""
    rng, n = np.random.default_rng(7), 100
    pose = np.tile((0.0, 0, 1.0, 0, 0, 0, 1), (n, 1))
    pose[:, :3] += rng.uniform(-2e-5, 2e-5, (n, 3))
    of = [convex_hull(0.5 * SIGNS)]
    a = [("hull", 0.0, 0)] * n
    m = touch(a, STILL, a, pose, 0.02, real, tables(of, real, WHERE["device"]), pairs_of_kinds(("hull",)))
    assert (m["count"] == 4).all() and (m["key"] == m["key"][0]).all() and len(set(m["key"][0])) == 4


def test_closed_forms_ask_for_no_search():
    assert not pairs_without_closed_form(pairs_of_kinds(("plane", "sphere", "box", "capsule")))
    assert pairs_without_closed_form(pairs_of_kinds(("sphere", "hull"))) == {("sphere", "hull"), ("hull", "hull")}
    assert ("plane", "plane") not in pairs_of_kinds(("plane", "box")) and len(pairs_of_kinds(("plane", "box"))) == 2


@both
def test_coal_finds_the_same_gaps(real):
    """Where coal is installed. Apart: to 1e-5. Overlapping, each depth is a bound from above; ours is never the greater."""
    coal = pytest.importorskip("coal")
    make = {"box": lambda s: coal.Box(*(2 * np.array(s))), "capsule": lambda s: coal.Capsule(s[0], 2 * s[1]),
            "cylinder": lambda s: coal.Cylinder(s[0], 2 * s[1]), "cone": lambda s: coal.Cone(s[0], 2 * s[1])}
    size = {"box": (0.3, 0.5, 0.7), "capsule": (0.25, 0.6), "cylinder": (0.4, 0.5), "cone": (0.5, 0.6)}
    rng, n = np.random.default_rng(21), 600
    a, b = ([(k, size[k]) for k in rng.choice(list(size), n)] for _ in range(2))
    pose_a, pose_b = poses(rng, n), poses(rng, n)
    pose_b[:, :3] = pose_a[:, :3] + rng.uniform(0.2, 1.5, (n, 1)) * (matrix(turns(rng, n)) @ (0, 0, 1.0))
    asked = coal.DistanceRequest()
    asked.gjk_tolerance = asked.epa_tolerance = 1e-10
    asked.gjk_max_iterations = asked.epa_max_iterations = 1000
    want = []
    for (kind_a, size_a), p, (kind_b, size_b), q in zip(a, pose_a, b, pose_b, strict=True):
        placed = [coal.Transform3s(matrix(pose[3:]), pose[:3]) for pose in (p, q)]
        want.append(coal.distance(make[kind_a](size_a), placed[0], make[kind_b](size_b), placed[1], asked,
                                  coal.DistanceResult()))
    want, got = np.array(want), apart_by(a, pose_a, b, pose_b, real)["gap"]
    apart_ones = want > 0
    assert 0.2 < apart_ones.mean() < 0.8 and np.median(np.abs(got - want)) < (MEDIAN if real is wp.float32 else 1e-10)
    assert np.abs(got - want)[apart_ones].max() < MOST
    assert (got < 0)[want < -MOST].all() and (got > want - MOST).all()


@both
def test_coal_finds_the_same_gaps_of_hulls(real):
    """Where coal is installed: flat, long and other hulls, anywhere and nearly touching; of hulls its depths are exact too."""
    coal = pytest.importorskip("coal")
    rng, n = np.random.default_rng(22), 400
    of = clouds(rng, 40)
    rows = rng.integers(0, 40, (2, n))
    a, b = ([("hull", 0.0, int(k)) for k in row] for row in rows)
    pose_a, pose_b = poses(rng, n), poses(rng, n)
    pose_b[:, :3] = pose_a[:, :3] + rng.uniform(0.2, 1.5, (n, 1)) * (matrix(turns(rng, n)) @ (0, 0, 1.0))
    H = tables(of, real, WHERE["device"])
    near = apart_by(a, pose_a, b, pose_b, wp.float64, tables(of, wp.float64, WHERE["device"]))
    left = rng.choice([-1, 1], n // 2) * 10.0 ** rng.uniform(-6, -2, n // 2)
    normal = np.einsum("nij,nj->ni", matrix(pose_a[:, 3:]), near["n"])[:n // 2]
    pose_b[:n // 2, :3] -= normal * (left - near["gap"][:n // 2])[:, None]
    solid = []
    for hull in of:
        points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        points.extend(list(hull.vertices))
        faces.extend([coal.Triangle(*map(int, face)) for face in hull.triangles])
        solid.append(coal.Convex(points, faces))
    asked = coal.DistanceRequest()
    asked.gjk_tolerance = asked.epa_tolerance = 1e-10
    asked.gjk_max_iterations = asked.epa_max_iterations = 1000
    want = np.array([coal.distance(solid[i], coal.Transform3s(matrix(p[3:]), p[:3]), solid[j],
                                   coal.Transform3s(matrix(q[3:]), q[:3]), asked, coal.DistanceResult())
                     for i, j, p, q in zip(*rows, pose_a, pose_b, strict=True)])
    got = apart_by(a, pose_a, b, pose_b, real, H)["gap"]
    error = np.abs(got - want) / 2.0
    assert 0.2 < (want > 0).mean() < 0.8 and np.median(error) < (MEDIAN if real is wp.float32 else 1e-9)
    assert error[want > 0].max() < MOST
    assert not ((got * want < 0) & (np.abs(want) > MOST)).any() and (got > want - MOST).all()
