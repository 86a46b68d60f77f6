"""Distances and sweeps against brute force and closed forms, in float32 and float64."""

from functools import cache

import numpy as np
import pytest
import warp as wp

from wsim.kernels.contact import collide
from wsim.kernels.contact.collider.shape import CONVEX, convex_distance_func
from wsim.kernels.math.real import types

SIZES = {"plane": (0.0, 0.0, 0.0), "sphere": (0.4, 0.0, 0.0), "box": (0.3, 0.5, 0.2), "capsule": (0.2, 0.35, 0.0),
         "cylinder": (0.35, 0.25, 0.0), "cone": (0.4, 0.3, 0.0)}
REALS = [wp.float32, wp.float64]


def gap(kind, q):
    """Largest of the functions that are <= 0 inside, (n,): only its sign is used."""
    a, b, c = SIZES[kind]
    x, y, z = q.T
    rho = np.hypot(x, y)
    return {"plane": lambda: z, "sphere": lambda: np.linalg.norm(q, axis=1) - a,
            "box": lambda: np.max(np.abs(q) - (a, b, c), axis=1),
            "capsule": lambda: np.linalg.norm(np.stack([x, y, z - np.clip(z, -b, b)], 1), axis=1) - a,
            "cylinder": lambda: np.maximum(rho - a, np.abs(z) - b),
            "cone": lambda: np.maximum(rho - a * (b - z) / (2 * b), -b - z)}[kind]()


def to_segment(p, a, b):
    """Distance of points (n, 2) to a segment."""
    a, b = np.array(a, float), np.array(b, float)
    t = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return np.linalg.norm(p - a - t[:, None] * (b - a), axis=1)


def to_boundary(kind, q):
    """Unsigned distance to the boundary, piece by piece, (n,)."""
    a, b, _ = SIZES[kind]
    if kind == "plane":
        return np.abs(q[:, 2])
    if kind == "box":                                  # nearest of six clamped faces
        half, best = np.array(SIZES["box"]), np.full(len(q), np.inf)
        for axis in range(3):
            for side in (-1, 1):
                p = np.clip(q, -half, half)
                p[:, axis] = side * half[axis]
                best = np.minimum(best, np.linalg.norm(q - p, axis=1))
        return best
    p = np.stack([np.hypot(q[:, 0], q[:, 1]), q[:, 2]], 1)          # profile (rho, z)
    if kind == "sphere":
        return np.abs(np.linalg.norm(p, axis=1) - a)
    if kind == "capsule":
        ends = np.abs(np.linalg.norm(p - np.stack([0 * p[:, 1], np.sign(p[:, 1]) * b], 1), axis=1) - a)
        return np.where(np.abs(p[:, 1]) > b, ends, np.abs(p[:, 0] - a))
    pieces = {"cylinder": [((0, -b), (a, -b)), ((a, -b), (a, b)), ((0, b), (a, b))],
              "cone": [((0, -b), (a, -b)), ((a, -b), (0, b))]}[kind]
    return np.min([to_segment(p, *piece) for piece in pieces], axis=0)


@cache
def evaluator(real):
    t, formula = types(real), convex_distance_func(CONVEX)

    @wp.kernel(module="test_collide", enable_backward=False)
    def evaluate(kind: int, size: t.vec3, q: wp.array(dtype=t.vec3), phi: wp.array(dtype=real),
                 n: wp.array(dtype=t.vec3)):
        i = wp.tid()
        f, m = formula(kind, size, q[i])
        phi[i] = f
        n[i] = m
    return evaluate


def evaluate(real, kind, q):
    """phi (n,) and normals (n, 3), float64, from the device function."""
    t = types(real)
    points = wp.array(q, dtype=t.vec3, device="cpu")
    phi, n = wp.zeros(len(q), dtype=real, device="cpu"), wp.zeros(len(q), dtype=t.vec3, device="cpu")
    wp.launch(evaluator(real), len(q), [CONVEX.index(kind), t.vec3(*SIZES[kind]), points], [phi, n], device="cpu")
    return phi.numpy().astype(np.float64), n.numpy().astype(np.float64)


def cloud(n=400, seed=3):
    q = np.random.default_rng(seed).uniform(-0.9, 0.9, (n, 3))
    return q.astype(np.float32).astype(np.float64)          # the same points in both precisions


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("kind", CONVEX)
def test_distance_is_that_of_the_nearest_surface_point(kind, real):
    q = cloud()
    phi, _ = evaluate(real, kind, q)
    atol = 5e-7 if real is wp.float32 else 1e-14                  # a few roundings of coordinates of 1 m
    np.testing.assert_allclose(np.abs(phi), to_boundary(kind, q), atol=atol)
    assert ((phi < 0) == (gap(kind, q) < 0)).all() and (phi < 0).any() and (phi > 0).any()


@pytest.mark.parametrize("kind", CONVEX)
def test_normal_is_the_gradient_and_has_length_one(kind):
    q, h = cloud(seed=4), 1e-6
    phi, n = evaluate(wp.float64, kind, q)
    slope = np.stack([(evaluate(wp.float64, kind, q + h * e)[0] - evaluate(wp.float64, kind, q - h * e)[0]) / (2 * h)
                      for e in np.eye(3)], axis=1)
    smooth = np.abs(np.linalg.norm(slope, axis=1) - 1) < 1e-6     # not astride a ridge, where two faces are as near
    assert smooth.mean() > 0.98
    # second derivative at most 1 / distance to a feature: h^2 of it and rounding 1e-16 / h
    np.testing.assert_allclose(n[smooth], slope[smooth], atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0, atol=1e-14)


@pytest.mark.parametrize("kind", CONVEX)
def test_float32_normals_hold_at_the_surface(kind):
    """A point pushed onto the surface is within rounding of it; its normal must not be made of rounding."""
    q = cloud(seed=5)
    phi, n = evaluate(wp.float64, kind, q)
    on = q - (phi - 1e-7)[:, None] * n
    near = phi > 0                                         # from outside, where edges and corners are reached too
    _, exact = evaluate(wp.float64, kind, on)
    _, found = evaluate(wp.float32, kind, on)
    faces = near & (np.linalg.norm(exact - n, axis=1) < 1e-3)
    smooth = faces & (np.linalg.norm(evaluate(wp.float64, kind, on - 4e-7 * n)[1] - n, axis=1) < 1e-3)
    assert smooth.sum() > 50
    np.testing.assert_allclose(found[smooth], exact[smooth], atol=2e-6)    # coordinates round to 6e-8 of 0.2 m
    assert np.isfinite(found).all()
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-6)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("kind", CONVEX)
def test_centres_and_axes_have_a_unit_normal(kind, real):
    q = np.array([[0, 0, 0], [0, 0, 0.1], [0, 0, -0.1], [0, 0, SIZES[kind][1]], [0, 0, -SIZES[kind][1]], [0, 0, 2.0]])
    phi, n = evaluate(real, kind, q)
    assert np.isfinite(phi).all()
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0, atol=1e-6)


@cache
def sweeper(real):
    t, formula = types(real), collide.convex_touch_func(CONVEX, real)

    @wp.kernel(module="test_collide", enable_backward=False)
    def sweep(kind: int, size: t.vec3, q0: wp.array(dtype=t.vec3), q1: wp.array(dtype=t.vec3), r: real, margin: real,
              C: wp.array(dtype=real), n: wp.array(dtype=t.vec3), p: wp.array(dtype=t.vec3), s0: wp.array(dtype=real)):
        i = wp.tid()
        c, m, touch, start = formula(kind, size, q0[i], q1[i], r, margin, real(0.0))
        C[i] = c
        n[i] = m
        p[i] = touch
        s0[i] = start
    return sweep


def sweep(real, kind, q0, q1, r, margin):
    t = types(real)
    out = [wp.zeros(len(q0), dtype=d, device="cpu") for d in (real, t.vec3, t.vec3, real)]
    ends = [wp.array(q, dtype=t.vec3, device="cpu") for q in (q0, q1)]
    wp.launch(sweeper(real), len(q0), [CONVEX.index(kind), t.vec3(*SIZES[kind]), *ends, r, margin], out, device="cpu")
    return [o.numpy().astype(np.float64) for o in out]


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("kind", CONVEX)
def test_a_sweep_finds_a_crossing_exactly_when_there_is_one(kind, real):
    rng, r = np.random.default_rng(7), 0.01
    q0 = rng.uniform(-0.9, 0.9, (600, 3)).astype(np.float32)
    q1 = (q0 + rng.normal(0.0, 0.7, q0.shape)).astype(np.float32)
    outside = evaluate(wp.float64, kind, q0)[0] > r + 1e-3
    q0, q1 = q0[outside], q1[outside]
    tau = np.linspace(0.0, 1.0, 801)[:, None, None]
    along = evaluate(wp.float64, kind, (q0 + tau * (q1 - q0)).reshape(-1, 3))[0].reshape(801, -1).min(axis=0)
    C, n, p, s0 = sweep(real, kind, q0, q1, r, 10.0)
    crosses, misses = along < r - 2e-3, along > r + 2e-3          # samples are up to 4e-3 m apart, so not the doubtful
    assert crosses.sum() > 20 and misses.sum() > 20
    assert (C[crosses] < 0).all()
    ends = evaluate(wp.float64, kind, q1)[0] - r
    np.testing.assert_allclose(C[misses], ends[misses], atol=1e-5)          # the plane is that of the nearest point
    on_surface = evaluate(wp.float64, kind, p)[0]
    np.testing.assert_allclose(on_surface, 0.0, atol=2e-6 if real is wp.float32 else 1e-12)


@pytest.mark.parametrize("kind", CONVEX)
def test_the_plane_of_a_sweep_keeps_the_point_out(kind):
    rng, r = np.random.default_rng(8), 0.01
    q0 = rng.uniform(-0.9, 0.9, (600, 3))
    q1 = q0 + rng.normal(0.0, 0.7, q0.shape)
    C, n, _, s0 = sweep(wp.float64, kind, q0, q1, r, 10.0)
    hit = (s0 > 0) & (C < 0)
    mended = q1[hit] - C[hit][:, None] * n[hit]
    assert hit.sum() > 20
    assert (evaluate(wp.float64, kind, mended)[0] > r - 1e-9).all()


@cache
def mesh_sweeper(real):
    t, formula = types(real), collide.mesh_touch_func(("solid", "sheet"), real)

    @wp.kernel(module="test_collide", enable_backward=False)
    def sweep(kind: int, mesh: wp.uint64, deep: int, depth: real, q0: wp.array(dtype=t.vec3),
              q1: wp.array(dtype=t.vec3), r: real, margin: real, C: wp.array(dtype=real), n: wp.array(dtype=t.vec3),
              s0: wp.array(dtype=real)):
        i = wp.tid()
        c, m, p, start, slip = formula(kind, mesh, deep, depth, q0[i], q1[i], r, margin)
        C[i] = c
        n[i] = m
        s0[i] = start
    return sweep


def cube(half=(0.3, 0.5, 0.2)):
    """Box as a mesh: points (8, 3), triangles (12, 3) outward."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    points = corners * np.array(half, np.float32)
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return points, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)


def mesh_sweep(real, points, triangles, kind, q0, q1, r=0.0, margin=1.0, deep=0, depth=0.0):
    t = types(real)
    corners = wp.array(triangles.ravel(), dtype=int, device="cpu")
    mesh = wp.Mesh(wp.array(points, dtype=wp.vec3, device="cpu"), corners, support_winding_number=True)
    out = [wp.zeros(len(q0), dtype=d, device="cpu") for d in (real, t.vec3, real)]
    wp.launch(mesh_sweeper(real), len(q0),
              [collide.KINDS.index(kind), mesh.id, deep, depth, wp.array(q0, dtype=t.vec3, device="cpu"),
               wp.array(q1, dtype=t.vec3, device="cpu"), r, margin], out, device="cpu")
    return [o.numpy().astype(np.float64) for o in out]


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("deep", [0, 1])
def test_a_closed_mesh_has_the_distance_and_normal_of_its_box(real, deep):
    q = cloud(seed=9)
    phi, n = evaluate(wp.float64, "box", q)
    second = np.sort(np.abs(np.abs(q) - SIZES["box"]), axis=1)
    inside_ridge = (phi < 0) & (second[:, 1] - second[:, 0] < 1e-3)          # two faces equally near: either will do
    C, m, _ = mesh_sweep(real, *cube(), "solid", q, q, deep=deep, depth=0.2)
    np.testing.assert_allclose(C, phi, atol=2e-6)                            # the query is float32 in both precisions
    np.testing.assert_allclose(m[~inside_ridge], n[~inside_ridge], atol=2e-5)


@pytest.mark.parametrize("kind", ["solid", "sheet"])
def test_a_ray_crossing_a_thin_mesh_is_a_contact_on_the_side_it_came_from(kind):
    points, triangles = cube((0.5, 0.5, 0.005))
    rng = np.random.default_rng(1)
    q0 = np.concatenate([rng.uniform(-0.4, 0.4, (100, 2)), rng.uniform(0.02, 0.1, (100, 1))], 1)
    q0[50:, 2] *= -1
    q1 = q0 * (1, 1, -1) + rng.normal(0, 0.01, q0.shape) * (1, 1, 0)
    C, n, s0 = mesh_sweep(wp.float32, points, triangles, kind, q0, q1, r=0.001)
    side = np.sign(q0[:, 2])
    np.testing.assert_allclose(n, side[:, None] * (0, 0, 1), atol=1e-6)
    np.testing.assert_allclose(C, -(np.abs(q1[:, 2]) + 0.006), atol=1e-6)     # below the face it met, and its thickness
    np.testing.assert_allclose(s0, np.abs(q0[:, 2]) - 0.006, atol=1e-6)


def test_a_wall_far_thinner_than_its_faces_are_wide_has_two_sides():
    """Of 1 mm, with edges of 3 m: a thousandth of the mean edge is more than the wall."""
    q = np.random.default_rng(2).uniform((-1.2, -1.2, 0.001), (1.2, 1.2, 0.3), (300, 3))
    q[150:, 2] *= -1
    q[:20, 1] = q[:20, 0]                                                    # over a seam of two triangles
    C, n, _ = mesh_sweep(wp.float32, *cube((1.5, 1.5, 0.0005)), "solid", q, q)
    np.testing.assert_allclose(C, np.abs(q[:, 2]) - 0.0005, atol=1e-6)
    np.testing.assert_allclose(n, np.sign(q[:, 2])[:, None] * (0, 0, 1), atol=1e-5)


@pytest.mark.parametrize("deep", [0, 1])
def test_a_way_that_rounding_starts_within_a_thin_mesh_still_enters_it(deep):
    """A point that a contact has left on a wall of 1 mm, or a tenth of its thickness inside, and that goes on by 8 cm."""
    rng = np.random.default_rng(3)
    q0 = np.concatenate([rng.uniform(-1.2, 1.2, (90, 2)), np.repeat([[0.0005], [0.0005 - 6e-8], [0.0004]], 30, 0)], 1)
    q1 = q0 + rng.uniform((-0.1, -0.1, -0.08), (0.1, 0.1, -0.002), (90, 3))
    for real in REALS:
        C, n, s0 = mesh_sweep(real, *cube((1.5, 1.5, 0.0005)), "solid", q0, q1, margin=0.2, deep=deep, depth=0.0005)
        np.testing.assert_allclose(n, np.tile([0.0, 0.0, 1.0], (90, 1)), atol=1e-6)
        np.testing.assert_allclose(C, q1[:, 2] - 0.0005, atol=2e-7)
        np.testing.assert_allclose(s0, q0[:, 2] - 0.0005, atol=3e-7)


def test_winding_number_finds_points_deep_inside():
    q = np.array([[0.0, 0.0, 0.05], [0.25, 0.1, 0.02]])
    near, _, _ = mesh_sweep(wp.float32, *cube(), "solid", q, q, margin=0.01)
    deep, n, _ = mesh_sweep(wp.float32, *cube(), "solid", q, q, margin=0.01, deep=1, depth=0.2)
    assert (near > 1e29).all()                                               # out of the reach of the cheap search
    np.testing.assert_allclose(deep, [-0.15, -0.05], atol=1e-6)
    np.testing.assert_allclose(n, [[0, 0, 1], [1, 0, 0]], atol=1e-6)
