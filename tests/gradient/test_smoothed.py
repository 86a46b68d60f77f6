"""Exact slopes beside those of smoothed losses: they agree where a run is smooth, and differ where a branch decides."""

import numpy as np
import pytest

from tests.make.gradient.gradients import net
from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import Rollout
from wsim.gradient.rollout.smoothed import _judge_slopes, trust
from wsim.scene import Box, Scene, SceneError, Springs
from wsim.simulation.simulation import Simulation


def rollout(scene, names, frames, at) -> Rollout:
    return Rollout(Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), frames), names, [at])


def test_a_smooth_run_is_trustworthy_and_the_smoothed_slope_is_that_of_a_parabola():
    """Half the square of the last positions of a chain, along every input."""
    made = rollout(net(integrator="leapfrog"), ["/chain:stiffness", "/chain:velocities", "gravity"], 2, 2)
    found = trust(made, lambda y: 0.5 * (y[0] ** 2).sum(), lambda y: np.stack([y[0], 0.0 * y[1]]), samples=16)
    assert [t.verdict for t in found] == ["agree"] * 3
    for t in found:
        assert abs(t.smoothed - t.exact) < 0.01 * abs(t.exact)
    assert all("trustworthy" in str(t) for t in found)


def ledge() -> Scene:
    """Two points on a soft spring, thrown along a box: the second lands 5 cm before its edge, or flies past it."""
    scene = Scene(gravity=(0.0, 0.0, -9.81), up="Z", fps=60.0, frames=30, solver="xpbd", integrator="backward_euler",
                  substeps=8, iterations=1)
    points = np.array([[-0.3, 0.0, 0.2], [-0.1, 0.0, 0.2]])
    scene.springs.append(Springs("/pair", points, np.array([[0, 1]]), np.array([1.0]), np.full(2, 0.1),
                                 velocities=np.tile([0.5, 0.0, 0.0], (2, 1))))
    scene.collider("/box", Box((0.5, 0.5, 0.1)), at=(-0.45, 0.0, -0.1))
    return scene


def test_a_branch_at_an_edge_is_not_trustworthy():
    """The height, and a little of the way, of the second point: its exact slope knows of the way only. A push of half a metre
    a second makes it miss the box; one of 2 cm/s does not."""
    made = rollout(ledge(), ["/pair:velocities"], 24, 24)
    weights = np.zeros(made.shape)
    weights[0, 0, 1] = 0.1, 0.0, 1.0
    landed = made.run()[0, 0, 1]
    assert abs(landed[2]) < 0.01 and -0.01 < landed[0] < 0.05
    found = [trust(made, lambda y: (weights * y).sum(), lambda y: weights, spreads={"/pair:velocities": spread})[0]
             for spread in (0.5, 0.02)]
    assert [t.verdict for t in found] == ["differ", "agree"]
    assert found[0].exact == pytest.approx(found[1].exact) and abs(found[0].smoothed) > 5.0 * abs(found[0].exact)
    assert "not trustworthy" in str(found[0])


def test_verdicts_follow_from_the_numbers():
    """A step of height 1 at the middle: E[s sign(s)] / (2 sigma) = sqrt(2/pi) / (2 sigma), where the exact slope is 0."""
    draws = np.random.default_rng(1).normal(size=4000)
    step = _judge_slopes("x", 0.0, np.sign(draws), draws, 0.5, 0.1)
    assert step.verdict == "differ" and step.smoothed == pytest.approx((2 / np.pi) ** 0.5, abs=4 * step.error)
    line = _judge_slopes("x", 3.0, 2.0 * 3.0 * 0.5 * draws, draws, 0.5, 0.1)
    assert line.verdict == "agree" and line.smoothed == pytest.approx(3.0) and line.error < 1e-12
    rare = _judge_slopes("x", 0.0, np.where(draws > 3.0, 1.0, 0.0)[:50], draws[:50], 0.5, 0.1)
    assert rare.verdict == "agree" and rare.smoothed == 0.0            # what no sample meets is not seen


@pytest.mark.parametrize("more, text", [({"samples": 2}, "samples: found 2; allowed is 4 or more"),
                                        ({"spreads": {"/chain:bend": 1.0}}, "/chain:bend: found a spread"),
                                        ({"spreads": {"gravity": 0.0}}, "gravity: found a spread of 0.0")])
def test_what_cannot_be_judged_is_said(more, text):
    made = rollout(net(integrator="leapfrog"), ["gravity"], 1, 1)
    with pytest.raises(SceneError, match=text):
        trust(made, lambda y: y.sum(), np.ones_like, **more)
