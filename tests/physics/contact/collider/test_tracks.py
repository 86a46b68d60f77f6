"""Motions of every kind on the device against those of the host, and what is compiled for them."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.contact.collider.poses import tried
from tests.make.scene.curve.motion import KINDS, OUTSIDE, made
from tests.make.scene.curve.usd_splines import both
from wsim.geometry import rotation, rotation_spline
from wsim.kernels.animation import rotation_spline as device
from wsim.physics.contact import poses
from wsim.physics.contact.poses.sampled import SampledMotions
from wsim.scene import Collider, Sphere
from wsim.scene.curve import Curve, Motion, Part, Stack
from wsim.scene.curve.easing import NAMES
from wsim.scene.curve.stack import ELEMENTS, SCALE, SHIFT, TURN

CLOSE = {"rtol": 0.0, "atol": 1e-12}


def sampled(motions, time, dt=0.5) -> np.ndarray:
    """(motions, 8, 4, 4) of the device, from `time` on."""
    c = tried([Collider(f"/c{k}", Sphere(0.1), m) for k, m in enumerate(motions)])
    c.prepare(time)
    of = c.poses.device_rows.sampled
    assert c.poses.many.tolist() == of.row.tolist() == list(range(len(motions))) and of.split == 0
    M = np.tile(np.eye(4), (*of.A.shape, 1, 1))
    M[..., :3, :3], M[..., :3, 3] = of.A.numpy(), of.p.numpy()
    return M


def alike(motions) -> None:
    for time in (-7.0, -1.9, 0.0, 0.37, 1.9, 3.7, 11.0):
        found = sampled(motions, time)
        for k, motion in enumerate(motions):
            t = time + 0.5 * np.arange(8) / 7
            np.testing.assert_allclose(found[k], motion.sampled(t), **CLOSE, err_msg=f"{k} {motion} at {time}")


@pytest.fixture(autouse=True)
def few(monkeypatch):
    monkeypatch.setattr(poses, "HOST_MOST", 0)


@pytest.mark.slow
def test_motions_by_keys_of_every_kind_are_those_of_the_host():
    motions = [made(kind, outside, seed) for kind in KINDS for seed, outside in enumerate(OUTSIDE) if (kind, outside) != (
        "linear", "held")]
    alike([m for m in motions if not m.plain])


def test_splines_in_stacks_are_those_of_the_host():
    """Handles, jumps and pieces of every form; elements of matrices; stacks with constants between; smooth turns."""
    turning = made("catmull_rom", "repeat", 4)
    motions = []
    for seed, outside in enumerate([*OUTSIDE, 1.7]):
        curve = both(seed, kind="bezier", before=outside, after=outside, jumps=True)[0]
        parts = [Part(SHIFT, curve, seed % 3), Part(TURN, curve, (seed + 1) % 3)]
        motions.append(Stack([*parts, turning.values[1], Part(SCALE, Curve([0.0, 2.0], [1.0, 0.5]), 2), turning]))
    values = np.random.default_rng(0).normal(size=(3, 4, 4))
    values[:, 3] = 0.0, 0.0, 0.0, 1.0
    motions.append(Stack([Part(ELEMENTS, Curve([0.0, 0.5, 2.0], values)), turning]))
    found = packed_samples(motions)
    for k, motion in enumerate(motions):
        np.testing.assert_allclose(found[k], motion.sampled(TIMES), **CLOSE, err_msg=str(k))


TIMES = np.linspace(-3.0, 6.0, 91) + 1e-3


def packed_samples(motions) -> np.ndarray:
    """As `sampled`, of motions that no collider may have."""
    of = SampledMotions(wp.get_device("cpu"), "unused")
    of.take(motions, TIMES - TIMES[0])
    of.begin(TIMES[0])
    for kernel, dim, inputs, outputs in of.launches():
        wp.launch(kernel, dim, inputs, outputs, device="cpu")
    M = np.tile(np.eye(4), (*of.A.shape, 1, 1))
    M[..., :3, :3], M[..., :3, 3] = of.A.numpy(), of.p.numpy()
    return M


@pytest.mark.slow
def test_every_easing_is_that_of_the_host():
    times = np.array([0.0, 1.0, 2.5])
    alike([Motion.through(times, np.outer(times, [1.0, 2.0, 3.0]), None, "eased", easing=name) for name in
           (*NAMES, (0.1, 1.7, 0.9, -0.4)) if name != "linear"])


def test_what_is_compiled_has_the_easings_and_parts_that_there_are_and_no_others():
    from wsim.physics.contact.poses.tracks import MotionTracks
    of = MotionTracks(wp.get_device("cpu"))
    of.take([made("catmull_rom", "held", 1, alpha=None)])
    assert of.sample.module.name == "wsim_tracks_0_of_5"


@wp.kernel(module="test_rotation_splines")
def turn(q: wp.array2d(dtype=wp.quatd), s: wp.array(dtype=wp.float64), squad_out: wp.array(dtype=wp.quatd),
         rate_out: wp.array(dtype=wp.vec3d), nlerp_out: wp.array(dtype=wp.quatd)):
    i = wp.tid()
    found, rate = device.squad_angular_rate(q[i, 0], q[i, 1], q[i, 2], q[i, 3], s[i])
    squad_out[i] = device.squad_rotation(q[i, 0], q[i, 1], q[i, 2], q[i, 3], s[i])
    if wp.abs(found[0] - squad_out[i][0]) > wp.float64(1.0e-15):
        rate = wp.vec3d(wp.float64(1.0e9))
    rate_out[i] = rate
    nlerp_out[i] = device.normalized_lerp(q[i, 0], q[i, 3], s[i])


def test_squad_its_angular_velocity_and_nlerp_on_the_device_are_those_of_the_host():
    rng, n = np.random.default_rng(0), 200
    q = rotation.unit_quat(rng.normal(size=(n, 4, 4)))
    near = rotation.quat_product(q[:, :1], rotation.quaternion_exponential(rng.normal(size=(n, 4, 3))
                                                                           * 10.0 ** rng.uniform(-9, 0, (n, 1, 1))))
    q = np.concatenate([q, near])
    s = rng.uniform(size=2 * n)
    out = [wp.zeros(2 * n, dtype=t, device="cpu") for t in (wp.quatd, wp.vec3d, wp.quatd)]
    wp.launch(turn, 2 * n, [wp.array(q, dtype=wp.quatd, device="cpu"), wp.array(s, dtype=wp.float64, device="cpu")], out,
              device="cpu")
    found, rate = rotation_spline.spherical_quadrangle_rate(*q.swapaxes(0, 1), s)
    np.testing.assert_allclose(out[0].numpy(), found, atol=1e-13)
    np.testing.assert_allclose(out[1].numpy(), rate, atol=1e-10)
    np.testing.assert_allclose(out[2].numpy(), rotation_spline.lerp_normalized(q[:, 0], q[:, 3], s), atol=1e-14)


@wp.kernel(module="test_rotation_mean")
def mean(K: wp.array(dtype=wp.mat44d), q_out: wp.array(dtype=wp.quatd)):
    i = wp.tid()
    q_out[i] = device.mean_rotation(K[i])


def test_the_mean_on_the_device_is_that_of_the_host():
    rng = np.random.default_rng(2)
    q, w = rotation.unit_quat(rng.normal(size=(20, 7, 4))), rng.uniform(size=(20, 7))
    K = np.einsum("bn,bni,bnj->bij", w, q, q)
    out = wp.zeros(20, dtype=wp.quatd, device="cpu")
    wp.launch(mean, 20, [wp.array(K, dtype=wp.mat44d, device="cpu")], [out], device="cpu")
    expected = np.array([rotation_spline.average_rotation(a, b) for a, b in zip(q, w, strict=True)])
    np.testing.assert_allclose(out.numpy(), expected, atol=1e-12)
