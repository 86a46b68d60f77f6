"""Length along paths: closed forms, and an even pace to 1e-6 of the whole."""

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.make.scene.curve.motion import made
from wsim.scene.curve import Curve, Motion
from wsim.scene.curve.arc import ArcLength, evenly


def test_the_length_of_a_parabola_is_its_closed_form():
    """p = (t, t^2) on 0 .. 1 as one Hermite piece: sqrt(5) / 2 + asinh(2) / 4."""
    arc = ArcLength(Curve([0.0, 1.0], [[0.0, 0.0], [1.0, 1.0]], "hermite", leave=[[1.0, 0.0], [1.0, 2.0]]))
    assert arc.whole == pytest.approx(np.sqrt(5) / 2 + np.arcsinh(2) / 4, rel=1e-10)
    t = arc.time([0.3 * arc.whole])[0]
    assert (t * np.sqrt(1 + 4 * t * t) + np.arcsinh(2 * t) / 2) / 2 == pytest.approx(0.3 * arc.whole, rel=1e-9)


@pytest.mark.parametrize("kind", first_and_slow(["linear", "catmull_rom", "monotone"]))
def test_an_even_path_has_gone_as_far_as_time_to_1e_6_of_the_whole(kind):
    rng = np.random.default_rng(3)
    path = Curve(np.array([0.0, 0.4, 2.0, 2.3, 5.0]), rng.normal(size=(5, 3)), kind)
    even, arc = evenly(path), ArcLength(path)
    t = np.linspace(0.0, 5.0, 1001)
    far = np.linalg.norm(even.sampled(t) - arc.at(arc.whole * t / 5.0), axis=1)
    assert far.max() < 1e-6 * arc.whole
    quad = pytest.importorskip("scipy.integrate").quad
    whole = sum(quad(lambda t: np.linalg.norm(path.rate(t)[0]), a, b, epsrel=1e-12)[0] for a, b in zip(
        path.times[:-1], np.nextafter(path.times[1:], 0.0), strict=True))
    assert arc.whole == pytest.approx(whole, rel=1e-9)
    if kind == "catmull_rom":
        speed = np.linalg.norm(even.rate(t[1:-1]), axis=1)
        np.testing.assert_allclose(speed, arc.whole / 5.0, rtol=2e-3)


@pytest.mark.slow
def test_a_motion_goes_along_with_its_turns_at_a_given_pace():
    motion, pace = made("catmull_rom", alpha=0.5), Curve([0.0, 3.0], [0.0, 1.0], "eased", easing="ease-in-out")
    even, arc = evenly(motion, pace), ArcLength(motion)
    t = np.linspace(0.0, 3.0, 301)
    at = arc.time(arc.whole * pace.sampled(t))
    assert isinstance(even, Motion)
    assert np.linalg.norm(even.sampled(t)[:, :3, 3] - motion.sampled(at)[:, :3, 3], axis=1).max() < 1e-6 * arc.whole
    expected = motion.sampled(arc.time(arc.whole * pace.sampled(even.times)))
    np.testing.assert_allclose(even.sampled(even.times), expected, atol=1e-7)


@pytest.mark.parametrize("wrong", [
    lambda: ArcLength(Curve([0.0], [[0.0, 1.0]])), lambda: ArcLength(Curve([0.0, 1.0], [[1.0, 1.0], [1.0, 1.0]])),
    lambda: evenly(made("linear"), Curve([0.0, 1.0], [0.0, 2.0]))])
def test_what_has_no_length_or_leaves_its_path_is_refused(wrong):
    with pytest.raises(ValueError, match=r"a path needs two keys|from 0 to 1"):
        wrong()
