"""The linear complementarity problem of a manifold's normal impulses against all sixteen sets of points that may bear."""

from itertools import product

import numpy as np
import pytest
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.complementarity.manifold_impulse import manifold_impulse_func
from wsim.kernels.rigid.impulse import tangent_func

BEARING = (2.0, 0.5, 0.1, 0.0)


@pytest.fixture(scope="module")
def solve():
    """(A, before, wanted, soft, near, acts), each of n problems -> P - P_0."""
    t, one = types(wp.float64), manifold_impulse_func(wp.float64)

    def rows(A: wp.array(dtype=t.mat44), before: wp.array(dtype=t.vec4), wanted: wp.array(dtype=t.vec4),
             soft: wp.array(dtype=t.vec4), near: wp.array(dtype=t.vec4), acts: wp.array(dtype=wp.vec4i),
             x: wp.array(dtype=t.vec4)):
        i = wp.tid()
        x[i] = one(A[i], before[i], wanted[i], soft[i], near[i], acts[i])
    kernel = wp.kernel(rows, name="manifold_impulse_rows", module="unique", enable_backward=False)

    def run(A, before, wanted, soft, near, acts) -> np.ndarray:
        arrays = [wp.array(v, dtype=d, device="cpu") for v, d in
                  zip((A, before, wanted, soft, near, acts), (t.mat44, t.vec4, t.vec4, t.vec4, t.vec4, wp.vec4i), strict=True)]
        x = wp.zeros(len(A), dtype=t.vec4, device="cpu")
        wp.launch(kernel, len(A), arrays, [x], device="cpu")
        return x.numpy()
    return run


def by_sets(M: np.ndarray, r: np.ndarray, before: np.ndarray) -> np.ndarray:
    """x with x >= -before, M x >= r, one of them an equation in each row: of all sets the one that holds best."""
    best, least = np.zeros(4), np.inf
    for bears in product((True, False), repeat=4):
        free = np.array(bears)
        x = -before.copy()
        if free.any():
            x[free] = np.linalg.solve(M[np.ix_(free, free)], r[free] - M[np.ix_(free, ~free)] @ x[~free])
        wrong = max(-(x + before).min(), (r - M @ x)[~free].max(initial=0.0))
        if wrong < least:
            best, least = x, wrong
    return best


def problems(n: int):
    """Corners of a square on a body of random mass and inertia; some have lost touch."""
    rng = np.random.default_rng(1)
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * 0.5
    J = np.concatenate([np.ones((n, 4, 1)), corners + rng.uniform(-0.2, 0.2, (n, 4, 2))], axis=2)
    w = rng.uniform(0.5, 2.0, (n, 3)) * (1.0, 6.0, 6.0)
    return np.einsum("nik,nk,njk->nij", J, w, J), rng.choice(BEARING, (n, 4)), rng.normal(size=(n, 4)), rng.random((n, 4)) < 0.8


def test_impulses_are_those_of_the_set_of_points_that_holds(solve):
    A, before, wanted, acts = problems(400)
    before *= acts
    soft, near = np.full((400, 4), 0.03), np.where(np.arange(4) < 2, 0.01, 0.0) * np.ones((400, 1))
    x = solve(A, before, wanted, soft, near, acts.astype(np.int32))
    some = 0
    for k in range(400):
        on = acts[k]
        M = (A[k] + np.diag(np.diag(A[k]) * (soft[k] + near[k])))[np.ix_(on, on)]
        M, r = np.eye(4) if on.sum() < 4 else M, (wanted[k] - np.diag(A[k]) * soft[k] * before[k])[on]
        if on.sum() < 4:
            M[np.ix_(range(on.sum()), range(on.sum()))] = (A[k] + np.diag(np.diag(A[k]) * (soft[k] + near[k])))[np.ix_(on, on)]
        expected = by_sets(M, np.pad(r, (0, 4 - len(r))), np.pad(before[k][on], (0, 4 - len(r))))[:len(r)]
        some += bool((expected + before[k][on] < 1e-9).any())
        assert np.abs(x[k][on] - expected).max(initial=0.0) < 1e-6 and not x[k][~on].any()
    assert 100 < some < 400


def test_four_corners_of_a_square_bear_alike(solve):
    """To rounding, whatever their order: a sequence from corner to corner would tilt what they bear."""
    corners = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    J = np.concatenate([np.ones((4, 1)), corners], axis=1)
    A = (J * (1.0, 6.0, 6.0)) @ J.T
    none, every = np.zeros((1, 4)), np.ones((1, 4))
    x = solve(A[None], none, every, 0.03 * every, none, every.astype(np.int32))
    assert np.ptp(x[0]) < 1e-13 and abs(x[0, 0] * (4.0 + 0.03 * 13.0) - 1.0) < 1e-12


@pytest.mark.parametrize("n", [(0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.6, -0.8, 0.0), (-0.5773503, 0.5773503, -0.5773502)])
def test_a_tangent_is_a_unit_vector_across(n):
    found, first = wp.zeros(1, dtype=wp.vec3d, device="cpu"), tangent_func(wp.float64)

    def one(n: wp.vec3d, out: wp.array(dtype=wp.vec3d)):
        out[0] = first(n)
    unit = np.array(n) / np.linalg.norm(n)
    kernel = wp.kernel(one, name="tangent_of", module="unique", enable_backward=False)
    wp.launch(kernel, 1, [wp.vec3d(*unit)], [found], device="cpu")
    assert abs(np.linalg.norm(found.numpy()[0]) - 1.0) < 1e-15 and abs(found.numpy()[0] @ unit) < 1e-15
