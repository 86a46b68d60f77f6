"""Attributes that are sampled in time: those of values that may change while a scene runs become curves (`wsim.scene.Varying`),
the others have their value at startTimeCode, which is said. Faces, tets and curves may not change.

A curve has a key at each sample. What follows from one spline by a factor is that spline; what follows otherwise from splines
has a key at each frame and at its middle, whose value the frame has. What follows from several attributes (the stretch of a
sheet from its Young's modulus) is worked out at each key.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from pxr import Usd

from wsim.scene import Scene, Varying
from wsim.scene.curve import Curve
from wsim.scene.values.table import VALUES, varying_value_names
from wsim.usd.stage import StageReading
from wsim.usd.transforms.splines import curve_from_spline

ROUNDED = 1e-6                     # of a value, how far a float is from its spline
OWN = ("physics:", "wsim:")        # namespaces whose samples are looked at
# sampled by nature, read elsewhere
CURVES = ("wsim:reaction", "wsim:fluid:strength", "wsim:liquid:strength",
          *(row.usd.attribute for row in VALUES if row.form == "curve" and row.usd))


def check_topology(reading: StageReading, prim: Usd.Prim, *names: str) -> bool:
    """True if attributes that say what is joined to what are the same at all times; one that is not is an error."""
    for name in names:
        attribute = prim.GetAttribute(name)
        codes = attribute.GetTimeSamples() if attribute else []
        for code in codes[1:]:
            if attribute.Get(code) != attribute.Get(codes[0]):
                reading.fail(prim.GetPath(), f"{name} is sampled in time and changes at time code {code:g}; what is joined to "
                             "what must stay while a scene runs: author one value, without samples")
                return False
    return True


def is_time_varying(attribute: Usd.Attribute) -> bool:
    """True if a value may differ from time to time."""
    return bool(attribute) and attribute.HasAuthoredValue() and attribute.ValueMightBeTimeVarying()


def value_attributes_of_prim(prim: Usd.Prim | None) -> list[Usd.Attribute]:
    """Attributes that wsim reads of a prim that says nothing but values: a material, a PhysicsScene."""
    return [] if prim is None else [a for a in prim.GetAuthoredAttributes() if a.GetName().startswith(OWN)]


def note_varying_values(reading: StageReading, path: str, kind: type, attributes: list[Usd.Attribute],
                        values: Callable[[StageReading], dict]) -> None:
    """Notes what differs in time of the values {name: value} [SI] of the object at `path`, of a class
    of the table of values.

    attributes    from which they follow
    values        reads them, at the start of the Reading that it is given
    """
    moving = [a for a in attributes if is_time_varying(a)]
    reading.followed |= {a.GetPath() for a in moving}
    if not moving:
        return
    codes = {code for a in moving for code in a.GetTimeSamples()}
    if any(a.HasSpline() for a in moving):
        codes |= set((reading.units.start + 0.5 * np.arange(2 * reading.frames + 1)).tolist())
    keys = sorted(codes)
    found = [values(replace(reading, units=replace(reading.units, start=code))) for code in keys]
    where = ", ".join(str(a.GetPath()) for a in moving)
    for name in found[0]:
        column = [np.asarray(at[name]) for at in found]
        if all(np.array_equal(v, column[0]) for v in column):
            continue
        if any(v.shape != column[0].shape for v in column):
            reading.fail(moving[0].GetPath(), f"{name} has {column[0].size} values at one time and another number at another; "
                         "give it as many at each")
        elif name in varying_value_names(kind.__name__):
            curve = _find_shared_spline(reading, moving, np.array(keys), np.array(column)) or Curve(
                reading.units.time(np.array(keys)), np.array(column))
            reading.varying.append((where, Varying(path, name, curve)))
        else:
            warn_samples_ignored(reading, where, f"{name} is fixed while a scene runs")


def _find_shared_spline(reading: StageReading, moving: list[Usd.Attribute], keys: np.ndarray,
                        column: np.ndarray) -> Curve | None:
    """The one spline that these values (keys,) are times a number, or each component (keys, n) times one and shifted; None if
    there is none."""
    if len(moving) != 1 or not moving[0].HasSpline() or column.ndim > 2:
        return None
    try:
        own = curve_from_spline(moving[0].GetSpline(), reading.units)
    except ValueError as why:
        reading.warn(moving[0].GetPath(), f"{why}: it is evaluated at frames")
        return None
    found = own.sampled(reading.units.time(keys))
    if column.ndim == 2:
        return _fit_shared_spline(own, found, column)
    factor = float(found @ column / max(found @ found, 1e-300))
    return own.scaled(factor) if np.abs(factor * found - column).max() <= ROUNDED * np.abs(column).max() else None


def _fit_shared_spline(own: Curve, found: np.ndarray, column: np.ndarray) -> Curve | None:
    """The spline as one of values (n,): c + f own, by what it has and they have (keys, n) at some times."""
    around = found - found.mean()
    f = around @ column / max(around @ around, 1e-300)
    c = column.mean(axis=0) - f * found.mean()
    if np.abs(c + np.outer(found, f) - column).max() > ROUNDED * np.abs(column).max():
        return None
    how = {name: np.outer(v, f) + (c if name == "until" else 0.0) if name in ("leave", "arrive", "until") else v
           for name, v in own.how.items()}
    sides = [side if isinstance(side, str) else side * f for side in (own.before, own.after)]
    return Curve(own.times, c + np.outer(own.values, f), own.kind, *sides, **how)


def warn_samples_ignored(reading: StageReading, where, reason: str) -> None:
    """Warns that of samples the one at the start counts."""
    reading.warn(where, f"is sampled in time, and {reason}: its value at startTimeCode counts; author one value, without "
                 "samples")


def attach_varying(reading: StageReading, scene: Scene) -> None:
    """Gives the scene what varies; what cannot, and samples that nobody has followed, are noted."""
    for where, thing in reading.varying:
        from wsim.scene.check.varying import fixed_value_reason
        if reason := fixed_value_reason(thing.path, thing.name, scene):
            warn_samples_ignored(reading, where, f"{thing.name} of {thing.path} cannot follow ({reason})")
        else:
            scene.varying.append(thing)
    for path in reading.sampled:
        if path not in reading.followed:
            warn_samples_ignored(reading, path, "it is fixed while a scene runs")
