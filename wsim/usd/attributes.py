"""Values of attributes in SI units, by the rows of `names`.

USD stores most physics values as float. A float read back is taken at its shortest decimal, so that 0.1 in a file is
0.1 and not 0.10000000149; a value that is no short decimal leaves its double as custom data (`wsim:exact`) beside the
float, which counts as long as the float still is its rounding: who edits the float is not overruled.
"""

import numpy as np
from pxr import Gf, Sdf, Usd, Vt

from wsim.scene import Problem, SceneError
from wsim.usd.names import Row, row
from wsim.usd.stage import Units

SI = Units()
EXACT, TIMES = "wsim:exact", "wsim:times"
_ARRAYS = {"float[]": (Vt.FloatArray, np.float32, ()), "double[]": (Vt.DoubleArray, np.float64, ()),
           "int[]": (Vt.IntArray, np.int32, ()),
           "int3[]": (Vt.Vec3iArray, np.int32, (3,)), "int4[]": (Vt.Vec4iArray, np.int32, (4,)),
           "point3f[]": (Vt.Vec3fArray, np.float32, (3,)), "vector3f[]": (Vt.Vec3fArray, np.float32, (3,))}


def authored(prim: Usd.Prim, owner: str, field: str) -> bool:
    attribute = prim.GetAttribute(row(owner, field).attribute)
    return bool(attribute) and attribute.HasAuthoredValue()


def decimal(value: float) -> float:
    """The shortest decimal that rounds to this float32, as a double."""
    return float(str(np.float32(value)))


def read(prim: Usd.Prim, owner: str, field: str, units: Units = SI, time=None, through=None):
    """SI value of a field on a prim, None if it is not authored.

    time        time code; None: the default value
    through     (forward, inverse) between the field [SI] and what the attribute holds [SI]
    Scalars are Python numbers, arrays NumPy, points of shape (n, 3). An empty array says as little as none: None.
    Raises SceneError if the attribute is of a type that cannot be what the row says.
    """
    entry = row(owner, field)
    attribute = prim.GetAttribute(entry.attribute)
    if not attribute or not attribute.HasAuthoredValue():
        return None
    value = attribute.Get(Usd.TimeCode.Default() if time is None else time)
    if value is None or entry.type.endswith("[]") and hasattr(value, "__len__") and len(value) == 0:
        return None
    try:
        return _si(attribute, value, entry, units, through)
    except (TypeError, ValueError):
        raise SceneError(Problem(str(attribute.GetPath()), f"is of type {attribute.GetTypeName()}; allowed is "
                                 f"{entry.type}: author it again with that type")) from None


def _si(attribute, value, entry: Row, units: Units, through):
    factor = units.factor(entry.unit)
    if entry.type in _ARRAYS:
        _, dtype, shape = _ARRAYS[entry.type]
        doubles = np.issubdtype(dtype, np.floating) and np.asarray(value).dtype == np.float64       # authored as such
        array = np.array(value, np.float64 if doubles else dtype).reshape(-1, *shape)
        return array if factor == 1.0 else array.astype(np.float64) * factor
    if entry.type == "vector3d":
        return tuple(float(v) * factor for v in value)
    if entry.type == "vector3f":
        return tuple(decimal(v) * factor for v in value)
    if entry.type in ("float", "double"):
        return _real(attribute, value, entry, factor, through)
    return {"int": int, "bool": bool, "token": str}[entry.type](value)


def _real(attribute, value, entry: Row, factor: float, through) -> float:
    forward, inverse = through or (float, float)
    if entry.type == "float":
        exact = attribute.GetCustomDataByKey(EXACT)
        if isinstance(exact, float) and np.float32(forward(exact) / factor) == np.float32(value):
            return exact
        value = decimal(value)
    return inverse(float(value) * factor)


def author(prim: Usd.Prim, owner: str, field: str, value, units: Units = SI, through=None) -> Usd.Attribute:
    """Writes the SI value of a field as the default value of its attribute."""
    entry = row(owner, field)
    attribute = attribute_of(prim, entry)
    factor = units.factor(entry.unit)
    if entry.type in _ARRAYS:
        attribute.Set(array(value, entry.type, factor))
    elif entry.type == "vector3d":
        attribute.Set(Gf.Vec3d(*(float(v) / factor for v in value)))
    elif entry.type == "vector3f":
        attribute.Set(Gf.Vec3f(*(float(v) / factor for v in value)))
    elif entry.type in ("float", "double"):
        forward = through[0] if through else float
        attribute.Set(float(forward(value) / factor))
        if entry.type == "float" and _si(attribute, attribute.Get(), entry, units, through) != value:
            attribute.SetCustomDataByKey(EXACT, float(value))
    else:
        attribute.Set(value)
    return attribute


def attribute_of(prim: Usd.Prim, entry: Row) -> Usd.Attribute:
    """The attribute of a row, made if the prim does not have it."""
    found = prim.GetAttribute(entry.attribute)
    if found:
        return found
    kind = Sdf.VariabilityUniform if entry.uniform else Sdf.VariabilityVarying
    return prim.CreateAttribute(entry.attribute, Sdf.ValueTypeNames.Find(entry.type), False, kind)


def array(value, usd_type: str, factor: float = 1.0):
    """NumPy values [SI] as a USD array in stage units."""
    vt, dtype, shape = _ARRAYS[usd_type]
    data = np.asarray(value)
    data = data if factor == 1.0 else data.astype(np.float64) / factor
    data = np.ascontiguousarray(data, dtype).reshape(-1, *shape)
    return vt.FromNumpy(data) if len(data) else vt()


def author_times(attribute: Usd.Attribute, times) -> None:
    """Notes the exact times [s] of a curve's keys beside its samples, whose time codes are rounded."""
    attribute.SetCustomDataByKey(TIMES, Vt.DoubleArray.FromNumpy(np.ascontiguousarray(times, np.float64)))


def read_times(attribute: Usd.Attribute, units: Units) -> np.ndarray | None:
    """The noted times [s], None if there are none or if the samples have been changed since."""
    times = attribute.GetCustomDataByKey(TIMES) if attribute else None
    if times is None:
        return None
    times, codes = np.array(times, np.float64), np.array(attribute.GetTimeSamples(), np.float64)
    if len(codes) == 0:
        return times if len(times) == 1 else None
    nearest = codes[np.abs(codes[None, :] - units.code(times)[:, None]).argmin(axis=1)]
    return times if np.allclose(nearest, units.code(times), rtol=1e-12, atol=1e-9) else None
