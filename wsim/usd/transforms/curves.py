"""Values of attributes over time <-> `wsim.scene.curve.Curve`.

    USD                                             read as
    a spline (numbers)                              the same, exactly
    samples with a noted kind (custom data)         keys at the noted times, of that kind, while all samples agree with it
    samples                                         keys, linear between them

Written likewise: numbers as splines where they are some, all else as samples at the keys and, of kinds other than linear, at
the frames between them, for those who read nothing else.
"""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
from pxr import Usd

from wsim.scene.curve import Curve
from wsim.usd.attributes import DEFAULT, author_times, read_times
from wsim.usd.stage import StageUnits
from wsim.usd.transforms.splines import author_spline, curve_from_spline, has_spline

KIND = "wsim:curve"                # custom data: a JSON object, kind, before, after and what the kind takes
AGREES = 1e-6                      # of the largest value, how far samples may lie from what is noted: floats are rounded


def read_curve(attribute: Usd.Attribute, units: StageUnits, value: Callable[[float | None], Any], factor: float = 1.0) -> Curve:
    """The curve of an attribute. value: reads it in SI units at a time code, or without one; factor: SI of one unit of a
    spline's values."""
    if has_spline(attribute):
        return curve_from_spline(attribute.GetSpline(), units, factor)
    codes, noted = attribute.GetTimeSamples(), read_times(attribute, units)
    if noted is not None and (how := read_kind(attribute)):
        keys = np.array([value(code) for code in nearest_time_codes(codes, units.code(noted))])
        try:
            curve = Curve(noted, keys, **how)
        except (TypeError, ValueError):
            curve = None
        if curve is not None and samples_match_curve(curve, units, {code: value(code) for code in codes}):
            return curve
    values = np.array([value(code) for code in codes or [None]])
    times = units.time(np.array(codes)) if codes else np.zeros(1)
    return Curve(times if noted is None or len(noted) != len(values) else noted, values)


def nearest_time_codes(codes: list[float], wanted: np.ndarray) -> list[float]:
    """The sampled time codes that are nearest to some."""
    found = np.array(codes)
    return found[np.abs(found[None, :] - wanted[:, None]).argmin(axis=1)].tolist()


def samples_match_curve(curve: Curve, units: StageUnits, samples: dict) -> bool:
    """True if samples, by time code, are those of the curve."""
    found = curve.sampled(units.time(np.array(list(samples))))
    given = np.array(list(samples.values()), np.float64)
    return found.shape == given.shape and bool(np.abs(found - given).max() <= AGREES * max(1e-30, np.abs(given).max()))


def author_curve(attribute: Usd.Attribute, curve: Curve, units: StageUnits, write: Callable[[Any, Usd.TimeCode], Any],
                 factor: float = 1.0) -> None:
    """Writes a curve. write: puts a value in SI units at a time code, or as default value."""
    if not curve.plain and author_spline(attribute, curve, units, factor):
        return
    for time in curve_sample_times(curve, units).tolist():
        write(curve.at(time), Usd.TimeCode(units.code(time)) if curve.moves else DEFAULT)
    if curve.moves or curve.times[0] != 0.0:
        author_times(attribute, curve.times)
    if not curve.plain:
        note_kind(attribute, curve)


def curve_sample_times(curve: Curve, units: StageUnits) -> np.ndarray:
    """Times [s] of the keys and, of what is not linear, of the frames between them that are no key."""
    if curve.plain:
        return curve.times
    keys = units.code(curve.times)
    codes = np.arange(np.ceil(keys[0]), keys[-1])
    codes = codes[np.abs(codes[:, None] - keys).min(axis=1) > 1e-6]
    return np.sort(np.concatenate([curve.times, units.time(codes)]))


def note_kind(attribute: Usd.Attribute, curve: Curve) -> None:
    """Notes the kind of a curve beside its samples."""
    how = {"kind": curve.kind, "before": curve.before, "after": curve.after, **curve.how}
    attribute.SetCustomDataByKey(KIND, json.dumps({name: v.tolist() if isinstance(v, np.ndarray) else v
                                                   for name, v in how.items()}))


def read_kind(attribute: Usd.Attribute) -> dict:
    """Kind that `note_kind` noted; nothing where it is no such thing."""
    said = attribute.GetCustomDataByKey(KIND)
    try:
        found = json.loads(said) if isinstance(said, str) else {}
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
