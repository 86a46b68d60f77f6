"""Scopes with ToyBrakeAPI <-> brakes; their values by the table."""

from pxr import Sdf, Usd

from tests.make.brake.objects import Brake
from wsim.usd.attributes import author_values, read_values
from wsim.usd.load_varying import vary
from wsim.usd.names import row
from wsim.usd.stage import Reading, Units


def load(reading: Reading, prim: Usd.Prim) -> Brake:
    path = str(prim.GetPath())
    vary(reading, path, Brake, [prim.GetAttribute(row("Brake", "grip").attribute)],
         lambda at: read_values(prim, "Brake", at.units))
    return Brake(path, str(prim.GetRelationship("toy:body").GetTargets()[0]), **read_values(prim, "Brake", reading.units))


def author(stage: Usd.Stage, brake: Brake, units: Units) -> None:
    prim = stage.DefinePrim(brake.path, "Scope")
    prim.AddAppliedSchema("ToyBrakeAPI")
    prim.CreateRelationship("toy:body").SetTargets([Sdf.Path(brake.body)])
    author_values(prim, brake, units)
