"""Prims with WsimMaterialPointsAPI <-> `MaterialPoints`: closed shapes as those of liquids' sources, or Points with volumes.
A GeomSubset of points has another material where WsimMaterialPointsAPI is applied to it too, or to the physics material that is
bound to it. Points of Newton and of PhysX are read as well: newton.py, physx.py."""

from dataclasses import fields
from math import inf
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdShade

from wsim.physics.contact.collider.cloud_usd import author_source_shape, has_source_shape, load_source_shape
from wsim.physics.mpm.objects import MATERIALS, MaterialPoints, MaterialSink, Pour
from wsim.physics.mpm.usd.points import (
    author_display_colors,
    author_point_places,
    author_subset,
    read_display_colors,
    read_material_subsets,
    read_point_places,
)
from wsim.physics.particles.usd.bindings import bound_physics_material
from wsim.usd import names
from wsim.usd.attributes import author_attribute as write_value
from wsim.usd.attributes import read_attribute
from wsim.usd.prims.pins import author_pin
from wsim.usd.stage import StageReading, StageUnits, applied_schemas

OWN, POURS = ("cell", "velocity", "spin", "drag", "integrator"), ("pour_start", "pour_end", "pour_rate")


def load(reading: StageReading, prim: Usd.Prim) -> MaterialPoints | MaterialSink | None:
    """The body of a prim; None if it is broken (reported), or only says what a body is of."""
    if prim.IsA(UsdGeom.Subset) or prim.IsA(UsdShade.Material):
        return None
    apis = applied_schemas(prim)
    if names.WSIM_DRAIN in apis:
        return _load_sink(reading, prim)
    if names.WSIM_GRAINS in apis:
        return _load_own(reading, prim)
    if names.NEWTON_POINTS in apis:
        from wsim.physics.mpm.usd.newton import load_newton_points
        return load_newton_points(reading, prim)
    from wsim.physics.mpm.usd.physx import load_particle_set
    return load_particle_set(reading, prim)


def _load_own(reading: StageReading, prim: Usd.Prim) -> MaterialPoints | None:
    path, units = str(prim.GetPath()), reading.units
    more: dict[str, Any] = {key: value for key in OWN
                            if (value := read_attribute(prim, "MaterialPoints", key, units)) is not None}
    if pour := _read_pour(prim, units):
        more["pour"] = pour
    if prim.IsA(UsdGeom.Points) and not pour:
        found = more | read_point_places(reading, prim)
        found["volumes"] = read_attribute(prim, "MaterialPoints", "volumes", units)
        chosen = read_material_subsets(reading, prim, len(found["points"]), lambda of: _material_of(reading, of))
        return MaterialPoints(path, **found, **chosen) if chosen else None
    material = read_own_material(reading, prim)
    if not has_source_shape(prim):
        reading.fail(path, f"is a {prim.GetTypeName() or 'prim without a type'} with {names.WSIM_GRAINS}; author it on a "
                     "closed shape, or on Points with wsim:mpm:volumes")
        return None
    shape, colors = load_source_shape(reading, prim), read_display_colors(reading, prim, 1)
    if shape is None or material is None:
        return None
    return MaterialPoints(path, shape[0], motion=shape[1], material=material, colors=colors, **more)


def _load_sink(reading: StageReading, prim: Usd.Prim) -> MaterialSink | None:
    if prim.IsA(UsdGeom.Points) or not has_source_shape(prim):
        kind = prim.GetTypeName() or "prim without a type"
        reading.fail(prim.GetPath(), f"is a {kind} with {names.WSIM_DRAIN}; author it on a Plane, a closed shape or Mesh")
        return None
    shape = load_source_shape(reading, prim)
    return None if shape is None else MaterialSink(str(prim.GetPath()), shape[0], shape[1])


def _read_pour(prim: Usd.Prim, units: StageUnits) -> Pour | None:
    """When and how much a prim pours; None: it does not."""
    start, end, rate = (read_attribute(prim, "MaterialPoints", name, units) for name in POURS)
    if start is None and end is None and rate is None:
        return None
    return Pour(0.0 if start is None else units.time(start), inf if end is None else units.time(end), rate)


def _material_of(reading: StageReading, prim: Usd.Prim) -> Any:
    """The material that a prim or a subset says, itself or by what is bound to it; None: none, or it is broken (reported)."""
    if names.WSIM_GRAINS in applied_schemas(prim):
        return read_own_material(reading, prim)
    bound = bound_physics_material(prim, own=True)
    if bound is None:
        return None
    if names.WSIM_GRAINS in applied_schemas(bound):
        return read_own_material(reading, bound)
    if names.NEWTON_MATERIAL in applied_schemas(bound):
        from wsim.physics.mpm.usd.newton import read_newton_material
        return read_newton_material(reading, bound)
    reading.fail(prim.GetPath(), f"its material {bound.GetPath()} has no {names.WSIM_GRAINS}; apply that to it")
    return None


def read_own_material(reading: StageReading, prim: Usd.Prim) -> Any:
    """The material that attributes wsim:mpm: say; None if they name none that there is (reported)."""
    units = reading.units
    name = read_attribute(prim, "MaterialPoints", "material", units) or "jelly"
    if name not in MATERIALS:
        reading.fail(prim.GetPath(), f"wsim:mpm:material is '{name}'; allowed is one of {', '.join(MATERIALS)}; author one of "
                     "these")
        return None
    kind: Any = MATERIALS[name]
    values = {f.name: read_attribute(prim, "MaterialPoints", f.name, units) for f in fields(kind)}
    return kind(**{key: value for key, value in values.items() if value is not None})


def author(stage: Usd.Stage, thing: MaterialPoints | MaterialSink, units: StageUnits) -> None:
    """Writes a body or a sink."""
    if isinstance(thing, MaterialSink):
        prim = author_source_shape(stage, thing, units)
        UsdGeom.Imageable(prim).CreatePurposeAttr(UsdGeom.Tokens.guide)
        prim.AddAppliedSchema(names.WSIM_DRAIN)
        return
    if thing.points is None:
        prim = author_source_shape(stage, thing, units)
        UsdGeom.Imageable(prim).CreatePurposeAttr(UsdGeom.Tokens.guide)       # its particles are drawn, not the shape
    else:
        prim = author_point_places(stage, thing, units)
        write_value(prim, "MaterialPoints", "volumes", np.atleast_1d(np.asarray(thing.volumes)), units)
    author_own_material(prim, thing.material, units)
    for k, material in enumerate(thing.further, 1):
        author_own_material(author_subset(prim, f"part_{k}", np.flatnonzero(thing.which == k)), material, units)
    if thing.colors is not None:
        author_display_colors(prim, thing.colors)
    if thing.pour:
        times = units.code(thing.pour.start), units.code(thing.pour.end)
        for name, value in zip(POURS, (*times, thing.pour.rate), strict=True):
            if value not in (None, inf):
                write_value(prim, "MaterialPoints", name, value, units)
    for field in OWN:
        value = getattr(thing, field)
        if field == "cell" or (value != "auto" if field == "integrator" else np.ndim(value) < 2 and np.any(value)):
            write_value(prim, "MaterialPoints", field, value, units)
    for pin in thing.pins:
        author_pin(stage, pin, thing, units, 0)


def author_own_material(prim: Usd.Prim, material: Any, units: StageUnits) -> None:
    """Writes a material on a prim, a subset or a material."""
    prim.AddAppliedSchema(names.WSIM_GRAINS)
    name = next(key for key, kind in MATERIALS.items() if type(material) is kind)
    write_value(prim, "MaterialPoints", "material", name, units)
    plain = MATERIALS[name]()
    for f in fields(plain):
        if getattr(material, f.name) != getattr(plain, f.name):
            write_value(prim, "MaterialPoints", f.name, getattr(material, f.name), units)
