"""Splines of USD (Ts) <-> `wsim.scene.curve.Curve`, exactly: knots with handles, straight and held pieces, jumps, what is
outside.

USD shortens handles that would run back in time when it evaluates a spline; they are read as it shortens them, and inner loops
by the knots that they stand for. A curve becomes a spline where each piece is straight, held or a cubic with handles: all kinds
but easings by name.
"""

from typing import Any

import numpy as np
from pxr import Sdf, Ts, Usd

from wsim.scene.curve import Curve
from wsim.usd.stage import StageUnits

TS: Any = Ts                              # its stubs lack names
FORMS = {TS.InterpCurve: "curve", TS.InterpLinear: "linear", TS.InterpHeld: "hold"}
SIDES = {TS.ExtrapHeld: "held", TS.ExtrapLinear: "linear", TS.ExtrapLoopRepeat: "repeat", TS.ExtrapLoopReset: "reset",
         TS.ExtrapLoopOscillate: "oscillate"}
ROUNDED = 1e-6                            # of the largest value, how far samples of a curve may lie from it: floats are rounded
TYPES = {"double": "double", "float": "float", "half": "half"}


def has_spline(attribute: Usd.Attribute) -> bool:
    """True if an attribute's value is a spline."""
    return bool(attribute) and attribute.HasSpline()


def curve_from_spline(spline, units: StageUnits, factor: float = 1.0) -> Curve:
    """The curve of a spline, values times `factor`. Raises ValueError for one without knots, or with value blocks."""
    if spline.IsEmpty() or spline.HasValueBlocks():
        raise ValueError("its spline has no knots" if spline.IsEmpty() else "its spline has value blocks")
    own = TS.Spline(spline)
    if own.HasLoops() and not own.HasExtrapolatingLoops() or own.HasExtrapolatingLoops() and own.HasInnerLoops():
        own.BakeInnerLoops()                                  # asked for last: USD warns of what is deprecated at each question
    if own.HasRegressiveTangents():
        own.AdjustRegressiveTangents()
    knots = list(own.GetKnots().values())
    codes = np.array([k.GetTime() for k in knots], np.float64)
    p = np.array([float(k.GetValue()) for k in knots]) * factor
    sides = [_read_spline_side(e, units, factor) for e in (own.GetPreExtrapolation(), own.GetPostExtrapolation())]
    how: dict[str, Any] = {"form": [FORMS[k.GetNextInterpolation()] for k in knots[:-1]]}
    if any(k.IsDualValued() for k in knots):
        how["until"] = np.array([float(k.GetPreValue()) for k in knots]) * factor
    how["leave"], how["arrive"] = (np.array([float(v) for v in slopes]) * (factor * units.fps) for slopes in (
        [k.GetPostTanSlope() for k in knots], [k.GetPreTanSlope() for k in knots]))
    if own.GetCurveType() == TS.CurveTypeHermite:
        return Curve(units.time(codes), p, "hermite", *sides, **how)
    span = np.diff(units.time(codes))
    for name, widths, room in (("leave_width", [k.GetPostTanWidth() for k in knots], np.append(span, 0.0)),
                               ("arrive_width", [k.GetPreTanWidth() for k in knots], np.append(0.0, span))):
        how[name] = np.minimum(np.array(widths, np.float64) / units.fps, room)
    return Curve(units.time(codes), p, "bezier", *sides, **how)


def _read_spline_side(of, units: StageUnits, factor: float):
    return SIDES[of.mode] if of.mode in SIDES else float(of.slope) * factor * units.fps


def spline_from_curve(curve: Curve, units: StageUnits, factor: float = 1.0, kind: str = "double"):
    """The spline of a curve of numbers (keys,), values over `factor`, of the type `kind` of attribute; None where a piece is no
    spline's."""
    if curve.values.ndim != 1 or kind not in TYPES:
        return None
    n = len(curve.times)
    made = [_bezier_handles(curve, k) for k in range(n - 1)]
    if any(m is None for m in made):
        return None
    found, per = TS.Spline(kind), 1.0 / (factor * units.fps)
    hermite = curve.kind == "hermite"
    found.SetCurveType(TS.CurveTypeHermite if hermite else TS.CurveTypeBezier)
    with TS.AntiRegressionAuthoringSelector(TS.AntiRegressionNone):
        for k in range(n):
            knot = TS.Knot(typeName=kind, time=float(units.code(curve.times[k])), value=float(curve.values[k]) / factor)
            knot.SetNextInterpolation(made[k][0] if k < n - 1 else TS.InterpCurve)
            before, behind = _key_slopes_and_widths(curve, made, k)
            knot.SetPreTanSlope(before[0] * per)
            knot.SetPostTanSlope(behind[0] * per)
            if not hermite:
                knot.SetPreTanWidth(before[1] * units.fps)
                knot.SetPostTanWidth(behind[1] * units.fps)
            if curve.until[k] != curve.values[k]:
                knot.SetPreValue(float(curve.until[k]) / factor)
            found.SetKnot(knot)
    found.SetPreExtrapolation(_spline_extrapolation(curve.before, per))
    found.SetPostExtrapolation(_spline_extrapolation(curve.after, per))
    return found


def _key_slopes_and_widths(curve: Curve, made: list, k: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """(slope [unit/s], width [s]) before and behind key k; those that no piece has are given ones, or 0."""
    given = [curve.how[name][k] if name in curve.how else 0.0 for name in ("arrive", "leave")]
    return (made[k - 1][2] if k else (float(given[0]), 0.0)), (made[k][1] if k < len(made) else (float(given[1]), 0.0))


def _bezier_handles(curve: Curve, k: int):
    """(interpolation, (slope [unit/s], width [s]) behind the earlier key and before the later) of a piece; None if it has
    none."""
    from wsim.scene.curve.easing import BEZIER, HOLD, STRAIGHT
    of = curve.pieces
    code, span = int(of.code[k]), float(of.span[k])
    b, c, d = (float(part[k]) for part in of.part[1:])
    if code == HOLD:
        return TS.InterpHeld, (0.0, 0.0), (0.0, 0.0)
    if code == STRAIGHT and c == 0.0 and d == 0.0 and (curve.kind == "linear" or "linear" in curve.how.get("form", ())):
        return TS.InterpLinear, (0.0, 0.0), (0.0, 0.0)
    if code not in (STRAIGHT, BEZIER):
        return None
    x = of.x[k] if code == BEZIER else np.array([1.0, 2.0]) / 3.0
    ends = []
    for rise, width in ((b, float(x[0]) * span), (b + c + c + d + d + d, float(1.0 - x[1]) * span)):
        if width <= 0.0 and abs(rise) > 0.0:
            return None                                       # a handle that stands upright
        ends.append((rise / (3.0 * width) if width > 0.0 else 0.0, width))
    return TS.InterpCurve, *ends


def _spline_extrapolation(side, per: float):
    modes = {name: mode for mode, name in SIDES.items()}
    found = TS.Extrapolation(modes[side] if isinstance(side, str) else TS.ExtrapSloped)
    if not isinstance(side, str):
        found.slope = float(side) * per
    return found


def author_spline(attribute: Usd.Attribute, curve: Curve, units: StageUnits, factor: float = 1.0) -> bool:
    """Writes a curve of numbers as a spline of its attribute; False where it is none, and nothing is written."""
    kind = {Sdf.ValueTypeNames.Double: "double", Sdf.ValueTypeNames.Float: "float", Sdf.ValueTypeNames.Half: "half"}.get(
        attribute.GetTypeName(), "")
    spline = spline_from_curve(curve, units, factor, kind)
    return spline is not None and bool(attribute.SetSpline(spline))


def replace_samples(attribute: Usd.Attribute, curve: Curve, units: StageUnits) -> bool:
    """Writes a curve of numbers as a spline in the place of its samples, which may have another unit; False, and they stay,
    where it is none, or they are not the curve times a number."""
    if curve.values.ndim != 1 or not curve.values.any():
        return False
    codes = attribute.GetTimeSamples()
    given, found = np.array([float(attribute.Get(code)) for code in codes]), curve.sampled(units.time(np.array(codes)))
    factor = float(given @ found / max(given @ given, 1e-300))
    if not factor or np.abs(factor * given - found).max() > ROUNDED * np.abs(found).max():
        return False
    default = attribute.Get()
    attribute.Clear()
    if default is not None:
        attribute.Set(default)
    if author_spline(attribute, curve, units, factor):
        return True
    for code, value in zip(codes, given.tolist(), strict=True):
        attribute.Set(value, code)
    return False
