"""Transforms with ToySparksAPI <-> sparks. Below one: Trace, of as many points as there are sparks."""

from pxr import Sdf, Usd, UsdGeom

from tests.make.rows.sparks.objects import Sparks
from wsim.usd.stage import StageReading, StageUnits

NAMES = ("count", "lit")


def load(reading: StageReading, prim: Usd.Prim) -> Sparks:
    return Sparks(str(prim.GetPath()), **{name: int(prim.GetAttribute(f"toy:{name}").Get()) for name in NAMES})


def author(stage: Usd.Stage, sparks: Sparks, units: StageUnits) -> None:
    prim = UsdGeom.Xform.Define(stage, sparks.path).GetPrim()
    prim.AddAppliedSchema("ToySparksAPI")
    for name in NAMES:
        prim.CreateAttribute(f"toy:{name}", Sdf.ValueTypeNames.Int).Set(getattr(sparks, name))
    UsdGeom.Points.Define(stage, f"{sparks.path}/Trace").CreatePointsAttr([(0.0, 0.0, 0.0)] * sparks.count)
