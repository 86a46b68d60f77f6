"""Values of a stage that no reader expects: of another type than the schema of their attribute has, numbers that are none
(NaN), or negative where that has no meaning.

Readers judge what they read by its bounds; this looks at what they pass over: USD takes a NaN of some attributes as not
authored, and a comparison with one is false, so that it would choose a default without a word. Infinity is left to the
readers: some attributes say by it that there is no limit.
"""

import re
from functools import cache

import numpy as np
from pxr import Sdf, Usd

from wsim.scene import Problem, SceneError
from wsim.usd.stage import StageReading, applied_schemas

PREFIXES = ("physics:", "drive:", "limit:", "wsim:", "primvars:wsim:")
WIDTHS, WEIGHTS = "widths", "primvars:skel:jointWeights"
POSITIVE = (WIDTHS, WEIGHTS)
RESTART = "wsim:restart:"
SCALARS = ("half", "float", "double", "int", "uint", "int64", "uint64", "uchar")
NUMBERS = ("half", "float", "double", "quat", "point3", "vector3", "normal3", "color3", "matrix")


def refuse_types(reading: StageReading) -> None:
    """Raises SceneError with every authored attribute whose type is of another kind than its schema says: numbers of any width
    are one kind, and so are points, vectors and normals, tokens and strings."""
    found = []
    for prim in Usd.PrimRange(reading.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
        if prim.IsPseudoRoot():
            continue
        definition = prim.GetPrimDefinition()
        for name in map(str, prim.GetAuthoredPropertyNames()):
            known = definition.GetAttributeDefinition(name)
            if known and (attribute := prim.GetAttribute(name)):         # whose own type name is that of the schema
                wanted, given = known.GetTypeName(), {spec.typeName for spec in attribute.GetPropertyStack(reading.start)}
                allowed = (_value_kind(wanted), *(("number",) if wanted == Sdf.ValueTypeNames.Bool else ()))
                found += [Problem(str(attribute.GetPath()), f"is of type {each}; allowed is {wanted}: author it again with "
                                  "that type") for each in given if _value_kind(each) not in allowed][:1]
    if found:
        raise SceneError(found)


@cache
def _value_kind(name: Sdf.ValueTypeName) -> str:
    """What values of a type are made of."""
    scalar = str(name.scalarType)
    plain = re.sub("[hfdi]$", "", re.sub("^(point|vector|normal|color|texCoord|half|float|double|int)(?=[234])", "vec", scalar))
    kind = {**dict.fromkeys(SCALARS, "number"), "token": "text", "string": "text"}.get(scalar, plain)
    return kind + "[]" * name.isArray


def refuse_numbers(reading: StageReading, said: set[str]) -> list[Problem]:
    """Errors of what is no number, on prims but those of which something else is `said` already."""
    found = []
    for prim in Usd.PrimRange(reading.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
        if prim.IsPseudoRoot() or str(prim.GetPath()) in said:
            continue
        for name in map(str, prim.GetAuthoredPropertyNames()):
            counts = name.startswith(PREFIXES) and not name.startswith(RESTART) or _allows_any_sign(reading, prim, name)
            if counts and (text := _describe_bad_value(prim.GetAttribute(name), reading)):
                found.append(Problem(str(prim.GetPath()), f"{name}{text}"))
    return found


def _allows_any_sign(reading: StageReading, prim: Usd.Prim, name: str) -> bool:
    """True for widths of what is simulated, and for weights of a mesh that follows a skeleton."""
    if name == WEIGHTS:
        bound = reading.skinned.get(prim.GetPath())
        return bool(bound and bound.followed)
    return name == WIDTHS and any(api.startswith(("Physics", "Wsim")) for api in applied_schemas(prim))


def _describe_bad_value(attribute: Usd.Attribute, reading: StageReading) -> str:
    """What is wrong with a value at the start, what is allowed and the fix; "" if nothing."""
    if not attribute or not str(attribute.GetTypeName()).startswith(NUMBERS):
        return ""
    value = attribute.Get(reading.start)
    if value is None:
        return ""
    found = np.asarray(_plain_numbers(value), np.float64)
    bad = np.isnan(found)
    low = attribute.GetName() in POSITIVE and found < 0.0
    if not bad.any() and not np.any(low):
        return ""
    k = int(np.argmax((bad | low).reshape(len(found), -1).any(axis=1))) if found.ndim else 0
    at = f"[{k}]" if attribute.GetTypeName().isArray else ""
    allowed = "numbers >= 0" if attribute.GetName() in POSITIVE else "numbers"
    shown = value[k] if attribute.GetTypeName().isArray else value
    return f"{at} is {shown}; allowed are {allowed}: author it again, or take it away"


def _plain_numbers(value):
    """Numbers of a value of USD."""
    if hasattr(value, "GetImaginary"):
        return [value.GetReal(), *value.GetImaginary()]
    if isinstance(value, (list, tuple)) or type(value).__name__.startswith("Quat") and hasattr(value, "__len__"):
        return [_plain_numbers(each) for each in value]
    return value
