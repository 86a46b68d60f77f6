"""BasisCurves with PhysicsCurvesDeformableSimAPI <-> `Rods`.

Linear curves, of open ends or periodic, which are closed rods; normals are directors of the edges behind points, thicknesses
are diameters. Stiffnesses that the material does not author follow from Young's modulus, Poisson's ratio and the diameter: E A,
E I, G J. Shear is rigid. Mass: masses of points or segments, else the body's mass or density, else the material's density.
"""

import math

import numpy as np
from pxr import Usd, UsdGeom

from wsim.physics.rods.objects import Rods, segment_ends
from wsim.usd import names
from wsim.usd.attributes import author_attribute as write
from wsim.usd.attributes import read_attribute
from wsim.usd.load_varying import check_topology
from wsim.usd.prims.cloth import load_points
from wsim.usd.prims.fabric import (
    UNAUTHORED,
    author_friction,
    bind_physics_material,
    bound_physics_material,
    is_physical,
    load_friction,
)
from wsim.usd.prims.pins import author_pin
from wsim.usd.stage import StageReading, StageUnits
from wsim.usd.transforms import author_motion, read_placement

STIFF = ("stretch", "bend", "twist")
OWN = ("self_collision", "drag", "skin_drag")           # of WsimRodsAPI


def simulates(prim: Usd.Prim) -> bool:
    """True if curves are read as rods."""
    return bool(UsdGeom.BasisCurves(prim))


def load_rods(reading: StageReading, prim: Usd.Prim, body: Usd.Prim) -> Rods | None:
    """The rods of a BasisCurves prim; None if it cannot be read (which is reported)."""
    path, units = prim.GetPath(), reading.units
    if UsdGeom.BasisCurves(prim).GetTypeAttr().Get() != UsdGeom.Tokens.linear:
        reading.fail(path, f"is a {UsdGeom.BasisCurves(prim).GetTypeAttr().Get()} BasisCurves; only type = linear can be "
                     "simulated")
        return None
    if not check_topology(reading, prim, "curveVertexCounts"):
        return None
    points, rest = load_points(reading, prim, "Rods")
    counts = read_attribute(prim, "Rods", "counts", units, reading.start)
    if points is None or counts is None or counts.sum() != len(points) or counts.min(initial=2) < 2:
        reading.fail(path, f"has {0 if points is None else len(points)} points and curveVertexCounts that sum to "
                     f"{0 if counts is None else counts.sum()}; the two must agree, with 2 or more vertices a curve")
        return None
    given = read_attribute(prim, "Rods", "rest_points", units)
    rods = Rods(str(path), points, counts, rest_points=rest if given is None else given,
                motion=read_placement(reading, prim).motion,
                closed=UsdGeom.BasisCurves(prim).GetWrapAttr().Get() == UsdGeom.Tokens.periodic)
    for field in ("velocities", "directors", "rest_directors"):
        value = read_attribute(prim, "Rods", field, units, reading.start)
        if value is not None and len(value) != len(points):
            reading.fail(path, f"{names.attribute_entry('Rods', field).attribute} has {len(value)} values; allowed is "
                               f"{len(points)} (one a "
                         "point)")
        elif value is not None:
            setattr(rods, field, value)
    rods.diameters = _read_point_values(reading, prim, "diameters", rods, names.THICKNESS)
    _warn_widths_unused(reading, prim)
    _read_rod_material(reading, prim, rods)
    rods.masses = _read_rod_masses(reading, prim, body, rods)
    rods.static_friction, rods.dynamic_friction = load_friction(reading, prim)
    for field in OWN:
        if (value := read_attribute(prim, "Rods", field, units)) is not None:
            setattr(rods, field, value)
    return rods


def _warn_widths_unused(reading: StageReading, prim: Usd.Prim) -> None:
    """Warns of widths that say another diameter than the fallback, where no thicknesses are authored."""
    widths = UsdGeom.BasisCurves(prim).GetWidthsAttr().Get(reading.start)
    if not widths or read_attribute(prim, "Rods", "diameters", reading.units) is not None:
        return
    largest, name = float(np.max(widths)) * reading.units.metres, names.attribute_entry("Rods", "diameters").attribute
    if abs(largest - names.THICKNESS) > 1e-3 * names.THICKNESS:
        reading.warn(prim.GetPath(), f"widths of up to {largest:.3g} m are only seen: {name} is not authored, and strands are "
                     f"{names.THICKNESS:g} m thick; author it, in units of the stage")


def _read_point_values(reading: StageReading, prim: Usd.Prim, field: str, rods: Rods, fallback: float) -> np.ndarray:
    """Values of points, (n,) or (1,), of an attribute that gives them to all, curves, segments or points."""
    counts, segments = rods.counts, segment_ends(rods)
    n, values = int(counts.sum()), read_attribute(prim, "Rods", field, reading.units)
    if values is None or len(values) == 0:
        return np.array([fallback])
    name = names.attribute_entry("Rods", field).attribute
    if not (np.isfinite(values) & (values > 0)).all():
        reading.fail(prim.GetPath(), f"{name} holds {values.min():g}; allowed are finite numbers > 0")
        return np.array([fallback])
    sizes = {"constant": 1, "point": n, "curve": len(counts), "segment": len(segments)}
    kind = prim.GetAttribute(f"{name}:elementType").Get() or next((k for k, m in sizes.items() if m == len(values)), "")
    if sizes.get(kind) != len(values):
        of = f" of elementType {kind!r}" if kind else ""
        reading.fail(prim.GetPath(), f"{name} has {len(values)} values{of}; allowed are "
                     + ", ".join(f"{m} for {k!r}" for k, m in sizes.items()) + ": author it again")
        return np.array([fallback])
    if kind == "curve":
        return np.repeat(values, counts)
    if kind == "segment":                                    # a point has the mean of its own
        return _sum_segments_at_points(values, segments, n) / _sum_segments_at_points(np.ones(len(values)), segments, n)
    return values


def _sum_segments_at_points(values: np.ndarray, segments: np.ndarray, n: int) -> np.ndarray:
    """Sum at each of n points of the values of its one or two segments."""
    return np.bincount(segments[:, 0], values, n) + np.bincount(segments[:, 1], values, n)


def _read_rod_material(reading: StageReading, prim: Usd.Prim, rods: Rods) -> None:
    """Elastic constants and density; fallbacks of the proposal where nothing says them."""
    rods.young, rods.poisson, rods.density = names.YOUNGS_MODULUS, names.POISSONS_RATIO, names.DENSITY
    material = bound_physics_material(reading, prim)
    if material is None or not is_physical(material):
        reading.warn(prim.GetPath(), f"no physics material is bound: the fallbacks of {names.CURVES_MATERIAL} count (E = "
                     f"{names.YOUNGS_MODULUS:g} Pa, density {names.DENSITY:g} kg/m^3); bind one by material:binding:physics")
        return
    for field in ("young", "poisson", *STIFF):
        value = read_attribute(material, "RodMaterial", field, reading.units)
        if value not in UNAUTHORED:
            setattr(rods, field, value)
    if (damping := read_attribute(material, "RodMaterial", "damping", reading.units)) is not None:
        rods.damping = damping
    density = read_attribute(material, "Friction", "density", reading.units)
    if density not in (*UNAUTHORED, 0.0):
        rods.density = density


def _read_rod_masses(reading: StageReading, prim: Usd.Prim, body: Usd.Prim, rods: Rods) -> np.ndarray | None:
    """[kg] of each point; None: from the density, into which a density of the body goes."""
    segments, n = segment_ends(rods), len(rods.points)
    values = read_attribute(prim, "Rods", "masses", reading.units)
    if values is not None and len(values) == n:
        return values
    if values is not None and len(values) == len(segments):
        return 0.5 * _sum_segments_at_points(values.astype(np.float64), segments, n)
    if values is not None and len(values) > 1:
        reading.fail(prim.GetPath(), f"physics:masses has {len(values)} values; allowed is 1, {len(segments)} (segments) "
                     f"or {n} (points)")
        return None
    total = float(values[0]) if values is not None and len(values) else read_attribute(body, "Body", "mass", reading.units)
    density = read_attribute(body, "Body", "density", reading.units)
    if density:
        rods.density = density
    if total and math.isfinite(total):
        world = rods.motion.points(rods.points if rods.rest_points is None else rods.rest_points, 0.0)
        first, second = segments.T
        d = np.broadcast_to(rods.diameters, n)
        of = 0.25 * np.pi * (0.5 * (d[first] + d[second]))**2 * np.linalg.norm(world[second] - world[first], axis=1)
        return 0.5 * _sum_segments_at_points(of * (total / of.sum()), segments, n)
    return None


def author(stage: Usd.Stage, rods: Rods, units: StageUnits) -> None:
    """Defines the BasisCurves of rods, their material and their pins."""
    curves = UsdGeom.BasisCurves.Define(stage, rods.path)
    prim = curves.GetPrim()
    curves.CreateTypeAttr(UsdGeom.Tokens.linear)
    if rods.closed:
        curves.CreateWrapAttr(UsdGeom.Tokens.periodic)
    for schema in (names.BODY, names.CURVES_SIM):
        prim.AddAppliedSchema(schema)
    for field in ("points", "counts", "velocities", "rest_points", "directors", "rest_directors", "diameters", "masses"):
        if (value := getattr(rods, field)) is not None:
            write(prim, "Rods", field, value, units)
    own = {field: value for field in OWN if (value := getattr(rods, field))}
    if own:
        prim.AddAppliedSchema(names.WSIM_RODS)
    for field, value in own.items():
        write(prim, "Rods", field, value, units)
    d = np.asarray(rods.diameters, np.float64)
    curves.CreateWidthsAttr((d / units.metres).astype(np.float32).tolist())
    curves.SetWidthsInterpolation(UsdGeom.Tokens.constant if len(d) == 1 else UsdGeom.Tokens.vertex)
    curves.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(curves.GetPointsAttr().Get()))
    author_motion(prim, rods.motion, units, 0)
    material = author_friction(stage, f"{rods.path}_material", (rods.static_friction, rods.dynamic_friction), units)
    material.AddAppliedSchema(names.CURVES_MATERIAL)
    write(material, "Friction", "density", rods.density, units)
    for field in ("young", "poisson", *STIFF):
        if (value := getattr(rods, field)) is not None:
            write(material, "RodMaterial", field, value, units)
    if rods.damping:
        material.AddAppliedSchema(names.WSIM_MATERIAL)
        write(material, "RodMaterial", "damping", rods.damping, units)
    bind_physics_material(prim, material)
    for pin in rods.pins:
        author_pin(stage, pin, rods, units, 0)
