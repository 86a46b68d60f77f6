"""Curves of handles of any length, pieces that are straight or held, jumps and every way outside of the keys, against Ts."""

import numpy as np
import pytest
from pxr import Ts

from wsim.scene.curve import Curve

FORMS = {"curve": Ts.InterpCurve, "linear": Ts.InterpLinear, "hold": Ts.InterpHeld}
SIDES = {"held": Ts.ExtrapHeld, "linear": Ts.ExtrapLinear, "repeat": Ts.ExtrapLoopRepeat, "reset": Ts.ExtrapLoopReset,
         "oscillate": Ts.ExtrapLoopOscillate}


def side(of) -> Ts.Extrapolation:
    found = Ts.Extrapolation(SIDES.get(of, Ts.ExtrapSloped) if isinstance(of, str) else Ts.ExtrapSloped)
    if not isinstance(of, str):
        found.slope = of
    return found


def both(seed, n=5, kind="bezier", before="held", after="held", jumps=False, forms=None) -> tuple[Curve, Ts.Spline]:
    """The same random curve twice."""
    rng = np.random.default_rng(seed)
    times, (p, leave, arrive) = np.cumsum(rng.uniform(0.3, 1.5, n)), rng.normal(size=(3, n))
    span = np.diff(times)
    widths = {"leave_width": np.append(span * rng.uniform(0.05, 0.95, n - 1), 0.0),
              "arrive_width": np.append(0.0, span * rng.uniform(0.05, 0.95, n - 1))}
    form = list(rng.choice(list(FORMS), n - 1)) if forms is None else [forms] * (n - 1)
    until = rng.normal(size=n) if jumps else p
    ours = Curve(times, p, kind, before, after, leave=leave, arrive=arrive, form=form, until=until,
                 **widths if kind == "bezier" else {})
    theirs = Ts.Spline()
    of = Ts.CurveTypeBezier if kind == "bezier" else Ts.CurveTypeHermite
    theirs.SetCurveType(of)
    for k, t in enumerate(times.tolist()):
        knot = Ts.Knot(typeName="double", time=t, value=float(p[k]), curveType=of, nextInterp=FORMS[[*form, "curve"][k]],
                       preTanSlope=float(arrive[k]), postTanSlope=float(leave[k]))
        if jumps:
            knot.SetPreValue(float(until[k]))
        if kind == "bezier":
            knot.SetPreTanWidth(float(widths["arrive_width"][k]))
            knot.SetPostTanWidth(float(widths["leave_width"][k]))
        theirs.SetKnot(knot)
    theirs.SetPreExtrapolation(side(before))
    theirs.SetPostExtrapolation(side(after))
    return ours, theirs


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
