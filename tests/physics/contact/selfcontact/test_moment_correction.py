"""Pushes of a pair with friction: neither a force nor a moment, and what turns as one does not slip."""

import numpy as np
import pytest
import warp as wp

from wsim.kernels.contact.selfcontact.moment_correction import couple_funcs
from wsim.kernels.math.real import types

THICK = 2e-3                             # [m] between closest points
A, B = (0.0, 0.0, 0.0), (0.03, 0.0, 0.0)
PAIRS = {                                # points, and weights of the closest
    "point": ([(0.01, THICK, 0.01), A, B, (0.0, 0.0, 0.03)], (1.0, -1 / 3, -1 / 3, -1 / 3)),
    "point at a corner": ([(0.0, THICK, 0.0), A, B, (0.0, 0.0, 0.03)], (1.0, -1.0, 0.0, 0.0)),
    "point beside an edge, in the plane": ([(0.015, 0.0, -THICK), A, B, (0.0, 0.0, 0.03)], (1.0, -0.5, -0.5, 0.0)),
    "edges": ([(0.01, THICK, -0.01), (0.01, THICK, 0.02), A, B], (2 / 3, 1 / 3, -2 / 3, -1 / 3)),
    "edges alike": ([(0.0, THICK, 0.0), (0.03, THICK, 0.0), A, B], (0.5, 0.5, -0.5, -0.5))}


def pushed(points: np.ndarray, b: np.ndarray, push: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What a push gives to four points, (4, 3), and the slip that they are seen to have where they go by d."""
    real, shape = wp.float64, wp.types.matrix((4, 3), wp.float64)
    _, lever, turn = couple_funcs(real)
    t = types(real)

    @wp.kernel(module="unique")
    def give(r: wp.array(dtype=shape), d: wp.array(dtype=shape), push: t.vec3, D: t.vec3, out: wp.array(dtype=t.vec3)):
        K = lever(r[0])
        back = K * wp.cross(D, push)
        for k in range(4):
            out[k] = -wp.cross(back, r[0][k])
        out[4] = -wp.cross(turn(K, r[0], d[0]), D)
    out, r = wp.zeros(5, dtype=t.vec3, device="cpu"), points - points.mean(axis=0)
    arrays = [wp.array([v], dtype=shape, device="cpu") for v in (r, d)]
    wp.launch(give, 1, [*arrays, t.vec3(*push), t.vec3(*(b @ r))], [out], device="cpu")
    return b[:, None] * push + out.numpy()[:4], b @ d + out.numpy()[4]


@pytest.mark.parametrize("name", PAIRS)
def test_pushes_have_no_sum_and_no_moment_and_a_common_turn_is_no_slip(name):
    points, b = (np.array(each) for each in PAIRS[name])
    rng = np.random.default_rng(3)
    T, turn, d = rng.normal(size=3), rng.normal(size=3), rng.normal(size=(4, 3))
    given, slip = pushed(points, b, T, d)
    assert np.abs(given.sum(axis=0)).max() < 1e-12
    assert np.abs(np.cross(points, given).sum(axis=0)).max() < 1e-12 * np.abs(points).max()
    assert np.vdot(given, d) == pytest.approx(T @ slip, rel=1e-9)               # the transpose: it takes what it is seen to
    _, slip = pushed(points, b, T, np.cross(turn, points) + (0.3, 0.1, 0.2))
    assert np.abs(slip).max() < 1e-12
    if name != "edges alike":                                                   # these carry no friction across
        T = np.cross(T, b @ points)
        given, _ = pushed(points, b, T, d)
        assert np.abs(given - b[:, None] * T).max() < 4.0 * THICK / 0.03 * np.linalg.norm(T)


def test_points_in_a_line_have_no_couple():
    points = np.array([(0.0, THICK, 0.0), (0.0, 0.0, 0.0), (0.0, -0.03, 0.0), (0.0, -0.06, 0.0)])
    given, _ = pushed(points, np.array([1.0, -1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.zeros((4, 3)))
    np.testing.assert_array_equal(given, np.array([1.0, -1.0, 0.0, 0.0])[:, None] * (1.0, 0.0, 0.0))
