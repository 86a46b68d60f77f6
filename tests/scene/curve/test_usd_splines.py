"""Curves of handles of any length, pieces that are straight or held, jumps and every way outside of the keys, against Ts."""

import numpy as np
import pytest
from pxr import Ts

from tests.make.scene.curve.usd_splines import SIDES, both, side
from wsim.scene.curve import Curve


def moments(curve: Curve) -> np.ndarray:
    """Around and in the keys, not at them nor where periods meet."""
    first, last = curve.times[0], curve.times[-1]
    t = np.linspace(first - 2.3 * (last - first), last + 2.3 * (last - first), 601)
    return t[np.abs((t - first) % (last - first)) > 1e-6]


@pytest.mark.parametrize("outside", [*SIDES, 1.7])
@pytest.mark.parametrize("kind", ["bezier", "hermite"])
@pytest.mark.parametrize("jumps", [False, True])
def test_a_spline_of_usd_is_evaluated_exactly_in_and_outside_of_its_keys(kind, outside, jumps):
    for seed in range(4):
        ours, theirs = both(seed, kind=kind, before=outside, after=outside, jumps=jumps)
        t = moments(ours)
        found = np.array([theirs.Eval(x) for x in t])
        np.testing.assert_allclose(ours.sampled(t), found, rtol=0, atol=1e-12 * max(1.0, np.abs(found).max()))
        rate = np.array([theirs.EvalDerivative(x) for x in t])
        np.testing.assert_allclose(ours.rate(t), rate, rtol=1e-8, atol=1e-8)
        at = ours.times if outside in ("held", "linear", 1.7) else ours.times[:-1]
        np.testing.assert_allclose(ours.sampled(at), [theirs.Eval(x) for x in at], rtol=0, atol=1e-12)


@pytest.mark.parametrize("outside", [*SIDES, 1.7])
def test_one_knot_is_that_of_usd(outside):
    theirs = Ts.Spline()
    theirs.SetKnot(Ts.Knot(typeName="double", time=1.0, value=2.0, nextInterp=Ts.InterpCurve, preTanSlope=0.5, postTanSlope=0.5,
                           preTanWidth=0.1, postTanWidth=0.1))
    theirs.SetPreExtrapolation(side(outside))
    theirs.SetPostExtrapolation(side(outside))
    ours = Curve([1.0], [2.0], "bezier", outside, outside, leave=[0.5])
    t = np.array([-1.0, 0.5, 1.0, 3.0])
    np.testing.assert_allclose(ours.sampled(t), [theirs.Eval(x) for x in t], atol=1e-12)


def test_handles_that_end_at_the_other_key_are_those_of_usd():
    """There dx/du is 0 at the ends."""
    theirs = Ts.Spline()
    for t, v in ((0.0, 0.0), (2.0, 1.0)):
        theirs.SetKnot(Ts.Knot(typeName="double", time=t, value=v, nextInterp=Ts.InterpCurve, preTanSlope=0.3,
                               postTanSlope=-0.4, preTanWidth=2.0, postTanWidth=2.0))
    ours = Curve([0.0, 2.0], [0.0, 1.0], "bezier", leave=[-0.4] * 2, arrive=[0.3] * 2, leave_width=[2.0, 0.0],
                 arrive_width=[0.0, 2.0])
    t = np.linspace(0.0, 2.0, 201)
    off = np.abs(ours.sampled(t) - [theirs.Eval(x) for x in t])
    middle = np.abs(t - 1.0) < 0.02                            # x(u) is flat there: u is known to the root of rounding
    assert off[~middle].max() < 1e-12
