"""Prims with WsimParticlesAPI <-> `Particles`: Points, whose widths are diameters, or closed shapes and meshes that are filled,
or that pour. What PhysX says of Points is a hint (physx.py)."""

from dataclasses import fields
from math import inf
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from wsim.physics.contact.collider.cloud_usd import author_source_shape, has_source_shape, load_source_shape
from wsim.physics.particles.pouring import Pour
from wsim.physics.position_based.filling import fill_with_particles
from wsim.physics.position_based.objects import MATERIALS, Particles
from wsim.physics.position_based.usd.physx import PhysxHints, read_physx_hints
from wsim.scene import Plane, SceneError
from wsim.scene.values.table import FRICTION
from wsim.usd import names
from wsim.usd.attributes import author_attribute as write_value
from wsim.usd.attributes import read_attribute, to_usd_array
from wsim.usd.prims.fabric import bound_physics_material
from wsim.usd.stage import StageReading, StageUnits, applied_schemas
from wsim.usd.transforms import author_motion, read_placement

POURS = ("pour_start", "pour_end", "pour_rate")
OTHERS = (names.RIGID_BODY, names.WSIM_GRAINS, names.WSIM_DRAIN, names.SURFACE_SIM, names.VOLUME_SIM, names.WSIM_SHAPES)
SHAPES = "Points, a closed Mesh, a Cube, Sphere, Capsule, Cylinder or Cone"
UNLIKE = 1e-3              # of a radius by which widths and a rest offset, or a scale and 1, may differ unsaid


def within(reading: StageReading, prim: Usd.Prim) -> list:
    """Paths of prims that are no colliders of the scene: its own, since particles meet everything anyway."""
    return [prim.GetPath()]


def load(reading: StageReading, prim: Usd.Prim) -> Particles | None:
    """The particles of a prim; None if it is broken, or left out (reported)."""
    beside = [api for api in OTHERS if api in applied_schemas(prim)]
    if beside:
        reading.fail(prim.GetPath(), f"has {names.WSIM_PARTICLES} and {beside[0]}; allowed is one of them: take the other away")
        return None
    named = read_attribute(prim, "Particles", "material", reading.units)
    hints = read_physx_hints(reading, prim, None if named is None else named == "fluid")
    if hints.left_out:
        return None
    material = _read_material(reading, prim, named or ("fluid" if hints.fluid else "grains"), hints)
    if material is None:
        return None
    pour = _read_pour(prim, reading.units)
    if prim.IsA(UsdGeom.Points) and not pour:
        return _load_points(reading, prim, material, hints)
    return _load_shape(reading, prim, material, pour)


def _load_shape(reading: StageReading, prim: Usd.Prim, material: Any, pour: Pour | None) -> Particles | None:
    """A shape that is full of particles, or that pours."""
    path, units = str(prim.GetPath()), reading.units
    radius = read_attribute(prim, "Particles", "radius", units)
    if not has_source_shape(prim):
        kind = prim.GetTypeName() or "prim without type"
        reading.fail(path, f"is a {kind} with {names.WSIM_PARTICLES}; author it on {SHAPES}")
        return None
    if radius is None or not 0.0 < radius < inf:
        found = "has no wsim:particles:radius" if radius is None else f"wsim:particles:radius is {radius / units.metres:g}"
        reading.fail(path, f"{found}; allowed is a finite length > 0, with which its shape is filled; author one")
        return None
    shape = load_source_shape(reading, prim)
    if shape is None:
        return None
    if isinstance(shape[0], Plane):
        reading.fail(path, f"a Plane has no end to fill; author {names.WSIM_PARTICLES} on {SHAPES}")
        return None
    velocity = read_attribute(prim, "Particles", "velocity", units)
    try:
        points = np.zeros((0, 3)) if pour else fill_with_particles(path, shape[0], radius, material)
    except SceneError as error:
        reading.problems += error.problems
        return None
    return Particles(path, points, radius, material, shape[1], None, _read_colors(reading, prim, 1), shape[0],
                     velocity if pour or velocity is not None and np.any(velocity) else None, pour)


def _read_pour(prim: Usd.Prim, units: StageUnits) -> Pour | None:
    """When and how much a prim pours; None: it does not."""
    start, end, rate = (read_attribute(prim, "Particles", name, units) for name in POURS)
    if start is None and end is None and rate is None:
        return None
    return Pour(0.0 if start is None else units.time(start), inf if end is None else units.time(end), rate)


def _load_points(reading: StageReading, prim: Usd.Prim, material: Any, hints: PhysxHints) -> Particles | None:
    path, units = str(prim.GetPath()), reading.units
    points, velocities, widths, radius, velocity = (
        read_attribute(prim, "Particles", name, units, *[reading.start] * (name in ("points", "velocities", "widths")))
        for name in ("points", "velocities", "widths", "radius", "velocity"))
    n = 0 if points is None else len(points)
    for name, found in (("velocities", velocities), ("widths", widths)):
        if found is not None and len(found) not in ((n,) if name == "velocities" else (1, n)):
            reading.fail(path, f"has {len(found)} {name} and {n} points; author {n}" + " or one" * (name == "widths"))
            return None
    if hints.places is not None and len(hints.places) == n:
        points = hints.places
    elif hints.places is not None:
        reading.warn(path, f"has {len(hints.places)} physxParticle:simulationPoints and {n} points: the points count; author "
                     "as many")
    reach = _choose_radius(reading, path, radius, widths, hints)
    if reach is None:
        reading.fail(path, "has neither widths nor wsim:particles:radius; author the diameters of its particles as widths")
        return None
    motion = read_placement(reading, prim).motion
    scale = float(np.cbrt(abs(np.linalg.det(motion.at(0.0)[:3, :3]))))
    if abs(scale - 1.0) > UNLIKE:
        reading.warn(path, f"its transform scales by {scale:.3g}, and the radii of its particles are not scaled; scale its "
                     "points and widths themselves")
    return Particles(path, np.zeros((0, 3), np.float32) if points is None else points, reach, material, motion, velocities,
                     _read_colors(reading, prim, n), None,
                     velocity if velocity is not None and np.any(velocity) and velocities is None else None)


def _choose_radius(reading: StageReading, path: str, radius: float | None, widths: np.ndarray | None, hints: PhysxHints) -> Any:
    """Radii of Points [m]: by wsim:particles:radius where there are no widths, and by PhysX's rest offset before widths, which
    PhysX only draws. None where nothing says one."""
    own: Any = radius if widths is None else 0.5 * widths
    if hints.radius is None or (radius is not None and widths is None):
        return hints.fallback if own is None else own
    if widths is not None and np.any(np.abs(0.5 * widths / hints.radius - 1.0) > UNLIKE):
        reading.warn(path, f"its widths are {2.0 * float(np.mean(own)):.3g} m on average, and PhysX's particles rest "
                     f"{2.0 * hints.radius:.3g} m apart: that counts; author widths of that size, or no rest offset")
    return hints.radius


def _read_colors(reading: StageReading, prim: Usd.Prim, count: int) -> np.ndarray | None:
    """Linear displayColor of the particles, (3,) or (count, 3); None where there is none."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor")
    values = np.array((primvar.ComputeFlattened(reading.start) if primvar and primvar.HasValue() else None) or [], np.float64)
    return None if len(values) == 0 else values if len(values) == count > 1 else values.mean(axis=0)


def _read_material(reading: StageReading, prim: Usd.Prim, name: str, hints: PhysxHints) -> Any:
    """The material that attributes wsim:particles: say; where they say nothing, hints, then a bound PhysicsMaterialAPI. None if
    they name none that there is (reported)."""
    if name not in MATERIALS:
        reading.fail(prim.GetPath(), f"wsim:particles:material is '{name}'; allowed is one of {', '.join(MATERIALS)}; author "
                     "one of these")
        return None
    kind: Any = MATERIALS[name]
    values = {f.name: read_attribute(prim, "Particles", f.name, reading.units) for f in fields(kind)}
    points = UsdGeom.Points(prim).GetPointsAttr().Get(reading.start) if prim.IsA(UsdGeom.Points) else None
    density = hints.density_of(hints.radius or hints.fallback or 0.0, len(points) if points else 0)
    for key, hint in (("density", density), ("static_friction", hints.friction), ("dynamic_friction", hints.friction),
                      ("surface_tension", hints.tension)):
        if values.get(key, 0.0) is None:
            values[key] = hint
    bound = bound_physics_material(reading, prim)
    for key in ("density", *FRICTION) if bound else ():
        if values.get(key, 0.0) is None:
            found = read_attribute(bound, "Friction", key, reading.units)
            values[key] = None if key == "density" and found == 0.0 else found     # 0 says nothing there, as in UsdPhysics
    return kind(**{key: value for key, value in values.items() if value is not None})


def author(stage: Usd.Stage, thing: Particles, units: StageUnits, frames: int = 0) -> None:
    """Writes particles as Points, or the shape that they fill or come from."""
    if thing.shape is None:
        prim = _author_points(stage, thing, units, frames)
    else:
        prim = author_source_shape(stage, thing, units)
        UsdGeom.Imageable(prim).CreatePurposeAttr(UsdGeom.Tokens.guide)       # its particles are drawn, not the shape
        prim.AddAppliedSchema(names.WSIM_PARTICLES)
        write_value(prim, "Particles", "radius", float(thing.radius[0]), units)
        if thing.velocity is not None:
            write_value(prim, "Particles", "velocity", thing.velocity, units)
    if thing.pour:
        times = units.code(thing.pour.start), units.code(thing.pour.end)
        for name, value in zip(POURS, (*times, thing.pour.rate), strict=True):
            if value not in (None, inf):
                write_value(prim, "Particles", name, value, units)
    if thing.colors is not None:
        kind = UsdGeom.Tokens.constant if np.ndim(thing.colors) == 1 else UsdGeom.Tokens.vertex
        UsdGeom.PrimvarsAPI(prim).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, kind).Set(
            Vt.Vec3fArray.FromNumpy(np.asarray(thing.colors, np.float32).reshape(-1, 3)))
    name = next(key for key, kind in MATERIALS.items() if type(thing.material) is kind)
    write_value(prim, "Particles", "material", name, units)
    plain = MATERIALS[name]()
    for f in fields(plain):
        if getattr(thing.material, f.name) != getattr(plain, f.name):
            write_value(prim, "Particles", f.name, getattr(thing.material, f.name), units)


def _author_points(stage: Usd.Stage, thing: Particles, units: StageUnits, frames: int) -> Usd.Prim:
    points = UsdGeom.Points.Define(stage, thing.path)
    prim = points.GetPrim()
    prim.AddAppliedSchema(names.WSIM_PARTICLES)
    write_value(prim, "Particles", "points", thing.points, units)
    points.CreateWidthsAttr(to_usd_array(2.0 * thing.radius, "float[]", units.metres))
    points.SetWidthsInterpolation(UsdGeom.Tokens.constant if len(thing.radius) == 1 else UsdGeom.Tokens.vertex)
    points.CreateExtentAttr(UsdGeom.Points.ComputeExtent(points.GetPointsAttr().Get(), points.GetWidthsAttr().Get()))
    if thing.velocities is not None:
        write_value(prim, "Particles", "velocities", thing.velocities, units)
    author_motion(prim, thing.motion, units, frames)
    return prim
