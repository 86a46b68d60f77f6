"""Every constraint of the table: gradient against differences, invariance, rest state, momentum, degenerate shapes."""

import math

import numpy as np
import pytest
import warp as wp

from tests.make.rows.equations import EQUATIONS
from wsim.kernels.cloth.constraint import arctangent, membrane_response, membrane_shear, membrane_slender
from wsim.kernels.math.real import types

wp.config.quiet = True
NAMES = sorted(EQUATIONS)
SIZES = [1.0, 1e-2, 1e-3]                # [m]: a formula that is right at one size only is wrong
SHAPES = {2: [[0, 0, 0], [0.9, 0.5, -0.3]],
          3: [[0, 0, 0], [1.1, 0.2, 0.3], [-0.2, 0.9, 0.4]],
          4: [[0, 0, 0], [1.0, 0.1, 0.2], [0.4, 0.9, -0.3], [0.5, -0.8, 0.5]]}


def evaluator(name, real):
    """Kernel writing C (rows) and the gradient (rows, points, 3) of one constraint at X (points - 1, 3)."""
    row, t = EQUATIONS[name], types(real)
    formula, n, rows = row.formula, row.points, row.rows
    relative = wp.types.matrix((n - 1, 3), real)
    rest = t.mat22 if name == "membrane" else real

    def one(X: wp.array(dtype=relative), rest: wp.array(dtype=rest), C_out: wp.array(dtype=real),
            G_out: wp.array3d(dtype=real)):
        C, G = formula(X[0], rest[0])
        C_out[0] = C
        for k in range(wp.static(n - 1)):
            for m in range(3):
                G_out[0, k, m] = G[k, m]

    def three(X: wp.array(dtype=relative), rest: wp.array(dtype=rest), C_out: wp.array(dtype=real),
              G_out: wp.array3d(dtype=real)):
        C, G1, G2 = formula(X[0], rest[0])
        for r in range(3):
            C_out[r] = C[r]
            for m in range(3):
                G_out[r, 0, m] = G1[r, m]
                G_out[r, 1, m] = G2[r, m]

    kernel = wp.kernel(three if rows == 3 else one, name=f"evaluate_{name}_{t.name}", module="unique",
                       enable_backward=False)

    def evaluate(points, value):
        points = np.asarray(points, np.float64)
        C = wp.zeros(rows, dtype=real, device="cpu")
        G = wp.zeros((rows, n - 1, 3), dtype=real, device="cpu")
        X = wp.array((points[1:] - points[0])[None], dtype=relative, device="cpu")
        wp.launch(kernel, 1, [X, wp.array([value], dtype=rest, device="cpu")], [C, G], device="cpu")
        G = G.numpy().astype(np.float64)
        return C.numpy().astype(np.float64), np.concatenate([-G.sum(1, keepdims=True), G], 1)

    return evaluate


@pytest.fixture(scope="module")
def evaluators():
    made = {}
    return lambda name, real=wp.float64: made.setdefault((name, real), evaluator(name, real))


def angle(p):
    """Dihedral angle [rad] from unit normals, independent of the kernel's formula."""
    e = p[1] - p[0]
    a, b = np.cross(e, p[2] - p[0]), np.cross(p[3] - p[0], e)
    a, b, e = a / np.linalg.norm(a), b / np.linalg.norm(b), e / np.linalg.norm(e)
    return math.atan2(np.dot(np.cross(a, b), e), a @ b)


def rest_of(name, p):
    """Rest value for which the points p are at rest."""
    if name == "dihedral":
        return angle(p)
    if name == "membrane":                     # (u, v) axes in the plane of the triangle
        a, b = p[1] - p[0], p[2] - p[0]
        u = a / np.linalg.norm(a)
        v = b - (b @ u) * u
        v /= np.linalg.norm(v)
        turn = np.array([[math.cos(0.4), -math.sin(0.4)], [math.sin(0.4), math.cos(0.4)]])
        return np.linalg.inv(turn @ np.array([[a @ u, b @ u], [a @ v, b @ v]]))
    if name == "area":                         # Heron
        a, b, c = np.linalg.norm(p - np.roll(p, 1, axis=0), axis=1)
        s = 0.5 * (a + b + c)
        return math.sqrt(s * (s - a) * (s - b) * (s - c))
    return float(np.linalg.norm(p[1] - p[0]))


def shape(name, size):
    return size * np.array(SHAPES[EQUATIONS[name].points], np.float64)


def moved(name, size):
    """A shape well away from rest, and the rest value of the unmoved one."""
    p = shape(name, size)
    return p + 0.15 * size * np.sin(np.arange(p.size) * 1.7).reshape(p.shape), rest_of(name, p)


def turned(p):
    axis, s = np.array([0.48, 0.6, 0.64]), 1.1
    K = np.cross(np.eye(3), -axis)
    return p @ (np.eye(3) + math.sin(s) * K + (1 - math.cos(s)) * K @ K).T


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", NAMES)
def test_gradient_equals_central_differences(evaluators, name, size):
    p, rest = moved(name, size)
    C, G = evaluators(name)(p, rest)
    eps = 1e-5 * size                          # error eps^2 C''' / 6 + rounding / eps: about 1e-10 of |G|
    numeric = np.zeros_like(G)
    for k in range(len(p)):
        for m in range(3):
            q = np.zeros_like(p)
            q[k, m] = eps
            numeric[:, k, m] = (evaluators(name)(p + q, rest)[0] - evaluators(name)(p - q, rest)[0]) / (2 * eps)
    assert np.abs(G).max() > 0
    assert np.abs(G - numeric).max() < 1e-8 * np.abs(G).max()


@pytest.mark.parametrize("name", NAMES)
def test_value_does_not_change_and_gradient_turns_with_the_points(evaluators, name):
    p, rest = moved(name, 1.0)
    C, G = evaluators(name)(p, rest)
    C2, G2 = evaluators(name)(turned(p) + [3.0, -2.0, 5.0], rest)
    assert np.abs(C).max() > 1e-2
    assert np.abs(C2 - C).max() < 1e-14        # rounding of coordinates of 5 m
    assert np.abs(G2 - turned(G)).max() < 1e-13


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", NAMES)
def test_rest_state_has_no_value(evaluators, name, size):
    p = shape(name, size)
    C, G = evaluators(name)(p, rest_of(name, p))
    assert np.abs(C).max() < 4e-16 * 8 and np.abs(G).max() > 0


@pytest.mark.parametrize("name", NAMES)
def test_no_torque_about_the_origin(evaluators, name):
    """Sum of x_k x G_k is the derivative along a turn: zero. The sum of G_k is zero by construction."""
    p, rest = moved(name, 1.0)
    _, G = evaluators(name)(p, rest)
    assert np.abs(np.cross(p[None], G).sum(1)).max() < 1e-14


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", NAMES)
def test_float32_agrees_with_float64(evaluators, name, size):
    p, rest = moved(name, size)
    p, rest = p.astype(np.float32), np.float32(rest)
    C, G = evaluators(name)(p, rest)
    c, g = evaluators(name, wp.float32)(p, rest)
    unit = {"m": size, "m^2": size**2}.get(EQUATIONS[name].unit, 1.0)
    assert np.abs(c - C).max() < 1e-6 * unit   # about 8 roundings of 1.2e-7
    assert np.abs(g - G).max() < 1e-6 * np.abs(G).max()


@pytest.mark.parametrize("real", [wp.float32, wp.float64])
@pytest.mark.parametrize("name", NAMES)
def test_degenerate_shapes_give_finite_numbers(evaluators, name, real):
    p, rest = moved(name, 1.0)
    line = np.outer(np.arange(len(p)), [1.0, 0.5, 0.2])
    flat = p.copy()
    flat[-1] = flat[0]
    for q in (np.zeros_like(p), line, flat, 1e-12 * p):
        C, G = evaluators(name, real)(q, rest)
        assert np.isfinite(C).all() and np.isfinite(G).all()


@pytest.mark.parametrize("fold", [0.0, 1e-6, 0.3, 1.5, 3.0, -0.3, -3.0])
def test_dihedral_measures_the_fold_away_from_the_normals(evaluators, fold):
    p = np.array([[0, 0, 0], [1, 0, 0], [0.3, 1, 0], [0.6, -math.cos(fold), -math.sin(fold)]])
    assert evaluators("dihedral")(p, 0.0)[0][0] == pytest.approx(fold, abs=1e-15)


def test_dihedral_takes_the_short_way_round(evaluators):
    p = np.array([[0, 0, 0], [1, 0, 0], [0.3, 1, 0], [0.6, -math.cos(3.0), -math.sin(3.0)]])
    assert evaluators("dihedral")(p, -3.0)[0][0] == pytest.approx(6.0 - 2 * math.pi, abs=1e-14)


def test_membrane_strains_of_a_stretched_and_sheared_triangle(evaluators):
    p = np.array([[0, 0, 0], [2.0, 0, 0], [0, 3.0, 0]])
    F = np.array([[1.1, 0.2, 0], [0, 0.9, 0], [0, 0, 1]])
    C, _ = evaluators("membrane")(p @ F.T, np.diag([1 / 2.0, 1 / 3.0]))
    _, sigma, Vt = np.linalg.svd(F[:2, :2])
    U = Vt.T @ np.diag(sigma) @ Vt                        # right stretch of F = R U
    assert np.abs(C - [U[0, 0] - 1, U[1, 1] - 1, 2 * U[0, 1]]).max() < 1e-14


@pytest.mark.parametrize("name", ["stretched", "collapsed"])
def test_membrane_response_is_the_product_of_its_gradients(evaluators, name):
    @wp.kernel(module="unique", enable_backward=False)
    def respond(C: wp.array(dtype=wp.vec3d), B: wp.array(dtype=wp.mat22d), w: wp.vec3d, out: wp.array(dtype=wp.mat33d)):
        out[0] = membrane_response(C[0], B[0], w[0], w[1], w[2])

    p, rest = moved("membrane", 1.0)
    if name == "collapsed":                    # F_u = 0
        p, rest = np.array([[0.0, 0, 0], [0, 0, 0], [0, 1, 0]]), np.array([[2.0, 0.0], [0.0, 1.5]])
    C, G = evaluators("membrane")(p, rest)
    w = np.array([0.5, 2.0, 3.0])
    out = wp.zeros(1, dtype=wp.mat33d, device="cpu")
    wp.launch(respond, 1, [wp.array([C], dtype=wp.vec3d, device="cpu"), wp.array([rest], dtype=wp.mat22d, device="cpu"),
                           wp.vec3d(*w)], [out], device="cpu")
    true = np.einsum("k,rkm,skm->rs", w, G, G)
    assert np.abs(out.numpy()[0] - true).max() < 1e-14 * np.abs(true).max()


@pytest.mark.parametrize("corners", [[(0, 0), (1, 0), (0, 100)], [(3, 1), (0, 0), (1, 0)], [(0, 0), (2, 0), (1, 3**0.5)]])
def test_slenderness_is_the_longest_edge_over_its_height(corners):
    @wp.kernel(module="unique", enable_backward=False)
    def take(B: wp.array(dtype=wp.mat22d), out: wp.array(dtype=wp.vec2d)):
        out[0] = membrane_slender(B[0])

    p = np.array(corners, float)
    Dm = np.stack([p[1] - p[0], p[2] - p[0]], axis=1)
    out = wp.zeros(1, dtype=wp.vec2d, device="cpu")
    wp.launch(take, 1, [wp.array([np.linalg.inv(Dm)], dtype=wp.mat22d, device="cpu")], [out], device="cpu")
    longest = np.linalg.norm(p - np.roll(p, 1, axis=0), axis=1).max()
    height = abs(np.linalg.det(Dm)) / longest
    over, under = out.numpy()[0]
    assert over / under == pytest.approx(longest / height, rel=1e-12)


@pytest.mark.parametrize("corners", [[(0, 0), (1, 0), (0, 7)], [(3, 1), (0, 0), (1, 0)], [(1, 0), (3, 1), (0, 0)],
                                     [(0, 0), (1, 0), (3, 1)]])
def test_shear_of_a_needle_is_that_between_its_longest_edge_and_its_height(corners):
    """U = 1 + shear (m n + n m) / 2 + stretches along both, which do not count; m along the longest edge, whichever that is."""
    @wp.kernel(module="unique", enable_backward=False)
    def take(B: wp.array(dtype=wp.mat22d), dC: wp.array(dtype=wp.vec3d), out: wp.array(dtype=wp.float64)):
        out[0] = membrane_shear(B[0], dC[0])

    p = np.array(corners, float)
    edges = np.roll(p, -1, axis=0) - p
    m = max(edges, key=np.linalg.norm)
    m = m / np.linalg.norm(m)
    n = np.array([-m[1], m[0]])
    U = 0.1 * (np.outer(m, n) + np.outer(n, m)) + 3.0 * np.outer(n, n) - 0.5 * np.outer(m, m)
    B = np.linalg.inv(np.stack([p[1] - p[0], p[2] - p[0]], axis=1))
    out = wp.zeros(1, dtype=wp.float64, device="cpu")
    wp.launch(take, 1, [wp.array([B], dtype=wp.mat22d, device="cpu"),
                        wp.array([(U[0, 0], U[1, 1], 2.0 * U[0, 1])], dtype=wp.vec3d, device="cpu")], [out], device="cpu")
    assert abs(out.numpy()[0]) == pytest.approx(0.2, rel=1e-12)


def test_arctangent_in_float32_errs_by_less_than_two_units_in_the_last_place():
    @wp.kernel(module="unique", enable_backward=False)
    def take(y: wp.array(dtype=float), x: wp.array(dtype=float), out: wp.array(dtype=float)):
        i = wp.tid()
        out[i] = arctangent(y[i], x[i])

    rng = np.random.default_rng(1)
    xy = (rng.standard_normal((2, 200_000)) * 10.0 ** rng.uniform(-15, 15, (2, 200_000))).astype(np.float32)
    xy[:, :5] = [[0, 0, 1, -1, 0], [1, -1, 0, 0, 0]]
    out = wp.zeros(xy.shape[1], dtype=float, device="cpu")
    wp.launch(take, xy.shape[1], [wp.array(xy[0], device="cpu"), wp.array(xy[1], device="cpu")], [out], device="cpu")
    true = np.arctan2(xy[0].astype(np.float64), xy[1].astype(np.float64))
    assert (np.abs(out.numpy() - true) / np.spacing(np.abs(true).astype(np.float32) + 1e-30)).max() < 2.0
