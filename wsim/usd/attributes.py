"""Values of attributes in SI units, by the rows of `names`.

USD stores most physics values as float. A float read back is taken at its shortest decimal, so that 0.1 in a file is
0.1 and not 0.10000000149; a value that is no short decimal leaves its double as custom data (`wsim:exact`) beside the
float, which counts as long as the float still is its rounding: who edits the float is not overruled.
"""

import numpy as np
from pxr import Gf, Sdf, Usd, Vt

from wsim.scene import Problem, SceneError
from wsim.usd.names import AttributeEntry, attribute_entry, schema_fields
from wsim.usd.stage import StageUnits

SI = StageUnits()
EXACT, TIMES = "wsim:exact", "wsim:times"
DEFAULT = Usd.TimeCode.Default()
_SCALARS = {"float": (int, float), "double": (int, float), "int": (int,), "bool": (bool, int), "token": (str,)}
_ARRAYS = {"float[]": (Vt.FloatArray, np.float32, ()), "double[]": (Vt.DoubleArray, np.float64, ()),
           "int[]": (Vt.IntArray, np.int32, ()),
           "int3[]": (Vt.Vec3iArray, np.int32, (3,)), "int4[]": (Vt.Vec4iArray, np.int32, (4,)),
           "point3f[]": (Vt.Vec3fArray, np.float32, (3,)), "vector3f[]": (Vt.Vec3fArray, np.float32, (3,)),
           "normal3f[]": (Vt.Vec3fArray, np.float32, (3,)), "vector3d[]": (Vt.Vec3dArray, np.float64, (3,))}


def is_authored(prim: Usd.Prim, owner: str, field: str) -> bool:
    attribute = prim.GetAttribute(attribute_entry(owner, field).attribute)
    return bool(attribute) and attribute.HasAuthoredValue()


def shortest_decimal(value: float) -> float:
    """The shortest decimal that rounds to this float32, as a double."""
    return float(str(np.float32(value)))


def read_attribute(prim: Usd.Prim, owner: str, field: str, units: StageUnits = SI, time=None, through=None):
    """SI value of a field on a prim, None if it is not authored.

    time        time code; None: the start, where samples count before the default value; DEFAULT: the default value alone
    through     (forward, inverse) between the field [SI] and what the attribute holds [SI]
    Scalars are Python numbers, arrays NumPy, points of shape (n, 3). An empty array says as little as none: None.
    Raises SceneError if the attribute is of a type that cannot be what the row says.
    """
    return read_table_attribute(prim, attribute_entry(owner, field), units, time, through)


def read_table_attribute(prim: Usd.Prim, entry: AttributeEntry, units: StageUnits = SI, time=None, through=None):
    """Value as `read_attribute` has it, of a row that need not be in the table."""
    attribute = prim.GetAttribute(entry.attribute)
    if not attribute or not attribute.HasAuthoredValue():
        return None
    if time is None:
        time = prim.GetStage().GetStartTimeCode() if units is SI else units.start
    value = attribute.Get(time)
    if value is None or entry.type.endswith("[]") and hasattr(value, "__len__") and len(value) == 0:
        return None
    try:
        return _to_si_value(attribute, value, entry, units, through)
    except (TypeError, ValueError):
        raise wrong_type_error(attribute, entry.type) from None


def wrong_type_error(attribute: Usd.Attribute, allowed: str) -> SceneError:
    """The error of an attribute whose value cannot be of the type that is read."""
    return SceneError(Problem(str(attribute.GetPath()), f"is of type {attribute.GetTypeName()}; allowed is {allowed}: author "
                              "it again with that type"))


def read_unlisted_number(attribute: Usd.Attribute, time) -> float:
    """A number of an attribute that no row has [stage units]. Raises SceneError where it is of another type."""
    found = attribute.Get(time)
    if isinstance(found, bool) or not isinstance(found, (int, float)):
        raise wrong_type_error(attribute, "double")
    return float(found)


def _to_si_value(attribute, value, entry: AttributeEntry, units: StageUnits, through):
    factor = units.factor(entry.unit)
    if entry.type == "token[]":
        if not isinstance(value, Vt.TokenArray):
            raise TypeError
        return list(value)
    if entry.type in _ARRAYS:
        return _to_numpy_array(value, *_ARRAYS[entry.type][1:], factor)
    if entry.type in ("vector3d", "vector3f"):
        exact = float if entry.type == "vector3d" else shortest_decimal
        x, y, z = (exact(v) * factor for v in value)
        return x, y, z
    if isinstance(value, bool) and entry.type != "bool" or not isinstance(value, _SCALARS[entry.type]):
        raise TypeError
    if entry.type in ("float", "double"):
        return _restore_double(attribute, value, entry, factor, through)
    return {"int": int, "bool": bool, "token": str}[entry.type](value)


def _to_numpy_array(value, dtype, shape: tuple[int, ...], factor: float) -> np.ndarray:
    """An array attribute as NumPy. Raises TypeError for what is no array of such rows, or of integers where those are meant."""
    found = np.array(value)
    whole = dtype is np.int32
    if found.shape[1:] != shape or found.ndim == 0 or found.dtype.kind not in ("iu" if whole else "fiu"):
        raise TypeError
    if whole and len(found) and (found.min() < -2**31 or found.max() >= 2**31):
        raise TypeError
    if whole or (factor == 1.0 and found.dtype != np.float64):           # doubles, authored or of other units, stay such
        return found.astype(dtype)
    with np.errstate(over="ignore"):                           # what overflows float32 is infinite, and reported as that
        return found.astype(np.float64) * factor


def _restore_double(attribute, value, entry: AttributeEntry, factor: float, through) -> float:
    forward, inverse = through or (float, float)
    if entry.type == "float":
        exact = attribute.GetCustomDataByKey(EXACT)
        if isinstance(exact, float) and np.float32(forward(exact) / factor) == np.float32(value):
            return exact
        value = shortest_decimal(value)
    return inverse(float(value) * factor)


def author_attribute(prim: Usd.Prim, owner: str, field: str, value, units: StageUnits = SI, through=None,
                     time=DEFAULT) -> Usd.Attribute:
    """Writes the SI value of a field as the default value of its attribute, or as a sample at a time code."""
    entry = attribute_entry(owner, field)
    attribute = define_attribute(prim, entry)
    factor = units.factor(entry.unit)
    if entry.type in _ARRAYS:
        attribute.Set(to_usd_array(value, entry.type, factor), time)
    elif entry.type == "vector3d":
        attribute.Set(Gf.Vec3d(*(float(v) / factor for v in value)), time)
    elif entry.type == "vector3f":
        attribute.Set(Gf.Vec3f(*(float(v) / factor for v in value)), time)
    elif entry.type in ("float", "double"):
        forward = through[0] if through else float
        attribute.Set(float(forward(value) / factor), time)
        if entry.type == "float" and time == DEFAULT and _to_si_value(attribute, attribute.Get(), entry, units,
                                                                      through) != value:
            attribute.SetCustomDataByKey(EXACT, float(value))
    else:
        attribute.Set(value, time)
    return attribute


def read_object_fields(prim: Usd.Prim, owner: str, units: StageUnits = SI) -> dict:
    """Values of a class that a prim authors [SI], by field: of rows of the table with an attribute."""
    found = {field: read_attribute(prim, owner, field, units) for field in schema_fields(owner)}
    return {field: value for field, value in found.items() if value is not None}


def author_object_fields(prim: Usd.Prim, thing, units: StageUnits = SI) -> None:
    """Writes the values of an object, as `read_object_fields` reads them."""
    for field in schema_fields(type(thing).__name__):
        author_attribute(prim, type(thing).__name__, field, getattr(thing, field), units)


def define_attribute(prim: Usd.Prim, entry: AttributeEntry) -> Usd.Attribute:
    """The attribute of a row, made if the prim does not have it."""
    found = prim.GetAttribute(entry.attribute)
    if found:
        return found
    kind = Sdf.VariabilityUniform if entry.uniform else Sdf.VariabilityVarying
    return prim.CreateAttribute(entry.attribute, Sdf.ValueTypeNames.Find(entry.type), False, kind)


def to_usd_array(value, usd_type: str, factor: float = 1.0):
    """NumPy values [SI] as a USD array in stage units."""
    vt, dtype, shape = _ARRAYS[usd_type]
    data = np.asarray(value)
    data = data if factor == 1.0 else data.astype(np.float64) / factor
    data = np.ascontiguousarray(data, dtype).reshape(-1, *shape)
    return vt.FromNumpy(data) if len(data) else vt()


def author_times(attribute: Usd.Attribute, times) -> None:
    """Notes the exact times [s] of a curve's keys beside its samples, whose time codes are rounded."""
    attribute.SetCustomDataByKey(TIMES, Vt.DoubleArray.FromNumpy(np.ascontiguousarray(times, np.float64)))


def read_times(attribute: Usd.Attribute, units: StageUnits) -> np.ndarray | None:
    """The noted times [s], None if there are none or if the samples have been changed since."""
    times = attribute.GetCustomDataByKey(TIMES) if attribute else None
    if times is None:
        return None
    times, codes = np.array(times, np.float64), np.array(attribute.GetTimeSamples(), np.float64)
    if len(codes) == 0:
        return times if len(times) == 1 else None
    nearest = codes[np.abs(codes[None, :] - units.code(times)[:, None]).argmin(axis=1)]
    return times if np.allclose(nearest, units.code(times), rtol=1e-12, atol=1e-9) else None
