"""What tests/scene/curve/test_usd_splines.py shares with other tests: both."""

import numpy as np
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
