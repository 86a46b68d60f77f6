"""Rotations on the host (wsim/geometry/rotation.py) against SciPy's, on the device (kernels/math/rotation.py) against those."""

from functools import cache

import numpy as np
import pytest
import warp as wp

from wsim.geometry import rotation as host
from wsim.kernels.math import rotation as device
from wsim.kernels.math.real import types

PI = np.pi
ANGLES = (0.0, 1e-12, 1e-4, 9.9e-3, 1.01e-2, 0.3, 2.0, PI - 1e-3, PI - 1e-7, PI)
ROUNDING = 2.3e-16


def vectors() -> np.ndarray:
    """Rotation vectors about random axes and those of the frame, by every angle, (n, 3)."""
    axes = np.concatenate([np.eye(3), -np.eye(3), np.random.default_rng(0).normal(size=(20, 3))])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return (axes[:, None, :] * np.array(ANGLES)[:, None]).reshape(-1, 3)


def rotations():
    return pytest.importorskip("scipy.spatial.transform").Rotation


def quaternions() -> np.ndarray:
    """Of `vectors`, then the other quaternion of each."""
    q = rotations().from_rotvec(vectors()).as_quat()
    return np.concatenate([q, -q])


def same_turn(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Distance of rotation vectors; about opposite axes half a turn is one rotation."""
    near = np.linalg.norm(u - v, axis=-1)
    other = v * (1.0 - 2.0 * PI / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-300))
    return np.minimum(near, np.linalg.norm(u - other, axis=-1))


def test_quaternions_matrices_and_vectors_are_those_of_scipy():
    u, q = vectors(), quaternions()
    Rotation = rotations()
    R = Rotation.from_quat(q)
    v = np.random.default_rng(1).normal(size=(len(q), 3))
    p = np.roll(q, 7, axis=0)
    assert np.abs(host.quaternion_exponential(u) - Rotation.from_rotvec(u).as_quat()).max() < 4 * ROUNDING
    assert np.abs(host.quaternion_to_matrix(q) - R.as_matrix()).max() < 8 * ROUNDING
    assert np.abs(host.quat_rotate(q, v) - R.apply(v)).max() < 32 * ROUNDING
    assert np.abs(host.quaternion_to_matrix(host.quat_product(p, q))
                  - (Rotation.from_quat(p) * R).as_matrix()).max() < 16 * ROUNDING
    assert np.abs(host.quat_rotate(host.quat_conjugate(q), host.quat_rotate(q, v)) - v).max() < 32 * ROUNDING
    assert same_turn(host.quaternion_logarithm(q), R.as_rotvec()).max() < 32 * ROUNDING
    assert np.abs(np.linalg.norm(host.quaternion_logarithm(q), axis=1)).max() <= PI + 8 * ROUNDING


def test_a_matrix_gives_its_quaternion_and_its_axis_and_angle_back():
    """An axis within 1e-6 of half a turn is off by what is left to it: that of R + 1, of which the turn back is no part."""
    q = quaternions()
    R = host.quaternion_to_matrix(q)
    assert np.abs(host.quaternion_to_matrix(host.matrix_quat(R))
                  - R).max() < 16 * ROUNDING and host.matrix_quat(R)[:, 3].min() >= 0.0
    axis, angle = host.axis_angle(R)
    error = np.abs(host.axis_rotation_matrix(axis, angle) - R).max(axis=(1, 2))
    assert angle.min() >= 0.0 and angle.max() <= PI
    assert np.all(error < 2e-12 + 1.1 * np.where(angle > PI - 1e-6, PI - angle, 0.0))
    one = [host.axis_angle(r) for r in R]
    assert all(np.array_equal(a, axis[k]) and b == angle[k] for k, (a, b) in enumerate(one))


@pytest.mark.parametrize("part", [0.0, 0.25, 1.0])
def test_slerp_goes_the_short_way_whichever_quaternion_says_the_end(part):
    p, u = np.roll(quaternions(), 3, axis=0), np.tile(vectors(), (2, 1))
    ends = host.quat_product(p, host.quaternion_exponential(u))
    for q in (ends, -ends):
        found = host.quaternion_logarithm(host.quat_product(host.quat_conjugate(p), host.slerp(p, q, part)))
        half = np.linalg.norm(u, axis=1) > PI - 1e-6                     # both ways are short
        assert np.abs(found - part * u)[~half].max() < 1e-14
        assert np.abs(np.linalg.norm(found, axis=1) - part * np.linalg.norm(u, axis=1))[half].max() < 1e-7


def test_a_constant_angular_velocity_is_integrated_exactly_and_found_again():
    q, omega, h = quaternions(), np.tile(vectors(), (2, 1)) / 0.1, 0.1
    end = host.rotate_by_angular_velocity(q, omega, h)
    steps = q
    for _ in range(64):
        steps = host.rotate_by_angular_velocity(steps, omega, h / 64)
    assert np.abs(np.abs((steps * end).sum(axis=1)) - 1.0).max() < 64 * ROUNDING
    assert same_turn(h * host.angular_velocity_between(q, end, h), h * omega).max() < 32 * ROUNDING
    assert np.array_equal(host.unit_quat(np.zeros(4)), [0.0, 0.0, 0.0, 1.0])


def test_polar_parts_are_a_rotation_and_a_symmetric_stretch_of_a_mirror_too():
    A = np.random.default_rng(2).normal(size=(40, 3, 3))
    R, S = host.polar_decomposition(A)
    assert np.abs(R @ S - A).max() < 64 * ROUNDING and np.abs(np.linalg.det(R) - 1.0).max() < 16 * ROUNDING
    assert np.abs(S - np.swapaxes(S, 1, 2)).max() < 32 * ROUNDING


@cache
def everything(real):
    """Kernel over pairs: every function of the device's set, 42 numbers a pair."""
    t = types(real)

    @wp.kernel(module="unique")
    def rotations(p: wp.array(dtype=t.quat), q: wp.array(dtype=t.quat), u: wp.array(dtype=t.vec3), out: wp.array2d(dtype=real)):
        i = wp.tid()
        s = real(0.3)
        h = real(0.1)
        product = device.multiply_rotations(p[i], q[i])
        back = device.conjugate_rotation(q[i])
        scaled = device.unit_quaternion(t.quat(real(3.0) * q[i][0], real(3.0) * q[i][1], real(3.0) * q[i][2],
                                               real(3.0) * q[i][3]))
        way = device.slerp(p[i], q[i], s)
        later = device.integrate_orientation(q[i], u[i] / h, h)
        again = device.matrix_to_quaternion(device.rotation_to_matrix(q[i]))
        exp = device.rotation_exponential(u[i])
        log = device.rotation_logarithm(q[i])
        turned = device.rotate_vector(q[i], u[i])
        rate = device.mean_angular_velocity(p[i], q[i], h)
        angle = wp.length(u[i])
        axis = t.vec3(real(1.0), real(0.0), real(0.0))
        if angle > real(0.0):
            axis = u[i] / angle
        R = device.rotation_about_axis(axis, angle)
        for k in range(4):
            out[i, k] = product[k]
            out[i, 4 + k] = back[k]
            out[i, 8 + k] = scaled[k]
            out[i, 12 + k] = way[k]
            out[i, 16 + k] = later[k]
            out[i, 20 + k] = again[k]
            out[i, 24 + k] = exp[k]
        for k in range(3):
            out[i, 28 + k] = log[k]
            out[i, 31 + k] = turned[k]
            out[i, 34 + k] = h * rate[k]
            for j in range(3):
                out[i, 37 + 3 * k + j] = R[k, j]

    return rotations


@pytest.mark.parametrize("real", [wp.float32, wp.float64])
def test_the_device_has_the_same_rotations(real):
    """From the same rounded inputs. Which way half a turn goes is left to the rounding: there rotations are compared."""
    number = np.float32 if real is wp.float32 else np.float64
    eps, t = float(np.finfo(number).eps), types(real)
    q, u = quaternions().astype(number), np.tile(vectors(), (2, 1)).astype(number)
    p = np.roll(q, 7, axis=0)
    out = wp.zeros((len(q), 46), dtype=real, device="cpu")
    wp.launch(everything(real), len(q), [wp.array(p, dtype=t.quat, device="cpu"), wp.array(q, dtype=t.quat, device="cpu"),
                                         wp.array(u, dtype=t.vec3, device="cpu")], [out], device="cpu")
    found = out.numpy().astype(np.float64)
    p, q, u = (a.astype(np.float64) for a in (p, q, u))
    angle = np.linalg.norm(u, axis=1, keepdims=True)
    axis = np.where(angle > 0.0, u / np.maximum(angle, 1e-300), (1.0, 0.0, 0.0))
    exact = [(0, host.quat_product(p, q)), (4, host.quat_conjugate(q)), (8, host.unit_quat(3.0 * q)),
             (16, host.rotate_by_angular_velocity(q, u / 0.1, 0.1)), (24, host.quaternion_exponential(u)),
             (31, host.quat_rotate(q, u)), (37, host.axis_rotation_matrix(axis, angle[:, 0]).reshape(-1, 9))]
    for at, values in exact:
        assert np.abs(found[:, at:at + values.shape[1]] - values).max() < 32 * eps, at
    again = host.matrix_quat(host.quaternion_to_matrix(q))
    assert np.minimum(np.abs(found[:, 20:24] - again), np.abs(found[:, 20:24] + again)).max() < 32 * eps
    assert same_turn(found[:, 28:31], host.quaternion_logarithm(q)).max() < 32 * eps
    assert same_turn(found[:, 34:37], 0.1 * host.angular_velocity_between(p, q, 0.1)).max() < 64 * eps
    apart = np.linalg.norm(host.quaternion_logarithm(host.quat_product(host.quat_conjugate(p), q)), axis=1) < PI - 1e-2
    assert np.abs(found[:, 12:16] - host.slerp(p, q, 0.3))[apart].max() < 32 * eps
