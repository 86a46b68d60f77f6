"""Transforms with ToyWheelAPI <-> wheels."""

from pxr import Sdf, Usd, UsdGeom

from tests.make.rows.wheels.objects import Wheel
from wsim.usd.stage import StageReading, StageUnits

NAMES = ("angle", "rate", "drag")


def load(reading: StageReading, prim: Usd.Prim) -> Wheel:
    values = {name: prim.GetAttribute(f"toy:{name}").Get() for name in NAMES}
    return Wheel(str(prim.GetPath()), **{name: float(v) for name, v in values.items() if v is not None})


def author(stage: Usd.Stage, wheel: Wheel, units: StageUnits) -> None:
    prim = UsdGeom.Xform.Define(stage, wheel.path).GetPrim()
    prim.AddAppliedSchema("ToyWheelAPI")
    for name in NAMES:
        prim.CreateAttribute(f"toy:{name}", Sdf.ValueTypeNames.Double).Set(float(getattr(wheel, name)))
