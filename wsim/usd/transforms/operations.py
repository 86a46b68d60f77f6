"""Warnings about transform operations (xformOps) without effect: an op that is authored but not in xformOpOrder, or named there
but not authored. Also errors on quaternions that are not unit. USD reports neither.
"""

from pxr import Usd, UsdGeom

from wsim.usd.stage import StageReading

INVERSE, RESET, OP, ORDER = "!invert!", "!resetXformStack!", "xformOp:", "xformOpOrder"
UNIT = 1e-2                 # departure of |q| from 1 that quath keeps, tenfold


def check_xform_ops(reading: StageReading, prim: Usd.Prim) -> None:
    """Reports ops without effect and quaternions that are not unit, once for each prim."""
    if prim.GetPath() in reading.placed:
        return
    reading.placed.add(prim.GetPath())
    path, order = prim.GetPath(), [str(name) for name in UsdGeom.Xformable(prim).GetXformOpOrderAttr().Get() or ()]
    named = {name.removeprefix(INVERSE) for name in order} - {RESET}
    has = {name for name in map(str, prim.GetAuthoredPropertyNames()) if name.startswith(OP)}
    for name in sorted(has - named):
        reading.warn(path, f"{name} is not in {ORDER}, and does nothing; add it there, or remove it")
    for name in sorted(n for n in named if not prim.HasAttribute(n)):
        reading.warn(path, f"{ORDER} names {name}, which is not authored, and does nothing; author it, or remove its name")
    for op in UsdGeom.Xformable(prim).GetOrderedXformOps():
        if op.GetOpType() == UsdGeom.XformOp.TypeOrient:
            _check_unit_quaternions(reading, op)


def _check_unit_quaternions(reading: StageReading, op: UsdGeom.XformOp) -> None:
    for code in (reading.units.start, *op.GetTimeSamples()):
        q = op.Get(code)
        if q is not None and not abs(q.GetLength() - 1.0) < UNIT:
            at = "" if code == reading.units.start else f" at time code {code:g}"
            path = op.GetAttr().GetPrim().GetPath()
            reading.fail(path, f"{op.GetName()} is a quaternion of length {q.GetLength():g}{at}, which USD turns into a "
                         "wrong rotation; allowed: a unit quaternion; fix: divide it by its length")
            return
