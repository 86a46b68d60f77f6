"""Motions by splines: their rates are derivatives, turns are smooth where slerps jump, stacks are those of USD."""

import numpy as np
import pytest

from tests.make.scene.curve.motion import KINDS, OUTSIDE, keys, made
from wsim.geometry import rotation
from wsim.scene.curve import Curve, Motion, Part, Stack
from wsim.scene.curve.stack import SCALE, SHIFT, TURN, then


def inner(motion, h=1e-4) -> np.ndarray:
    t = np.linspace(motion.times[0] - 4.0, motion.times[-1] + 4.0, 211)
    period = motion.times[-1] - motion.times[0]
    around = np.concatenate([motion.times + k * period for k in range(-4, 5)] + [2 * motion.times[0] - motion.times + k * period
                                                                              for k in range(-4, 5)])
    return t[np.abs(t[:, None] - around).min(axis=1) > 10 * h]


@pytest.mark.parametrize("outside", OUTSIDE)
@pytest.mark.parametrize("kind", KINDS)
def test_the_rate_of_a_motion_is_its_derivative_and_its_axes_stay_orthonormal(kind, outside):
    motion, h = made(kind, outside), 1e-5
    motion = Motion(motion.times, motion.values @ np.diag([1.0, 2.0, 0.5, 1.0]), kind, outside, outside, **KINDS[kind])
    t = inner(motion)
    found = (motion.sampled(t + h) - motion.sampled(t - h)) / (2 * h)
    scale = 1.0 + np.abs(found).max()
    wrong = np.abs(motion.rate(t) - found).max(axis=(1, 2)) > 3e-8 * scale
    assert wrong.sum() <= (4 if kind == "eased" else 0)        # corners of a bounce within its piece
    R = made(kind, outside).sampled(t)[:, :3, :3]
    np.testing.assert_allclose(R @ R.swapaxes(1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-13)


@pytest.mark.parametrize("kind", KINDS)
def test_keys_are_met(kind):
    motion = made(kind)
    np.testing.assert_allclose(motion.sampled(motion.times), motion.values, atol=1e-14)
    np.testing.assert_allclose(made(kind, "repeat").at(motion.times[-1]), motion.values[-1], atol=1e-13)


def test_without_more_a_spline_of_two_keys_is_the_motion_between_them():
    times, places, q = keys(1, 2)
    t = np.linspace(times[0] - 1, times[1] + 1, 31)
    for kind in ("catmull_rom", "monotone"):
        np.testing.assert_allclose(Motion.through(times, places, q, kind).sampled(t),
                                   Motion.through(times, places, q, "linear").sampled(t), atol=1e-14)


def test_velocities_of_smooth_turns_are_continuous_at_keys_where_chained_slerps_jump():
    smooth, chained = made("catmull_rom", alpha=None), made("linear")
    jump = {}
    for name, motion in (("smooth", smooth), ("chained", chained)):
        before, after = (motion.velocities(motion.times[1:-1] + s)[1] for s in (-1e-9, 1e-9))
        jump[name] = np.linalg.norm(after - before, axis=1)
    assert jump["smooth"].max() < 1e-5 < 0.5 < jump["chained"].min()
    speeds = np.linalg.norm(chained.velocities(np.linspace(chained.times[0], chained.times[1], 50)[:-1])[1], axis=1)
    np.testing.assert_allclose(speeds, speeds[0], rtol=1e-6)


def test_repeating_goes_on_from_where_it_ended():
    motion = made("catmull_rom", "repeat")
    period, t = motion.times[-1] - motion.times[0], motion.times[-1]
    np.testing.assert_allclose(motion.at(t - 1e-12), motion.at(t + 1e-12), atol=1e-9)
    turn = motion.values[-1][:3, :3] @ motion.values[0][:3, :3].T
    np.testing.assert_allclose(motion.at(t + 0.3)[:3, :3], turn @ motion.at(t + 0.3 - period)[:3, :3], atol=1e-13)


def test_a_stack_is_the_product_of_its_parts_and_its_rate_the_derivative():
    t = np.linspace(-0.5, 3.5, 41) + 1e-3
    swing = Curve([0.0, 1.0, 3.0], [0.0, 2.0, -1.0], "catmull_rom", after="oscillate")
    fixed = made("linear").values[1]
    own = made("catmull_rom")
    stack = Stack([Part(SHIFT, swing, 1), fixed, Part(TURN, swing, 2), own, Part(SCALE, Curve([0.0, 2.0], [1.0, 3.0]), 0)])
    c, s, zero, one = np.cos(swing.sampled(t)), np.sin(swing.sampled(t)), 0 * t, 0 * t + 1
    turn = np.array([[c, -s, zero, zero], [s, c, zero, zero], [zero, zero, one, zero], [zero, zero, zero, one]])
    turn = np.moveaxis(turn, 2, 0)
    shift, scale = np.tile(np.eye(4), (2, len(t), 1, 1))
    shift[:, 1, 3], scale[:, 0, 0] = swing.sampled(t), np.clip(1 + t, 1, 3)
    np.testing.assert_allclose(stack.sampled(t), shift @ fixed @ turn @ own.sampled(t) @ scale, atol=1e-13)
    h = 1e-5
    np.testing.assert_allclose(stack.rate(t), (stack.sampled(t + h) - stack.sampled(t - h)) / (2 * h), atol=1e-7)
    assert stack.moves and stack == Stack([stack]) and not Stack([fixed]).moves
    np.testing.assert_allclose(stack.later(0.7).sampled(t + 0.7), stack.sampled(t), atol=1e-13)
    np.testing.assert_allclose(then(own, fixed).sampled(t), own.sampled(t) @ fixed, atol=1e-15)


@pytest.mark.parametrize(("wrong", "said"), [
    (lambda t, p, q: Motion.through(t, p, 2 * q), "number 0 of length 2; divide each by its length"),
    (lambda t, p, q: Motion.through(t, p, q[:3]), "3 of them for 5 places"),
    (lambda t, p, q: Motion.through(t[::-1], p, q), "key 1 at"),
    (lambda t, p, q: Motion.through(t, p * np.nan, q), "finite"),
    (lambda t, p, q: Motion.through(t, p, q, after=1.0), "has no slope|a slope is for a Curve")])
def test_what_is_no_motion_is_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        wrong(*keys())


@pytest.mark.parametrize("turns", [0, 1, 4])
def test_many_times_at_once_are_one_after_the_other_to_the_bit(turns):
    """turns: keys that have a rotation of their own; the others have that of the key before."""
    rng = np.random.default_rng(turns)
    q = rng.normal(size=(5, 4))
    q[:5 - turns] = q[0]
    motion = Motion.through(np.cumsum(rng.uniform(0.1, 1.0, 5)), rng.normal(size=(5, 3)), rotation.unit_quat(q), "linear")
    t = np.append(rng.uniform(-1.0, 5.0, 40), motion.times)
    np.testing.assert_array_equal(motion.sampled(t), np.stack([motion.at(one) for one in t]))
