"""Euler angles, nlerp, squad and averages: against SciPy, closed forms and each other."""

import numpy as np
import pytest

from wsim.geometry.euler import LOCK, ORDERS, from_euler, to_euler
from wsim.geometry.rotation import (
    angular_velocity_between,
    axis_rotation_matrix,
    matrix_quat,
    quat_product,
    quaternion_exponential,
    quaternion_logarithm,
    quaternion_to_matrix,
    slerp,
)
from wsim.geometry.rotation_spline import average_rotation, inner_quaternions, lerp_normalized, spherical_quadrangle


def turns(n, seed=0):
    q = np.random.default_rng(seed).normal(size=(n, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


@pytest.mark.parametrize("order", ORDERS)
def test_euler_angles_there_and_back_and_where_they_lock(order):
    rng, q = np.random.default_rng(1), turns(500)
    angles, locked = to_euler(q, order)
    assert not locked.any()
    np.testing.assert_allclose(quaternion_to_matrix(from_euler(angles, order)), quaternion_to_matrix(q), atol=1e-13)
    proper = order[0] == order[2]
    assert (angles[:, 1] >= (0.0 if proper else -np.pi / 2)).all() and (angles[:, 1] <= (np.pi if proper else np.pi / 2)).all()
    for b in (0.0, np.pi) if proper else (-np.pi / 2, np.pi / 2):
        at = np.column_stack([rng.uniform(-3, 3, 50), np.full(50, b), rng.uniform(-3, 3, 50)])
        q = from_euler(at, order)
        angles, locked = to_euler(q, order)
        assert locked.all() and not angles[:, 2].any()
        np.testing.assert_allclose(quaternion_to_matrix(from_euler(angles, order)), quaternion_to_matrix(q), atol=2e-15 + LOCK)
        near = from_euler(at + (0.0, 1e-3, 0.0), order)
        assert not to_euler(near, order)[1].any()


@pytest.mark.parametrize("order", ORDERS)
def test_euler_angles_are_scipys(order):
    Rotation = pytest.importorskip("scipy.spatial.transform").Rotation
    q = turns(200, 2)
    np.testing.assert_allclose(to_euler(q, order)[0], Rotation.from_quat(q).as_euler(order), atol=1e-12)


def test_the_first_letter_turns_first_about_axes_that_stay():
    q = from_euler([0.3, 0.5, 0.7], "xyz")
    R = axis_rotation_matrix(np.eye(3)[2], 0.7) @ axis_rotation_matrix(np.eye(3)[1], 0.5) @ axis_rotation_matrix(np.eye(3)[0],
                                                                                                                 0.3)
    np.testing.assert_allclose(quaternion_to_matrix(q), R, atol=1e-15)
    with pytest.raises(ValueError, match="not 'xxz'"):
        to_euler(q, "xxz")


def test_half_way_between_a_quarter_turn_about_x_and_one_about_y():
    """w .81649658, 70.53 degrees about (1, 1, 0)."""
    x, y = quaternion_exponential([np.pi / 2, 0, 0]), quaternion_exponential([0, np.pi / 2, 0])
    want = (0.40824829, 0.40824829, 0.0, 0.81649658)
    np.testing.assert_allclose(slerp(x, y, 0.5), want, atol=1e-8)
    np.testing.assert_allclose(lerp_normalized(x, y, 0.5), want, atol=1e-8)
    u = quaternion_logarithm(slerp(x, y, 0.5))
    assert np.degrees(np.linalg.norm(u)) == pytest.approx(70.5288, abs=1e-4)
    np.testing.assert_allclose(u / np.linalg.norm(u), (np.sqrt(0.5), np.sqrt(0.5), 0), atol=1e-15)


def test_slerp_turns_at_constant_speed_and_the_short_way():
    p, q = turns(1, 3)[0], turns(1, 4)[0]
    s = np.linspace(0, 1, 101)
    speed = np.linalg.norm(angular_velocity_between(*(slerp(p, q, s)[k] for k in (slice(None, -1), slice(1, None))), 0.01),
                           axis=1)
    assert np.ptp(speed) < 1e-6 * speed.mean() and speed.mean() <= np.pi
    np.testing.assert_allclose(slerp(p, -q, 0.3), slerp(p, q, 0.3), atol=1e-15)
    np.testing.assert_allclose(lerp_normalized(p, -q, 0.3), lerp_normalized(p, q, 0.3), atol=1e-15)


def test_nlerp_is_a_microradian_off_slerp_where_the_dot_is_9995():
    """With a the angle of the quaternions, a^3 s (1 - s) (1 - 2 s) / 6 off in it and twice that as a rotation."""
    p = turns(300, 5)
    axis = np.random.default_rng(6).normal(size=(300, 3))
    q = quat_product(quaternion_exponential(axis / np.linalg.norm(axis, axis=1, keepdims=True) * 2 * np.arccos(0.9995)), p)
    for s in (0.2, 0.2113, 0.5, 0.7):
        off = np.linalg.norm(angular_velocity_between(slerp(p, q, s), lerp_normalized(p, q, s), 1.0), axis=1)
        want = np.arccos(0.9995) ** 3 * abs(s * (1 - s) * (1 - 2 * s)) / 3
        np.testing.assert_allclose(off, want, rtol=2e-3, atol=1e-15)
    assert want < np.arccos(0.9995) ** 3 / (18 * np.sqrt(3)) < 1.02e-6


@pytest.mark.parametrize("even", [True, False])
def test_squad_keeps_the_angular_velocity_at_keys_where_chained_slerp_jumps(even):
    rng = np.random.default_rng(7)
    times = np.arange(6.0) if even else np.cumsum(rng.uniform(0.3, 2.0, 6))
    q = [turns(1, 8)[0]]
    for _ in range(5):
        q.append(quat_product(quaternion_exponential(rng.normal(size=3)), q[-1]))
    q = np.array(q)
    a, b = inner_quaternions(times, q)

    def at(k, s):
        return spherical_quadrangle(q[k], a[k], b[k], q[k + 1], s)

    jumps = []
    for k in range(1, 5):
        h = 1e-5
        before = angular_velocity_between(at(k - 1, 1 - h), at(k - 1, 1.0), h * (times[k] - times[k - 1]))
        behind = angular_velocity_between(at(k, 0.0), at(k, h), h * (times[k + 1] - times[k]))
        assert np.linalg.norm(before - behind) < 5e-4          # of differences, first order in h
        exact = [np.linalg.norm(angular_velocity_between(at(k - 1, 1 - h), at(k - 1, 1.0), h * (times[k] - times[k - 1]))
                                - angular_velocity_between(at(k, 0.0), at(k, h), h * (times[k + 1] - times[k])))
                                for h in (1e-4, 1e-5)]
        assert exact[1] < 0.2 * exact[0]                       # and gone with h
        d0, d1 = (angular_velocity_between(q[j], q[j + 1], times[j + 1] - times[j]) for j in (k - 1, k))
        jumps.append(np.linalg.norm(d1 - d0))
    assert min(jumps) > 0.1
    if even:
        for k in range(1, 5):                                  # Shoemake 1987
            own = (quaternion_logarithm(quat_product(q[k] * (-1, -1, -1, 1), q[k + 1]))
                   + quaternion_logarithm(quat_product(q[k] * (-1, -1, -1, 1), q[k - 1])))
            np.testing.assert_allclose(a[k], quat_product(q[k], quaternion_exponential(-own / 4)), atol=1e-14)
            np.testing.assert_allclose(b[k - 1], a[k], atol=1e-14)


def test_two_keys_of_squad_are_slerp():
    q = turns(2, 9)
    a, b = inner_quaternions(np.array([0.0, 2.0]), q)
    np.testing.assert_allclose(quaternion_to_matrix(spherical_quadrangle(q[0], a[0], b[0], q[1], 0.3)),
                               quaternion_to_matrix(slerp(q[0], q[1], 0.3)), atol=1e-14)


def test_the_mean_of_turns_about_one_axis_is_the_mean_angle_whatever_the_signs():
    angles = np.array([0.1, 0.2, 0.6])
    q = quaternion_exponential(np.outer(angles, (0.0, 0.6, 0.8))) * np.array([1.0, -1.0, 1.0])[:, None]
    np.testing.assert_allclose(quaternion_logarithm(average_rotation(q, [1, 1, 0])), np.array((0.0, 0.6, 0.8)) * 0.15,
                               atol=1e-14)
    assert np.linalg.norm(quaternion_logarithm(average_rotation(q))) == pytest.approx(0.3, abs=2e-3)  # chordal: 0.2993
    rotated = quat_product(turns(1, 3)[0], q)
    np.testing.assert_allclose(quaternion_to_matrix(average_rotation(rotated)),
                               quaternion_to_matrix(quat_product(turns(1, 3)[0], average_rotation(q))), atol=1e-14)
    with pytest.raises(ValueError, match="not all 0"):
        average_rotation(q, [0, 0, 0])


def test_conversions_of_rotations_there_and_back():
    q = turns(400, 11)
    tiny = quaternion_exponential(np.random.default_rng(1).normal(size=(50, 3)) * 1e-9)
    half = quaternion_exponential(np.pi * np.eye(3))
    for of in (q, tiny, half):
        np.testing.assert_allclose(quaternion_to_matrix(matrix_quat(quaternion_to_matrix(of))), quaternion_to_matrix(of),
                                   atol=1e-14)
        np.testing.assert_allclose(quaternion_to_matrix(quaternion_exponential(quaternion_logarithm(of))),
                                   quaternion_to_matrix(of), atol=1e-14)
