"""Scopes with ToyBrakeAPI <-> brakes; their values by the table."""

from pxr import Sdf, Usd

from tests.make.rows.brake.objects import Brake
from wsim.usd.attributes import author_object_fields, read_object_fields
from wsim.usd.load_varying import note_varying_values
from wsim.usd.names import attribute_entry
from wsim.usd.stage import StageReading, StageUnits


def load(reading: StageReading, prim: Usd.Prim) -> Brake:
    path = str(prim.GetPath())
    note_varying_values(reading, path, Brake, [prim.GetAttribute(attribute_entry("Brake", "grip").attribute)],
                        lambda at: read_object_fields(prim, "Brake", at.units))
    return Brake(path, str(prim.GetRelationship("toy:body").GetTargets()[0]),
                 **read_object_fields(prim, "Brake", reading.units))


def author(stage: Usd.Stage, brake: Brake, units: StageUnits) -> None:
    prim = stage.DefinePrim(brake.path, "Scope")
    prim.AddAppliedSchema("ToyBrakeAPI")
    prim.CreateRelationship("toy:body").SetTargets([Sdf.Path(brake.body)])
    author_object_fields(prim, brake, units)
