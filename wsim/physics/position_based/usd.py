"""Prims with WsimParticlesAPI <-> `Particles`: Points, whose widths are diameters."""

from dataclasses import fields
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from wsim.physics.position_based.objects import MATERIALS, Particles
from wsim.usd import names
from wsim.usd.attributes import author_attribute as write_value
from wsim.usd.attributes import read_attribute, to_usd_array
from wsim.usd.stage import StageReading, StageUnits
from wsim.usd.transforms import author_motion, read_placement


def load(reading: StageReading, prim: Usd.Prim) -> Particles | None:
    """The particles of a prim; None if it is broken (reported)."""
    path, units = str(prim.GetPath()), reading.units
    material = _read_material(reading, prim)
    radius = read_attribute(prim, "Particles", "radius", units)
    if material is None:
        return None
    if not prim.IsA(UsdGeom.Points):
        kind = prim.GetTypeName() or "prim without type"
        reading.fail(path, f"is a {kind} with {names.WSIM_PARTICLES}; author it on Points: scene.particles fills a shape")
        return None
    return _load_points(reading, prim, material, radius)


def _load_points(reading: StageReading, prim: Usd.Prim, material: Any, radius: float | None) -> Particles | None:
    path, units = str(prim.GetPath()), reading.units
    points, velocities, widths = (
        read_attribute(prim, "Particles", name, units, reading.start) for name in ("points", "velocities", "widths"))
    n = 0 if points is None else len(points)
    for name, found in (("velocities", velocities), ("widths", widths)):
        if found is not None and len(found) not in ((n,) if name == "velocities" else (1, n)):
            reading.fail(path, f"has {len(found)} {name} and {n} points; author {n}" + " or one" * (name == "widths"))
            return None
    if widths is None and radius is None:
        reading.fail(path, "has neither widths nor wsim:particles:radius; author the diameters of its particles as widths")
        return None
    reach = radius if widths is None else 0.5 * widths
    return Particles(path, np.zeros((0, 3), np.float32) if points is None else points, reach, material,
                     read_placement(reading, prim).motion, velocities, _read_colors(reading, prim, n))


def _read_colors(reading: StageReading, prim: Usd.Prim, count: int) -> np.ndarray | None:
    """Linear displayColor of the particles, (3,) or (count, 3); None where there is none."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor")
    values = np.array((primvar.ComputeFlattened(reading.start) if primvar and primvar.HasValue() else None) or [], np.float64)
    return None if len(values) == 0 else values if len(values) == count > 1 else values.mean(axis=0)


def _read_material(reading: StageReading, prim: Usd.Prim) -> Any:
    """The material that attributes wsim:particles: say; None if they name none that there is (reported)."""
    name = read_attribute(prim, "Particles", "material", reading.units) or "grains"
    if name not in MATERIALS:
        reading.fail(prim.GetPath(), f"wsim:particles:material is '{name}'; allowed is one of {', '.join(MATERIALS)}; author "
                     "one of these")
        return None
    kind: Any = MATERIALS[name]
    values = {f.name: read_attribute(prim, "Particles", f.name, reading.units) for f in fields(kind)}
    return kind(**{key: value for key, value in values.items() if value is not None})


def author(stage: Usd.Stage, thing: Particles, units: StageUnits, frames: int = 0) -> None:
    """Writes particles as Points."""
    points = UsdGeom.Points.Define(stage, thing.path)
    prim = points.GetPrim()
    prim.AddAppliedSchema(names.WSIM_PARTICLES)
    write_value(prim, "Particles", "points", thing.points, units)
    points.CreateWidthsAttr(to_usd_array(2.0 * thing.radius, "float[]", units.metres))
    points.SetWidthsInterpolation(UsdGeom.Tokens.constant if len(thing.radius) == 1 else UsdGeom.Tokens.vertex)
    points.CreateExtentAttr(UsdGeom.Points.ComputeExtent(points.GetPointsAttr().Get(), points.GetWidthsAttr().Get()))
    if thing.velocities is not None:
        write_value(prim, "Particles", "velocities", thing.velocities, units)
    if thing.colors is not None:
        kind = UsdGeom.Tokens.constant if np.ndim(thing.colors) == 1 else UsdGeom.Tokens.vertex
        UsdGeom.PrimvarsAPI(prim).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, kind).Set(
            Vt.Vec3fArray.FromNumpy(np.asarray(thing.colors, np.float32).reshape(-1, 3)))
    author_motion(prim, thing.motion, units, frames)
    name = next(key for key, kind in MATERIALS.items() if type(thing.material) is kind)
    write_value(prim, "Particles", "material", name, units)
    plain = MATERIALS[name]()
    for f in fields(plain):
        if getattr(thing.material, f.name) != getattr(plain, f.name):
            write_value(prim, "Particles", f.name, getattr(thing.material, f.name), units)
