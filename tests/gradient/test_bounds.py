"""Products and verdicts by what stands at the end of what it may be (a friction or a thickness of 0), and by where a collider
is, which worlds share: against exact adjoints in float64, and what is refused. XPBD of six substeps of three sweeps, and
leapfrog of 50, whose sweeps on a contact end after so many, or one more: a ragged function of friction, right to 1e-3."""

from functools import cache

import numpy as np
import pytest

from tests.make.gradient.gradients import net
from tests.make.physics.contact.project_adjoint import SOLVERS, dropped
from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import Rollout
from wsim.gradient.rollout.smoothed import trust
from wsim.scene import SceneError
from wsim.simulation.simulation import Simulation

FREE = ["/floor:dynamic_friction", "/cloth:dynamic_friction", "/floor:thickness"]


@cache
def rollout(solver: str, friction: float = 0.0) -> Rollout:
    """Of a sheet that falls on a moving plane and slides."""
    scene = dropped("plane", (friction, friction), **SOLVERS[solver])
    recording = Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), 3)
    return Rollout(recording, [*FREE, "/floor:shift"], [2, 3])


def half(y: np.ndarray) -> float:
    return 0.5 * float((y**2).sum())


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("name", FREE)
def test_jvp_at_the_end_of_a_range_is_from_the_side_that_is_allowed(solver, name):
    """Ahead along d, or behind where d leads out; right to what vjp says of that side."""
    f = rollout(solver)
    s = np.random.default_rng(3).normal(size=f.run().shape)
    by = f.vjp(s)[name]
    for way in (1.0, -1.0):
        found = f.jvp({name: way})
        assert (s * found.value).sum() == pytest.approx(way * by, rel=1e-8 if solver == "xpbd" else 1e-3) and by != 0.0
        assert found.order == 11 and found.error.max() < (1e-7 if solver == "xpbd" else 1e-3)
        assert found.said == f"from one side: {name} is 0, and allowed is 0 to inf"
    assert f.gauss_newton({name: 1.0}).said == found.said
    free = rollout(solver, 0.3).jvp({name: 1.0})
    assert name == FREE[2] or (free.order, free.said) == (12, "from both sides")


def test_hvp_at_the_end_of_a_range():
    """H d of one side, by gradients there: against a plain difference of them, of order 2."""
    f, name = rollout("xpbd"), FREE[0]
    found = f.hvp({name: 1.0}, lambda y: y)
    assert found.order == 5 and found.said.startswith("from one side")
    g, h = [], 1e-5
    for k in range(3):
        y = f.run({name: k * h})
        g.append(f.vjp(y)[name])
    f.run({name: 0.0})
    assert found.value[name] == pytest.approx((4.0 * g[1] - 3.0 * g[0] - g[2]) / (2.0 * h), rel=1e-5)


@pytest.mark.parametrize("solver", SOLVERS)
def test_products_and_verdicts_by_where_a_collider_is(solver):
    """Worlds share it: copies run one after the other."""
    f, name = rollout(solver, 0.3), "/floor:shift"
    y, rng = f.run(), np.random.default_rng(4)
    s, d = rng.normal(size=y.shape), 1e-5 * rng.normal(size=(4, 3))
    found = f.jvp({name: d}, step=0.03)                  # at 0.1 its steps reach over a kink: its own error, 4e-4, tells
    assert (s * found.value).sum() == pytest.approx((f.vjp(s)[name] * d).sum(), rel=1e-6)
    assert found.said == "from both sides" and np.abs(f.run() - y).max() == 0.0
    one = Rollout(f.recording, [name], [2, 3])
    (said,) = trust(one, half, lambda y: y, samples=4, spreads={name: 1e-6})
    assert said.verdict == "agree" and said.smoothed == pytest.approx(said.exact, rel=1e-3)
    assert set(one.copied) == {1}


def test_what_cannot_be_is_refused_with_the_mend():
    f, slid = rollout("xpbd"), rollout("xpbd", 0.3)
    for call, words in [
            (lambda: trust(f, half, lambda y: y, samples=4),
             r"/floor:dynamic_friction: is 0, and copies with a spread of 5e-05 have -.* to .*; allowed are 0 to inf; a "
             "smoothed loss needs both sides of it: set it off that end, or leave it out of the rollout"),
            (lambda: trust(slid, half, lambda y: y, samples=4, spreads={FREE[0]: 0.6}),
             r"is 0.3, and copies with a spread of 0.6 have -.*; give spreads={'/floor:dynamic_friction': 0\.\d+} or less"),
            (lambda: f.jvp({FREE[0]: 1.0, FREE[1]: -1.0}),
             "/cloth:dynamic_friction: is 0, and a step of 5e-05 along the direction leaves 0 to inf, which is allowed, or "
             "takes /floor:dynamic_friction out of what is; give a smaller step, or take the product with each input by itse")]:
        with pytest.raises(SceneError, match=words):
            call()


def test_a_value_of_zero_gives_no_step():
    """Of a spring that was slackened live; a given step is taken from above."""
    f = Rollout(Recording(Simulation(net(integrator="leapfrog"), device="cpu", precision="float64", gradients=True), 2),
                ["/chain:stiffness"])
    f.run({"/chain:stiffness": np.where(np.arange(11) == 10, 0.0, 40.0)})
    for call in (lambda: f.jvp({"/chain:stiffness": 1.0}), lambda: trust(f, half, lambda y: y, samples=4)):
        with pytest.raises(SceneError, match="/chain:stiffness: is 0 in some of its values, so that a part of it is no step"):
            call()
    s = np.random.default_rng(5).normal(size=f.shape)
    d = np.eye(11)[10]
    found = f.jvp({"/chain:stiffness": d}, step=0.5)
    f.recording.run()
    assert found.said.startswith("from one side: /chain:stiffness is 0 to 40") and found.order == 11
    assert (s * found.value).sum() == pytest.approx(f.vjp(s)["/chain:stiffness"] @ d, rel=1e-8)
