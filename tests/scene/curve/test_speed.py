"""Bounds of how fast motions go: never less than what their poses do, and not much more."""

import numpy as np
import pytest

from tests.conftest import first_and_slow
from wsim.geometry import rotation
from wsim.geometry.rotation import axis_rotation_matrix
from wsim.scene.curve import Curve, Motion, Part, Stack
from wsim.scene.curve.speed import LinearMotion, motion_speed_bounds

TIMES = np.array([0.0, 0.1, 0.25, 0.3, 0.5])
FRAMES = np.linspace(-0.049, 0.601, 27)              # some have a key inside, some are before the first or behind the last
AT = np.array([0.3, -0.2, 0.5])
FINE = 400             # poses of a frame

HANDLES = {"leave_width": np.full(5, 0.02), "arrive_width": np.array([0.03, 0.05, 0.01, 0.02, 0.1])}
KINDS: dict[str, dict] = {
    "linear": {}, "catmull_rom": {"alpha": 0.5}, "kochanek_bartels": {"tension": 0.3, "bias": -0.2}, "monotone": {},
    "hermite": {"leave": np.linspace(-3.0, 3.0, 15).reshape(5, 3)}, "eased": {"easing": "ease-in-out"},
    "bezier": {"leave": np.linspace(2.0, -2.0, 15).reshape(5, 3), **HANDLES}}


def keys(seed: int, turn: float = 0.7) -> np.ndarray:
    rng, M = np.random.default_rng(seed), np.tile(np.eye(4), (5, 1, 1))
    M[:, :3, 3] = rng.uniform(-1.0, 1.0, (5, 3))
    for each in M:
        axis = rng.normal(size=3)
        each[:3, :3] = axis_rotation_matrix(axis / np.linalg.norm(axis), rng.uniform(-turn, turn))
    return M


def smooth(seed: int) -> np.ndarray:
    """Keys of a helix, turning by 1 rad about an axis that tilts by 0.5 rad."""
    M, s = keys(seed), TIMES / TIMES[-1]
    M[:, :3, 3] = np.stack([np.cos(3.0 * s + seed), np.sin(3.0 * s + seed), s], axis=1)
    for each, t in zip(M, s, strict=True):
        each[:3, :3] = axis_rotation_matrix(np.array([0.0, np.sin(0.5 * t), np.cos(0.5 * t)]), t)
    return M


def stack(seed: int) -> Stack:
    rng = np.random.default_rng(seed)
    constant = np.eye(4)
    constant[:3, :3], constant[:3, 3] = 0.5 * keys(seed + 1)[0, :3, :3], (1.0, 2.0, 3.0)
    double = np.diag([2.0, 2.0, 2.0, 1.0])
    return Stack([constant, Part("shift", Curve(TIMES, rng.normal(size=5), "catmull_rom"), 1),
                  Part("turn", Curve(TIMES[1:], rng.normal(size=4)), 2), Motion(TIMES, keys(seed), "monotone"),
                  Part("turn", Curve(TIMES[::2], rng.normal(size=3), "monotone"), 0), double])


def moved(motion: Motion, at=AT) -> tuple[np.ndarray, np.ndarray]:
    """(greatest distance [m] of a point and angle [rad] from where a frame begins, the greatest rates), (frames, 2) each."""
    far, fast = [], []
    for a, b in zip(FRAMES[:-1], FRAMES[1:], strict=True):
        M = motion.sampled(np.linspace(a, b, FINE + 1))
        x, q = M[:, :3, :3] @ at + M[:, :3, 3], rotation.matrix_quat(M[:, :3, :3] / np.cbrt(np.linalg.det(M[0, :3, :3])))

        def angle(p, r):
            return 2.0 * np.arcsin(np.minimum(1.0, np.linalg.norm(rotation.quat_product(rotation.quat_conjugate(p), r)[:, :3],
                                                                  axis=1)))
        far.append([np.linalg.norm(x - x[0], axis=1).max(), angle(q, np.repeat(q[:1], FINE + 1, 0)).max()])
        step = FINE / (b - a)
        fast.append([np.linalg.norm(np.diff(x, axis=0), axis=1).max() * step, angle(q[:-1], q[1:]).max() * step])
    return np.array(far), np.array(fast)


@pytest.mark.parametrize("side", ["held", "linear"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", first_and_slow(range(3)))
def test_no_pose_leaves_its_bounds(kind, side, seed):
    motion = Motion(TIMES, keys(seed), kind, side, side, **KINDS[kind])
    bound, (far, fast) = motion_speed_bounds(motion, FRAMES, AT), moved(motion)
    assert (bound[:, :2] >= far - 1e-6).all() and (bound[:, 2:] >= fast * (1.0 - 1e-6) - 1e-6).all()
    speeds = np.linalg.norm(motion.velocities(np.linspace(-0.049, 0.601, 26 * FINE))[0], axis=1).reshape(26, FINE).max(axis=1)
    assert (motion_speed_bounds(motion, FRAMES, np.zeros(3))[:, 2] >= speeds * (1.0 - 1e-9)).all()


@pytest.mark.parametrize("kind", ["linear", "catmull_rom", "kochanek_bartels", "monotone"])
def test_bounds_of_smooth_ways_are_near_what_they_bound(kind):
    """Slerps have theirs exactly; frames are as long as half of a piece, over which a parabola's middle control point stands
    out, and squad's turns are bounded one by one."""
    motion = Motion(TIMES, smooth(0), kind)
    bound, (far, fast) = motion_speed_bounds(motion, FRAMES, np.zeros(3)), moved(motion, np.zeros(3))
    moves = fast[:, 1] > 0.0
    np.testing.assert_array_less(bound[moves], 1.3 * np.concatenate([far, fast], axis=1)[moves])
    if kind == "linear":
        np.testing.assert_allclose(bound[:, 2:], fast, rtol=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_a_stack_stays_within_the_bounds_of_its_parts(seed):
    bound, (far, fast) = motion_speed_bounds(stack(seed), FRAMES, AT), moved(stack(seed))
    assert (bound[:, :2] >= far - 1e-6).all() and (bound[:, 2:] >= fast * (1.0 - 1e-6) - 1e-6).all()
    assert (bound[:, 2:].max(axis=0) < 6.0 * fast.max(axis=0)).all()                   # as if all moved the same way


@pytest.mark.parametrize("count", [1, 2, 5])
def test_linear_keys_are_summed_to_the_same(count):
    """Also where several keys are in a frame, or none; and poses are those of the matrices."""
    motion = Motion(TIMES[:count], keys(3)[:count])
    line = LinearMotion(motion)
    for t in (FRAMES, np.linspace(-0.3, 0.9, 7), np.array([-2.0, 3.0]), np.array([0.0, 0.1, 0.3])):
        np.testing.assert_allclose(line.fastest(t, AT)[:, :2], motion_speed_bounds(motion, t, AT)[:, :2], atol=1e-12)
        assert (line.fastest(t, AT)[:, 2:] >= motion_speed_bounds(motion, t, AT)[:, 2:] - 1e-12).all()
        p, q = line.at(t)
        np.testing.assert_allclose(rotation.quaternion_to_matrix(q), motion.sampled(t)[:, :3, :3], atol=1e-14)
        np.testing.assert_allclose(p, motion.sampled(t)[:, :3, 3], atol=1e-14)
    if count == 5:
        inside = np.linspace(0.01, 0.29, 12)
        np.testing.assert_allclose(line.fastest(inside, AT), motion_speed_bounds(motion, inside, AT), atol=1e-12)


def test_a_straight_way_and_a_steady_turn_are_known_exactly():
    """3 m/s and 2 rad/s; 0.5 m from the axis it is faster by 1 m/s at most."""
    M = np.tile(np.eye(4), (2, 1, 1))
    M[1, 0, 3], M[1, :3, :3] = 3.0, axis_rotation_matrix(np.array([0.0, 0.0, 1.0]), 2.0)
    bound = motion_speed_bounds(Motion([0.0, 1.0], M), np.array([0.2, 0.3, 0.5, 1.2]), np.array([0.5, 0.0, 0.0]))
    np.testing.assert_allclose(bound, [[0.4, 0.2, 4.0, 2.0], [0.8, 0.4, 4.0, 2.0], [2.0, 1.0, 4.0, 2.0]], rtol=1e-12)


@pytest.mark.parametrize("motion", [
    Motion(TIMES, keys(0), "eased", easing="elastic-out"), Motion(TIMES, keys(0), "hold"),
    Motion(TIMES, keys(0), after="repeat"), Motion(TIMES, keys(0, 3.1), "catmull_rom"),
    Stack([Part("scale", Curve(TIMES, np.ones(5) + TIMES), 0), Motion(TIMES, keys(1))]),
    Stack([Part("elements", Curve(TIMES, keys(3)))])], ids=["elastic", "hold", "repeat", "half turns", "scale", "elements"])
def test_what_has_no_formula_has_no_bound(motion):
    with np.errstate(all="raise"):
        bound = motion_speed_bounds(motion, FRAMES, AT)
    assert np.isinf(bound).any() and not np.isnan(bound).any()
    far, fast = moved(motion) if motion.kind != "stack" else (0.0, 0.0)
    assert (bound[:, :2] >= far - 1e-6).all() and (bound[:, 2:] >= fast * (1.0 - 1e-6) - 1e-6).all()
