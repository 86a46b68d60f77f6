"""Gradients with respect to joint angles and weights of blend shapes, through skinning to pins; and what is refused."""

import numpy as np
import pytest

from tests.make.physics.animation.gradients import SOLVERS, held
from wsim import Simulation
from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import Rollout
from wsim.physics.animation.objects import DUAL, LINEAR
from wsim.scene import Scene


def slopes(scene: Scene, names: list[str]) -> None:
    """Of order 4, in float64."""
    f = Rollout(Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), 2), names, [1, 2])
    s = np.random.default_rng(5).normal(size=f.run().shape)
    found = f.vjp(s)
    for name in names:
        base = f.values()[name]
        way = np.random.default_rng(8).normal(size=base.shape)
        step = 2e-6
        losses = {k: float((f.run({name: base + k * step * way}) * s).sum()) for k in (-2, -1, 1, 2)}
        f.run({name: base})
        expected = (8.0 * (losses[1] - losses[-1]) - (losses[2] - losses[-2])) / (12.0 * step)
        assert abs(expected) > 1e-3
        assert float((found[name] * way).sum()) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("solver", "method", "stiffness"), [
    pytest.param(solver, method, stiffness, marks=pytest.mark.slow if (solver, method) != ("xpbd", DUAL) else ())
    for solver in SOLVERS for method, stiffness in ((LINEAR, 30.0), (DUAL, np.inf))])
def test_angles_and_weights_have_the_slope_of_differences(solver, method, stiffness):
    slopes(held(solver, method, stiffness), ["/man/bones:turns", "/man/bones:weights"])


@pytest.mark.slow
def test_a_skeleton_that_stands_still_has_them_too():
    slopes(held("explicit", keys=1), ["/man/bones:turns", "/man/bones:weights"])


@pytest.mark.slow
def test_angles_away_from_the_animation_have_the_slope_there():
    scene = held("explicit")
    f = Rollout(Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), 2), ["/man/bones:turns"], [2])
    base = 0.4 * np.random.default_rng(1).normal(size=f.values()["/man/bones:turns"].shape)
    s = np.random.default_rng(5).normal(size=f.run({"/man/bones:turns": base}).shape)
    np.testing.assert_allclose(f.values()["/man/bones:turns"], base, atol=1e-12)
    way, step = np.random.default_rng(8).normal(size=base.shape), 2e-6
    slope = float((f.vjp(s)["/man/bones:turns"] * way).sum())
    losses = {k: float((f.run({"/man/bones:turns": base + k * step * way}) * s).sum()) for k in (-2, -1, 1, 2)}
    assert slope == pytest.approx((8.0 * (losses[1] - losses[-1]) - (losses[2] - losses[-2])) / (12.0 * step), rel=1e-6)


