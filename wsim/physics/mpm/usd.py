"""Prims with WsimMaterialPointsAPI <-> `MaterialPoints`: closed shapes as those of liquids' sources, or Points with volumes."""

from dataclasses import fields
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from wsim.physics.contact.collider.cloud_usd import author_source_shape, has_source_shape, load_source_shape
from wsim.physics.mpm.objects import MATERIALS, MaterialPoints
from wsim.usd import names
from wsim.usd.attributes import author_attribute as write_value
from wsim.usd.attributes import read_attribute, to_usd_array
from wsim.usd.stage import StageReading, StageUnits
from wsim.usd.transforms import read_placement

OWN = ("cell", "velocity", "spin")


def load(reading: StageReading, prim: Usd.Prim) -> MaterialPoints | None:
    """The body of a prim; None if it is broken (reported)."""
    path, units = str(prim.GetPath()), reading.units
    name = read_attribute(prim, "MaterialPoints", "material", units) or "jelly"
    if name not in MATERIALS:
        reading.fail(path, f"wsim:mpm:material is '{name}'; allowed is one of {', '.join(MATERIALS)}")
        return None
    kind: Any = MATERIALS[name]
    found = {key: read_attribute(prim, "MaterialPoints", key, units) for key in (*OWN, *(f.name for f in fields(kind)))}
    more: dict[str, Any] = {key: found.pop(key) for key in OWN if found[key] is not None}
    more["material"] = kind(**{key: value for key, value in found.items() if key not in OWN and value is not None})
    if prim.IsA(UsdGeom.Points):
        return MaterialPoints(path, **(more | read_points(prim, reading)))
    if not has_source_shape(prim):
        reading.fail(path, f"is a {prim.GetTypeName() or 'prim without a type'} with {names.WSIM_GRAINS}; author it on a "
                     "closed shape, or on Points with wsim:mpm:volumes")
        return None
    shape = load_source_shape(reading, prim)
    return None if shape is None else MaterialPoints(path, shape[0], motion=shape[1], **more)


def read_points(prim: Usd.Prim, reading: StageReading) -> dict[str, Any]:
    """Fields of a body of points, world [SI]."""
    place, points, units = read_placement(reading, prim), UsdGeom.Points(prim), reading.units
    local = np.array(points.GetPointsAttr().Get(reading.start) or np.zeros((0, 3)), np.float64) * units.metres
    rates = points.GetVelocitiesAttr().Get(reading.start)
    found: dict[str, Any] = {"points": place.frame[0][:3, 3] + local @ place.linear[0].T,
                             "volumes": read_attribute(prim, "MaterialPoints", "volumes", units)}
    if rates is not None and len(rates) == len(local):
        found["velocity"] = np.array(rates, np.float64) * units.metres @ place.linear[0].T
    return found


def author(stage: Usd.Stage, thing: MaterialPoints, units: StageUnits) -> None:
    """Writes a body."""
    prim = author_points(stage, thing, units) if thing.points is not None else author_source_shape(stage, thing, units)
    if thing.points is None:                                   # its particles are drawn, not the shape that they began in
        UsdGeom.Imageable(prim).CreatePurposeAttr(UsdGeom.Tokens.guide)
    prim.AddAppliedSchema(names.WSIM_GRAINS)
    name = next(key for key, kind in MATERIALS.items() if type(thing.material) is kind)
    write_value(prim, "MaterialPoints", "material", name, units)
    plain = MATERIALS[name]()
    for f in fields(plain):
        if getattr(thing.material, f.name) != getattr(plain, f.name):
            write_value(prim, "MaterialPoints", f.name, getattr(thing.material, f.name), units)
    for field in OWN:
        value = getattr(thing, field)
        if field == "cell" or np.shape(value) == (3,) and np.any(value):
            write_value(prim, "MaterialPoints", field, value, units)


def author_points(stage: Usd.Stage, thing: MaterialPoints, units: StageUnits) -> Usd.Prim:
    """Defines the prim of a body of points."""
    points = UsdGeom.Points.Define(stage, thing.path)
    volumes = np.atleast_1d(np.asarray(thing.volumes, np.float64))
    points.CreatePointsAttr(to_usd_array(thing.points, "point3f[]", units.metres))
    widths = (6.0 / np.pi * volumes) ** (1.0 / 3.0)
    points.CreateWidthsAttr(to_usd_array(widths, "float[]", units.metres))
    points.SetWidthsInterpolation(UsdGeom.Tokens.constant if len(widths) == 1 else UsdGeom.Tokens.vertex)
    if thing.velocity is not None and thing.velocity.ndim == 2:
        points.CreateVelocitiesAttr(to_usd_array(thing.velocity, "vector3f[]", units.metres))
    write_value(points.GetPrim(), "MaterialPoints", "volumes", volumes, units)
    return points.GetPrim()
