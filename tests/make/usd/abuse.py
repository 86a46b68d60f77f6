"""What tests/usd/test_abuse.py shares with other tests: refusals."""

import numpy as np
from pxr import Usd

from wsim.scene import SceneError
from wsim.usd.load import read_stage

NAN = float("nan")
SCALARS = {"float": (NAN, float("inf"), -1.0, 0.0, 1e30), "double": (NAN, float("inf"), -1.0, 0.0, 1e30),
           "int": (-1, 0, 2**31 - 1), "token": ("", "nonsense")}


def spoilt(attribute: Usd.Attribute) -> list:
    """Values of the attribute's type that make no sense."""
    kind, value = str(attribute.GetTypeName()), attribute.Get(Usd.TimeCode.EarliestTime())
    if kind in SCALARS:
        return list(SCALARS[kind])
    if kind == "matrix4d":
        return [value * 0.0, value * NAN]
    if not kind.endswith("[]") or value is None:
        return []
    found = [type(value)(), type(value)(list(value)[:-1]), type(value)(list(value) * 2)]
    data = np.array(value)
    for bad in {"f": (NAN, np.inf, -1.0, 0.0), "i": (-1, 10**6)}.get(data.dtype.kind, ()):
        other = data.copy()
        other[len(other) // 2] = bad
        found.append(type(value).FromNumpy(other))
    return found


def refusals(path) -> tuple[int, int]:
    """Spoilt values of a stage's attributes that are refused, each for reasons with a path, and those that were tried: of prims
    of one type and schemas, which the same code reads, each attribute once."""
    stage = Usd.Stage.Open(str(path))
    stage.SetEditTarget(stage.GetSessionLayer())
    refused = tried = 0
    kinds = {(str(prim.GetTypeName()), *prim.GetAppliedSchemas(), a.GetName()): a for prim in stage.Traverse()
             for a in prim.GetAuthoredAttributes()}
    for attribute in kinds.values():
        for value in spoilt(attribute):
            stage.GetSessionLayer().Clear()
            attribute.Set(value)
            tried += 1
            try:
                read_stage(stage)
            except SceneError as error:
                refused += 1
                assert all(problem.path and problem.text for problem in error.problems)
    return refused, tried
